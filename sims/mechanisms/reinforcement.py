"""Entries whose files come with gymnasium (MIT): the mechanisms on which reinforcement learning is tried out."""

from __future__ import annotations

from pathlib import Path

import mujoco
from mechanisms.entry import Entry

import invtrack
from invtrack.errors import PlantError


def inverted_pendulum(path: Path) -> invtrack.Plant:
    """A cart that balances a pole, which leans a little: its capsule is not quite upright on its hinge."""
    return invtrack.trim(invtrack.Plant.from_xml(path, inputs=["slide"], outputs=["joint:slider"])).plant


def double_pendulum(path: Path) -> invtrack.Plant:
    """Two poles on top of each other on a cart; the output is the tip of the upper one."""
    return invtrack.trim(invtrack.Plant.from_xml(path, inputs=["slide"], outputs=["site:tip:x"])).plant


def reacher(path: Path) -> invtrack.Plant:
    """A planar arm of two links; the target that it is to reach lies on slides of its own, which nothing moves."""
    plant = invtrack.Plant.from_xml(
        path,
        inputs=["actuator 0", "actuator 1"],
        outputs=["body:fingertip:x", "body:fingertip:y"],
        drop_states=[f"target_{axis}{rate}" for axis in "xy" for rate in ("", " velocity")],
    )
    return invtrack.trim(plant, positions={"joint0": 0.3, "joint1": 1.0}).plant


def pusher(source: Path | mujoco.MjSpec) -> invtrack.Plant:
    """An arm of seven joints for the three coordinates of its tips."""
    plant = invtrack.Plant.from_xml(
        source, inputs=[f"actuator {i}" for i in range(7)], outputs=[f"body:tips_arm:{axis}" for axis in "xyz"]
    )
    bent = {"r_shoulder_lift_joint": 0.2, "r_elbow_flex_joint": -0.8, "r_wrist_flex_joint": -0.5}
    return invtrack.trim(plant, positions=bent).plant


def cleared_pusher(path: Path) -> invtrack.Plant:
    """The same without the object on the table and the mark of its goal."""
    spec = mujoco.MjSpec.from_file(str(path))
    for body in ("object", "goal"):
        spec.delete(spec.body(body))
    return pusher(spec)


def swimmer(path: Path) -> invtrack.Plant:
    """Three links in water; where they swim, and which way, acts on nothing."""
    plant = invtrack.Plant.from_xml(
        path,
        inputs=["actuator 0", "actuator 1"],
        outputs=["joint:motor1_rot", "joint:motor2_rot"],
        drop_states=["slider1", "slider2", "free_body_rot"],
    )
    return invtrack.trim(plant).plant


JOINTS = ("thigh_joint", "leg_joint", "foot_joint")


def standing_hopper(path: Path) -> invtrack.Plant:
    """A leg that stands on its foot; the search starts crouched, with the foot on the floor."""
    plant = _hopper(path).at(qpos={"rootz": 1.0, "rooty": -0.2, "thigh_joint": -0.4, "leg_joint": -0.8, "foot_joint": 0.4})
    return invtrack.trim(plant).plant


def held_hopper(path: Path) -> invtrack.Plant:
    """The same leg with its torso held in the air: welded to the world, the torso would collide with the thigh that it carries."""
    spec = mujoco.MjSpec.from_file(str(path))
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    for joint in ("rootx", "rootz", "rooty"):
        spec.delete(spec.joint(joint))
    return invtrack.trim(_hopper(spec), positions={"thigh_joint": -0.6, "leg_joint": -1.2, "foot_joint": 0.2}).plant


def _hopper(source: Path | mujoco.MjSpec) -> invtrack.Plant:
    inputs = [f"actuator {i}" for i in range(3)]
    return invtrack.Plant.from_xml(source, inputs=inputs, outputs=[f"joint:{joint}" for joint in JOINTS])


GYMNASIUM = [
    Entry(
        name="inverted_pendulum",
        package="gymnasium",
        file="inverted_pendulum.xml",
        plant=inverted_pendulum,
        motion=(0.2,),
        duration=2.0,
    ),
    Entry(
        name="double_pendulum",
        package="gymnasium",
        file="inverted_double_pendulum.xml",
        plant=double_pendulum,
        motion=(0.1,),
        duration=2.0,
    ),
    Entry(name="reacher", package="gymnasium", file="reacher.xml", plant=reacher, motion=(-0.01, 0.01), duration=1.0),
    Entry(name="swimmer", package="gymnasium", file="swimmer.xml", plant=swimmer, motion=(0.1, -0.1), duration=1.0),
    Entry(
        name="pusher",
        package="gymnasium",
        file="pusher_v5.xml",
        plant=pusher,
        motion=(0.0, 0.0, 0.05),
        duration=1.0,
        refused_by=PlantError,
    ),
    Entry(
        name="cleared_pusher",
        package="gymnasium",
        file="pusher_v5.xml",
        plant=cleared_pusher,
        motion=(0.0, 0.02, 0.05),
        duration=1.0,
    ),
    Entry(
        name="standing_hopper",
        package="gymnasium",
        file="hopper.xml",
        plant=standing_hopper,
        motion=(-0.025, -0.05, 0.025),
        duration=1.0,
        refused_by=PlantError,
    ),
    Entry(
        name="held_hopper", package="gymnasium", file="hopper.xml", plant=held_hopper, motion=(-0.025, -0.05, 0.025), duration=1.0
    ),
]
