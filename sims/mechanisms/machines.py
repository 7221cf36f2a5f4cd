"""Entries of machines that can be bought: a quadrotor (drone-models, MIT), a robot with two arms (openarm-mujoco, Apache-2.0)."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import mujoco
import numpy as np
from mechanisms.entry import Entry

import invtrack


def crazyflie(path: Path) -> invtrack.Plant:
    """A quadrotor of 27 g in hover; the file leaves it to the user to let it fly."""
    spec = mujoco.MjSpec.from_file(str(path))
    spec.body("drone").add_freejoint(name="drone")
    plant = invtrack.Plant.from_xml(
        spec,
        inputs=[f"motor{i}_{what}" for what in ("force", "torque") for i in range(4)],
        outputs=[f"body:drone:{what}" for what in ("x", "y", "z", "yaw")],
    )
    return invtrack.trim(plant, positions={"drone.z": 0.5}).plant


THRUST, TORQUE = 0.066, 5e-4
"""What a motor gives in hover [N], and what its drag may then change about the vertical axis [N m]: sizes to weigh inputs by."""

allocated = partial(invtrack.invert, R=np.diag(4 * [1 / THRUST**2] + 4 * [1 / TORQUE**2]))

SERVOS = [f"right_joint{i}_ctrl" for i in (1, 2, 4)]
FINGERS = ("openarm_right_ee_inner_finger", "openarm_right_ee_outer_finger")


def openarm(path: Path) -> invtrack.Plant:
    """The right arm of a robot with two, held up by position servos that sag under it.

    Left out are its fingers, which touch each other, and the dry friction of its joints, of which no linear model knows.
    """
    spec = mujoco.MjSpec.from_file(str(path))
    for joint in spec.joints:
        joint.frictionloss = 0.0
    for coupling in list(spec.equalities):
        spec.delete(coupling)
    for body in ("openarm_left_base_link", *FINGERS):
        spec.delete(spec.body(body))
    for servo in list(spec.actuators):
        if servo.name.startswith("left") or "finger" in servo.name:
            spec.delete(servo)
    plant = invtrack.Plant.from_xml(spec, inputs=SERVOS, outputs=[f"site:right_ee_control_point:{axis}" for axis in "xyz"])
    bent = {"openarm_right_joint1": 0.5, "openarm_right_joint2": 0.3, "openarm_right_joint4": 1.2}
    return invtrack.trim(plant, positions=bent).plant


MACHINES = [
    Entry(
        name="crazyflie",
        package="drone-models",
        file="cf2x_L250.xml",
        plant=crazyflie,
        motion=(0.1, 0.05, 0.1, 0.2),
        duration=1.0,
        method=allocated,
    ),
    Entry(
        name="openarm",
        package="openarm-mujoco",
        file="openarm_bimanual.xml",
        plant=openarm,
        motion=(0.0, 0.0, 0.03),
        duration=1.0,
    ),
]
