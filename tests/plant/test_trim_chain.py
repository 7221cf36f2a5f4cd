"""Equilibria of long chains, of which a torque at one joint accelerates all links, some thousands of times as much as others."""

from __future__ import annotations

import numpy as np
import pytest

import invtrack

MASS, LENGTH, GRAVITY = 0.3, 0.1, 9.81  # of a link [kg], [m]


def chain(links: int, *, driven: int, joint: str = "") -> invtrack.Plant:
    """Links on hinges, horizontal, the first of which are driven; joint: attributes of the hinges."""
    bodies = ""
    for i in reversed(range(links)):
        bodies = (
            f'<body pos="{LENGTH if i else 0} 0 0"><joint name="j{i}" axis="0 -1 0" {joint}/><geom type="capsule" size="0.01"'
            f' fromto="0 0 0 {LENGTH} 0 0" mass="{MASS}" contype="0" conaffinity="0"/>{bodies}</body>'
        )
    motors = [f"m{i}" for i in range(driven)]
    actuators = "".join(f'<motor name="{motor}" joint="j{i}"/>' for i, motor in enumerate(motors))
    return invtrack.Plant.from_xml(
        f'<mujoco model="chain"><worldbody>{bodies}</worldbody><actuator>{actuators}</actuator></mujoco>',
        inputs=motors,
        outputs=[f"joint:j{links - 1}"],
    )


@pytest.mark.parametrize("links", [3, 20, 60])
def test_each_motor_carries_what_hangs_beyond_its_joint(links: int) -> None:
    held = invtrack.trim(chain(links, driven=links))
    beyond = links - np.arange(links)
    torques = MASS * GRAVITY * LENGTH * beyond**2 / 2  # the weight of the links beyond at half of their length
    assert held.plant.operating_point.u0 == pytest.approx(torques, rel=1e-9)
    assert held.plant.operating_point.x0 == pytest.approx(np.zeros(2 * links), abs=1e-12)


def test_springs_carry_what_no_motor_does() -> None:
    """Of all hinges on springs only the first is driven: each spring bends by the torque beyond it, and by little, so that it is
    that of the horizontal chain to second order."""
    links, stiffness = 20, 1e5
    held = invtrack.trim(chain(links, driven=1, joint=f'stiffness="{stiffness}"'), positions={"j0": 0.0})
    beyond = links - np.arange(links)
    torques = MASS * GRAVITY * LENGTH * beyond**2 / 2
    bent = held.plant.operating_point.x0[:links]
    assert bent[0] == 0.0
    assert bent[1:] == pytest.approx(-torques[1:] / stiffness, rel=1e-4)
    assert held.plant.operating_point.u0 == pytest.approx(torques[:1], rel=1e-4)
