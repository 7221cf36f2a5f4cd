"""Input shapers: sequences of impulses with which a command is convolved so that flexible modes are left at rest."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arguments import instance, one_of, require_text
from invtrack.arrays import Array, real_numbers, require_share
from invtrack.baselines.extra_insensitive import extra_insensitive
from invtrack.baselines.modes import Mode, as_modes
from invtrack.errors import ControlError
from invtrack.references.delayed import SAME_TIME, delayed_sum
from invtrack.references.signal import PiecewiseSignal, require_signal

Kind = Literal["ZV", "ZVD", "ZVDD", "EI", "two-hump EI"]

ORDERS = {"ZV": 1, "ZVD": 2, "ZVDD": 3}
"""How often each of these shapers is a ZV shaper after itself."""

SUM_TOLERANCE = 1e-12
"""By how much amplitudes may miss the sum 1."""

MOST_IMPULSES = 1024
"""Impulses of a cascade at most."""


@dataclass(frozen=True, eq=False, init=False)
class Shaper:
    """Impulses at times t_i with amplitudes A_i that add up to one: it makes sum of A_i c(t - t_i) of a command c.

    Args:
        times: (k,) [s], increasing, the first one 0.
        amplitudes: (k,); they may be negative.
        kind: its name.
        modes: those that it was made for; none where it was not made for any.

    Raises ControlError where these do not fit.
    """

    times: Array
    amplitudes: Array
    kind: str
    modes: tuple[Mode, ...]

    def __init__(
        self, times: ArrayLike, amplitudes: ArrayLike, kind: str = "shaper", modes: Sequence[tuple[float, float]] = ()
    ) -> None:
        times, amplitudes = (
            real_numbers("times", times, error=ControlError),
            real_numbers("amplitudes", amplitudes, error=ControlError),
        )
        if times.ndim != 1 or not len(times) or times.shape != amplitudes.shape:
            raise ControlError(f"expected as many times (k,) as amplitudes (k,), got shapes {times.shape} and {amplitudes.shape}")
        if times[0] != 0 or not np.all(np.isfinite(times)) or np.any(np.diff(times) <= 0):
            raise ControlError(f"times of impulses must be finite and increase from 0 on, got {times.tolist()}")
        if not np.all(np.isfinite(amplitudes)) or abs(np.sum(amplitudes) - 1) > SUM_TOLERANCE * np.sum(np.abs(amplitudes)):
            raise ControlError(f"amplitudes of impulses must add up to 1, got {amplitudes.tolist()}")
        for value in (times, amplitudes):
            value.setflags(write=False)
        made_for, kind = as_modes(modes), require_text("kind", kind, error=ControlError)
        for name, entry in {"times": times, "amplitudes": amplitudes, "kind": kind, "modes": made_for}.items():
            object.__setattr__(self, name, entry)

    @property
    def duration(self) -> float:
        """By how much longer the shaped command takes [s]."""
        return float(self.times[-1])

    def shaped(self, reference: PiecewiseSignal) -> PiecewiseSignal:
        """The reference convolved with the impulses, exactly; it ends `duration` later.

        Raises TrajectoryError for what is no signal.
        """
        return delayed_sum(require_signal("reference", reference), self.amplitudes, self.times)

    def after(self, other: Shaper) -> Shaper:
        """The convolution of both, which leaves at rest what either of them does.

        Raises ControlError for what is no shaper, and where that makes more than 1024 impulses.
        """
        instance("other", other, Shaper, expected='a Shaper, such as shaper("ZV", modes)', error=ControlError)
        if len(self.times) * len(other.times) > MOST_IMPULSES:
            raise ControlError(
                f"{len(self.times)} impulses after {len(other.times)} make more than {MOST_IMPULSES}; shape for fewer modes, or "
                "with a kind that has fewer impulses"
            )
        times = np.add.outer(self.times, other.times).ravel()
        order = np.argsort(times, kind="stable")
        times = times[order]
        first = np.flatnonzero(np.diff(times, prepend=-np.inf) > SAME_TIME * np.spacing(times))  # of those at one time
        products: Array = np.multiply.outer(self.amplitudes, other.amplitudes).ravel()[order]
        amplitudes = np.add.reduceat(products, first)
        kind = self.kind if self.kind == other.kind else f"{self.kind} after {other.kind}"
        return Shaper(times[first], amplitudes, kind, (*other.modes, *self.modes))


def shaper(kind: Kind, modes: Sequence[tuple[float, float]], *, tolerance: float = 0.05) -> Shaper:
    """The input shaper of a kind for each of the modes, one after the other.

    | kind | leaves | lasts, undamped |
    |---|---|---|
    | ZV | nothing at the modelled frequency | half a period |
    | ZVD, ZVDD | nothing there, nor in the first (and second) derivative by frequency | 1, 3/2 periods |
    | EI | `tolerance` at the modelled frequency, nothing at one below and one above | 1 period |
    | two-hump EI | nothing there and at one below and one above, up to `tolerance` between | 3/2 periods |

    With K = exp(-damping pi / sqrt(1 - damping^2)) and the damped period T, ZV has the amplitudes 1 / (1 + K), K / (1 + K) at 0 and
    T / 2; ZVD and ZVDD are ZV convolved with itself. EI shapers are solved for numerically, damping included. What they leave is
    residual vibration, as `residual_vibration_ratio` has it.

    Args:
        kind: "ZV", "ZVD", "ZVDD", "EI" or "two-hump EI".
        modes: pairs (natural frequency [rad/s], damping ratio), such as `flexible_modes` finds.
        tolerance: residual vibration that EI shapers allow, between 0 and 1.

    Raises ControlError for another kind, modes or tolerance out of range, and EI shapers that there are none of. Sources: N.
    Singer, W. Seering, "Preshaping command inputs to reduce system vibration", ASME Journal of Dynamic Systems, Measurement, and
    Control 112(1), 1990; for EI see `invtrack.baselines.extra_insensitive`.
    """
    one_of("kind", kind, get_args(Kind), error=ControlError)
    require_share("tolerance", tolerance, error=ControlError)
    single = [_for_mode(kind, mode, float(tolerance)) for mode in as_modes(modes)]
    if not single:
        raise ControlError("expected at least one mode (frequency [rad/s], damping ratio) to shape the command for, got none")
    return reduce(lambda earlier, later: later.after(earlier), single)


def _for_mode(kind: Kind, mode: Mode, tolerance: float) -> Shaper:
    if kind in ORDERS:
        order, half = ORDERS[kind], mode.damped_period / 2
        K = math.exp(-mode.damping * mode.frequency * half)
        amplitudes: Array = np.array([math.comb(order, i) * K**i for i in range(order + 1)]) / (1 + K) ** order
        return Shaper(half * np.arange(float(order + 1)), amplitudes, kind, (mode,))
    found, times = extra_insensitive(1 if kind == "EI" else 2, mode.damping, tolerance)
    return Shaper(np.array(times) / mode.frequency, np.array(found), kind, (mode,))
