"""Models of few states in the place of those of many, and what the output loses by that."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invtrack.arrays import Array, ComplexArray, finite_number, real_vector, require_share, whole_number
from invtrack.channels import Channels
from invtrack.errors import ModelError, RelativeDegreeError
from invtrack.layout import aligned
from invtrack.linear.internal_dynamics import format_zeros
from invtrack.linear.oscillation import oscillatory_eigenvalues
from invtrack.linear.state_space import StateSpace
from invtrack.linear.state_units import plant_units
from invtrack.linear.switched import SwitchedSystem
from invtrack.linear.without_hidden_modes import KeptStates
from invtrack.linear.zeros import ZeroReport, zero_report

LOWEST, FREQUENCIES = 1e-3, 200
"""Lowest frequency, as a share of the band, at which responses are looked at, and how many there are between."""

AROUND = np.array([0.0, -0.5, 0.5, -1.0, 1.0, -3.0, 3.0])
"""Further frequencies at each pole of either model: off its own by these multiples of its distance from the axis."""

ENTRIES_AT_ONCE = 200_000
"""Of matrices that are solved together."""

ROUNDING = 10.0
"""Rounding of a projection, in units of n eps times its norm in balanced units."""

UNDAMPED = 1e-11
"""An eigenvalue nearer to the axis than this share of the size of A, in balanced units, is not damped."""

LISTED = 6
"""Columns of a table, or zeros, that a text shows at most."""


@dataclass(frozen=True, eq=False)
class Reduction:
    """A model of fewer states z for one of many states x: x = V z + N u but for what was cut, and z = W x.

    All of them are departures from rest, u too. The directions V are the same in all intervals, so that x is continuous at a switch
    where z is; each has its own W.

    Args:
        method: its name.
        full, reduced: the models of n and k states.
        W: of each interval (k, n), W V = 1.
        V, N: (n, k) and (n, m). N is what the modes that were cut make of a constant input, where the reduced model has that as
            its feedthrough, and zero elsewhere.
        band: up to which frequency [rad/s] the two were compared.
        modes: how many modes were kept besides those at rest (rigid-body modes) or growing; an oscillation is one.
        lost: what inversion of the reduced model loses of the full one's output within the band: the largest |y - y_d| over |y_d|
            of any frequency and interval.
        considered: (modes, lost) of all numbers of modes that were tried, the chosen one last.
    """

    method: str
    full: SwitchedSystem
    reduced: SwitchedSystem
    W: tuple[Array, ...]
    V: Array
    N: Array
    band: float
    modes: int
    lost: float
    considered: tuple[tuple[int, float], ...]

    @property
    def n_states(self) -> int:
        """Number of states k of the reduced model."""
        return self.reduced.n_states

    @cached_property
    def zeros_before(self) -> tuple[ZeroReport, ...]:
        """Zeros and relative degree of the full model in each interval. Raises RelativeDegreeError where it has no inverse."""
        return self.full.map(zero_report)

    @cached_property
    def zeros_after(self) -> tuple[ZeroReport, ...]:
        """Zeros and relative degree of the reduced model in each interval. Raises RelativeDegreeError where it has no inverse."""
        return self.reduced.map(zero_report)

    @cached_property
    def cut_gain(self) -> Array:
        """Largest gain of what was cut, |G - G_r| from each input to each output, within the band (N + 1, p, m)."""
        pairs = zip(self.full.systems, self.reduced.systems, strict=True)
        gains = []
        for full, reduced in pairs:
            w = frequency_grid([full, reduced], self.band)
            gains.append(np.max(np.abs(frequency_response(full, w) - frequency_response(reduced, w)), axis=0))
        return np.array(gains)

    def output_error(self, frequencies: ArrayLike, *, interval: int = 0) -> ComplexArray:
        """What inversion of the reduced model makes of the full one's output: (y - y_d) / y_d, (G - G_r) G_r^-1 (k, p, p).

        Args:
            frequencies: at which (k,) [rad/s], positive.
            interval: of a model that switches, which one is meant.

        Raises ModelError for frequencies that are not positive and an interval that there is none of.
        """
        entries = [f"frequency {i}" for i in range(np.size(np.asarray(frequencies, dtype=object)))]
        w = real_vector("frequencies [rad/s]", frequencies, entries, error=ModelError)
        if not np.all(w > 0):
            raise ModelError(f"frequencies [rad/s] must be positive, got {float(np.min(w)):.6g} among them")
        number = whole_number("interval", interval, highest=len(self.full) - 1, error=ModelError)
        responses = [frequency_response(model.systems[number], w) for model in (self.full, self.reduced)]
        return _relative(*responses)

    def __str__(self) -> str:
        before, after = self.full.n_states, self.reduced.n_states
        tried = [(str(modes), f"{lost:.2g}") for modes, lost in self.considered]
        lines = [
            f"{self.method}: {after} of {before} states, {self.modes} mode(s) besides those at rest",
            f"  lost of the output up to {self.band:.4g} rad/s: {self.lost:.2g} of it (inverse of the reduced model, full model)",
            *aligned(("modes kept", "lost of the output"), tried[-LISTED:]),
        ]
        for k, name in enumerate(["", *(f" from {t:.6g} s on" for t in self.full.switch_times)]):
            gain = float(np.max(self.cut_gain[k]))
            lines.append(f"  gain of what was cut, up to there{name}: {gain:.3g}")
        lines += [f"  {when}: {_zeros_of(reports)}" for when, reports in (("before", self._before), ("after", self._after))]
        return "\n".join(lines)

    def _before(self) -> ZeroReport:
        return self.zeros_before[0]

    def _after(self) -> ZeroReport:
        return self.zeros_after[0]


def _zeros_of(report: Callable[[], ZeroReport]) -> str:
    """Relative degree and slowest zeros as text, or why there are none."""
    try:
        found = report()
    except RelativeDegreeError as reason:
        return f"no inverse ({reason})"
    slow = sorted((zero.value for zero in found.zeros), key=abs)[:LISTED]
    return f"{found.degrees}, {len(found.zeros)} zeros, the slowest {format_zeros(slow) if slow else '(none)'}"


@dataclass(frozen=True, eq=False)
class Projection:
    """States z = W x, x = V z + N u, with the number of modes that they keep besides those at rest; W of each distinct model."""

    W: tuple[Array, ...]
    V: Array
    N: Array
    modes: int

    def of(self, plant: SwitchedSystem) -> SwitchedSystem:
        """A switched model in these states."""
        reduced = [self._of(system, W) for system, W in zip(plant.distinct, self.W, strict=True)]
        return SwitchedSystem([reduced[number] for number in plant.numbers.tolist()], plant.switch_times)

    def _of(self, system: StateSpace, W: Array) -> StateSpace:
        """The model in these states; where N is not zero, with the feedthrough of what is cut.

        Sums over many states cancel, as what an input does to an output's rate does. What rounding of W and V leaves of them is
        among the errors stated.
        """
        names = [f"z{i}" for i in range(1, len(W) + 1)]
        kept = KeptStates(W, self.V, Channels(names, [""] * len(names))).of(system)
        units, rounding = plant_units(system), ROUNDING * system.n_states * np.finfo(float).eps
        rows, columns = np.linalg.norm(W * units, axis=1), np.linalg.norm(self.V / units[:, None], axis=0)
        B, C = np.linalg.norm(system.B / units[:, None], axis=0), np.linalg.norm(system.C * units, axis=1)
        errors = {"B": rounding * np.outer(rows, B), "C": rounding * np.outer(C, columns)}
        kept = replace(
            kept, error_estimates={**kept.error_estimates, **{name: kept.errors(name) + e for name, e in errors.items()}}
        )
        if not np.any(self.N):
            return kept
        measurement = replace(kept.measurement, D=kept.measurement.D + system.measurement.C @ self.N)
        return replace(kept, D=kept.D + system.C @ self.N, measurement=measurement)


def chosen(
    method: str,
    plant: SwitchedSystem,
    candidates: Iterable[Projection],
    *,
    band: float,
    accuracy: float,
    modes: int | None,
) -> Reduction:
    """The reduction by the first projection that loses no more than `accuracy`, or by the one that keeps so many modes.

    Args:
        method: its name.
        plant: the full model.
        candidates: projections that keep more and more modes.
        band: up to which frequency it is to be right [rad/s].
        accuracy: share of the output that may be lost.
        modes: how many modes are to be kept; None: as many as the accuracy needs.

    Raises ModelError where no candidate is good enough.
    """
    w = [frequency_grid([system], band) for system in plant.distinct]
    responses = [frequency_response(system, grid) for system, grid in zip(plant.distinct, w, strict=True)]
    considered: list[tuple[int, float]] = []
    for projection in candidates:
        if modes is not None and projection.modes < modes:
            continue
        reduced = projection.of(plant)
        if _grows(plant, reduced):
            considered.append((projection.modes, np.inf))
            continue
        lost = 0.0
        for full, small, grid, G in zip(plant.distinct, reduced.distinct, w, responses, strict=True):
            more = frequency_grid([small], band)  # where the reduced model's own poles and zeros are
            error = _relative(frequency_response(full, more), frequency_response(small, more))
            lost = max(lost, _share(_relative(G, frequency_response(small, grid))), _share(error))
        considered.append((projection.modes, lost))
        if projection.modes == modes or (modes is None and lost <= accuracy):
            return Reduction(
                method=method,
                full=plant,
                reduced=reduced,
                W=tuple(projection.W[number] for number in plant.numbers.tolist()),
                V=projection.V,
                N=projection.N,
                band=band,
                modes=projection.modes,
                lost=lost,
                considered=tuple(considered),
            )
    tried = ", ".join(f"{lost:.2g} with {number}" for number, lost in considered[-LISTED:])
    wanted = f"{modes} modes" if modes is not None else f"an accuracy of {accuracy:.2g} up to {band:.4g} rad/s"
    raise ModelError(
        f"{method} finds no model in fewer states with {wanted}"
        + (f": lost of the output are {tried} modes" if tried else "")
        + "; take a narrower band or a lower accuracy, or plan on the model as it is"
    )


def require_square(plant: SwitchedSystem, method: str) -> None:
    """Raises ModelError unless there are as many inputs as outputs."""
    if plant.n_inputs != plant.n_outputs:
        raise ModelError(
            f"{method} needs as many inputs as outputs, as what it loses is judged by the inverse; got {plant.n_inputs} and "
            f"{plant.n_outputs}: choose them with StateSpace.with_inputs and with_outputs"
        )


def checked(band: float, accuracy: float, modes: int | None) -> tuple[float, float, int | None]:
    """The options of a reduction. Raises ModelError for what is out of range."""
    limit = finite_number("band", band, unit="rad/s", error=ModelError)
    if limit <= 0:
        raise ModelError(f"band must be a positive frequency [rad/s], got {limit:.6g}")
    require_share("accuracy", accuracy, error=ModelError)
    return limit, float(accuracy), None if modes is None else whole_number("modes", modes, error=ModelError)


def frequency_grid(systems: Sequence[StateSpace], band: float) -> Array:
    """Frequencies (k,) [rad/s] up to `band`: evenly spread, evenly in their logarithm, and close around each pole."""
    poles = np.concatenate([np.linalg.eigvals(system.A) for system in systems])
    width = np.maximum(np.abs(poles.real), np.finfo(float).eps * np.abs(poles))
    near = np.ravel(np.abs(poles.imag)[:, None] + width[:, None] * AROUND)
    w = np.concatenate([np.geomspace(LOWEST * band, band, FREQUENCIES), np.linspace(LOWEST * band, band, FREQUENCIES), near])
    return np.unique(w[(w >= LOWEST * band) & (w <= band)])


def frequency_response(system: StateSpace, w: Array) -> ComplexArray:
    """G(jw) = C (jw - A)^-1 B + D (k, p, m) at the frequencies (k,) [rad/s]; infinite at a pole on the axis."""
    n, result = system.n_states, np.empty((len(w), *system.D.shape), dtype=complex)
    at_once = max(1, ENTRIES_AT_ONCE // n**2)
    for start in range(0, len(w), at_once):
        part = slice(start, start + at_once)
        resolvent = 1j * w[part, None, None] * np.eye(n) - system.A
        try:
            result[part] = system.C @ np.linalg.solve(resolvent, system.B.astype(complex)) + system.D
        except np.linalg.LinAlgError:
            result[part] = [_at_one(matrix, system) for matrix in resolvent]
    return result


def _at_one(resolvent: ComplexArray, system: StateSpace) -> ComplexArray:
    try:
        return np.asarray(system.C @ np.linalg.solve(resolvent, system.B.astype(complex)) + system.D)
    except np.linalg.LinAlgError:
        return np.full(system.D.shape, np.inf, dtype=complex)


def _relative(G: ComplexArray, G_r: ComplexArray) -> ComplexArray:
    """(G - G_r) G_r^-1 (k, p, p); infinite where G_r has no inverse, or either is at a pole."""
    result = np.full(G.shape, np.inf, dtype=complex)
    for k in np.flatnonzero(np.all(np.isfinite(G) & np.isfinite(G_r), axis=(1, 2))).tolist():
        try:
            result[k] = np.linalg.solve(G_r[k].T, (G[k] - G_r[k]).T).T
        except np.linalg.LinAlgError:
            continue
    return result


def _share(errors: ComplexArray) -> float:
    """Largest share of an output that is lost: the largest eigenvalue of the errors' sizes, which no units of outputs change."""
    size = np.abs(errors)
    if not np.all(np.isfinite(size)):
        return float("inf")
    return float(np.max(np.abs(np.linalg.eigvals(size)), initial=0.0))


def _grows(plant: SwitchedSystem, reduced: SwitchedSystem) -> bool:
    """Whether the reduced model has more modes that grow, or stay, than the full one."""
    for full, small in zip(plant.distinct, reduced.distinct, strict=True):
        is_damped = damped(full)
        full_count, small_count = (int(np.sum(~is_damped(np.linalg.eigvals(system.A).astype(complex)))) for system in (full, small))
        if small_count > full_count:
            return True
    return False


def damped(system: StateSpace) -> Callable[[ComplexArray], NDArray[np.bool_]]:
    """Tells of eigenvalues whether they are damped, which those of a rigid body are not, nor those that grow.

    A rigid body's double eigenvalue at zero is moved by an error of A as far as the root of it, though not as far as half of the
    slowest oscillation.
    """
    units = plant_units(system)
    size, errors = (float(np.linalg.norm(M * units / units[:, None], 2)) for M in (system.A, system.errors("A")))
    rounding = UNDAMPED * size
    slowest = np.min(np.abs(oscillatory_eigenvalues(system)), initial=np.inf)
    at_rest = min(np.sqrt(size * (errors + rounding)), slowest / 2)

    def tell(values: ComplexArray) -> NDArray[np.bool_]:
        return np.asarray((values.real < -rounding) & (np.abs(values) > at_rest))

    return tell
