"""The play of a transmission: closed in linear models, as if its joint were not there; open in simulations."""

from __future__ import annotations

import numpy as np
import pytest

import invtrack
from invtrack.errors import PlantError

# A motor turns a wheel, and that through a flexible shaft an arm; between rotor and wheel there may be play.
ARM = """
<mujoco model="geared arm">
  <compiler angle="radian"/>
  <option integrator="RK4" timestep="0.001" gravity="0 0 -9.81"/>
  <worldbody>
    <body name="rotor">
      <joint name="motor" axis="0 1 0" damping="0.1"/>
      <inertial pos="0 0 0" mass="1" diaginertia="0.02 0.02 0.02"/>
      <body name="wheel">
        {play}
        <inertial pos="0 0 0" mass="0.5" diaginertia="0.01 0.01 0.01"/>
        <body name="arm">
          <joint name="shaft" axis="0 1 0" stiffness="30" damping="0.05"/>
          <inertial pos="0 0 -0.2" mass="0.6" diaginertia="0.03 0.03 0.03"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="torque" joint="motor"/></actuator>
</mujoco>"""
GAP = 2e-3
PLAY = f'<joint name="play" axis="0 1 0" range="-{GAP} {GAP}" limited="true"/>'


def arm(play: str = PLAY, **options: object) -> invtrack.Plant:
    settings = {"backlash": ["play"] if play else [], **options}
    return invtrack.Plant.from_xml(ARM.format(play=play), inputs=["torque"], outputs=["body:arm:pitch"], **settings)  # type: ignore[arg-type]


def test_the_model_is_that_of_the_mechanism_without_play() -> None:
    found, rigid = invtrack.linearize(arm()), invtrack.linearize(arm(play=""))
    assert found.states == rigid.states
    assert found.left_out == (f"play of joint play: {-GAP:g} to {GAP:g} rad",)
    for name in "ABC":
        expected = getattr(rigid, name)
        np.testing.assert_allclose(getattr(found, name), expected, atol=1e-11 * np.max(np.abs(rigid.A)))


def test_an_arm_held_against_gravity_has_the_same_equilibrium_and_model() -> None:
    """Its weight would close the play to one side; the equilibrium and the model are those of the mechanism without it."""
    held, rigid = (invtrack.trim(plant, outputs=[0.4]) for plant in (arm(), arm(play="")))
    assert held.controls == pytest.approx(rigid.controls, rel=1e-6)
    assert held.scaled_residual < 1e-8
    found, expected = (invtrack.linearize(point.plant) for point in (held, rigid))
    np.testing.assert_allclose(found.A, expected.A, atol=1e-8 * np.max(np.abs(expected.A)))
    plan = invtrack.invert(found, invtrack.rest_to_rest(0.4, 0.45, duration=1.0, smoothness=4))
    gains = np.array([[20.0, 0.0, 2.0, 0.0]])
    result = invtrack.simulate(held.plant, invtrack.TrackingController(plan, gains), timestep=1e-3, end=2.0)
    # It hangs on one flank of its play, whose limit MuJoCo lets give way under the load, by less than the gap.
    assert GAP < abs(result.error[-1, 0]) < 2 * GAP


def test_a_run_has_the_play_and_says_so() -> None:
    plant = arm()
    plan = invtrack.invert(invtrack.linearize(plant), invtrack.rest_to_rest(0.0, 0.05, duration=1.0, smoothness=4))
    assert "play of joint play" in plan.remarks[0]
    result = invtrack.simulate(plant, invtrack.TrackingController(plan, np.array([[20.0, 0.0, 2.0, 0.0]])), timestep=1e-3, end=2.0)
    moved = np.max(np.abs(result.qpos[:, 1]))  # of the play itself
    assert 0.5 * GAP < moved < 1.5 * GAP
    difference = invtrack.max_error(result, wanted="planned_output")
    assert 0.2 * GAP < difference < 4 * GAP
    rigid = arm(play="")
    smooth = invtrack.invert(invtrack.linearize(rigid), plan.reference)
    assert (
        invtrack.max_error(invtrack.simulate(rigid, invtrack.TrackingController(smooth), timestep=1e-3, end=2.0)) < 0.2 * difference
    )


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["gear"], "backlash names 'gear', which is no slide or hinge joint of the model; those are: motor, play, shaft"),
        ("play", r'expected a list of joints for backlash such as \["name"\], got \'play\''),
    ],
)
def test_what_is_no_play_is_refused(names: object, message: str) -> None:
    with pytest.raises(PlantError, match=message):
        arm(backlash=names)


def test_play_that_is_not_stated_leaves_the_arm_loose() -> None:
    """Then the model is that of the open gap, and the motor does not move the arm."""
    model = invtrack.linearize(arm(backlash=[]))
    assert "play" in model.states
    assert model.left_out == ()
