"""A plan within limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from invtrack.plans.plan import Plan
from invtrack.redesign.limited.active_limits import ActiveLimit
from invtrack.redesign.limited.optimality import Optimality
from invtrack.redesign.limits import Bound


@dataclass(frozen=True, eq=False, repr=False)
class ConstrainedTrajectory(Plan):
    """A plan with limits.

    Args:
        limits: all that it has to keep.
        active: those that it touches, when, and what more room there would be worth.
        overshoot: largest excess of any limit anywhere, as a share of the limit's size; zero where all are kept.
        step: longest time over which the input is linear [s]. Zero where no limit is active: the plan is then the optimum without
            limits, in closed form.
        optimality: cost and duality gap, how far from the best plan within the limits it can be; None where no limit is active.
    """

    limits: tuple[Bound, ...] = ()
    active: tuple[ActiveLimit, ...] = ()
    overshoot: float = 0.0
    step: float = 0.0
    optimality: Optimality | None = None

    @property
    def shadow_prices(self) -> dict[str, float]:
        """By how much the cost falls per unit by which each limit is loosened on both of its sides, to first order.

        For a limit that was stated as one number it is minus the derivative of the cost by it; zero for limits that are not active.
        """
        return {limit.name: sum((a.multiplier for a in self.active if a.name == limit.name), start=0.0) for limit in self.limits}

    def __str__(self) -> str:
        """What it is, and a table of its limits: how long each side acts, and what one unit more there would save."""
        head = [repr(self)]
        if self.optimality is not None:
            cost, gap = self.optimality.cost, self.optimality.duality_gap
            head.append(f"cost {cost:.6g}; the best plan within the limits costs less by a share of {gap:.0e} at most")
        rows = [("limit", "unit", "side", "value", "active [s]", "stretches", "cost saved per unit")]
        for limit in self.limits:
            for side, value in (("low", limit.low), ("high", limit.high)):
                if np.isfinite(value):
                    at = f"{value + limit.offset:.6g}"
                    rows.append((limit.name, limit.unit or "-", side, at, *self._activity(limit.name, side)))
        widths = [max(map(len, column)) + 2 for column in zip(*rows, strict=True)]
        lines = ("".join(f"{entry:<{width}}" for entry, width in zip(row, widths, strict=True)).rstrip() for row in rows)
        return "\n".join([*head, *lines])

    def _activity(self, name: str, side: str) -> tuple[str, str, str]:
        """How long a side of a limit acts, in how many stretches, and what one unit more saves, as text."""
        for each in self.active:
            if (each.name, each.side) == (name, side):
                return f"{each.duration:.4g}", str(len(each.stretches)), f"{each.multiplier:.4g}"
        return "0", "0", "0"
