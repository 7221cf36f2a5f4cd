"""Controllers with a few imperfect sensors, and the linear model as the prediction of the physics."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import invtrack
from invtrack.channels import Channels
from invtrack.errors import SimulationError
from invtrack.linear.state_space import Measurement
from invtrack.simulation.linear_plant import linear_plant
from invtrack.simulation.simulated_plant import SensorChain
from tests.simulation.reference_loop import stepped
from tests.simulation.rigs import JUMPS, Rig, cantilever_rig

POLES = (-2 + 2j, -2 - 2j, -1.5 + 1j, -1.5 - 1j, -1 + 0.5j, -1 - 0.5j)
START, STOP = -5.0, 15.0


@pytest.fixture(scope="module")
def rig() -> Rig:
    return cantilever_rig(measurements=("base_position", "tip_position"))


def run(rig: Rig, plant: invtrack.Plant | invtrack.LinearPlant, controller: object, **options: object) -> invtrack.RunResult:
    settings: dict[str, object] = {"timestep": 2e-3, "start": START, "end": STOP, **options}
    settings.setdefault("initial_state", rig.plan(START).x[0])
    return invtrack.simulate(plant, controller, **settings)  # type: ignore[arg-type]


def with_observer(rig: Rig, **options: object) -> invtrack.OutputFeedbackController:
    return invtrack.OutputFeedbackController(rig.plan, rig.gains, invtrack.LuenbergerObserver(POLES), **options)  # type: ignore[arg-type]


def test_linear_model_predicts_the_physics(rig: Rig) -> None:
    linear = invtrack.LinearPlant(rig.model, input_limits=rig.plant.input_limits)
    noise = {
        "tip_position": invtrack.Sensor(noise=1e-3, quantization=1e-4),
        "base_position": invtrack.Sensor(noise=1e-3, delay=0.015),
    }
    state = invtrack.TrackingController(rig.plan, rig.gains, period=0.01)
    for controller, sensors in ((state, {}), (with_observer(rig, period=0.01), noise)):
        physics = run(rig, rig.plant, controller, sensors=sensors)
        prediction = run(rig, linear, controller, sensors=sensors)
        assert np.array_equal(physics.time, prediction.time)
        np.testing.assert_allclose(physics.output.values, prediction.output.values, atol=1e-6)
        assert physics.output.channels == prediction.output.channels


def test_linear_plant_tracks_to_the_same_order(rig: Rig) -> None:
    linear = invtrack.LinearPlant(rig.model)
    for evaluate, steps, order in (("held", (8e-3, 4e-3), 2), ("stages", (0.16, 0.08), 4)):
        errors = [invtrack.max_error(run(rig, linear, rig.controller, evaluate=evaluate, timestep=step)) for step in steps]
        assert np.log(errors[0] / errors[1]) / np.log(steps[0] / steps[1]) == pytest.approx(order, abs=0.25)


def test_without_noise_the_observer_costs_nothing_on_the_plan(rig: Rig) -> None:
    """Also where the plant jumps within a hold: what holding the input does there is known and not left for the sensors to find."""
    state = run(rig, rig.plant, invtrack.TrackingController(rig.plan, rig.gains, period=0.05))
    observed = run(rig, rig.plant, with_observer(rig, period=0.05))
    size = np.max(np.abs(state.error))
    np.testing.assert_allclose(observed.error, state.error, atol=1e-3 * size)


def test_a_wrong_start_is_estimated_away_at_the_observers_rate(rig: Rig) -> None:
    linear = invtrack.LinearPlant(rig.model)
    wrong = rig.plan(START).x[0] + np.array([0.1, -0.05, 0.2, 0.0, 0.1, 0.0])
    result = run(rig, linear, with_observer(rig), initial_state=wrong)
    error = np.linalg.norm(result.estimate.values - result.state.values[:-1], axis=1)
    assert error[0] > 0.05
    # Half a turn of the slowest observer poles, -1 +- 0.5j, after the last jump: then their part has only changed sign and size.
    early, late = np.searchsorted(result.time, [8.0, 8.0 + 2 * np.pi])
    assert np.log(error[early] / error[late]) / (2 * np.pi) == pytest.approx(1.0, abs=0.03)


def test_kalman_filter_is_the_better_estimator_for_the_noise_it_is_designed_for(rig: Rig) -> None:
    linear = invtrack.LinearPlant(rig.model)
    sensors = {name: invtrack.Sensor(noise=2e-3) for name in ("base_position", "tip_position")}
    spread = {}
    for name, observer in (
        ("kalman", invtrack.KalmanFilter(input_noise=1e-2, measurement_noise=2e-3)),
        ("fast poles", invtrack.LuenbergerObserver([3 * pole for pole in POLES])),
    ):
        controller = invtrack.OutputFeedbackController(rig.plan, rig.gains, observer, period=0.01)
        result = run(rig, linear, controller, sensors=sensors)
        spread[name] = np.std(result.estimate.values - result.state.values[:-1], axis=0)
    assert np.all(spread["kalman"] < spread["fast poles"])
    assert spread["kalman"][2] < 0.3 * spread["fast poles"][2]  # the rotation, which no sensor sees


def test_a_known_delay_is_compensated(rig: Rig) -> None:
    late = {name: invtrack.Sensor(delay=0.02) for name in ("base_position", "tip_position")}
    ignored = invtrack.max_error(run(rig, rig.plant, with_observer(rig), sensors=late))
    known = invtrack.max_error(run(rig, rig.plant, with_observer(rig, measurement_delay=0.02), sensors=late))
    assert known < 1e-2 * ignored


def test_input_is_held_between_updates_and_its_mean_costs_second_order(rig: Rig) -> None:
    controller = invtrack.TrackingController(rig.plan, rig.gains, period=0.05)
    result = run(rig, rig.plant, controller)
    changes = np.flatnonzero(np.diff(result.commanded["base_force"]) != 0) + 1
    phase = (result.time[changes] - START) / 0.05
    np.testing.assert_allclose(phase, np.rint(phase), atol=1e-9)
    assert len(changes) == round((STOP - START) / 0.05) - 1
    # How much a hold that straddles a jump costs depends on where the jump falls in it, so the order shows over a wide range only.
    periods = (0.08, 0.01)
    errors = [
        invtrack.max_error(run(rig, rig.plant, invtrack.TrackingController(rig.plan, rig.gains, period=period)))
        for period in periods
    ]
    assert np.log(errors[0] / errors[1]) / np.log(periods[0] / periods[1]) == pytest.approx(2.0, abs=0.4)


def test_the_same_seed_gives_the_same_noise(rig: Rig) -> None:
    linear = invtrack.LinearPlant(rig.model)
    noise = {"tip_position": invtrack.Sensor(noise=1e-3)}
    first, second = (run(rig, linear, with_observer(rig), sensors=noise, seed=3, end=0.0) for _ in range(2))
    other = run(rig, linear, with_observer(rig), sensors=noise, seed=4, end=0.0)
    assert first.equals(second)
    assert not first.equals(other)


def test_sensor_values_are_recorded_and_read_back(rig: Rig, tmp_path: Path) -> None:
    result = run(
        rig, rig.plant, with_observer(rig, period=0.01), end=0.0, sensors={"tip_position": invtrack.Sensor(quantization=1e-3)}
    )
    digits = result.measured["tip_position"] / 1e-3
    np.testing.assert_allclose(digits, np.rint(digits), atol=1e-9)
    assert result.measured.channels.units == ("m", "m")
    invtrack.save_recording(result, tmp_path / "run.rrd")
    assert invtrack.load_recording(tmp_path / "run.rrd")["run"].equals(result)


def test_delay_interpolates_between_steps() -> None:
    """Of x' = 1 from 0, a sensor that is 0.15 s late shows t - 0.15, and before the run began what it began with."""

    class One:
        estimate = np.zeros(1)

        def update(self, index: int, measurement: np.ndarray) -> np.ndarray:
            return np.ones(1)

    one = Channels(["a"], ["m"])
    plant = invtrack.StateSpace([[0.0]], [[1.0]], [[1.0]], measurement=Measurement([[1.0]], [[0.0]], one, np.zeros(1)))
    simulated = linear_plant(invtrack.LinearPlant(plant))
    sensors = SensorChain(["a"], {"a": invtrack.Sensor(delay=0.15)}, seed=0)
    run = stepped(simulated, np.zeros(1), One(), steps=4, timestep=0.1, sensors=sensors)
    np.testing.assert_allclose(run.measured[:, 0], [0.0, 0.0, 0.05, 0.15], atol=1e-15)


def test_limits_of_a_linear_plant(rig: Rig) -> None:
    linear = invtrack.LinearPlant(rig.model, input_limits=[[-100.0, 100.0]])
    with pytest.warns(RuntimeWarning, match=r"needs base_force from -268\.\d to 215\.\d"):
        result = run(rig, linear, rig.controller)
    assert invtrack.results.peak_input(result) == 100.0


def test_switch_times_of_the_linear_plant_are_its_own(rig: Rig) -> None:
    late = invtrack.LinearPlant(invtrack.SwitchedSystem(rig.model.systems, [t + 0.05 for t in JUMPS]))
    physics = run(rig, rig.plant, rig.controller, schedule=[invtrack.Change(t + 0.05, **values) for t, values in rig.plan.schedule])
    prediction = run(rig, late, rig.controller)
    assert invtrack.max_error(prediction) == pytest.approx(invtrack.max_error(physics), rel=1e-4)
    assert invtrack.max_error(physics) > 1e-3


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"sensors": {"tip": invtrack.Sensor()}}, "the plant's measurements are: base_position, tip_position"),
        ({"evaluate": "stages"}, "without a state"),
        ({"schedule": [invtrack.Change(1.0, tip_mass=2.0)]}, "switches by its own switch times"),
    ],
)
def test_bad_requests_are_refused(rig: Rig, options: dict[str, object], message: str) -> None:
    with pytest.raises(SimulationError, match=message):
        run(rig, invtrack.LinearPlant(rig.model), with_observer(rig), **options)


@pytest.mark.parametrize("field", ["noise", "quantization", "delay"])
def test_negative_imperfections_are_refused(field: str) -> None:
    with pytest.raises(SimulationError, match=f"sensor's {field} must be finite and not negative"):
        invtrack.Sensor(**{field: -1e-3})
