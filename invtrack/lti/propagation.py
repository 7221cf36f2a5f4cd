"""Solutions of v' = M v at many times at once, without accumulating error over steps."""

from __future__ import annotations

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

Array = NDArray[np.float64]

NODE_ANGLE = 0.5
"""Distance of the nodes from which the Taylor series starts, times the norm of M."""

TAYLOR_TERMS = 13
"""Terms of that series: over half a node distance the first one left out is below 1e-17 of the first."""


def flow(M: Array, v: Array, tau: Array) -> Array:
    """exp(M tau_i) v_i for all i at once.

    M (q, q); v (m, q); tau (m,) [s], not negative. Each tau is split into a whole number of node distances h, applied as the binary
    digits exp(M h 2^b), and a remainder |r| <= h / 2, applied as a Taylor series; so the cost is m q^2 log(tau |M|), and the error
    does not grow with the number of samples. Exponentials that decay never overflow, whatever tau.
    """
    size = float(np.linalg.norm(M, 1)) if M.size else 0.0
    if size <= 0.0 or v.size == 0:
        return v.copy()
    step = NODE_ANGLE / size
    count = np.rint(tau / step)
    result = _apply_binary_digits(M, v, count, step)
    remainder = (tau - count * step)[:, None]
    term = result
    for j in range(1, TAYLOR_TERMS + 1):
        term = (term @ M.T) * (remainder / j)
        result = result + term
    return result


def _apply_binary_digits(M: Array, v: Array, count: Array, step: float) -> Array:
    result = v.copy()
    digits = count.astype(np.int64)
    # Squaring up from a norm of NODE_ANGLE loses less than expm of the larger matrices, whose Pade denominators are worse
    # conditioned.
    power = scipy.linalg.expm(M * step)
    for bit in range(int(digits.max(initial=0)).bit_length()):
        chosen = (digits >> bit) & 1 == 1
        result[chosen] = result[chosen] @ power.T
        power = power @ power
    return result
