"""What the loop promises on any plant: sides, limits, divergence, refusals."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

import invtrack
from invtrack.errors import SimulationError
from invtrack.testing import assert_residual_vibration

OSCILLATOR = """
<mujoco model="oscillator">
  <option gravity="0 0 0" integrator="{integrator}"/>
  <worldbody>
    <body name="cart">
      <joint name="slide" type="slide" axis="1 0 0" stiffness="{stiffness}"/>
      <geom size="0.1" mass="2"/>
    </body>
  </worldbody>
  <actuator><motor name="force" joint="slide" {limits}/></actuator>
  <sensor><jointpos name="position" joint="slide"/></sensor>
</mujoco>
"""


def oscillator(folder: Path, *, integrator: str = "RK4", stiffness: float = 8.0, limits: str = "") -> invtrack.Plant:
    path = folder / "oscillator.xml"
    path.write_text(OSCILLATOR.format(integrator=integrator, stiffness=stiffness, limits=limits))
    return invtrack.Plant.from_xml(path, inputs=["force"], outputs=["position"], parameters={"mass": "body:cart:mass:scaled"})


def plan(plant: invtrack.Plant, **options: float) -> invtrack.Plan:
    return invtrack.invert(invtrack.linearize(plant), invtrack.rest_to_rest(0.0, 1.0, 1.0), **options)


def test_architecture_program_runs_as_written(tmp_path: Path) -> None:
    plant = invtrack.Plant.from_xml(
        invtrack.model_path("cantilever"),
        inputs=["base_force"],
        outputs=["tip_position"],
        parameters={"tip_mass": "body:tip:mass"},
    )
    light, heavy = (invtrack.linearize(plant, tip_mass=m) for m in (0.0, 100.0))
    model = invtrack.SwitchedSystem([light, heavy], switch_times=[3.0])
    reference = invtrack.rest_to_rest(0.0, 2.0, duration=6.0)
    plan = invtrack.invert(model, reference)
    controller = invtrack.TrackingController(plan, gains=invtrack.lqr(model, Q=100.0, R=0.01))
    result = invtrack.simulate(plant, controller, timestep=5e-3)
    assert_residual_vibration(result, at_most=1e-5)
    invtrack.save_recording(result, tmp_path / "run.rrd")
    assert invtrack.load_recording(tmp_path / "run.rrd")["run"].equals(result)


def test_a_step_in_mass_keeps_position_and_velocity_and_changes_acceleration(tmp_path: Path) -> None:
    plant = oscillator(tmp_path, stiffness=0.0)
    controller = invtrack.TrackingController(plan(plant))
    result = invtrack.simulate(plant, controller, schedule=[invtrack.Change(0.25, mass=4.0)], timestep=1e-3, end=0.5)
    at = int(np.flatnonzero(result.time == 0.25)[0])
    acceleration = np.diff(result.state["slide velocity"]) / np.diff(result.time)
    u = result.applied["force"]
    assert acceleration[at - 1] == pytest.approx(u[at - 1] / 2.0, rel=1e-9)
    assert acceleration[at] == pytest.approx(u[at] / 4.0, rel=1e-9)
    assert result.parameters["mass"][at - 1 : at + 1].tolist() == [2.0, 4.0]


def test_outputs_and_states_belong_to_the_same_instant(tmp_path: Path) -> None:
    plant = oscillator(tmp_path)
    result = invtrack.simulate(plant, invtrack.TrackingController(plan(plant)), timestep=1e-2, end=1.5)
    assert np.array_equal(result.output["position"], result.state["slide"])


def test_saturation_is_the_actuators_and_both_inputs_are_kept(tmp_path: Path) -> None:
    plant = oscillator(tmp_path, limits='ctrllimited="true" ctrlrange="-5 5"')
    with pytest.warns(RuntimeWarning, match=r"the plan needs force from -4\.145 to 12\.14 N, its actuator passes on -5 to 5"):
        result = invtrack.simulate(plant, invtrack.TrackingController(plan(plant)), timestep=1e-3, end=2.0)
    assert invtrack.results.peak_input(result) == 5.0
    assert np.max(np.abs(result.commanded.values)) > 10
    assert invtrack.max_error(result) > 0.1


def test_divergence_stops_the_run_with_time_and_cause_and_keeps_the_record(tmp_path: Path) -> None:
    plant = oscillator(tmp_path, stiffness=0.0)
    unstable = invtrack.TrackingController(plan(plant), np.array([[-400.0, -40.0]]))
    result = invtrack.simulate(plant, unstable, timestep=1e-2, end=60.0, initial_state=[1e-3, 0.0])
    assert result.status == "diverged"
    assert 0 < result.time[-1] < 60
    assert "MuJoCo reports" in result.message
    assert np.all(np.isfinite(result.state.values))
    assert len(result.time) == len(result.state.values) == len(result.commanded.values) + 1
    assert result.events[-1].kind == "end"


def test_period_of_the_slowest_mode_is_that_of_the_plans_last_interval(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plant = oscillator(tmp_path)
    heavy, light = (invtrack.linearize(plant, mass=mass) for mass in (2.0, 0.5))
    reference = invtrack.rest_to_rest(0.0, 1.0, 1.0)
    switched = invtrack.invert(invtrack.SwitchedSystem([heavy, light], [0.5]), reference)
    rigid = oscillator(tmp_path, stiffness=0.0)
    free = invtrack.invert(invtrack.linearize(rigid), reference)
    monkeypatch.setattr(mujoco, "mj_differentiatePos", None)  # nothing is linearized from here on
    for mechanism, planned, period in ((plant, switched, 2 * np.pi / 4.0), (rigid, free, np.nan)):
        run = invtrack.simulate(mechanism, invtrack.TrackingController(planned), timestep=1e-2, end=1.5)
        assert run.vibration_period == pytest.approx(period, nan_ok=True)


def test_two_runs_at_once_do_not_see_each_others_callbacks(tmp_path: Path) -> None:
    plant = oscillator(tmp_path)
    alone = invtrack.simulate(plant, invtrack.TrackingController(plan(plant)), timestep=1e-2, end=1.0, evaluate="stages")
    other = oscillator(tmp_path, stiffness=50.0)

    def disturb(share: float) -> None:
        invtrack.linearize(other)
        data = mujoco.MjData(other.model)
        mujoco.mj_step(other.model, data)

    result = invtrack.simulate(
        plant, invtrack.TrackingController(plan(plant)), timestep=1e-2, end=1.0, evaluate="stages", progress=disturb
    )
    assert result.equals(alone)
    assert mujoco.get_mjcb_control() is None


def test_callback_is_cleared_after_an_exception(tmp_path: Path) -> None:
    plant = oscillator(tmp_path)

    def fail(share: float) -> None:
        raise RuntimeError("stop here")

    with pytest.raises(RuntimeError, match="stop here"):
        invtrack.simulate(plant, invtrack.TrackingController(plan(plant)), timestep=1e-2, evaluate="stages", end=1.0, progress=fail)
    assert mujoco.get_mjcb_control() is None


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"timestep": -1e-3}, "timestep must be a positive number"),
        ({"start": 2.0, "end": 1.0}, "must end after it starts"),
        ({"evaluate": "end"}, "evaluate must be"),
        ({"initial_state": [0.0]}, r"\(2,\): slide \[m\], slide velocity \[m/s\]; got shape"),
        ({"schedule": [invtrack.Change(0.5, masse=1.0)]}, "the plant's are: mass"),
        ({"schedule": [invtrack.Change(0.5, mass=1.0), invtrack.Change(0.5, mass=2.0)]}, "two changes at"),
    ],
)
def test_bad_requests_are_refused(tmp_path: Path, options: dict[str, object], message: str) -> None:
    plant = oscillator(tmp_path)
    with pytest.raises(SimulationError, match=message):
        invtrack.simulate(plant, invtrack.TrackingController(plan(plant)), **options)  # type: ignore[arg-type]


def test_continuous_hold_needs_the_stages_of_rk4(tmp_path: Path) -> None:
    plant = oscillator(tmp_path, integrator="Euler")
    with pytest.raises(SimulationError, match="stages of RK4"):
        invtrack.simulate(plant, invtrack.TrackingController(plan(plant)), evaluate="stages")


def test_a_plan_for_another_plant_is_refused(tmp_path: Path) -> None:
    plant = oscillator(tmp_path)
    other = invtrack.StateSpace([[0, 1], [-4, 0]], [[0], [0.5]], [[1, 0]])
    controller = invtrack.TrackingController(invtrack.invert(other, invtrack.rest_to_rest(0.0, 1.0, 1.0)))
    with pytest.raises(SimulationError, match=r"the plan's states are x1, x2, the plant's are slide \[m\], slide velocity"):
        invtrack.simulate(plant, controller)
    moved = plant.at(qpos=[0.5], ctrl=[4.0])
    with pytest.raises(SimulationError, match="another operating point"):
        invtrack.simulate(moved, invtrack.TrackingController(plan(plant)))


@pytest.mark.parametrize(("time", "values", "message"), [(np.nan, {"m": 1.0}, "a finite number"), (1.0, {}, "names no parameter")])
def test_bad_changes_are_refused(time: float, values: dict[str, float], message: str) -> None:
    with pytest.raises(SimulationError, match=message):
        invtrack.Change(time, **values)
