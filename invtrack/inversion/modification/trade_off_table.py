"""The trade between preactuation and tracking error as data: one point per real part of the zeros moved."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from invtrack.errors import InversionError
from invtrack.lti.zero_dynamics import format_zeros

Array = NDArray[np.float64]


@dataclass(frozen=True)
class TradeOffPoint:
    """One real part [rad/s] for the zeros moved, and what it costs and gains.

    alpha [rad/s]: decay rate of the input before the manoeuvre (infinite: none). preactuation [s]: from when on the input is above
    the trade's level. max_error, error_after: largest predicted |y - y_d| over all of time, and after T_f, of any output as a share
    of its scale. peak_input: largest |u_i| in the inputs' units.
    """

    real_part: float
    alpha: float
    preactuation: float
    max_error: float
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
        titles = ("real part [rad/s]", "alpha [rad/s]", "preactuation [s]", "error [-]", "error after [-]", "peak input")
        rows = [
            tuple(f"{self.column(name)[k]:.4g}" for name in TradeOffPoint.__dataclass_fields__) for k in range(len(self.points))
        ]
        return "\n".join([head, *("".join(f"{entry:<19}" for entry in row).rstrip() for row in (titles, *rows))])
