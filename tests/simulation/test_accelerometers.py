"""Observers with accelerometers, on which the input acts at once: the usual sensor at the tip of a flexible mechanism."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

import invtrack
from invtrack.plant import with_input_limits

# A hoist: a carriage that a motor lifts, a load of 1 kg on a spring above it, both against gravity; an accelerometer on each.
HOIST = """
<mujoco model="hoist">
  <option gravity="0 0 -9.81" integrator="RK4"/>
  <worldbody>
    <body name="carriage">
      <joint name="lift" type="slide" axis="0 0 1" damping="2"/>
      <inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/>
      <site name="carriage"/>
      <body name="load" pos="0 0 0.5">
        <joint name="stretch" type="slide" axis="0 0 1" stiffness="80"/>
        <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
        <site name="tip"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="force" joint="lift"/></actuator>
  <sensor><accelerometer name="at_carriage" site="carriage"/><accelerometer name="at_tip" site="tip"/></sensor>
</mujoco>"""
MEASUREMENTS = ("joint:lift", "at_carriage[2]", "at_tip[2]")
POLES = (-4 + 3j, -4 - 3j, -6 + 2j, -6 - 2j)
PERIOD = 0.01


class Rig:
    """The hoist at rest, its linear model, a plan and gains."""

    def __init__(self) -> None:
        plant = invtrack.Plant.from_xml(HOIST, inputs=["force"], outputs=["site:tip:z"], measurements=MEASUREMENTS)
        self.plant = invtrack.trim(plant, outputs={"site:tip:z": 0.5}).plant
        self.model = invtrack.linearize(self.plant)
        self.plan = invtrack.invert(self.model, invtrack.rest_to_rest(0.5, 0.8, duration=1.5, smoothness=6), tolerance=1e-8)
        self.gains = invtrack.lqr(self.model, Q=100.0, R=0.1)

    def run(self, plant: invtrack.Plant | invtrack.LinearPlant, plan: invtrack.Plan, **options: object) -> invtrack.RunResult:
        delay = options.pop("measurement_delay", 0.0)
        observer = invtrack.LuenbergerObserver(POLES)
        controller = invtrack.OutputFeedbackController(
            plan,
            self.gains,
            observer,
            period=PERIOD,
            measurement_delay=delay,  # type: ignore[arg-type]
        )
        settings = {"timestep": 2.5e-3, "start": 0.0, "end": 2.5, "initial_state": self.plan(0.0).x[0], **options}
        return invtrack.simulate(plant, controller, **settings)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def rig() -> Rig:
    return Rig()


def test_feedthrough_is_force_over_mass(rig: Rig) -> None:
    """At once the force accelerates the carriage alone; sensors at rest show gravity."""
    np.testing.assert_allclose(rig.model.measurement.D[:, 0], [0, 1 / 2, 0], atol=1e-9)
    np.testing.assert_allclose(rig.model.measurement.y0[1:], [9.81, 9.81], rtol=1e-9)
    assert rig.model.operating_point.u0 == pytest.approx([3 * 9.81])


def test_physics_and_linear_model_track_alike(rig: Rig) -> None:
    physics, prediction = (rig.run(plant, rig.plan) for plant in (rig.plant, invtrack.LinearPlant(rig.model)))
    np.testing.assert_allclose(physics.measured.values, prediction.measured.values, atol=1e-7)
    np.testing.assert_allclose(physics.output.values, prediction.output.values, atol=1e-8)
    assert invtrack.max_error(physics) < 1e-4 * 0.3
    np.testing.assert_allclose(physics.estimate.values, physics.state.values[:-1], atol=1e-2)


@pytest.mark.parametrize("kind", ["mujoco", "linear"])
def test_a_wrong_start_is_estimated_away_at_the_chosen_poles(rig: Rig, kind: str) -> None:
    """From update to update the estimation error is multiplied by (I - M C) A_d, whatever the feedback does meanwhile."""
    plant = rig.plant if kind == "mujoco" else invtrack.LinearPlant(rig.model)
    wrong = np.array([0.02, -0.03, 0.1, 0.05])
    result = rig.run(plant, rig.plan, initial_state=rig.plan(0.0).x[0] + wrong)
    C, A_d = rig.model.measurement.C, expm(rig.model.A * PERIOD)
    M = invtrack.LuenbergerObserver(POLES).gain(rig.model, PERIOD)
    every = round(PERIOD / 2.5e-3)
    found = (result.state.values[:-1] - result.estimate.values)[::every][:100]
    expected = [(np.eye(4) - M @ C) @ wrong]
    while len(expected) < len(found):
        expected.append((np.eye(4) - M @ C) @ A_d @ expected[-1])
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.max(np.abs(expected)))


def test_an_observer_that_ignores_the_feedthrough_is_led_astray(rig: Rig) -> None:
    """Six times and more: what the law knows of the input is used."""
    ignorant = replace(rig.model, measurement=replace(rig.model.measurement, D=np.zeros((3, 1))))
    blind = invtrack.invert(ignorant, rig.plan.reference, tolerance=1e-8)
    assert invtrack.max_error(rig.run(rig.plant, blind)) > 6 * invtrack.max_error(rig.run(rig.plant, rig.plan))


@pytest.mark.parametrize("delay", [PERIOD / 2, PERIOD])
def test_late_accelerometers(rig: Rig, delay: float) -> None:
    late = {name: invtrack.Sensor(delay=delay) for name in MEASUREMENTS}
    ignored = invtrack.max_error(rig.run(rig.plant, rig.plan, sensors=late))
    known = invtrack.max_error(rig.run(rig.plant, rig.plan, sensors=late, measurement_delay=delay))
    assert known < 0.01 * ignored


def test_kalman_filter_makes_use_of_the_accelerometer(rig: Rig) -> None:
    """With a coarse position sensor, the deviation of the load's estimated speed falls by far with the accelerometers."""
    linear, spread = invtrack.LinearPlant(rig.model), {}
    for deviations in ((2e-2, 1e-2, 1e-2), (2e-2, 1e3, 1e3)):
        observer = invtrack.KalmanFilter(input_noise=0.1, measurement_noise=deviations)
        controller = invtrack.OutputFeedbackController(rig.plan, rig.gains, observer, period=PERIOD)
        sensors = {name: invtrack.Sensor(noise=noise) for name, noise in zip(MEASUREMENTS, (2e-2, 1e-2, 1e-2), strict=True)}
        result = invtrack.simulate(linear, controller, timestep=PERIOD, start=0.0, end=8.0, sensors=sensors, seed=2)
        spread[deviations[1]] = np.std(result.estimate.values - result.state.values[:-1], axis=0)
    assert spread[1e-2][1] < 0.5 * spread[1e3][1]


@pytest.mark.parametrize("plant", ["mujoco", "linear"])
def test_an_input_that_is_cut_off_does_not_lead_the_estimate_astray(rig: Rig, plant: str) -> None:
    """Half of what the plan needs is passed on; the plant falls behind, and the estimate knows where it is."""
    low, high = rig.plan.input_range
    rest = rig.model.operating_point.u0
    bounds = np.column_stack([rest + (low - rest) / 2, rest + (high - rest) / 2])
    limited = with_input_limits(rig.plant, {"force": bounds[0]})
    plan = invtrack.invert(invtrack.linearize(limited), rig.plan.reference, tolerance=1e-8)
    real = limited if plant == "mujoco" else invtrack.LinearPlant(plan.model)
    with pytest.warns(RuntimeWarning, match="expect saturation"):
        result = rig.run(real, plan)
    assert np.any(result.applied.values != result.commanded.values)
    assert invtrack.max_error(result) > 0.03
    every = round(PERIOD / 2.5e-3)
    away = (result.estimate.values - result.state.values[:-1])[::every]
    assert np.max(np.abs(away)) < 1e-6 * np.max(np.abs(result.state.values))
