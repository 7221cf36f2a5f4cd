"""What a controller is to the simulation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from invtrack.signals.nominal import NominalTrajectory

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Instants:
    """The instants of a run at which a controller is asked for its input, known before the run starts.

    time (m,) [s]: when the state is measured; hold (m,) [s]: for how long the input is then held (0 where it is evaluated anew at
    every stage of the integrator); inside (m,) [s]: a time in the open interval between the breakpoints around it, so that nobody
    has to guess which side of a breakpoint an instant belongs to.
    """

    time: Array
    hold: Array
    inside: Array


class Law(Protocol):
    """A controller prepared for the instants of one run; it may hold a state of its own."""

    def update(self, index: int, measurement: Array) -> Array:
        """Input (p,) for instant number `index`, from the plant's state (n,) as deviation from the operating point."""
        ...


class Controller(Protocol):
    """A feedback law around a planned trajectory. The same controller can be used in any number of runs."""

    @property
    def nominal(self) -> NominalTrajectory:
        """The trajectory that it follows: it sets the span of the run and what errors are measured against."""
        ...

    @property
    def breakpoints(self) -> Array:
        """Times [s] at which its input may jump; each becomes a step boundary."""
        ...

    @property
    def stateless(self) -> bool:
        """Whether the input depends on time and measurement alone, so that it may be evaluated at every stage of an integrator."""
        ...

    def begin(self, instants: Instants) -> Law:
        """The law for the instants of one run, everything that can be computed ahead done here."""
        ...
