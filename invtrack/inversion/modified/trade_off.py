"""What moving zeros costs in tracking error and gains in preactuation, as a table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from invtrack.arrays import Array
from invtrack.errors import InversionError
from invtrack.layout import aligned
from invtrack.linear.internal_dynamics import format_zeros


@dataclass(frozen=True)
class TradeOffPoint:
    """One real part for the zeros moved, and what it costs and gains.

    Args:
        real_part: of the zeros moved [rad/s].
        alpha: rate at which the input before the manoeuvre decays backward in time [rad/s]; infinite without preactuation.
        preactuation: how long before the manoeuvre the input gets above the level of the trade-off [s].
        max_error: largest predicted |y - y_d| over all of time, of any output as a share of its scale.
        error_bound: what no plan can bring that below which starts from rest `preactuation` before the manoeuvre, however large its
            input (see `error_bound`), or where a Plant's outputs begin to be bent; NaN where none is known.
        error_after: the same after the manoeuvre's end T_f.
        peak_input: largest |u_i|, in the inputs' units.
    """

    real_part: float
    alpha: float
    preactuation: float
    max_error: float
    error_bound: float
    error_after: float
    peak_input: float


@dataclass(frozen=True)
class TradeOff:
    """Preactuation against error for several real parts of the zeros moved; `print` shows a table, `column` gives one quantity.

    level: the share of the peak input at which the preactuation is read. moved: the zeros, where the plant has them.
    """

    points: tuple[TradeOffPoint, ...]
    level: float
    moved: tuple[complex, ...]

    def column(self, name: str) -> Array:
        """One attribute of all points, in their order (m,): "real_part", "preactuation", "max_error", ..."""
        names = tuple(TradeOffPoint.__dataclass_fields__)
        if name not in names:
            raise InversionError(f"no column {name!r}; there are {', '.join(names)}")
        return np.array([getattr(point, name) for point in self.points])

    def __str__(self) -> str:
        head = f"zeros at {format_zeros(self.moved)} moved; preactuation from {100 * self.level:g} % of the peak input on"
        titles = (
            "real part [rad/s]",
            "alpha [rad/s]",
            "preactuation [s]",
            "error [-]",
            "least error [-]",
            "error after [-]",
            "peak input",
        )
        rows = [
            tuple(f"{self.column(name)[k]:.4g}" for name in TradeOffPoint.__dataclass_fields__) for k in range(len(self.points))
        ]
        return "\n".join([head, *aligned(titles, rows)])
