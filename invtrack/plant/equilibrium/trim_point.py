"""The equilibrium that `trim` finds, as data and as a table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from invtrack.layout import aligned
from invtrack.plant.elements import listed
from invtrack.plant.plant import Plant

Kind = Literal["output", "position", "activation", "control"]

COLUMNS = ("", "name", "value", "unit", "")


@dataclass(frozen=True)
class TrimmedQuantity:
    """One number of an equilibrium.

    origin: "given"; "solved"; "held" (the control of an actuator that is no input of the plant); "follows" (an output that was not
    given).
    """

    kind: Kind
    name: str
    unit: str
    value: float
    origin: Literal["given", "solved", "held", "follows"]


@dataclass(frozen=True, eq=False, repr=False)
class TrimPoint:
    """An equilibrium of a plant: at rest, with all accelerations and all rates of activations zero.

    Args:
        plant: the plant with this equilibrium as its operating point.
        parameters: the values of all named parameters for which it is one; `linearize(point.plant, **point.parameters)`.
        quantities: outputs, positions, activations and controls. The position of a slide, of a hinge or of the place of a free
            joint is that in qpos; rotations of ball and free joints are vectors [rad] from the orientation before.
        residual: what is left, as rates of all velocities and activations by their names, in SI units.
        scaled_residual: the largest that is left, the given outputs included, relative to the accelerations that all single forces
            together would make and to the motion of an output over the size of the mechanism.
        evaluations: how often the search evaluated the equations.
        open_directions: in how many directions the equilibrium could be moved with all that is given as it is. Of these equilibria
            this is the one nearest to the plant's operating point, in posture first, then in its controls.
        held_by: contacts and limits of joints and tendons that bear load there; `linearize` refuses those.
        at_limits: names of the controls and activations at an end of their range; `linearize` refuses inputs there.
    """

    plant: Plant
    parameters: Mapping[str, float]
    quantities: tuple[TrimmedQuantity, ...]
    residual: Mapping[str, float]
    scaled_residual: float
    evaluations: int
    open_directions: int
    held_by: tuple[str, ...]
    at_limits: tuple[str, ...]

    @property
    def outputs(self) -> dict[str, float]:
        """The plant's outputs, and the measurements that were given, by name."""
        return self._values("output")

    @property
    def positions(self) -> dict[str, float]:
        """The coordinates (nv) by name."""
        return self._values("position")

    @property
    def activations(self) -> dict[str, float]:
        """The activations (na) by name."""
        return self._values("activation")

    @property
    def controls(self) -> dict[str, float]:
        """The controls (nu) of all actuators by name."""
        return self._values("control")

    @property
    def largest_residual(self) -> float:
        """The largest rate that is left, in SI units: what `linearize` compares with its equilibrium_tolerance."""
        return max(map(abs, self.residual.values()), default=0.0)

    def _values(self, kind: Kind) -> dict[str, float]:
        return {quantity.name: quantity.value for quantity in self.quantities if quantity.kind == kind}

    def _summary(self) -> str:
        solved = sum(quantity.origin == "solved" for quantity in self.quantities)
        return (
            f"equilibrium of {self.plant.name!r}: {solved} solved in {self.evaluations} evaluations, largest rate left"
            f" {self.largest_residual:.1e} (SI), {self.scaled_residual:.1e} of its terms"
        )

    def __repr__(self) -> str:
        """In a line: how much was solved, and what is left."""
        return f"TrimPoint({self._summary()})"

    def __str__(self) -> str:
        """All quantities in a table, and what a reader has to know of them."""
        rows = [(q.kind, q.name, f"{q.value:.8g}", q.unit, q.origin) for q in self.quantities]
        lines = [self._summary(), *aligned(COLUMNS, rows)]
        if self.open_directions:
            lines.append(f"{self.open_directions} direction(s) left open by what is given; this is the nearest equilibrium")
        if self.held_by:
            lines.append(f"held by {listed(self.held_by)}: there is no linear model about it")
        if self.at_limits:
            lines.append(f"at the end of their range: {listed(self.at_limits)}")
        return "\n".join(lines)
