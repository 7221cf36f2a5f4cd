"""A vertical take-off aircraft steps aside at constant height, in MuJoCo: nonminimum phase by thrusters that are tilted.

To go to the right it has to roll, and the torque that rolls it pushes it to the left. Exact tracking of its place therefore needs a
torque that acts before the motion. The aircraft rolls so far that its linear model about hover, by which thrust does not push it
aside, misses the way and loses height. It may learn the rest from run to run, unless the way is so long that learning makes the
errors larger. Plant and question: P. Martin, S. Devasia, B. Paden, "A different look at output tracking: control of a VTOL
aircraft", Automatica 32(1), 1996.
"""

from __future__ import annotations

from motions.ways import COLUMNS, Motion

import invtrack
from invtrack.figures import comparison_figure, tracking_figure
from invtrack.studies import Setup, Study, StudyOptions, Table

DISTANCES = (1.0, 3.0, 12.0)  # [m]
DURATION = 2.0  # [s]
BAND = 60.0  # [rad/s]


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
    return Setup(
        cases,
        figures={
            "comparison": lambda done: comparison_figure(done.among(shown), window=(-1.0, 4.0)),
            "tracking": lambda done: tracking_figure(done["3_m_inverse"], window=(-1.0, 3.0)),
        },
        report=[Table(f"VTOL, to the side in {DURATION:g} s at constant height", COLUMNS)],
    )


def _aside(distance: float) -> invtrack.PiecewiseSignal:
    sideways, up = (invtrack.rest_to_rest(0.0, amount, duration=DURATION) for amount in (distance, 0.0))
    return invtrack.references.stack([sideways, up])


STUDY = Study("vtol", build, description=__doc__, defaults=StudyOptions())

if __name__ == "__main__":
    STUDY.main()
