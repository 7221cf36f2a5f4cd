"""Flexible arms raise their loads against gravity, in MuJoCo: a rod that bends, with payloads that change, and joints that yield.

An arm of four parts on springs raises the direction of its tip by a right angle, once with one payload, once with a payload that
becomes heavier and then lighter on the way; an arm of two links on flexible joints, relative degree (4, 4), turns both. Gravity
makes every posture another plant, with other equilibria at both ends. With the linear model of the start, gravity wins: under its
inverse the rod whirls round and the links miss by more than their motion. Feedback alone, around the postures at rest along the way
and the inputs that hold them, arrives, but late and swinging: it misses by most of the motion. Where the links' bearings rub twice
as much as the model knows, the inverse of the motion misses, too, and learns the rest from run to run. Redesign trades some
of the rod's motion for torque, also within limits, and costs what it says, less than every other way that is tried.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from motions.redesigns import Redesign
from motions.ways import COLUMNS, Motion

import invtrack
from invtrack.figures import comparison_figure, tracking_figure
from invtrack.references import stack
from invtrack.studies import Setup, Study, StudyOptions, Table

FROM, TO = -np.pi / 3, np.pi / 6  # [rad]
LINKS = (1.0, -0.7)  # [rad]
DURATION = 1.0  # [s]
FRICTION = {"friction1": 0.1, "friction2": 0.1}  # [N m s], twice that of the model
BAND, SETTLING = 80.0, 4.0  # [rad/s], [s]
R, Q_Y = 1e-3, 1.0  # of the torque [1 / (N m)^2 s] and the direction [1 / rad^2 s]
TORQUE = (1.8, 5.4)  # [N m]
PAYLOADS = (invtrack.Change(0.3, payload=0.5), invtrack.Change(0.7, payload=0.1))  # [s], [kg]


def build(options: StudyOptions) -> Setup:
    motions = [_raised("raised"), _raised("payloads", PAYLOADS), _turned("joints"), _turned("rubbing", FRICTION)]
    cases = [case for motion in motions for case in motion.cases(options.timestep)]
    redesign = Redesign(motions[0], R, Q_Y, low=TORQUE[:1], high=TORQUE[1:], seed=options.seed)
    windows = {motion.name: (-1.0, 3.0) for motion in motions}
    return Setup(
        [*cases, *redesign.cases()],
        sweeps={redesign.trade_off: redesign.points()},
        sections={"redesign": redesign.section()},
        figures={
            **{
                f"comparison_{name}": lambda done, name=name, window=window: comparison_figure(
                    done.among([case.name for case in cases if case.name.startswith(name)]), window=window
                )
                for name, window in windows.items()
            },
            "tracking": lambda done: tracking_figure(done["payloads_inverse"], window=(-1.0, 2.0)),
            "redesigns": lambda done: comparison_figure(done.among(redesign.shown), window=(-2.0, 3.0)),
            redesign.trade_off: redesign.figure,
        },
        report=[
            Table(
                f"Flexible arms raised against gravity in {DURATION:g} s",
                COLUMNS,
                lambda done: done.rows([case.name for case in cases]),
            ),
            redesign.table(),
        ],
    )


def _raised(name: str, schedule: Sequence[invtrack.Change] = ()) -> Motion:
    """The flexible rod, held by its hub's torque below the horizontal."""
    plant = invtrack.Plant.from_xml(
        invtrack.model_path("flexible_arm"),
        inputs=["torque"],
        outputs=["tendon:direction"],
        parameters={"payload": "body:payload:mass"},
    )
    plant = invtrack.trim(plant, outputs=[FROM]).plant

    def linear(plant: invtrack.Plant) -> invtrack.SwitchedSystem:
        later = [invtrack.linearize(plant, equilibrium="same outputs", **change.parameters) for change in schedule]
        return invtrack.SwitchedSystem([invtrack.linearize(plant), *later], [change.time for change in schedule])

    reference = invtrack.rest_to_rest(FROM, TO, duration=DURATION)
    return Motion(name, plant, reference, Q=1.0, R=1.0, schedule=schedule, linear=linear)


def _turned(name: str, actual: Mapping[str, float] | None = None) -> Motion:
    """The links on flexible joints, held horizontally; actual: how much their bearings rub, where no plan knows."""
    plant = invtrack.Plant.from_xml(
        invtrack.model_path("flexible_joints"),
        inputs=["torque1", "torque2"],
        outputs=["joint:link1", "joint:link2"],
        parameters={"friction1": "joint:rotor1:damping", "friction2": "joint:rotor2:damping"},
    )
    plant = invtrack.trim(plant, outputs=[0.0, 0.0]).plant
    reference = stack([invtrack.rest_to_rest(0.0, angle, duration=DURATION, smoothness=5) for angle in LINKS])
    return Motion(name, plant, reference, Q=1.0, R=1.0, actual=actual or {}, band=BAND if actual else None, settling=SETTLING)


STUDY = Study("flexible_arm", build, description=__doc__, defaults=StudyOptions())

if __name__ == "__main__":
    STUDY.main()
