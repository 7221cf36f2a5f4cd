"""Which points a sweep visits, each with a seed of its own: all combinations, samples of distributions, or a list."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from invtrack.arguments import by_name, items
from invtrack.arrays import Array, shown, whole_number
from invtrack.errors import SweepError

Value = float | int | str | bool
"""What a parameter can be: what has no such value (a method, a plan, a gain matrix) is given a name that the study knows."""

OWN_COLUMNS = ("index", "key", "seed", "status", "reason", "digest", "study")
"""Columns that every row has, whose names no parameter and no number can take."""

LARGEST_SEED = 2**63 - 1
"""What a column of whole numbers holds: with so many, no two of a million seeds that are drawn are likely to be the same."""


@dataclass(frozen=True, eq=False)
class Design:
    """The points of a sweep in their order, and a seed for each.

    All points have the same parameters, and a parameter the same kind of value everywhere: numbers, whole numbers, texts, or True
    and False.

    Raises SweepError for points that differ in their parameters, values of another kind, the same point twice with the same seed.
    """

    points: Sequence[Mapping[str, Value]]
    seeds: Sequence[int]

    def __post_init__(self) -> None:
        points = [_point(point) for point in items("points", self.points, expected="a list of points", error=SweepError)]
        seeds = [
            whole_number("a seed", seed, highest=LARGEST_SEED, error=SweepError)
            for seed in items("seeds", self.seeds, expected="a list of whole numbers", error=SweepError)
        ]
        if not points:
            raise SweepError("expected at least one point, got none")
        if len(points) != len(seeds):
            raise SweepError(f"expected a seed for each of {len(points)} points, got {len(seeds)} seeds")
        for number, point in enumerate(points):
            if point.keys() != points[0].keys():
                raise SweepError(
                    f"point {number} has the parameters {', '.join(point)}, expected those of point 0, {', '.join(points[0])}"
                )
        columns = {name: _alike(name, [point[name] for point in points]) for name in points[0]}
        points = [dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)] if columns else points
        first: dict[Any, int] = {}
        for number, (point, seed) in enumerate(zip(points, seeds, strict=True)):
            before = first.setdefault((*point.values(), seed), number)
            if before != number:
                raise SweepError(
                    f"points {before} and {number} are the same, {point}, with the same seed {seed}; leave one of them out"
                )
        object.__setattr__(self, "points", tuple(points))
        object.__setattr__(self, "seeds", tuple(seeds))

    def __len__(self) -> int:
        return len(self.points)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(self.points[0])

    def column(self, name: str) -> tuple[Value, ...]:
        """The values of one parameter, by point. Raises SweepError where there is none of that name."""
        if name not in self.points[0]:
            raise SweepError(f"no parameter named {name!r}; there are: {', '.join(self.parameters) or 'none'}")
        return tuple(point[name] for point in self.points)

    def crossed_with(self, parameters: Mapping[str, Sequence[Value]]) -> Design:
        """Each point with every combination of further parameters, all of them with the seed of the point.

        Methods or gains are compared on the same samples and the same noise: monte_carlo(...).crossed_with({"method": [...]}).
        Raises SweepError for a parameter that the points already have.
        """
        added = _combinations(parameters)
        taken = sorted(set(self.parameters) & set(added[0]))
        if taken:
            raise SweepError(f"expected further parameters, but the points already have {', '.join(taken)}")
        pairs = [({**point, **more}, seed) for point, seed in zip(self.points, self.seeds, strict=True) for more in added]
        return Design([point for point, _ in pairs], [seed for _, seed in pairs])


def listed(points: Iterable[Mapping[str, Value]], *, seed: int = 0) -> Design:
    """These points, in this order, each with a seed of its own that follows from `seed` and its number."""
    found = items("points", points, expected="a list of points", error=SweepError)
    return Design(found, _seeds(len(found), seed))


def grid(parameters: Mapping[str, Sequence[Value]], *, repeats: int = 1, seed: int = 0) -> Design:
    """Every combination of the values, the last parameter's varying fastest; each `repeats` times, with other seeds.

    The j-th repeat has the same seed at every point (common random numbers): what differs between points is not the noise.
    """
    count = whole_number("repeats", repeats, lowest=1, error=SweepError)
    points = _combinations(parameters)
    return Design([point for point in points for _ in range(count)], [*_seeds(count, seed)] * len(points))


def monte_carlo(parameters: Mapping[str, Any], samples: int, *, seed: int = 0) -> Design:
    """Independent samples of independent parameters.

    parameters: by name, a frozen distribution of scipy.stats (`stats.norm(100.0, 2.0)`), or a list of values that are equally
    likely. The first samples of a longer design with the same seed are those of a shorter one, so a sweep can be extended.
    """
    return _sampled(parameters, samples, lambda n, d: np.random.default_rng(_whole_seed(seed)).random((n, d)), seed)


def latin_hypercube(parameters: Mapping[str, Any], samples: int, *, seed: int = 0) -> Design:
    """As `monte_carlo`, with each parameter's range met evenly: one sample in each of `samples` intervals of equal probability.

    Means of what is nearly additive in the parameters are then much closer with the same number of runs (McKay, Beckman, Conover,
    Technometrics 21, 1979). A longer design is another one.
    """
    from scipy.stats import qmc  # takes half a second, which a worker of a cluster need not spend

    return _sampled(parameters, samples, lambda n, d: np.asarray(qmc.LatinHypercube(d, rng=_whole_seed(seed)).random(n)), seed)


def _sampled(parameters: Mapping[str, Any], samples: int, uniform: Callable[[int, int], Array], seed: int) -> Design:
    """Values at which the parameters' distribution functions take uniform values (samples, parameters)."""
    count = whole_number("samples", samples, lowest=1, error=SweepError)
    expected = "distributions or lists of values by the names of parameters"
    given = by_name("parameters", parameters, expected=expected, error=SweepError)
    if not given:
        raise SweepError("expected at least one parameter to sample, got none")
    # A uniform value of exactly 0 lies at minus infinity of a normal distribution.
    shares = np.clip(uniform(count, len(given)), 2.0**-54, 1 - 2.0**-53)
    columns = [_quantiles(name, source, share) for (name, source), share in zip(given.items(), shares.T, strict=True)]
    return Design([dict(zip(given, values, strict=True)) for values in zip(*columns, strict=True)], _seeds(count, seed))


def _quantiles(name: str, source: Any, share: Array) -> list[Value]:
    quantile = getattr(source, "ppf", None)
    if quantile is None:
        choices = items(
            f"parameter {name!r}", source, expected="a frozen distribution of scipy.stats or a list of values", error=SweepError
        )
        if not choices:
            raise SweepError(f"parameter {name!r} has no values to choose from")
        return [choices[int(u * len(choices))] for u in share]
    try:
        values = np.asarray(quantile(share), dtype=float)
    except TypeError as reason:
        raise SweepError(
            f"parameter {name!r} must be a frozen distribution such as stats.norm(0.0, 1.0), got {shown(source)}: {reason}"
        ) from reason
    if values.shape != share.shape or not np.all(np.isfinite(values)):
        raise SweepError(
            f"parameter {name!r} must be a distribution of one finite number, {shown(source)} gives others; check its arguments"
        )
    discrete = hasattr(source, "dist") and hasattr(source.dist, "pmf")
    return [int(value) if discrete else float(value) for value in values]


def _combinations(parameters: Mapping[str, Sequence[Value]]) -> list[dict[str, Value]]:
    given = by_name("parameters", parameters, expected="lists of values by the names of parameters", error=SweepError)
    columns = [
        items(f"parameter {name!r}", values, expected="a list of values", error=SweepError) for name, values in given.items()
    ]
    for name, values in zip(given, columns, strict=True):
        if not values:
            raise SweepError(f"parameter {name!r} has no values; give it at least one, or leave it out")
    return [dict(zip(given, values, strict=True)) for values in product(*columns)]


def _whole_seed(seed: int) -> int:
    return whole_number("seed", seed, error=SweepError)


def _seeds(count: int, seed: int) -> list[int]:
    """A seed for each number from 0 to count - 1, the same ones for any count."""
    # A stream of its own, apart from that of the samples; raw bits are the same in every version of numpy.
    bits = np.random.PCG64(np.random.SeedSequence(_whole_seed(seed), spawn_key=(1,))).random_raw(count)
    return [int(drawn) & LARGEST_SEED for drawn in bits]


def _point(point: object) -> dict[str, Any]:
    found = dict(by_name("a point", point, expected="values by the names of parameters", error=SweepError))
    taken = [name for name in found if name in OWN_COLUMNS or not name]
    if taken:
        raise SweepError(f"a parameter cannot be called {taken[0]!r}; every row has {', '.join(OWN_COLUMNS)} of its own")
    return found


def _alike(name: str, values: Sequence[Any]) -> list[Value]:
    """The values of one parameter as one kind; whole numbers among numbers become numbers."""
    expected = f"parameter {name!r}: expected numbers, texts, or True and False, of one kind at all points"
    plain: list[Any] = [value.item() if isinstance(value, np.generic) else value for value in values]
    for value in plain:
        if not isinstance(value, (bool, int, float, str)) or (isinstance(value, float) and math.isnan(value)):
            raise SweepError(f"{expected}, got {shown(value)}; name what is none of these, and let the study look it up")
    kinds = {type(value) for value in plain}
    if kinds == {int, float}:
        return [float(value) for value in plain]
    if len(kinds) > 1:
        raise SweepError(f"{expected}, got {' and '.join(sorted(kind.__name__ for kind in kinds))}")
    if kinds == {int} and max(map(abs, plain)) >= 2**63:
        raise SweepError(f"parameter {name!r}: expected whole numbers of at most 64 bits, got {shown(max(plain, key=abs))}")
    return plain
