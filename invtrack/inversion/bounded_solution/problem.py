"""What an inversion starts from: the internal dynamics of each interval."""

from __future__ import annotations

from invtrack.linear.internal_dynamics import SplitDynamics, split_dynamics
from invtrack.linear.switched import SwitchedSystem


def split_each(plant: SwitchedSystem) -> list[SplitDynamics]:
    """Split internal dynamics of each interval; models that recur are worked out once.

    Zeros on the imaginary axis are refused in the first and the last interval, which have no end; over the others they stay
    bounded.
    """
    known: dict[int, SplitDynamics] = {}
    for system in (plant.systems[0], plant.systems[-1]):
        if id(system) not in known:
            known[id(system)] = split_dynamics(system)
    for system in plant.systems:
        if id(system) not in known:
            known[id(system)] = split_dynamics(system, endless=False)
    return [known[id(system)] for system in plant.systems]
