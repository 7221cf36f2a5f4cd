"""The plan of least cost."""

from __future__ import annotations

from dataclasses import dataclass

from invtrack.plans.plan import Plan


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class OptimalTrajectory(Plan):
    """The plan of least cost, or of least mean cost over several models.

    Args:
        optimality_gap: largest share of its cost by which any other input could cost less, from a bound that the plan's costate
            gives (see `invtrack.redesign.optimality`), worked out from values alone.
        variants: what the input makes of each of several models, the first one among them; none for a single model.
        probabilities: of the variants.
    """

    optimality_gap: float
    variants: tuple[OptimalTrajectory, ...] = ()
    probabilities: tuple[float, ...] = ()

    def __repr__(self) -> str:
        """What it is, without its arrays."""
        others = f", {len(self.variants)} models" if self.variants else ""
        return f"{super().__repr__()[:-1]}, at most {self.optimality_gap:.1e} of its cost above the least{others}>"
