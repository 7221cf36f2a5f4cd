"""What an input shaper leaves of a flexible mode: residual vibration over frequency, and the band in which it is little."""

from __future__ import annotations

import math

import numpy as np
import scipy  # loads scipy.optimize at its first use
from numpy.typing import ArrayLike

from invtrack.arguments import instance
from invtrack.arrays import Array, real_numbers, require_share
from invtrack.baselines.modes import as_modes
from invtrack.baselines.shaper import Shaper
from invtrack.errors import ControlError

PER_TURN = 64
"""Frequencies per turn of the last impulse's phase at which the vibration is looked at."""

REACH = 8.0
"""How far above a mode's frequency the edge of its band is looked for, as a multiple of it."""

ON_LEVEL = 1e-9
"""Vibration that is above the level by this share of it is rounding: EI shapers touch their tolerance."""


def residual_vibration_ratio(shaper: Shaper, frequency: ArrayLike, damping: ArrayLike = 0.0) -> Array:
    """Vibration of a mode after the last impulse, as a share of that of a single impulse of size 1 at the time 0.

    V = exp(-zeta w t_n) sqrt(C^2 + S^2), C and S the sums over the impulses of A_i exp(zeta w t_i) cos(w_d t_i), and sin, with
    w_d = w sqrt(1 - zeta^2) and t_n the time of the last one: of amplitudes, the one at t_n over the one at 0.

    Args:
        shaper: the shaper.
        frequency: natural frequencies w of the real mode [rad/s], of any shape.
        damping: its damping ratio zeta, from 0 to below 1, of a shape that broadcasts with it.

    Raises ControlError for frequencies that are negative, damping ratios out of range, and shapes that do not fit. Source: N.
    Singer, W. Seering 1990, eq. 8.
    """
    _require_shaper(shaper)
    w, zeta = real_numbers("frequency", frequency, error=ControlError), real_numbers("damping", damping, error=ControlError)
    if not (np.all((w >= 0) & (w < np.inf)) and np.all((zeta >= 0) & (zeta < 1))):
        raise ControlError("expected finite frequencies [rad/s] that are not negative, and damping ratios from 0 to below 1")
    try:
        w, zeta = np.broadcast_arrays(w, zeta)
    except ValueError as error:
        raise ControlError(f"frequency and damping have shapes {w.shape} and {zeta.shape}, which do not broadcast") from error
    rate = (zeta + 1j * np.sqrt((1 - zeta) * (1 + zeta))) * w
    since_last = shaper.times - shaper.times[-1]  # not positive, so that no exponential overflows
    return np.asarray(np.abs(np.exp(np.multiply.outer(rate, since_last)) @ shaper.amplitudes))


def insensitivity(shaper: Shaper, mode: tuple[float, float], *, level: float = 0.05) -> float:
    """Width of the band of frequencies around a mode's in which no more than `level` is left, as a share of the mode's frequency.

    0 where more is left at the mode's own frequency, infinite where the band has no upper edge up to eight times that. The damping
    ratio stays that of the mode. Undamped, at 5 %: 0.06 (ZV), 0.29 (ZVD), 0.40 (EI), 0.72 (two-hump EI,
    of which 0.73 is in print).

    Raises ControlError for a mode or a level out of range. Source: W. Singhose, W. Seering, N. Singer 1994.
    """
    _require_shaper(shaper)
    require_share("level", level, error=ControlError)
    (given,) = as_modes([mode])

    def excess(share: ArrayLike) -> Array:
        left = residual_vibration_ratio(shaper, np.multiply(given.frequency, share), given.damping)
        return np.asarray(left - level * (1 + ON_LEVEL))

    if excess(1.0) > 0:
        return 0.0
    turns = given.frequency * shaper.duration / (2 * np.pi)
    step = 1 / (PER_TURN * max(1.0, turns))
    edges = []
    for shares in (np.arange(1.0, 0.0, -step), np.arange(1.0, REACH, step)):
        outside = np.flatnonzero(excess(shares) > 0)
        if outside.size:
            first = int(outside[0])
            edges.append(float(scipy.optimize.brentq(lambda share: float(excess(share)), shares[first - 1], shares[first])))
        else:
            edges.append(0.0 if shares[-1] < 1 else math.inf)
    return edges[1] - edges[0]


def _require_shaper(shaper: object) -> None:
    instance("shaper", shaper, Shaper, expected='a Shaper, such as shaper("ZV", modes)', error=ControlError)
