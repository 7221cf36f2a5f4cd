"""What approximate inverses make of the output that is wanted, because of zeros that they do not cancel.

Each zero, or pair of complex ones, acts by a short filter with the gain 1 at rest, stated in differences of neighbouring samples:
as polynomials in z, several zeros near z = 1 would cancel to rounding.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import scipy  # loads scipy.signal at its first use

from invtrack.arrays import Array, ComplexArray

Kind = Literal["NPZ-ignore", "ZPETC", "ZMETC"]


def filtered(kind: Kind, zeros: ComplexArray, steps: Array) -> Array:
    """What steps from sample to sample become (m,); they begin and end with as many that are zero as there are zeros, or more.

    zeros: those that are not cancelled, complex ones in conjugate pairs. With B(z) the polynomial that has them, scaled to B(1) =
    1: "NPZ-ignore" gives B(z) y, "ZPETC" B(z) B(1/z) y, "ZMETC" B(z) over the same with its zeros outside the unit circle put
    inside it, at their reciprocals; of zeros inside or on it this is B(z) y, too.
    """
    result = steps
    for zero in zeros[zeros.imag >= 0].tolist():
        result = _ahead(zero, result)
        if kind == "ZPETC":
            result = _ahead(zero, result[::-1])[::-1]
        elif kind == "ZMETC" and abs(zero) > 1:
            result = _reflected(zero, result)
    return result


def _ahead(zero: complex, y: Array) -> Array:
    """B(z) y of one real zero, or of a pair: 1 + d / e, with d = z - 1 and e = 1 - zero, or that times its conjugate."""
    d = np.diff(np.append(y, [0.0, 0.0]))
    if zero.imag == 0:
        return np.asarray(y + d[:-1] / (1 - zero.real))
    e = 1 - zero
    return np.asarray(y + (2 * e.real * d[:-1] + np.diff(d)) / abs(e) ** 2)


def _reflected(zero: complex, y: Array) -> Array:
    """y over B(z) with its zero, or pair, at the reciprocal: (1 - zero) / (1 - zero z) y, or both of a pair."""
    if zero.imag == 0:
        numerator, denominator = [0.0, (zero.real - 1) / zero.real], [1.0, -1 / zero.real]
    else:
        size = abs(zero) ** 2
        numerator, denominator = [0.0, 0.0, abs(1 - zero) ** 2 / size], [1.0, -2 * zero.real / size, 1 / size]
    return np.asarray(scipy.signal.lfilter(numerator, denominator, y))
