"""What actuators pass on of their controls, against what MuJoCo makes of them."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from invtrack.plant.limits import limit_text
from invtrack.plant.plant import Plant

CART = """
<mujoco model="cart">
  <option gravity="0 0 0"/>
  <worldbody>
    <body name="cart">
      <joint name="x" type="slide" axis="1 0 0" {joint}/><geom size="0.1" mass="1" contype="0"/>
      <body name="bob"><joint name="z" type="slide" axis="0 0 1"/><geom size="0.1" mass="1" contype="0"/></body>
    </body>
  </worldbody>
  <tendon><fixed name="both"><joint joint="x" coef="1"/><joint joint="z" coef="1"/></fixed>
    <fixed name="limited" actuatorfrcrange="-1 1"><joint joint="z" coef="1"/></fixed></tendon>
  <actuator>{actuators}</actuator>
</mujoco>"""
INF = float("inf")


def cart(actuators: str, joint: str = "") -> Plant:
    return Plant.from_xml(CART.format(actuators=actuators, joint=joint), inputs=["u"], outputs=["joint:x"])


CONSTANT = [
    ('<motor name="u" joint="x" ctrlrange="-3 3"/>', "", [-3, 3], "ctrlrange of u"),
    ('<motor name="u" joint="x" forcerange="-2 1"/>', "", [-2, 1], "forcerange of u"),
    ('<motor name="u" joint="x" ctrlrange="-1 5" forcerange="-2 2"/>', "", [-1, 2], "ctrlrange and forcerange of u"),
    ('<motor name="u" joint="x" ctrlrange="3 5" forcerange="-2 2"/>', "", [2, 2], "forcerange of u"),
    (
        '<general name="u" joint="x" gainprm="4" biastype="affine" biasprm="1 0 0" forcerange="-7 5"/>',
        "",
        [-2, 1],
        "forcerange of u",
    ),
    ('<general name="u" joint="x" gainprm="-2" forcerange="-2 4"/>', "", [-2, 1], "forcerange of u"),
    ('<motor name="u" joint="x" gear="10"/>', 'actuatorfrcrange="-20 40"', [-2, 4], "actuatorfrcrange of joint x at u"),
    (
        '<motor name="u" joint="x" gear="-10"/><motor joint="z"/>',
        'actuatorfrcrange="-20 40"',
        [-4, 2],
        "actuatorfrcrange of joint x at u",
    ),
    (
        '<motor name="u" joint="x" gear="10" forcerange="-3 3"/>',
        'actuatorfrcrange="-20 40"',
        [-2, 3],
        "actuatorfrcrange of joint x and forcerange of u",
    ),
]


@pytest.mark.parametrize(("actuators", "joint", "limits", "text"), CONSTANT)
def test_the_tightest_of_all_limits_is_the_inputs(actuators: str, joint: str, limits: list[float], text: str) -> None:
    plant = cart(actuators, joint)
    np.testing.assert_allclose(plant.input_limits, [limits], rtol=1e-15)
    named = limit_text(plant.model, "u", int(plant.input_addresses[0]))
    assert sorted(named.split()) == sorted(text.split())


@pytest.mark.parametrize(("actuators", "joint", "limits", "text"), CONSTANT)
def test_mujoco_clamps_just_there(actuators: str, joint: str, limits: list[float], text: str) -> None:
    plant = cart(actuators, joint)
    low, high = plant.input_limits[0]

    def force(control: float) -> float:
        data = plant.new_data()
        data.qpos[:], data.qvel[:], data.ctrl[0] = [0.3, -0.2], [1.0, 2.0], control
        mujoco.mj_forward(plant.model, data)
        return float(data.qfrc_actuator[0])

    assert force(high + 10) == pytest.approx(force(high), rel=1e-14)
    assert force(low - 10) == pytest.approx(force(low), rel=1e-14)
    if high > low:
        inside = np.array([force(control) for control in np.linspace(low, high, 5)])
        slope = np.diff(inside)
        np.testing.assert_allclose(slope, slope[0], rtol=1e-12)
        assert abs(slope[0]) > 0.1


@pytest.mark.parametrize(
    ("actuators", "joint"),
    [
        ('<position name="u" joint="x" kp="10" forcerange="-2 2"/>', ""),
        ('<velocity name="u" joint="x" kv="10" forcerange="-2 2"/>', ""),
        ('<general name="u" joint="x" dyntype="filter" dynprm="0.1" forcerange="-2 2"/>', ""),
        ('<muscle name="u" joint="x" lengthrange="-1 1" forcerange="-2 2" ctrllimited="false"/>', ""),
        ('<motor name="u" joint="x"/><motor joint="x"/>', 'actuatorfrcrange="-2 2"'),
        ('<motor name="u" joint="x"/><motor tendon="both"/>', 'actuatorfrcrange="-2 2"'),
        ('<motor name="u" tendon="both"/>', 'actuatorfrcrange="-2 2"'),
        ('<motor name="u" tendon="limited" forcerange="-2 2"/>', ""),
    ],
)
def test_a_force_that_depends_on_more_than_the_control_is_no_limit_of_it(actuators: str, joint: str) -> None:
    assert cart(actuators, joint).input_limits.tolist() == [[-INF, INF]]


def test_a_limit_of_the_force_bounds_plans_within_limits() -> None:
    """x'' = u with |u| <= 6: a cycloid over 1 m in 1 s would need 2 pi."""
    from invtrack.plant.linearize import linearize

    plant = cart('<motor name="u" joint="x" forcerange="-6 6"/><motor joint="z"/>')
    assert linearize(plant.at()).input_limits.tolist() == [[-6.0, 6.0]]
