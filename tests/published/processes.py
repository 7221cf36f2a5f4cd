"""Processes: tanks, reactors, distillation columns, boilers."""

from __future__ import annotations

import numpy as np

from tests.published.plant import Figures, PublishedPlant, matrix


def _quadruple_tank(name: str, splits: tuple[float, float], constants: tuple[float, ...], zeros: Figures) -> PublishedPlant:
    """Outputs the levels of the lower tanks [V], inputs the pumps' voltages, with the share g1, g2 that goes to the lower tanks.

    The gains c_i = T_i k k_c / A_i of the source scale inputs and outputs only and are left out.
    """
    (g1, g2), (T1, T2, T3, T4) = splits, constants
    return PublishedPlant(
        f"quadruple tank, {name}",
        "K. H. Johansson, IEEE Trans. Control Systems Technology 8 (2000), 456-465, eq. 7; the zeros are printed there",
        [[-1 / T1, 0, 1 / T3, 0], [0, -1 / T2, 0, 1 / T4], [0, 0, -1 / T3, 0], [0, 0, 0, -1 / T4]],
        [[g1, 0], [0, g2], [0, 1 - g2], [1 - g1, 0]],
        [[0.5, 0, 0, 0], [0, 0.5, 0, 0]],
        zeros=zeros,
        duration=60.0,
    )


# The printed time constants are rounded to whole seconds, which moves the zeros by more than the last printed digit.
TANK_MINIMUM_PHASE = _quadruple_tank("minimum phase", (0.70, 0.60), (62.0, 90.0, 23.0, 30.0), Figures((-0.060, -0.018), 1.2e-3))
TANK_NONMINIMUM_PHASE = _quadruple_tank(
    "nonminimum phase", (0.43, 0.34), (63.0, 91.0, 39.0, 56.0), Figures((0.013, -0.057), 1.2e-3)
)

# Open-loop poles as in J. Kautsky, N. K. Nichols, P. Van Dooren, International Journal of Control 41 (1985), example 1.
BATCH_REACTOR = PublishedPlant(
    "unstable batch reactor",
    "N. Munro, Proc. IEE 119 (1972); H. H. Rosenbrock, Computer-Aided Control System Design, 1974; Y. S. Hung, A. G. "
    "J. MacFarlane, Multivariable Feedback: A Quasi-Classical Approach, Springer, 1982; COMPleib REA1",
    matrix(
        """
        1.38 -0.2077 6.715 -5.676;
        -0.5814 -4.29 0 0.675;
        1.067 4.273 -6.654 5.893;
        0.048 4.273 1.343 -2.104
        """
    ),
    [[0, 0], [5.679, 0], [1.136, -3.146], [1.136, 0]],
    [[1, 0, 1, -1], [0, 1, 0, 0], [0, 0, 1, -1]],
    outputs=(0, 1),
    poles=Figures((1.991, 0.0635, -5.0566, -8.6659), 5e-4),
)

# All nine states as candidates for outputs.
AMMONIA_REACTOR = PublishedPlant(
    "tubular ammonia reactor",
    "L. M. Patnaik, N. Viswanadham, I. G. Sarma, IEEE Trans. Automatic Control 25 (1980); example 1.5 of CTDSX (D. "
    "Kressner, V. Mehrmann, T. Penzl, SLICOT Working Note 1998-9)",
    matrix(
        """
        -4.019 5.12 0 0 -2.082 0 0 0 0.87;
        -0.346 0.986 0 0 -2.34 0 0 0 0.97;
        -7.909 15.407 -4.069 0 -6.45 0 0 0 2.68;
        -21.816 35.606 -0.339 -3.87 -17.8 0 0 0 7.39;
        -60.196 98.188 -7.907 0.34 -53.008 0 0 0 20.4;
        0 0 0 0 94 -147.2 0 53.2 0;
        0 0 0 0 0 94 -147.2 0 0;
        0 0 0 0 0 12.8 0 -31.6 0;
        0 0 0 0 12.8 0 0 18.8 -31.6
        """
    ),
    matrix(
        """
        0.01 -0.011 -0.151;
        0.003 -0.021 0;
        0.009 -0.059 0;
        0.024 -0.162 0;
        0.068 -0.445 0;
        0 0 0;
        0 0 0;
        0 0 0;
        0 0 0
        """
    ),
    np.eye(9),
    outputs=(0, 3, 8),
)

# Outputs top and bottom composition and pressure. CTDSX has 0.022 in row 5, column 7 too, which no balance of a tray contains.
DISTILLATION = PublishedPlant(
    "binary distillation column with pressure variation",
    "E. J. Davison, Benchmark Problems for Control System Design, IFAC, 1990; COMPleib BDT1",
    matrix(
        """
        -0.014 0.0043 0 0 0 0 0 0 0 0 0;
        0.0095 -0.0138 0.0046 0 0 0 0 0 0 0 0.0005;
        0 0.0095 -0.0141 0.0063 0 0 0 0 0 0 0.0002;
        0 0 0.0095 -0.0158 0.011 0 0 0 0 0 0;
        0 0 0 0.0095 -0.0312 0.015 0 0 0 0 0;
        0 0 0 0 0.0202 -0.0352 0.022 0 0 0 0;
        0 0 0 0 0 0.0202 -0.0422 0.028 0 0 0;
        0 0 0 0 0 0 0.0202 -0.0482 0.037 0 0.0002;
        0 0 0 0 0 0 0 0.0202 -0.0572 0.042 0.0005;
        0 0 0 0 0 0 0 0 0.0202 -0.0483 0.0005;
        0.0255 0 0 0 0 0 0 0 0 0.0255 -0.0185
        """
    ),
    matrix(
        """
        0 0 0;
        5e-06 -4e-05 0.0025;
        2e-06 -2e-05 0.005;
        1e-06 -1e-05 0.005;
        0 0 0.005;
        0 0 0.005;
        -5e-06 1e-05 0.005;
        -1e-05 3e-05 0.005;
        -4e-05 5e-06 0.0025;
        -2e-05 2e-06 0.0025;
        0.00046 0.00046 0
        """
    ),
    [[0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0], [1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1]],
    duration=200.0,
)

# Outputs drum pressure and drum level; three inputs, of which two are taken.
DRUM_BOILER = PublishedPlant(
    "drum boiler",
    "K. L. Chien, E. I. Ergin, C. Ling, A. Lee, Trans. ASME 80 (1958); example 1.8 of CTDSX",
    matrix(
        """
        -3.93 -0.00315 0 0 0 4.03e-05 0 0 0;
        368 -3.05 3.03 0 0 -0.00377 0 0 0;
        27.4 0.0787 -0.0596 0 0 -0.000281 0 0 0;
        -0.0647 -5.2e-05 0 -0.255 -3.35e-06 3.6e-07 6.33e-05 0.000194 0;
        3850 17.3 -12.8 -12600 -2.91 -0.105 12.7 43.1 0;
        22400 18 0 -35.6 -0.000104 -0.414 90 56.9 0;
        0 0 0.00234 0 0 0.000222 -0.203 0 0;
        0 0 0 -1.27 0.001 7.86e-05 0 -0.0717 0;
        -2.2 -0.00177 0 -8.44 -0.000111 1.38e-05 0.00149 0.00602 -1e-10
        """
    ),
    matrix(
        """
        0 0 0;
        0 0 0;
        1.56 0 0;
        0 -5.13e-06 0;
        8.28 -1.5 0.0395;
        0 1.78 0;
        2.33 0 0;
        0 -0.0245 0.00284;
        0 2.94e-05 0
        """
    ),
    [[0, 0, 0, 0, 0, 1, 0, 0, 0], [0, 0, 0, 0, 0, 0, 0, 0, 1]],
    inputs=(0, 1),
    duration=50.0,
)

# Outputs top and bottom composition, inputs reflux and boilup, gain as printed; its relative gain is 35.1.
DISTILLATION_LV = PublishedPlant(
    "high-purity distillation column, LV configuration",
    "S. Skogestad, M. Morari, J. C. Doyle, IEEE Trans. Automatic Control 33 (1988), 1092-1105",
    [[-1 / 75, 0], [0, -1 / 75]],
    [[0.878 / 75, -0.864 / 75], [1.082 / 75, -1.096 / 75]],
    [[1, 0], [0, 1]],
    zeros=Figures((), 0.0),
    gain=([[0.878, -0.864], [1.082, -1.096]], [[0.0005, 0.0005], [0.0005, 0.0005]]),
    duration=60.0,
)

PROCESSES = (
    TANK_MINIMUM_PHASE,
    TANK_NONMINIMUM_PHASE,
    BATCH_REACTOR,
    AMMONIA_REACTOR,
    DISTILLATION,
    DRUM_BOILER,
    DISTILLATION_LV,
)
