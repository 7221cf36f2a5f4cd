"""Plants with the numbers that their sources print."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Cantilever on a driven base with a point mass m_t at its tip: S. Devasia, B. Paden, C. Rossi, "Exact-output tracking theory for
# systems with parameter jumps", International Journal of Control, accepted 1996. M x'' + S x = [1 0 0]' u,
# x = (base translation x1, tip translation x2, tip rotation x3), output x2.
CANTILEVER_M = np.array([[156.0, 54.0, -13.0], [54.0, 156.0, -22.0], [-13.0, -22.0, 4.0]])  # for m_t = 0
CANTILEVER_S = np.array([[12.0, -12.0, 6.0], [-12.0, 12.0, -6.0], [6.0, -6.0, 4.0]])
CANTILEVER_TIP_MASSES = (0.0, 100.0, 10.0)  # on [0, pi/2], (pi/2, 3 pi/2], (3 pi/2, 2 pi]

# The joints of models/cantilever.xml are q = (x1, x2 - x1, x3): x = T q, and the same for the velocities.
_T = np.array([[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
PAPER_FROM_MJCF = np.kron(np.eye(2), _T)


def cantilever_paper(m_t: float) -> tuple[Array, Array, Array]:
    """(A (6, 6), B (6, 1), C (1, 6)) of the cantilever in the paper's state (x1, x2, x3, x1', x2', x3')."""
    M = CANTILEVER_M.copy()
    M[1, 1] += m_t
    A = np.block([[np.zeros((3, 3)), np.eye(3)], [-np.linalg.solve(M, CANTILEVER_S), np.zeros((3, 3))]])
    B = np.concatenate([np.zeros(3), np.linalg.solve(M, [1.0, 0.0, 0.0])])[:, None]
    C = np.eye(6)[[1]]
    return A, B, C


# Two-disc torsional rig: S. Devasia, "Guidance of Nonlinear Nonminimum-Phase Dynamic Systems", NASA report, 1996, note on
# output-trajectory redesign. State (th1, th1', th2, th2'), the order in which the printed A and B belong together; output th2.
TWO_DISC_A = np.array([[0, 1, 0, 0], [-3.1555, -0.1640, 3.1555, 0.3845], [0, 0, 0, 1], [2.8956, -0.0899, -2.8956, -0.1124]])
TWO_DISC_B = np.array([[0.0], [1.8139], [0.0], [0.27]])
TWO_DISC_C = np.array([[0.0, 0.0, 1.0, 0.0]])

# Its printed transfer functions from the motor, highest power of s first. They agree with A, B, C to the rounding of the latter.
TWO_DISC_DENOMINATOR = np.array([1.0, 0.2765, 6.1041, 0.0, 0.0])
TWO_DISC_NUMERATORS = {"disc1_angle": np.array([1.8139, 0.3077, 6.1041]), "disc2_angle": np.array([0.27, -0.1187, 6.1041])}

# From the state (th1, th2, th1', th2') of models/two_disc.xml to the printed order.
NOTE_FROM_MJCF = np.eye(4)[[0, 2, 1, 3]]

# Helicopter in hover, COMPleib example HE3 (F. Leibfritz, "COMPleib: Constraint Matrix-optimization Problem Library", 2004): the
# published model of the Bell 205 in hover in the same conventions as S. Devasia's example in the NASA report, whose own A is lost
# in the scan. States U W Q V P R theta phi, inputs collective, longitudinal cyclic, lateral cyclic, tail rotor; outputs U, W, V, R.
HE3_A = np.array(
    [
        [-0.0046, 0.038, 0.3259, -0.0045, -0.402, -0.073, -9.81, 0],
        [-0.1978, -0.5667, 0.357, -0.0378, -0.2149, 0.5683, 0, 0],
        [0.0039, -0.0029, -0.2947, 0.007, 0.2266, 0.0148, 0, 0],
        [0.0133, -0.0014, -0.4076, -0.0654, -0.4093, 0.2674, 0, 9.81],
        [0.0127, -0.01, -0.8152, -0.0397, -0.821, 0.1442, 0, 0],
        [-0.0285, -0.0232, 0.1064, 0.0709, -0.2786, -0.7396, 0, 0],
        [0, 0, 1, 0, 0, 0, 0, 0],
        [0, 0, 0, 0, 1, 0, 0, 0],
    ]
)
HE3_B = np.array(
    [
        [0.0676, 0.1221, -0.0001, -0.0016],
        [-1.1151, 0.1055, 0.0039, 0.0035],
        [0.0062, -0.0682, 0.001, -0.0035],
        [-0.017, 0.0049, 0.1067, 0.1692],
        [-0.0129, 0.0106, 0.2227, 0.143],
        [0.139, 0.0059, 0.0326, -0.407],
        [0, 0, 0, 0],
        [0, 0, 0, 0],
    ]
)
HE3_C = np.eye(8)[[0, 1, 3, 5]]
