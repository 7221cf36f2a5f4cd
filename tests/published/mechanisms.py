"""Mechanisms: springs, pendulums, beams, a vehicle that hovers."""

from __future__ import annotations

from tests.cited_plants import TWO_DISC_A, TWO_DISC_B, TWO_DISC_C, cantilever_paper
from tests.published.plant import Figures, PublishedPlant, matrix

# Two unit masses, a unit spring; force on the first, the outputs are both positions. Noncollocated: relative degree 4, no zeros.
TWO_MASSES = PublishedPlant(
    "two masses and a spring",
    "B. Wie, D. S. Bernstein, J. Guidance, Control, and Dynamics 15 (1992), 1057-1059",
    [[0, 0, 1, 0], [0, 0, 0, 1], [-1, 1, 0, 0], [1, -1, 0, 0]],
    [[0], [0], [1], [0]],
    [[1, 0, 0, 0], [0, 1, 0, 0]],
    outputs=(1,),
    zeros=Figures((), 0.0),
)

# About hover x'' = -theta + eps u2, y'' = u1, theta'' = u2, in units of gravity; with x and y held theta'' = sin(theta) / eps.
PVTOL = PublishedPlant(
    "planar VTOL aircraft in hover, eps = 0.01",
    "J. Hauser, S. Sastry, G. Meyer, Automatica 28 (1992), 665-679",
    [[0, 0, 0, 1, 0, 0], [0, 0, 0, 0, 1, 0], [0, 0, 0, 0, 0, 1], [0, 0, -1, 0, 0, 0], [0, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0]],
    [[0, 0], [0, 0], [0, 0], [0, 0.01], [1, 0], [0, 1]],
    [[1, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0]],
    zeros=Figures((10.0, -10.0), 0.0),
)

# Outputs the cart's position and the pendulum's angle; poles as printed there.
CART_PENDULUM = PublishedPlant(
    "inverted pendulum on a cart",
    "Control Tutorials for MATLAB and Simulink, University of Michigan: Inverted Pendulum, System Modeling",
    [[0, 1, 0, 0], [0, -0.1818, 2.6727, 0], [0, 0, 0, 1], [0, -0.4545, 31.1818, 0]],
    [[0], [1.8182], [0], [4.5455]],
    [[1, 0, 0, 0], [0, 0, 1, 0]],
    outputs=(0,),
    poles=Figures((0, -0.1428, 5.5651, -5.6041), 1.5e-4),
)

# The zeros of the printed transfer function; those of the printed matrices, in fewer digits, differ by 2e-4.
TWO_DISC = PublishedPlant(
    "two-disc torsional rig",
    "S. Devasia, NASA report, 1996, note on output-trajectory redesign",
    TWO_DISC_A,
    TWO_DISC_B,
    TWO_DISC_C,
    zeros=Figures((0.21981 + 4.74968j, 0.21981 - 4.74968j), 2.5e-4),
    duration=8.0,
)

CANTILEVER = PublishedPlant(
    "cantilever on a driven base",
    "S. Devasia, B. Paden, C. Rossi, Exact-output tracking theory for systems with parameter jumps, 1996, section 5",
    *cantilever_paper(10.0),
    zeros=Figures((1.76534, -1.76534, 0.234538, -0.234538), 5e-6),
)

# Four modes without damping, four actuators, rates where they act: each output's derivative has a zero at 0, on the axis.
SPACE_STRUCTURE = PublishedPlant(
    "large space structure",
    "A. J. Calise, D. D. Moerder, Automatica 21 (1985), 271-276; COMPleib NN16",
    matrix(
        """
        0 1 0 0 0 0 0 0;
        -0.42 0 0 0 0 0 0 0;
        0 0 0 1 0 0 0 0;
        0 0 -0.1849 0 0 0 0 0;
        0 0 0 0 0 1 0 0;
        0 0 0 0 -4.41 0 0 0;
        0 0 0 0 0 0 0 1;
        0 0 0 0 0 0 -4.84 0
        """
    ),
    matrix(
        """
        0 0 0 0;
        -0.92 -1.4 0.92 -1.4;
        0 0 0 0;
        0.65 1.6 0.65 -1.6;
        0 0 0 0;
        1.4 -1 1.4 1;
        0 0 0 0;
        2 -0.8 -2 -0.8
        """
    ),
    matrix(
        """
        0 -1.8 0 1.3 0 2.9 0 4.1;
        0 -2.7 0 3.2 0 -2.1 0 -1.6;
        0 1.8 0 1.3 0 2.9 0 -4.1;
        0 -2.7 0 -3.2 0 2.1 0 -1.6
        """
    ),
)

# Outputs attitude and its rate, with bending and sloshing.
SATURN_V = PublishedPlant(
    "Saturn V booster",
    "L. F. Miller, R. G. Cochran, J. W. Howze, International Journal of Control 27 (1978), 455-462; COMPleib NN5",
    matrix(
        """
        0 1 0 0 0 0 0;
        0 0 0.2 -0.65 -0.002 2.6 0;
        -0.014 1 -0.041 0.0002 -0.015 -0.033 0;
        0 0 0 0 1 0 0;
        0 0 0 -45 -0.13 255 0;
        0 0 0 0 0 0 1;
        0 0 0 0 0 -50 -10
        """
    ),
    [[0], [0], [0], [0], [0], [0], [1]],
    [[1, 0, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0, 0]],
    outputs=(0,),
)

MECHANISMS = (TWO_MASSES, PVTOL, CART_PENDULUM, TWO_DISC, CANTILEVER, SPACE_STRUCTURE, SATURN_V)
