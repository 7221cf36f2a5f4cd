"""Random plants with more inputs than outputs, each with a weight of its inputs and a reference that is smooth enough for it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from invtrack.arrays import Array
from invtrack.linear.state_space import StateSpace
from invtrack.references.profiles import rest_to_rest
from invtrack.references.signal import PiecewiseSignal
from tests.random_draws.plants import CHANNEL_SCALE, FAMILIES, STATE_SCALE, Matrices, Units


@dataclass(frozen=True, eq=False)
class DrawnWidePlant:
    """A plant, the units in which invtrack gets it, a reference from rest to rest in these units, and how dear inputs are.

    weight, R: positive definite (m, m), the same one in the units of `unit` and in those of `model`.
    """

    family: str
    unit: Matrices
    units: Units
    model: StateSpace
    reference: PiecewiseSignal
    weight: Array
    R: Array


def drawn_wide_plant(seed: int, number: int) -> DrawnWidePlant:
    """The plant of this number in the sequence that `seed` starts."""
    rng = np.random.default_rng([seed, 1, number])
    families, kinds = list(FAMILIES), list(SURPLUS)
    family = families[int(rng.choice(len(families), p=[FAMILIES[name][1] for name in families]))]
    kind = kinds[int(rng.integers(len(kinds)))]
    square, order = FAMILIES[family][0](rng)
    unit = SURPLUS[kind](rng, square)
    n, p, m = len(unit.A), unit.p, unit.B.shape[1]
    units = Units(
        np.exp2(rng.integers(-STATE_SCALE, STATE_SCALE + 1, n)),
        np.exp2(rng.integers(-CHANNEL_SCALE, CHANNEL_SCALE + 1, m)),
        np.exp2(rng.integers(-CHANNEL_SCALE, CHANNEL_SCALE + 1, p)),
    )
    root = rng.normal(size=(m, m))
    weight = root @ root.T + 0.1 * np.eye(m) if rng.random() < 0.5 else np.diag(10 ** rng.uniform(-1.0, 1.0, m))
    target = rng.normal(size=p) * (rng.random(p) < 0.7)
    target[rng.integers(p)] = 1.0
    reference = rest_to_rest(np.zeros(p), target * units.y, float(rng.uniform(1.0, 5.0)), smoothness=order)
    R = weight / units.u / units.u[:, None]
    return DrawnWidePlant(f"{family}, {kind}", unit, units, units.model(unit), reference, weight, R)


def with_fewer_outputs(rng: np.random.Generator, square: Matrices) -> Matrices:
    """Some of the outputs, of a plant with several: what made the others move is left over."""
    if square.p == 1:
        return with_further_inputs(rng, square)
    kept = np.sort(rng.permutation(square.p)[: int(rng.integers(1, square.p))])
    return replace(square, C=square.C[kept], D=square.D[kept])


def with_alike_inputs(rng: np.random.Generator, square: Matrices) -> Matrices:
    """Each of the inputs is a mixture of more of them, which leaves every zero where it is."""
    mixing = rng.normal(size=(square.p, square.p + int(rng.integers(1, 3))))
    return replace(square, B=square.B @ mixing, D=square.D @ mixing)


def with_further_inputs(rng: np.random.Generator, square: Matrices) -> Matrices:
    """One input or two more, that push every state."""
    more = int(rng.integers(1, 3))
    direct = rng.normal(size=(square.p, more)) * (rng.random() < 0.3)
    return replace(square, B=np.hstack([square.B, rng.normal(size=(len(square.A), more))]), D=np.hstack([square.D, direct]))


SURPLUS: dict[str, Callable[[np.random.Generator, Matrices], Matrices]] = {
    "fewer outputs": with_fewer_outputs,
    "inputs alike": with_alike_inputs,
    "further inputs": with_further_inputs,
}
"""How a plant with as many inputs as outputs comes to have more."""
