"""A quadrotor carries a load on a rope through space, in MuJoCo: the load follows its path and comes to rest without a swing.

The outputs are the place of the load and the heading of the vehicle. The hook lies below the centre of mass: to push the load
forward the vehicle leans, which first moves the hook back. So the load is nonminimum phase, and exact tracking needs thrusts that
act before it moves. On the way the vehicle turns by a right angle: thrusters that pushed the load sideways at the start push it
backward at the end, which the linear model about the start does not know. Plant, there with a massless rope in the centre of mass:
K. Sreenath, T. Lee, V. Kumar, "Geometric control and differential flatness of a quadrotor UAV with a cable-suspended load", IEEE
Conference on Decision and Control, 2013.
"""

from __future__ import annotations

import numpy as np
from motions.ways import COLUMNS, Motion

import invtrack
from invtrack.figures import comparison_figure, tracking_figure
from invtrack.studies import Setup, Study, StudyOptions, Table

THRUSTERS = ("front_left", "front_right", "rear_left", "rear_right")
OUTPUTS = ("body:load:x", "body:load:y", "body:load:z", "body:vehicle:yaw")

WAY = (4.0, 2.0, 1.0)  # of the load [m]: ahead, to the left, up
TURN = np.pi / 2  # of the vehicle [rad]
DURATION, SMOOTHNESS = 3.0, 4  # [s]; so many derivatives of the path vanish at its ends


def build(options: StudyOptions) -> Setup:
    plant = invtrack.Plant.from_xml(invtrack.model_path("slung_load"), inputs=THRUSTERS, outputs=OUTPUTS, keyframe="hover")
    ways = [invtrack.rest_to_rest(0.0, way, duration=DURATION, smoothness=SMOOTHNESS) for way in (*WAY, TURN)]
    motion = Motion("", plant, invtrack.references.stack(ways), Q=1.0, R=1.0)
    return Setup(
        motion.cases(options.timestep),
        figures={
            "comparison": lambda done: comparison_figure(done.among(), window=(-1.0, 5.0)),
            "tracking": lambda done: tracking_figure(done["inverse"], window=(-1.0, 4.0)),
        },
        report=[
            Table(
                f"Load on a rope, {', '.join(f'{way:g}' for way in WAY)} m and a turn by a right angle in {DURATION:g} s", COLUMNS
            )
        ],
    )


STUDY = Study("slung_load", build, description=__doc__, defaults=StudyOptions())

if __name__ == "__main__":
    STUDY.main()
