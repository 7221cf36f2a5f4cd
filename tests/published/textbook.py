"""Small examples that the theory of multivariable zeros is told with."""

from __future__ import annotations

import numpy as np

from tests.published.plant import Figures, PublishedPlant

EMAMI = "A. Emami-Naeini, P. Van Dooren, Computation of zeros of linear multivariable systems, Automatica 18 (1982), 415-430"

# [1/(s+1), 2/(s+3); 1/(s+1), 1/(s+1)]: no element has a zero, the determinant (1 - s)/((s+1)^2 (s+3)) has one at 1.
ROSENBROCK = PublishedPlant(
    "Rosenbrock's example",
    "H. H. Rosenbrock, State-Space and Multivariable Theory, Nelson, 1970",
    [[-1, 0, 0], [0, -3, 0], [0, 0, -1]],
    [[1, 0], [0, 1], [0, 1]],
    [[1, 2, 0], [1, 0, 1]],
    zeros=Figures((1.0,), 0.0),
    poles=Figures((-1.0, -1.0, -3.0), 0.0),
)

# 1/((0.2 s + 1)(s + 1)) [1, 1; 1 + 2 s, 2], with one filter for each input.
SKOGESTAD = PublishedPlant(
    "Skogestad and Postlethwaite's example",
    "S. Skogestad, I. Postlethwaite, Multivariable Feedback Control, Wiley, 1996",
    [[0, 1, 0, 0], [-5, -6, 0, 0], [0, 0, 0, 1], [0, 0, -5, -6]],
    [[0, 0], [5, 0], [0, 0], [0, 5]],
    [[1, 0, 1, 0], [1, 2, 2, 0]],
    zeros=Figures((0.5,), 0.0),
    poles=Figures((-1.0, -1.0, -5.0, -5.0), 0.0),
)

# A feedthrough of rank one.
EMAMI_3 = PublishedPlant(
    "Emami-Naeini and Van Dooren's example 3",
    EMAMI,
    np.kron(np.eye(2), np.diag([1.0, 1.0], k=1)),
    np.eye(6)[:, [2, 5]],
    [[1, 1, 0, 0, 0, 0], [0, 0, 0, 1, -1, 0]],
    [[1, 0], [1, 0]],
    zeros=Figures((1.0, -0.6823278, 0.3411639 + 1.1615414j, 0.3411639 - 1.1615414j), 5e-8),
)

# The second input acts on both outputs before the first one does.
EMAMI_4 = PublishedPlant(
    "Emami-Naeini and Van Dooren's example 4",
    EMAMI,
    [
        [-0.129, 0.0, 0.0396, 0.025, 0.0191],
        [0.00329, 0.0, -0.0000779, 0.000122, -0.621],
        [0.0718, 0.0, -0.1, 0.000887, -3.85],
        [0.0411, 0.0, 0.0, -0.0822, 0.0],
        [0.000361, 0.0, 0.000035, 0.0000426, -0.0743],
    ],
    [[0.0, 0.00139], [0.0, 0.0000359], [0.0, -0.00989], [0.0000249, 0.0], [0.0, -0.00000534]],
    np.eye(5)[:2],
    zeros=Figures((-0.06467751, -0.3680512), 5e-8),
    duration=60.0,
)

EMAMI_5 = PublishedPlant(
    "Emami-Naeini and Van Dooren's example 5: fifteen integrators",
    EMAMI,
    np.diag(np.ones(14), k=1),
    np.eye(15)[:, 14:],
    np.eye(15)[:1],
    zeros=Figures((), 0.0),
)

EMAMI_6 = PublishedPlant(
    "Emami-Naeini and Van Dooren's example 6: no input reaches the output",
    EMAMI,
    [[2, -1, 0], [0, 0, 0], [-1, 0, 0]],
    [[0], [0], [1]],
    [[0, -1, 0]],
)

EMAMI_7 = PublishedPlant(
    "Emami-Naeini and Van Dooren's example 7: no input reaches the output", EMAMI, np.zeros((2, 2)), [[0], [1]], [[-1, 0]]
)

# A double zero that is no hidden mode.
EMAMI_8 = PublishedPlant(
    "Emami-Naeini and Van Dooren's example 8: a double zero",
    EMAMI,
    [
        [-2, 1, 0, 0, 0, 0],
        [1, -2, 1, 0, 1, -1],
        [0, 1, -2, 1, 0, 0],
        [0, 0, 1, -1, 0, 1],
        [0, -1, 0, 0, 0, 0],
        [0, 1, 0, -1, 0, 0],
    ],
    np.eye(6)[:, [0]] + np.eye(6)[:, [4]],
    np.eye(6)[[3]],
    zeros=Figures((-1.0, -1.0), 0.0),
)

EMAMI_9 = PublishedPlant(
    "Emami-Naeini and Van Dooren's example 9: (s - 20)/s^15",
    EMAMI,
    np.diag(np.ones(14), k=1),
    np.eye(15)[:, 14:],
    np.eye(15)[[1]] - 20 * np.eye(15)[[0]],
    zeros=Figures((20.0,), 0.0),
)

# Three outputs, two inputs: zeros 4 and -3 of all three together; two of them, as they are inverted, have more.
EMAMI_11 = PublishedPlant(
    "Emami-Naeini and Van Dooren's example 11",
    EMAMI,
    [[-2, -6, 3, -7, 6], [0, -5, 4, -4, 8], [0, 2, 0, 2, -2], [0, 6, -3, 5, -6], [0, -2, 2, -2, 5]],
    [[-2, 7], [-8, -5], [-3, 0], [1, 5], [-8, 0]],
    [[0, -1, 2, -1, -1], [1, 1, 1, 0, -1], [0, 3, -2, 3, -1]],
    outputs=(0, 1),
)

# Every mode can be read off its row of B and its column of C.
SLICOT_AB08ND = PublishedPlant(
    "example of SLICOT's AB08ND",
    "SLICOT Library, program example of AB08ND",
    np.diag([1.0, 1.0, 3.0, -4.0, -1.0, 3.0]),
    [[0, -1], [-1, 0], [1, -1], [0, 0], [0, 1], [-1, -1]],
    [[1, 0, 0, 1, 0, 0], [0, 1, 0, 1, 0, 1], [0, 0, 1, 0, 0, 1]],
    outputs=(0, 1),
)

TEXTBOOK = (
    ROSENBROCK,
    SKOGESTAD,
    EMAMI_3,
    EMAMI_4,
    EMAMI_5,
    EMAMI_6,
    EMAMI_7,
    EMAMI_8,
    EMAMI_9,
    EMAMI_11,
    SLICOT_AB08ND,
)
