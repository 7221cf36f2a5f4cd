"""Aircraft. COMPleib: F. Leibfritz, Constraint Matrix-optimization Problem Library, 2004, which cites the sources given."""

from __future__ import annotations

from tests.published.plant import Figures, PublishedPlant, matrix

# Outputs height error, forward speed, pitch angle; inputs spoiler, forward acceleration, elevator. Poles: J. M. Maciejowski,
# Multivariable Feedback Design, 1989; without finite zeros (same place).
AIRC = PublishedPlant(
    "vertical plane of an aircraft (AIRC)",
    "Y. S. Hung, A. G. J. MacFarlane, Multivariable Feedback: A Quasi-Classical Approach, Springer, 1982; COMPleib AC1",
    matrix(
        """
        0 0 1.132 0 -1;
        0 -0.0538 -0.1712 0 0.0705;
        0 0 0 1 0;
        0 0.0485 0 -0.8556 -1.013;
        0 -0.2909 0 1.0532 -0.6859
        """
    ),
    [[0, 0, 0], [-0.12, 1, 0], [0, 0, 0], [4.419, 0, -1.665], [1.575, 0, -0.0732]],
    [[1, 0, 0, 0, 0], [0, 1, 0, 0, 0], [0, 0, 1, 0, 0]],
    zeros=Figures((), 0.0),
    poles=Figures((0, -0.78 + 1.03j, -0.78 - 1.03j, -0.0176 + 0.1826j, -0.0176 - 0.1826j), 5e-3),
)

L1011 = PublishedPlant(
    "lateral motion of an L-1011",
    "C. Edwards, S. K. Spurgeon, International Journal of Control 59 (1994), 1211-1229; COMPleib AC3",
    matrix(
        """
        0 0 1 0 0;
        0 -0.154 -0.0042 1.54 0;
        0 0.249 -1 -5.2 0;
        0.0386 -0.996 -0.0003 -0.117 0;
        0 0.5 0 0 -0.5
        """
    ),
    [[0, 0], [-0.744, -0.032], [0.337, -1.12], [0.02, 0], [0, 0]],
    [[0, 1, 0, 0, -1], [0, 0, 1, 0, 0], [0, 0, 0, 1, 0], [1, 0, 0, 0, 0]],
    outputs=(0, 2),
)

CCV = PublishedPlant(
    "control-configured vehicle",
    "A. T. Alexandridis, P. N. Paraskevopoulos, IEEE Trans. Automatic Control 41 (1996), 1046-1050, example 2; COMPleib AC11",
    matrix(
        """
        -1.341 0.9933 0 -0.1689 -0.2518;
        43.223 -0.8693 0 -17.251 -1.5766;
        1.341 0.0067 0 0.1689 0.2518;
        0 0 0 -20 0;
        0 0 0 0 -20
        """
    ),
    [[0, 0], [0, 0], [0, 0], [20, 0], [0, 20]],
    [[0, 0, 1, 0, 0], [47.76, -0.268, 0, -4.56, 4.45], [0, 0, 0, 1, 0], [0, 0, 0, 0, 1]],
    outputs=(0, 1),
)

ASTOVL = PublishedPlant(
    "advanced short take-off and vertical landing aircraft",
    "S. Toffner-Clausen, System Identification and Robust Control, Springer, 1996, p. 274; COMPleib AC12",
    matrix(
        """
        -0.0017 0.0413 -5.3257 -9.7565;
        -0.0721 -0.3393 49.5146 -1.0097;
        -0.0008 0.0138 -0.2032 0.0009;
        0 0 1 0
        """
    ),
    [[0.2086, -0.0005, -0.0271], [-0.0005, 0.2046, 0.0139], [-0.0047, 0.0023, 0.1226], [0, 0, 0]],
    [[0, 0, 57.2958, 0], [0, 0, 0, 57.2958], [0.1045, -0.9945, 0.1375, 51.5791], [-0.0002, 0.0045, 0, 0]],
    outputs=(0, 2, 3),
)

SUPERSONIC = PublishedPlant(
    "supersonic transport at Mach 2.7",
    "Computation of optimal output feedback gains for linear multivariable systems, IEEE Trans. Automatic Control 19 (1974), "
    "257-258; COMPleib AC15",
    [[-0.037, 0.0123, 0.00055, -1], [0, 0, 1, 0], [-6.37, 0, -0.23, 0.0618], [1.25, 0, 0.016, -0.0457]],
    [[0.00084, 0.000236], [0, 0], [0.08, 0.804], [-0.0862, -0.0665]],
    [[0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
    outputs=(0, 2),
)

# Elevator only; three states of a gust, which no input moves. Outputs: normal acceleration, airspeed, longitudinal acceleration,
# climb rate, pitch rate.
TRANSPORT = PublishedPlant(
    "transport aircraft in cruise",
    "D. Gangsaas, K. R. Bruce, J. D. Blight, U.-L. Ly, IEEE Trans. Automatic Control 31 (1986), 995-1014; COMPleib AC8",
    matrix(
        """
        -0.01365 0.178 0.00017 -0.561 -0.03726 0 0.01365 -0.01311 0;
        -0.01516 -0.752 1.001 0.00127 -0.06311 0 0.01516 0.05536 0;
        0.00107 0.07896 -0.8725 0 -3.399 0 -0.00107 -0.00581 0;
        0 0 1 0 0 0 0 0 0;
        0 0 0 0 -20 10.72 0 0 0;
        0 0 0 0 0 -50 0 0 0;
        0 0 0 0 0 0 -0.4447 0 0;
        0 0 0 0 0 0 0 -0.4447 0.0044;
        0 0 0 0 0 0 0 -0.0044 -0.4447
        """
    ),
    [[0], [0], [0], [0], [0], [50], [0], [0], [0]],
    matrix(
        """
        0.00646 0.3203 -0.03358 0 -0.1032 0 -0.00646 -0.02358 0;
        1 0 0 0 0 0 -1 0 0;
        -0.01365 0.178 0.00017 -0.561 -0.03726 0 0.01365 -0.01311 0;
        0 -13.58 0 13.58 0 0 0 0 0;
        0 0 1 0 0 0 0 0 0
        """
    ),
    outputs=(3,),
    duration=20.0,
)

# Outputs airspeed [ft/s] and climb rate [ft/s]; inputs elevator [0.01 rad] and thrust. S. Boyd, lectures on Linear Dynamical
# Systems (EE263), Stanford, from A. E. Bryson; poles and gain from the same place.
BOEING_747 = PublishedPlant(
    "longitudinal motion of a Boeing 747 in cruise",
    "S. Boyd, EE263 Introduction to Linear Dynamical Systems, Stanford; after A. E. Bryson",
    [[-0.003, 0.039, 0, -0.322], [-0.065, -0.319, 7.74, 0], [0.02, -0.101, -0.429, 0], [0, 0, 1, 0]],
    [[0.01, 1], [-0.18, -0.04], [-1.16, 0.598], [0, 0]],
    [[1, 0, 0, 0], [0, -1, 0, 7.74]],
    poles=Figures((-0.3750 + 0.8818j, -0.3750 - 0.8818j, -0.0005 + 0.0674j, -0.0005 - 0.0674j), 8e-5),
    gain=([[27.2, -15.0], [-1.34, 24.9]], [[0.05, 0.05], [0.005, 0.05]]),
    duration=20.0,
)

AIRCRAFT = (AIRC, L1011, CCV, ASTOVL, SUPERSONIC, TRANSPORT, BOEING_747)
