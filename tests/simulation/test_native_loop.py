"""The compiled loop means what a loop in plain Python says, alone, side by side with others, and in the next process."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import invtrack
from invtrack.control.protocol import Instants, Law
from invtrack.errors import SimulationError
from tests.plant.mechanisms import BALL_PENDULUM, LAGGED_SLIDER, cantilever
from tests.simulation.reference_loop import python_loop


def two_disc() -> invtrack.Plant:
    return invtrack.Plant.from_xml(invtrack.model_path("two_disc"), inputs=["motor"], outputs=["disc2_angle"])


def followed(plant: invtrack.Plant, *, size: float = 0.3, **options: Any) -> invtrack.TrackingController:
    model = invtrack.linearize(plant)
    n = model.n_outputs
    reference = invtrack.rest_to_rest(np.zeros(n), np.full(n, size), 1.0, smoothness=4)
    plan = invtrack.invert(model, reference, max_preactuation=0.5)
    turns_freely = "ball.rz" in model.states.names  # about its own axis, which no torque moves: no LQR
    gains = np.hstack([np.eye(2, 3), np.eye(2, 3)]) if turns_freely else invtrack.lqr(model, Q=1.0, R=1.0)
    return invtrack.TrackingController(plan, gains, **options)


def slider(integrator: str) -> invtrack.Plant:
    text = LAGGED_SLIDER.replace('integrator="RK4"', f'integrator="{integrator}"')
    return invtrack.Plant.from_xml(text, inputs=["drive"], outputs=["position"])


def pendulum() -> invtrack.Plant:
    return invtrack.Plant.from_xml(BALL_PENDULUM, inputs=["torque_x", "torque_y"], outputs=["joint:ball:rx", "joint:ball:ry"])


def size_of(trace: np.ndarray) -> float:
    return float(np.max(np.abs(trace)))


PLANTS = {
    "coupled, RK4": two_disc,
    "activation, Euler": lambda: slider("Euler"),
    "activation, implicit": lambda: slider("implicitfast"),
    "quaternion, RK4": pendulum,
}


@pytest.mark.parametrize("evaluate", ["held", "stages"])
@pytest.mark.parametrize("name", PLANTS)
def test_states_and_inputs_are_those_of_a_loop_in_python(name: str, evaluate: str) -> None:
    plant = PLANTS[name]()
    if evaluate == "stages" and "RK4" not in name:
        pytest.skip("stages are those of RK4")
    controller = followed(plant)
    span = {"start": -0.25, "end": 1.5, "timestep": 4e-3}
    result = invtrack.simulate(plant, controller, evaluate=evaluate, initial_state=np.zeros(plant.n_states), **span)  # type: ignore[arg-type]
    expected = python_loop(plant, controller, evaluate=evaluate, **span)  # type: ignore[arg-type]
    assert size_of(result.state.values - expected.x) < 1e-12 * max(size_of(expected.x), 1.0)
    assert size_of(result.commanded.values - expected.u) < 1e-11 * size_of(expected.u)


def sphere() -> invtrack.Plant:
    """A ball joint that a torque about each axis turns."""
    body = """<mujoco model="sphere"><option integrator="RK4" gravity="0 0 0"/><worldbody><body><joint name="ball" type="ball"/>
    <site name="c"/><inertial pos="0 0 0" mass="1" diaginertia=".3 .2 .1"/></body></worldbody>
    <actuator><motor name="x" site="c" gear="0 0 0 1 0 0"/><motor name="y" site="c" gear="0 0 0 0 1 0"/>
    <motor name="z" site="c" gear="0 0 0 0 0 1"/></actuator></mujoco>"""
    outputs = [f"joint:ball:{axis}" for axis in ("rx", "ry", "rz")]
    plant = invtrack.Plant.from_xml(body, inputs=["x", "y", "z"], outputs=outputs)
    return plant.at(qpos={"ball": [0.9, 0.1, -0.3, 0.2]})


@pytest.mark.parametrize("evaluate", ["held", "stages"])
def test_rotations_are_fed_back_in_the_tangent_space_of_what_is_planned(evaluate: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A turn by a radian, from a place beside its start; no call of Python on the way."""
    plant = sphere()
    start = plant.measure(plant.new_data(plant.model))
    reference = invtrack.rest_to_rest(start, start + np.array([0.7, -0.4, 0.6]), 1.0)
    plan = invtrack.invert(plant, reference)
    controller = invtrack.TrackingController(plan, invtrack.lqr(plan, Q=1.0, R=1.0))
    span = {"start": -0.2, "end": 1.2, "timestep": 5e-3, "evaluate": evaluate}
    expected = python_loop(plant, controller, **span)  # type: ignore[arg-type]
    monkeypatch.delattr(invtrack.control.DifferenceLaw, "update")
    result = invtrack.simulate(plant, controller, initial_state=np.zeros(plant.n_states), **span)  # type: ignore[arg-type]
    assert size_of(result.state.values - expected.x) < 1e-12 * max(size_of(expected.x), 1.0)
    assert size_of(result.commanded.values - expected.u) < 1e-11 * size_of(expected.u)


def test_an_estimator_on_noisy_late_digital_sensors_sees_the_same() -> None:
    plant = cantilever()
    model = invtrack.SwitchedSystem([invtrack.linearize(plant, tip_mass=mass) for mass in (0.0, 10.0)], [0.4])
    plan = invtrack.invert(model, invtrack.rest_to_rest(0.0, 0.3, 1.0, smoothness=4), max_preactuation=0.5)
    gains = invtrack.lqr(model, Q=1.0, R=1e-3)
    controller = invtrack.OutputFeedbackController(
        plan, gains, invtrack.KalmanFilter(1.0, 1e-3), period=0.0107, measurement_delay=0.006
    )
    sensors = {name: invtrack.Sensor(noise=1e-4, quantization=1e-5, delay=0.006) for name in plant.measurements.names}
    span = {"start": -0.2, "end": 1.4, "timestep": 2e-3}
    changes = [invtrack.Change(0.4, tip_mass=10.0)]
    result = invtrack.simulate(
        plant,
        controller,
        schedule=changes,
        sensors=sensors,
        seed=7,
        initial_state=np.zeros(plant.n_states),
        **span,  # type: ignore[arg-type]
    )
    expected = python_loop(plant, controller, changes=changes, sensors=sensors, seed=7, **span)  # type: ignore[arg-type]
    # Rounding may move a value over the edge of a digit, but nothing does so here.
    assert size_of(result.measured.values - expected.measured) < 1e-12
    assert size_of(result.state.values - expected.x) < 1e-10 * size_of(expected.x)
    assert size_of(result.commanded.values - expected.u) < 1e-10 * size_of(expected.u)


class Called:
    """A controller whose law is an object in Python that passes everything on to a built-in one."""

    def __init__(self, inner: Any, *, fails_at: int | None = None) -> None:
        self._inner, self._fails_at = inner, fails_at

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)

    def begin(self, instants: Instants) -> Law:
        outer, law = self, self._inner.begin(instants)

        class InPython:
            @property
            def estimate(self) -> Any:
                return law.estimate

            def update(self, index: int, measurement: np.ndarray) -> np.ndarray:
                if index == outer._fails_at:
                    raise KeyError("the sensor bus is down")
                result: np.ndarray = law.update(index, measurement)
                return result

        return InPython()


@pytest.mark.parametrize("kind", ["held", "stages", "linear", "linear stages", "estimator"])
def test_a_law_in_python_does_what_the_built_in_one_does(kind: str) -> None:
    plant: Any = two_disc()
    controller: Any = followed(plant)
    if kind == "estimator":
        controller = invtrack.OutputFeedbackController(
            controller.plan, controller.gains, invtrack.KalmanFilter(1.0, 1e-3), period=0.01
        )
    if "linear" in kind:
        plant = invtrack.LinearPlant(controller.plan.model)
    options: dict[str, Any] = {"start": -0.3, "end": 1.2, "timestep": 5e-3, "initial_state": np.zeros(4)}
    options["evaluate"] = "stages" if "stages" in kind else "held"
    built_in = invtrack.simulate(plant, controller, **options)
    called = invtrack.simulate(plant, Called(controller), **options)
    assert size_of(built_in.state.values - called.state.values) < 1e-12 * size_of(built_in.state.values)
    assert size_of(built_in.commanded.values - called.commanded.values) < 1e-12 * size_of(built_in.commanded.values)
    assert size_of(built_in.estimate.values - called.estimate.values) < 1e-12 if kind == "estimator" else True


@pytest.mark.parametrize("evaluate", ["held", "stages"])
def test_an_exception_in_a_law_reaches_the_caller(evaluate: Any) -> None:
    plant = two_disc()
    controller: Any = Called(followed(plant), fails_at=100)
    with pytest.raises(KeyError, match="the sensor bus is down"):
        invtrack.simulate(plant, controller, start=-0.3, end=1.2, timestep=5e-3, evaluate=evaluate, initial_state=np.zeros(4))
    assert (mujoco.get_mjcb_control(), mujoco.get_mjcb_passive()) == (None, None)


def test_an_input_of_the_wrong_shape_is_refused() -> None:
    plant = two_disc()
    controller = followed(plant)

    class Wide(Called):
        def begin(self, instants: Instants) -> Any:
            return WideLaw()

    class WideLaw:
        estimate = None

        def update(self, index: int, measurement: np.ndarray) -> np.ndarray:
            return np.zeros(2)

    wide: Any = Wide(controller)
    with pytest.raises(SimulationError, match=r"must return an input \(1,\), got shape \(2,\)"):
        invtrack.simulate(plant, wide, start=-0.3, end=1.2, timestep=5e-3, initial_state=np.zeros(4))


def test_runs_in_threads_are_those_made_one_by_one() -> None:
    """Couplings, laws at stages and warnings of runs that go on at the same time do not mix."""
    plant, size = two_disc(), [0.1, 0.2, 0.3, 0.4]
    controllers = [followed(plant, size=each) for each in size]

    def run(controller: invtrack.TrackingController) -> np.ndarray:
        options: dict[str, Any] = {"start": -0.3, "end": 1.5, "timestep": 1e-3, "initial_state": np.zeros(4), "evaluate": "stages"}
        values: np.ndarray = invtrack.simulate(plant, controller, **options).state.values
        return values

    alone = [run(controller) for controller in controllers]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(run, controllers * 3))
    assert all(np.array_equal(a, b) for a, b in zip(alone * 3, together, strict=True))
    assert (mujoco.get_mjcb_control(), mujoco.get_mjcb_passive()) == (None, None)


def test_models_can_be_compiled_while_another_thread_runs() -> None:
    plant = two_disc()
    controller, done = followed(plant), threading.Event()
    options: dict[str, Any] = {"start": -0.3, "end": 6.0, "timestep": 1e-3, "initial_state": np.zeros(4)}
    alone = invtrack.simulate(plant, controller, **options)

    def load() -> int:
        loaded = 0
        while not done.is_set() or loaded == 0:
            two_disc()
            loaded += 1
        return loaded

    with ThreadPoolExecutor(1) as pool:
        loading = pool.submit(load)
        together = invtrack.simulate(plant, controller, **options)
        done.set()
    assert loading.result() > 0
    assert np.array_equal(alone.state.values, together.state.values)


PROGRAM = """
import invtrack, numpy as np
plant = invtrack.Plant.from_xml(invtrack.model_path("two_disc"), inputs=["motor"], outputs=["disc2_angle"])
reference = invtrack.rest_to_rest(0.0, 0.1, 1.0)
invtrack.invert(plant, reference, max_preactuation=0.5)
controller = invtrack.TrackingController(invtrack.invert(invtrack.linearize(plant), reference, max_preactuation=0.5))
for evaluate in ("held", "stages"):
    invtrack.simulate(plant, controller, start=-0.1, end=1.0, evaluate=evaluate, initial_state=np.zeros(4))
"""


def test_a_second_process_compiles_nothing() -> None:
    """Of what plans and runs of the first compile: what is not found on disk would count as a miss.

    Test processes that compile side by side may write over each other's list of what is kept; a process after them adds what lacks.
    """
    exec(PROGRAM, {})
    counted = f"""
import numba
from numba.core import event
with event.install_recorder("numba:compile") as record:
    {PROGRAM.replace(chr(10), chr(10) + "    ")}
    count = len(record.buffer)
    numba.njit(lambda: 0)()
print(count, len(record.buffer) > count)
"""
    command = [sys.executable, "-W", "error", "-c", counted]
    environment = {**os.environ, "PYTHONPATH": str(Path(invtrack.__file__).parents[1])}

    def compiled() -> list[str]:
        finished = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        assert finished.returncode == 0, finished.stderr
        return finished.stdout.split()[-2:]

    found = compiled()
    assert (found if found[0] == "0" else compiled()) == ["0", "True"]
