"""Plans on the smooth model, run with everything: what dry friction and delays make of them, against what they must."""

from __future__ import annotations

import numpy as np
import pytest

import invtrack
from invtrack.errors import SimulationError

# A block of 2 kg on a damper of 3 N s/m: what is left out shows in its own right.
BLOCK = """
<mujoco model="block">
  <option gravity="0 0 0" integrator="RK4" timestep="0.001"/>
  <worldbody><body><joint name="x" type="slide" axis="1 0 0" damping="3" {joint}/>
    <inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/></body></worldbody>
  <actuator><motor name="push" joint="x" {push}/></actuator>
</mujoco>"""
MASS, DAMPING = 2.0, 3.0
REFERENCE = invtrack.rest_to_rest(0.0, 0.5, duration=1.0, smoothness=4)


def block(joint: str = "", push: str = "") -> invtrack.Plant:
    return invtrack.Plant.from_xml(BLOCK.format(joint=joint, push=push), inputs=["push"], outputs=["joint:x"])


def run(plant: invtrack.Plant, gains: object = None, **options: object) -> invtrack.RunResult:
    plan = invtrack.invert(invtrack.linearize(plant), REFERENCE)
    settings = {"timestep": 1e-3, "end": 3.0, **options}
    return invtrack.simulate(plant, invtrack.TrackingController(plan, gains), **settings)  # type: ignore[arg-type]


def test_friction_shows_as_the_difference_from_the_plan() -> None:
    """While the block slides, friction F leaves a deviation e from the plan with m e'' + c e' = -F."""
    friction, rate = 0.2, DAMPING / MASS
    result = run(block(joint=f'frictionloss="{friction}"'))
    sliding = (result.time >= 0.2) & (result.time <= 0.8)
    t = result.time[sliding] - 0.2
    e, v = (result.state.values - result.state_reference.values)[sliding].T
    drift = -friction / DAMPING
    np.testing.assert_allclose(v, drift + (v[0] - drift) * np.exp(-rate * t), atol=2e-3 * abs(drift))
    np.testing.assert_allclose(e, e[0] + drift * t + (v[0] - drift) * (1 - np.exp(-rate * t)) / rate, atol=1e-3 * abs(drift))
    assert invtrack.max_error(result, wanted="planned_output") > 0.03
    assert result.remarks == ("planned without what the linear model leaves out: dry friction of joint x: 0.2 N",)
    assert invtrack.max_error(run(block())) < 1e-6


def test_feedback_holds_a_stuck_block_to_friction_over_stiffness() -> None:
    """At rest at the end, |K_x e| <= F."""
    friction, K = 0.2, np.array([[40.0, 12.0]])
    result = run(block(joint=f'frictionloss="{friction}"'), K, end=4.0)
    assert abs(result.error[-1, 0]) <= 1.05 * friction / K[0, 0]


@pytest.mark.parametrize("start", [-3.0, 0.0, 5.0])
def test_a_delayed_actuator_moves_the_block_late(start: float) -> None:
    """Without feedback the whole motion is late by the delay, whatever the clock shows.

    By h/6 less, in fact: the last of RK4's stages, with its weight of a sixth, already reads the next control from the buffer.
    """
    delay, h = 0.02, 1e-3
    plant = block(push=f'delay="{delay}" nsample="40"')
    plan = invtrack.invert(invtrack.linearize(plant), REFERENCE.shifted(start))
    result = invtrack.simulate(plant, invtrack.TrackingController(plan), timestep=h, end=start + 2.0)
    late = REFERENCE(result.time - start - delay + h / 6)
    np.testing.assert_allclose(result.output.values, late, atol=2e-6)


def test_a_delay_that_the_buffer_does_not_hold_is_refused_and_the_advice_leads_on() -> None:
    with pytest.raises(
        SimulationError, match=r"'push' acts 0.02 s late, which is up to 20 steps .* the last 10 only; set nsample=20"
    ):
        run(block(push='delay="0.02" nsample="10"'))
    assert invtrack.max_error(run(block(push='delay="0.02" nsample="20"'))) < 0.05


def test_a_delayed_actuator_that_holds_a_load_keeps_holding_it() -> None:
    plant = block(push='delay="0.05" nsample="60"', joint='stiffness="10"').at(qpos={"x": 0.3}, ctrl={"push": 3.0})
    plan = invtrack.invert(invtrack.linearize(plant), invtrack.rest_to_rest(0.3, 0.3, duration=0.2))
    result = invtrack.simulate(plant, invtrack.TrackingController(plan), timestep=1e-3, start=0.0, end=1.0)
    np.testing.assert_allclose(result.output.values, 0.3, atol=1e-12)
