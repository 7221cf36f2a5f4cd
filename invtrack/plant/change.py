"""When the plant's physical parameters really change."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from invtrack.errors import SimulationError


class Change:
    """At `time` [s] the named parameters take new values, as in Change(3.0, tip_mass=100.0); the state is continuous."""

    def __init__(self, time: float, **parameters: float) -> None:
        if not np.isfinite(time):
            raise SimulationError(f"a change needs a finite time, got {time}")
        if not parameters:
            raise SimulationError(
                f"the change at t = {time} s names no parameter; write for instance Change({time}, tip_mass=100.0)"
            )
        self.time = float(time)
        self.parameters = {name: float(value) for name, value in parameters.items()}

    def __repr__(self) -> str:
        return f"Change({self.time}, {', '.join(f'{k}={v}' for k, v in self.parameters.items())})"


def ordered(schedule: Sequence[Change]) -> list[Change]:
    """The changes in the order of their times. Raises SimulationError where two happen at once."""
    strange = [change for change in schedule if not isinstance(change, Change)]
    if strange:
        raise SimulationError(f"the schedule holds {strange[0]!r}; expected changes such as invtrack.Change(3.0, tip_mass=100.0)")
    result = sorted(schedule, key=lambda change: change.time)
    for first, second in itertools.pairwise(result):
        if first.time == second.time:
            raise SimulationError(f"two changes at t = {first.time} s; name all parameters in one Change")
    return result
