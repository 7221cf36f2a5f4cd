"""Helicopters."""

from __future__ import annotations

import numpy as np

from tests.cited_plants import HE3_A, HE3_B
from tests.published.plant import PublishedPlant, matrix

# Outputs vertical velocity and pitch attitude [deg]; inputs collective and cyclic.
CH47 = PublishedPlant(
    "tandem-rotor helicopter CH-47 at 40 knots",
    "J. C. Doyle, G. Stein, IEEE Trans. Automatic Control 26 (1981), 4-16, section VI",
    [[-0.02, 0.005, 2.4, -32], [-0.14, 0.44, -1.3, -30], [0, 0.018, -1.6, 1.2], [0, 0, 1, 0]],
    [[0.14, -0.12], [0.36, -8.6], [0.35, 0.009], [0, 0]],
    [[0, 1, 0, 0], [0, 0, 0, 57.3]],
)

# All four states as candidates for outputs: horizontal and vertical velocity, pitch rate, pitch angle.
VTOL = PublishedPlant(
    "longitudinal motion of a VTOL helicopter",
    "S. N. Singh, A. A. R. Coelho, J. Dynamic Systems, Measurement and Control 106 (1984), 203-210; COMPleib HE1",
    matrix(
        """
        -0.0366 0.0271 0.0188 -0.4555;
        0.0482 -1.01 0.0024 -4.0208;
        0.1002 0.3681 -0.707 1.42;
        0 0 1 0
        """
    ),
    [[0.4422, 0.1761], [3.5446, -7.5922], [-5.52, 4.49], [0, 0]],
    [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
    outputs=(0, 1),
)

AH64 = PublishedPlant(
    "AH-64 at 130 knots",
    "Ph. M. Fitzsimons, Automatica 31 (1995), 1885-1887; COMPleib HE2",
    matrix(
        """
        -0.0649 0.0787 0.1705 -0.5616;
        0.0386 -0.939 4.2277 0.0198;
        0.1121 -0.4254 -0.7968 0;
        0 0 1 0
        """
    ),
    [[-0.9454, 0.5313], [-8.6476, -10.769], [19.0824, -2.8959], [0, 0]],
    [[1, 0, 0, 0], [0, 0, 0, 1]],
)

# All eight states as candidates for outputs: U W Q V P R theta phi; the chosen ones are those of the hover study.
BELL_205 = PublishedPlant(
    "Bell 205 in hover",
    "COMPleib HE3, after D.-W. Gu, P. Hr. Petkov, M. M. Konstantinov, SLICOT Working Note 1999-12",
    HE3_A,
    HE3_B,
    np.eye(8),
    outputs=(0, 1, 3, 5),
    duration=10.0,
)

HELICOPTERS = (CH47, VTOL, AH64, BELL_205)
