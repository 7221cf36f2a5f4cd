"""What changes in a run: by default what the plan was made for, its first values included."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import invtrack
from invtrack.errors import SimulationError

CARTS = """
<mujoco model="carts">
  <option gravity="0 0 0" integrator="RK4"/>
  <worldbody>
    <body name="cart">
      <joint name="slide" type="slide" axis="1 0 0" stiffness="8" damping="1"/>
      <geom size="0.1" mass="2"/>
    </body>
  </worldbody>
  <actuator><motor name="force" joint="slide"/></actuator>
  <sensor><jointpos name="position" joint="slide"/></sensor>
</mujoco>
"""
PARAMETERS = {"mass": "body:cart:mass", "damping": "joint:slide:damping"}
SLEW = invtrack.rest_to_rest(0.0, 1.0, 1.0)


@pytest.fixture
def plant(tmp_path: Path) -> invtrack.Plant:
    return cart(tmp_path, PARAMETERS)


def cart(folder: Path, parameters: dict[str, object]) -> invtrack.Plant:
    path = folder / "cart.xml"
    path.write_text(CARTS)
    return invtrack.Plant.from_xml(path, inputs=["force"], outputs=["position"], parameters=parameters)  # type: ignore[arg-type]


def controller(plant: invtrack.Plant, *masses: float, at: tuple[float, ...] = ()) -> invtrack.TrackingController:
    model = invtrack.SwitchedSystem([invtrack.linearize(plant, mass=mass) for mass in masses], at)
    return invtrack.TrackingController(invtrack.invert(model, SLEW), invtrack.lqr(model, Q=1.0, R=1.0))


def test_a_linear_model_knows_the_parameters_it_holds_for(plant: invtrack.Plant) -> None:
    light = invtrack.linearize(plant, mass=1)
    assert light.parameters == {"mass": 1.0, "damping": 1.0}
    assert light.transformed(np.eye(2)).parameters == light.parameters
    assert invtrack.StateSpace(light.A, light.B, light.C).parameters == {}


def test_a_plan_knows_what_changes_when(plant: invtrack.Plant) -> None:
    plan = controller(plant, 1.0, 4.0, 4.0, 3.0, at=(0.25, 0.5, 0.75)).plan
    assert plan.model.parameters == {"mass": 1.0, "damping": 1.0}
    assert plan.schedule == ((0.25, {"mass": 4.0}), (0.75, {"mass": 3.0}))


def test_intervals_for_values_of_other_parameters_are_refused(plant: invtrack.Plant) -> None:
    known = invtrack.linearize(plant)
    with pytest.raises(invtrack.InvtrackError, match="interval 1 holds for values of the parameters none, interval 0 of mass"):
        invtrack.SwitchedSystem([known, invtrack.StateSpace(known.A, known.B, known.C, **channels(known))], [1.0])


def channels(model: invtrack.StateSpace) -> dict[str, invtrack.Channels]:
    return {"states": model.states, "inputs": model.inputs, "outputs": model.outputs}


def test_a_run_begins_and_goes_on_with_the_values_of_the_plan(plant: invtrack.Plant) -> None:
    run = invtrack.simulate(plant, controller(plant, 1.0, 4.0, at=(0.25,)), timestep=1e-3)
    at = int(np.flatnonzero(run.time == 0.25)[0])
    assert run.parameters["mass"][[0, at - 1, at, -1]].tolist() == [1.0, 1.0, 4.0, 4.0]
    assert [event.text for event in run.events if event.kind == "parameter"] == ["mass = 4 kg"]
    acceleration = np.diff(run.state["slide velocity"]) / np.diff(run.time)
    force = run.applied["force"] - 8 * run.state["slide"][:-1] - run.state["slide velocity"][:-1]
    np.testing.assert_allclose(acceleration[[at - 1, at]], force[[at - 1, at]] / [1.0, 4.0], rtol=1e-2)
    assert invtrack.max_error(run) < 1e-5


def test_a_stated_schedule_starts_from_the_plants_own_values(plant: invtrack.Plant) -> None:
    planned = controller(plant, 1.0, 4.0, at=(0.25,))
    still = invtrack.simulate(plant, planned, schedule=(), timestep=1e-2)
    late = invtrack.simulate(plant, planned, schedule=[invtrack.Change(0.5, mass=3.0)], timestep=1e-2)
    assert set(still.parameters["mass"]) == {2.0}
    assert list(dict.fromkeys(late.parameters["mass"])) == [2.0, 3.0]
    assert min(invtrack.max_error(run) for run in (still, late)) > 1e-2


def test_a_linear_plant_switches_by_itself(plant: invtrack.Plant) -> None:
    planned = controller(plant, 1.0, 4.0, at=(0.25,))
    run = invtrack.simulate(invtrack.LinearPlant(planned.plan.model), planned, timestep=1e-2)
    assert run.parameters.channels == invtrack.Channels()
    assert [event.time for event in run.events if event.kind == "parameter"] == [0.25]


def test_a_plan_for_parameters_that_the_plant_lacks_is_refused(plant: invtrack.Plant, tmp_path: Path) -> None:
    other = cart(tmp_path, {"mass": PARAMETERS["mass"]})
    with pytest.raises(SimulationError, match=r"made for values of damping; the plant's parameters are: mass \[kg\]. .*schedule="):
        invtrack.simulate(other, controller(plant, 2.0), timestep=1e-2)
    invtrack.simulate(other, controller(plant, 2.0), schedule=(), timestep=1e-2)
