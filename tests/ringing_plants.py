"""Plants whose inverses ring: a crane, and any zeros one likes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

import invtrack


def crane(damping: float) -> invtrack.StateSpace:
    """A trolley of 5 kg with a payload of 10 kg on a rope of 1 m: force to the trolley's position."""
    g, rope, M, m, drag = 9.81, 1.0, 5.0, 10.0, 8.0
    A = np.zeros((4, 4))
    A[:2, 2:] = np.eye(2)
    A[2] = [0, m * g / M, -drag / M, damping / (M * rope)]
    A[3] = [0, -(M + m) * g / (M * rope), drag / (M * rope), -damping * (M + m) / (M * m * rope**2)]
    return invtrack.StateSpace(A, [[0], [0], [1 / M], [-1 / (M * rope)]], np.eye(4)[:1])


def with_zeros(zeros: Sequence[complex], **more: Any) -> invtrack.StateSpace:
    """Poles at -1, -2, -3, -4 and these zeros, conjugates included; more: arguments of StateSpace."""
    poles, numerator = np.poly([-1.0, -2.0, -3.0, -4.0]), np.real(np.poly(zeros))
    A = np.vstack([np.hstack([np.zeros((3, 1)), np.eye(3)]), -poles[:0:-1]])
    C = np.zeros((1, 4))
    C[0, : len(numerator)] = numerator[::-1]
    return invtrack.StateSpace(A, np.eye(4)[:, 3:], C, **more)
