"""Plants and motions for modified inversion."""

from __future__ import annotations

import numpy as np

from invtrack.linear.state_space import StateSpace
from invtrack.linear.zeros import zeros
from invtrack.references.profiles import piecewise_polynomial
from tests.cited_plants import HE3_A, HE3_B, HE3_C, TWO_DISC_A, TWO_DISC_B, TWO_DISC_C

HE3 = StateSpace(HE3_A, HE3_B, HE3_C, outputs=["U", "W", "V", "R"])
HE3_POLES = [-1.0, -2.0, -3.0, -4.0]

# Unit displacements to the side and upward in 5 s: W and V follow the derivative of the minimum-jerk quintic, U and R stay at zero.
_SPEED = np.array([0.0, 0.0, 30.0, -60.0, 30.0]) / 5.0
HOVER = piecewise_polynomial([0.0, 5.0], [np.outer([0.0, 1.0, 1.0, 0.0], _SPEED)], time_scale=5.0)

TWO_DISC = StateSpace(TWO_DISC_A, TWO_DISC_B, TWO_DISC_C)

# The same rig without damping and velocity coupling: its zeros lie on the imaginary axis.
_PASSIVE_A = TWO_DISC_A.copy()
_PASSIVE_A[np.ix_([1, 3], [1, 3])] = 0.0
PASSIVE_TWO_DISC = StateSpace(_PASSIVE_A, TWO_DISC_B, TWO_DISC_C)


def moved_pair(real_part: float) -> tuple[complex, dict[complex, complex]]:
    """The helicopter's unstable pair, and the wish to move it to this real part."""
    pair = complex(max(zeros(HE3), key=lambda s: (s.real, s.imag)))
    return pair, {pair: complex(real_part, pair.imag)}
