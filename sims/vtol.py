"""A vertical take-off aircraft steps aside at constant height, in MuJoCo: nonminimum phase by thrusters that are tilted.

To go to the right it has to roll, and the torque that rolls it pushes it to the left. Exact tracking of its place therefore needs a
torque that acts before the motion. The aircraft rolls so far that its linear model about hover, by which thrust does not push it
aside, misses the way and loses height. It may learn the rest from run to run, unless the way is so long that learning makes the
errors larger. Redesign gives up a hundredth of the way for five sixths of the torque; it, too, is planned on the nonlinear motion,
also within limits, and costs what it says, less than every other way that is tried. Plant and question: P. Martin, S. Devasia,
B. Paden, "A different look at output tracking: control of a VTOL aircraft", Automatica 32(1), 1996.
"""

from __future__ import annotations

from motions.redesigns import Redesign
from motions.ways import COLUMNS, Motion

import invtrack
from invtrack.figures import comparison_figure, tracking_figure
from invtrack.studies import Setup, Study, StudyOptions, Table

DISTANCES = (1.0, 3.0, 12.0)  # [m]
DURATION = 2.0  # [s]
BAND = 60.0  # [rad/s]
R, Q_Y = 1e-2, 1.0  # of inputs [1 / N^2 s], [1 / (N m)^2 s], and of outputs [1 / m^2 s]
THRUST, TURN = (9.45, 10.17), 0.47  # [N], [N m]: four fifths of what the redesigned plan takes above rest


def build(options: StudyOptions) -> Setup:
    plant = invtrack.Plant.from_xml(
        invtrack.model_path("vtol"),
        inputs=["thrust", "turn"],
        outputs=["site:centre:x", "site:centre:z"],
        keyframe="hover",
    )
    motions = [
        Motion(f"{distance:g}_m", plant, _aside(distance), Q=1.0, R=1.0, band=BAND, contracts=distance < DISTANCES[-1])
        for distance in DISTANCES
    ]
    cases = [case for motion in motions for case in motion.cases(options.timestep)]
    shown = [case.name for case in cases if case.name.startswith("3_m_")]
    redesign = Redesign(motions[1], R, Q_Y, low=(THRUST[0], -TURN), high=(THRUST[1], TURN), seed=options.seed)
    return Setup(
        [*cases, *redesign.cases()],
        sweeps={redesign.trade_off: redesign.points()},
        sections={"redesign": redesign.section()},
        figures={
            "comparison": lambda done: comparison_figure(done.among(shown), window=(-1.0, 4.0)),
            "tracking": lambda done: tracking_figure(done["3_m_inverse"], window=(-1.0, 3.0)),
            "redesigns": lambda done: comparison_figure(done.among(redesign.shown), window=(-2.0, 4.0)),
            redesign.trade_off: redesign.figure,
        },
        report=[
            Table(
                f"VTOL, to the side in {DURATION:g} s at constant height",
                COLUMNS,
                lambda done: done.rows([case.name for case in cases]),
            ),
            redesign.table(),
        ],
    )


def _aside(distance: float) -> invtrack.PiecewiseSignal:
    sideways, up = (invtrack.rest_to_rest(0.0, amount, duration=DURATION) for amount in (distance, 0.0))
    return invtrack.references.stack([sideways, up])


STUDY = Study("vtol", build, description=__doc__, defaults=StudyOptions())

if __name__ == "__main__":
    STUDY.main()
