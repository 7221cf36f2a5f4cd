"""Entries whose files come with dm-control (Apache-2.0): the mechanisms of its control suite."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import mujoco
import numpy as np
from mechanisms.entry import Entry

import invtrack
from invtrack.errors import ControlError


def crane_cart(path: Path) -> invtrack.Plant:
    """The cart of a cart-pole whose pole hangs: a crane, all but undamped, in which the cart is to move."""
    plant = invtrack.Plant.from_xml(path, inputs=["slide"], outputs=["joint:slider"])
    return invtrack.trim(plant.at(qpos={"hinge_1": np.pi})).plant


def crane_tip(path: Path) -> invtrack.Plant:
    """The same crane; the output is the end of the pole, beyond its centre of percussion, where the file has no site."""
    spec = mujoco.MjSpec.from_file(str(path))
    spec.body("pole_1").add_site(name="tip", pos=[0.0, 0.0, 1.0])
    plant = invtrack.Plant.from_xml(spec, inputs=["slide"], outputs=["site:tip:x"])
    return invtrack.trim(plant.at(qpos={"hinge_1": np.pi})).plant


def acrobot(path: Path) -> invtrack.Plant:
    """Two links that stand on a shoulder without a motor; only the elbow has one."""
    return invtrack.trim(invtrack.Plant.from_xml(path, inputs=["elbow"], outputs=["site:tip:x"])).plant


def pendulum(path: Path) -> invtrack.Plant:
    """A pendulum held aslant against gravity."""
    plant = invtrack.Plant.from_xml(path, inputs=["torque"], outputs=["joint:hinge"])
    return invtrack.trim(plant, positions={"hinge": 0.1}).plant


def reacher(path: Path) -> invtrack.Plant:
    """A planar arm of two links."""
    plant = invtrack.Plant.from_xml(path, inputs=["shoulder", "wrist"], outputs=["body:finger:x", "body:finger:y"])
    return invtrack.trim(plant, positions={"shoulder": 0.3, "wrist": 1.0}).plant


def point_mass(path: Path) -> invtrack.Plant:
    """A mass on two slides, driven through tendons."""
    return invtrack.trim(invtrack.Plant.from_xml(path, inputs=["t1", "t2"], outputs=["joint:root_x", "joint:root_y"])).plant


def fish(path: Path) -> invtrack.Plant:
    """A fish held in water, which beats its tail by a position servo."""
    spec = mujoco.MjSpec.from_file(str(path))
    spec.delete(spec.joint("root"))
    return invtrack.trim(invtrack.Plant.from_xml(spec, inputs=["tail"], outputs=["joint:tail1"])).plant


ARM = ("right_shoulder1", "right_shoulder2", "right_elbow")
OTHER_ARM = ("left_shoulder1", "left_shoulder2", "left_elbow")


def humanoid(path: Path) -> invtrack.Plant:
    """The right arm of a humanoid whose torso is held: its left arm is held up, too, but spine and legs hang from it limply."""
    spec = mujoco.MjSpec.from_file(str(path))
    spec.delete(spec.joint("root"))
    raised = dict(zip((*ARM, *OTHER_ARM), 2 * (0.3, 0.2, -1.2), strict=True))
    return invtrack.trim(_right_hand(spec), positions=raised, free=OTHER_ARM).plant


def humanoid_arm(path: Path) -> invtrack.Plant:
    """The same arm on a body that is stiff otherwise."""
    spec = mujoco.MjSpec.from_file(str(path))
    for joint in list(spec.joints):
        if joint.name not in ARM:
            for actuator in [actuator for actuator in spec.actuators if actuator.target == joint.name]:
                spec.delete(actuator)
            spec.delete(joint)
    return invtrack.trim(_right_hand(spec), positions=dict(zip(ARM, (0.3, 0.2, -1.2), strict=True))).plant


def _right_hand(spec: mujoco.MjSpec) -> invtrack.Plant:
    return invtrack.Plant.from_xml(spec, inputs=list(ARM), outputs=[f"body:right_hand:{axis}" for axis in "xyz"])


redesigned = partial(invtrack.quadratic_redesign, R=1.0, Q_x=np.diag([0.0, 10.0, 0.0, 10.0]), Q_y=1000.0)

DM_CONTROL = [
    Entry(
        name="crane_cart_exact",
        package="dm-control",
        file="cartpole.xml",
        plant=crane_cart,
        motion=(0.2,),
        duration=2.0,
        method=partial(invtrack.invert, max_postactuation=10.0),
    ),
    Entry(
        name="crane_cart",
        package="dm-control",
        file="cartpole.xml",
        plant=crane_cart,
        motion=(0.2,),
        duration=2.0,
        method=redesigned,
        called="redesign",
    ),
    Entry(name="crane_tip", package="dm-control", file="cartpole.xml", plant=crane_tip, motion=(0.2,), duration=2.0),
    Entry(name="acrobot", package="dm-control", file="acrobot.xml", plant=acrobot, motion=(0.05,), duration=2.0),
    Entry(name="pendulum", package="dm-control", file="pendulum.xml", plant=pendulum, motion=(0.05,), duration=1.0),
    Entry(name="two_link_arm", package="dm-control", file="reacher.xml", plant=reacher, motion=(-0.01, 0.01), duration=1.0),
    Entry(name="point_mass", package="dm-control", file="point_mass.xml", plant=point_mass, motion=(0.04, 0.02), duration=2.0),
    Entry(name="fish", package="dm-control", file="fish.xml", plant=fish, motion=(0.05,), duration=4.0),
    Entry(
        name="humanoid",
        package="dm-control",
        file="humanoid.xml",
        plant=humanoid,
        motion=(0.01, 0.0, 0.025),
        duration=1.0,
        refused_by=ControlError,
    ),
    Entry(
        name="humanoid_arm", package="dm-control", file="humanoid.xml", plant=humanoid_arm, motion=(0.01, 0.0, 0.025), duration=1.0
    ),
]
