"""What a user is told before a run starts."""

from __future__ import annotations

import numpy as np
import pytest

import invtrack
from invtrack.errors import SimulationError

# x'' = u, output x: exact inversion without preactuation.
POINT_MASS = invtrack.StateSpace([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]])
# (1 - s) / (s + 2)^2: a zero at 1.
NONMINIMUM = invtrack.StateSpace([[0.0, 1.0], [-4.0, -4.0]], [[0.0], [1.0]], [[1.0, -1.0]])
SLEW = invtrack.rest_to_rest(0.0, 1.0, 1.0)


def test_a_plan_is_no_controller() -> None:
    plan = invtrack.invert(POINT_MASS, SLEW)
    with pytest.raises(SimulationError, match=r"expected a controller, got Plan.*TrackingController\(plan, gains\)"):
        invtrack.simulate(invtrack.LinearPlant(POINT_MASS), plan)  # type: ignore[arg-type]


def test_schedules_hold_changes() -> None:
    controller = invtrack.TrackingController(invtrack.invert(POINT_MASS, SLEW))
    with pytest.raises(SimulationError, match=r"expected changes such as invtrack.Change\(3.0, tip_mass=100.0\)"):
        invtrack.simulate(invtrack.LinearPlant(POINT_MASS), controller, schedule=[(1.0, {"mass": 2.0})])  # type: ignore[list-item]


def test_more_steps_than_can_be_recorded_are_refused() -> None:
    controller = invtrack.TrackingController(invtrack.invert(POINT_MASS, SLEW))
    with pytest.raises(SimulationError, match=r"takes 2.0e\+09 steps, more than the 5e\+07"):
        invtrack.simulate(invtrack.LinearPlant(POINT_MASS), controller, timestep=1e-9)


def test_a_reference_that_begins_elsewhere_is_pointed_out() -> None:
    controller = invtrack.TrackingController(invtrack.invert(POINT_MASS, invtrack.rest_to_rest(2.0, 3.0, 1.0)))
    plant = invtrack.LinearPlant(POINT_MASS)
    with pytest.warns(RuntimeWarning, match=r"at 2 instead of 0. References are absolute"):
        invtrack.simulate(plant, controller, timestep=0.01)
    invtrack.simulate(plant, controller, timestep=0.01, initial_state=[2.0, 0.0])


def test_preactuation_cut_short_is_pointed_out() -> None:
    plan = invtrack.invert(NONMINIMUM, SLEW, max_preactuation=0.5)
    with pytest.warns(RuntimeWarning, match="preactuation was cut short"):
        invtrack.simulate(invtrack.LinearPlant(NONMINIMUM), invtrack.TrackingController(plan), timestep=0.01)


def test_a_feedback_held_for_too_long_is_pointed_out() -> None:
    """x'' = -w^2 x - 2 w x' sampled every h is unstable beyond some w h; the threshold is found by simulation."""
    plan = invtrack.invert(POINT_MASS, SLEW)
    stiff = invtrack.TrackingController(plan, [[100.0**2, 2 * 100.0]])
    plant = invtrack.LinearPlant(POINT_MASS)
    with pytest.warns(RuntimeWarning, match=r"unstable when its input is held for 0.02 s: errors grow"):
        coarse = invtrack.simulate(plant, stiff, timestep=0.02, initial_state=[1e-6, 0.0])
    fine = invtrack.simulate(plant, stiff, timestep=0.005, initial_state=[1e-6, 0.0])
    assert coarse.status == "diverged" or invtrack.max_error(coarse) > 1e3 * invtrack.max_error(fine)


def test_the_plant_that_is_there_decides_whether_a_held_feedback_is_stable() -> None:
    """x'' = k u, u = -w^2 x - 2 w x' with k = 4: the sampled loop is unstable at a hold at which the plan's own, k = 1, is not."""
    stronger = invtrack.StateSpace([[0.0, 1.0], [0.0, 0.0]], [[0.0], [4.0]], [[1.0, 0.0]])
    controller = invtrack.TrackingController(invtrack.invert(POINT_MASS, SLEW), [[100.0**2, 2 * 100.0]])
    invtrack.simulate(invtrack.LinearPlant(POINT_MASS), controller, timestep=5e-3)
    K, hold = np.array([[1e4, 200.0]]), 5e-3
    A_d, B_d = np.array([[1.0, hold], [0.0, 1.0]]), 4 * np.array([[hold**2 / 2], [hold]])  # exact for a double integrator
    radius = np.max(np.abs(np.linalg.eigvals(A_d - B_d @ K)))
    with pytest.warns(RuntimeWarning, match=rf"held for 0.005 s: errors grow {radius:.4g} times"):
        invtrack.simulate(invtrack.LinearPlant(stronger), controller, timestep=hold)


@pytest.mark.parametrize(("zero", "when"), [(3000.0, "grows before"), (-3000.0, "dies out after")])
def test_a_zero_faster_than_the_hold_is_pointed_out_where_the_input_shows_it(zero: float, when: str) -> None:
    """(1 - s / zero) / (s + 1)^2: a reference without curvature to spare makes the input of the zero's own time."""
    model = invtrack.StateSpace([[0.0, 1.0], [-1.0, -2.0]], [[0.0], [1.0]], [[1.0, -1 / zero]])
    rough, smooth = invtrack.rest_to_rest(0.0, 1.0, 1.0, smoothness=1), invtrack.rest_to_rest(0.0, 1.0, 1.0, smoothness=4)
    controller = invtrack.TrackingController(invtrack.invert(model, rough))
    with pytest.warns(RuntimeWarning, match=rf"of its peak, {when} the manoeuvre at 3000 rad/s, a zero faster than the 0.001 s"):
        invtrack.simulate(invtrack.LinearPlant(model), controller, timestep=1e-3)
    invtrack.simulate(invtrack.LinearPlant(model), controller, timestep=1e-4, end=1.1)  # fine enough
    invtrack.simulate(invtrack.LinearPlant(model), invtrack.TrackingController(invtrack.invert(model, smooth)), timestep=1e-3)


def test_sensors_that_nobody_looks_at_are_pointed_out() -> None:
    controller, plant = invtrack.TrackingController(invtrack.invert(POINT_MASS, SLEW)), invtrack.LinearPlant(POINT_MASS)
    (name,) = plant.model.measurements.names
    with pytest.warns(RuntimeWarning, match="TrackingController knows the state and looks at none"):
        invtrack.simulate(plant, controller, timestep=0.01, sensors={name: invtrack.Sensor(noise=1e-3)})


def test_representations_are_short() -> None:
    plan = invtrack.invert(POINT_MASS, SLEW)
    run = invtrack.simulate(invtrack.LinearPlant(POINT_MASS), invtrack.TrackingController(plan), timestep=0.01, name="slew")
    assert len(repr(plan)) < 300
    assert "stable inversion" in repr(plan)
    assert len(repr(run)) < 300
    assert "'slew'" in repr(run)


CART_POLE = invtrack.StateSpace(  # 1 kg cart, 0.2 kg at 0.5 m above it; output: the cart's position
    [[0, 0, 1, 0], [0, 0, 0, 1], [0, -0.2 * 9.81, 0, 0], [0, 1.2 * 9.81 / 0.5, 0, 0]],
    [[0], [0], [1], [-2]],
    [[1, 0, 0, 0]],
)
TWO_MASSES = invtrack.StateSpace(np.kron(np.eye(2), [[0, 1], [0, 0]]), np.kron(np.eye(2), [[0], [1]]), np.kron(np.eye(2), [[1, 0]]))


@pytest.mark.parametrize("model", [POINT_MASS, CART_POLE, TWO_MASSES], ids=["point mass", "cart-pole", "two masses"])
def test_a_run_without_a_flexible_mode_has_all_its_figures(model: invtrack.StateSpace) -> None:
    p = model.n_outputs
    plan = invtrack.invert(model, invtrack.rest_to_rest(np.zeros(p), np.ones(p), duration=1.0))
    controller = invtrack.TrackingController(plan, invtrack.lqr(model, Q=1.0, R=1.0))
    found = invtrack.metrics(invtrack.simulate(invtrack.LinearPlant(model), controller, timestep=1e-3))
    assert all(isinstance(value, float) and np.isfinite(value) for name, value in found.items() if name != "notes")
    assert found.notes == {"residual_vibration": "no flexible mode: window of the manoeuvre's length, 1 s"}
    assert found.residual_vibration is not None
    assert found.residual_vibration < 1e-4
    assert found.preactuation_time == pytest.approx(invtrack.results.preactuation_time(plan), abs=2e-3)
    assert found.postactuation_time == pytest.approx(invtrack.results.postactuation_time(plan), abs=2e-3)
