"""Feedback along a motion: the Riccati equation against an independent integrator, limits in which it is known, runs in MuJoCo."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.integrate
import scipy.linalg

import invtrack
from invtrack.control import GainsAlong, Instants, amplification
from invtrack.control.riccati_along import riccati_along
from invtrack.errors import ControlError
from invtrack.linear.state_space import StateSpace
from invtrack.plans.linearizations import Linearizations
from invtrack.simulation.preflight import warn_of_unstable_holds
from tests.inversion.nonlinear.mechanisms import cart_pole, link, pvtol, satellite, sideways

Q, R = np.diag([3.0, 1.0, 0.5]), np.array([[0.2, 0.05], [0.05, 0.4]])
PAYLOADS = [invtrack.Change(0.3, payload=0.5), invtrack.Change(0.7, payload=0.1)]


def varying(t: float) -> tuple[np.ndarray, np.ndarray]:
    A = np.array([[0.0, 1.0, np.sin(3 * t)], [2.0 * np.cos(t), -0.3, 1.0], [0.5, -t, 1.0]])
    return A, np.array([[0.0, 1.0], [1.0 + 0.5 * t, 0.0], [0.0, 1.0]])


def sampled(count: int) -> Linearizations:
    edges = np.linspace(0.0, 2.0, count + 1)
    A, B = zip(*(varying(float(t)) for t in (edges[:-1] + edges[1:]) / 2), strict=True)
    return Linearizations(edges, np.stack(A), np.stack(B))


def integrated(times: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Gains at times [s] by an integrator for ordinary differential equations."""

    def rate(t: float, flat: np.ndarray) -> np.ndarray:
        X, (A, B) = flat.reshape(3, 3), varying(t)
        return -np.asarray(A.T @ X + X @ A - X @ B @ np.linalg.solve(R, B.T @ X) + Q).ravel()

    found = scipy.integrate.solve_ivp(rate, (2.0, 0.0), last.ravel(), rtol=1e-12, atol=1e-13, dense_output=True, method="DOP853")
    return np.stack([np.linalg.solve(R, varying(t)[1].T @ found.sol(t).reshape(3, 3)) for t in times])


def test_gains_are_those_of_the_riccati_equation_to_second_order() -> None:
    last = scipy.linalg.solve_continuous_are(*varying(2.0), Q, R)
    errors = []
    for count in (100, 200, 400):
        along = sampled(count)
        errors.append(float(np.max(np.abs(riccati_along(along, Q, R, last) - integrated(along.middles, last)))))
    assert errors[-1] < 1e-4
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 2.0, atol=0.1)


def test_a_plant_that_does_not_change_keeps_its_stationary_gain_over_stretches_of_any_length() -> None:
    A, B = varying(0.4)
    X = scipy.linalg.solve_continuous_are(A, B, Q, R)
    edges = np.cumsum([0.0, 1e-6, 1e-3, 0.1, 10.0, 1e4])
    along = Linearizations(edges, np.repeat(A[None], 5, axis=0), np.repeat(B[None], 5, axis=0))
    K = np.linalg.solve(R, B.T @ X)
    np.testing.assert_allclose(riccati_along(along, Q, R, X), np.repeat(K[None], 5, axis=0), rtol=0, atol=1e-9 * np.max(np.abs(K)))
    from_elsewhere = riccati_along(along, Q, R, 1e6 * np.eye(3))
    np.testing.assert_allclose(from_elsewhere[:-1], np.repeat(K[None], 4, axis=0), rtol=0, atol=1e-9 * np.max(np.abs(K)))


def test_gains_follow_the_units_of_states_inputs_and_time() -> None:
    along, last = sampled(50), np.eye(3)
    states, inputs, second = np.array([1e4, 1e-3, 7.0]), np.array([1e-5, 30.0]), 1e3
    A, B = along.A * states[:, None] / states / second, along.B * states[:, None] / inputs / second
    weights = Q / np.outer(states, states), R / np.outer(inputs, inputs), second * last / np.outer(states, states)
    gains = riccati_along(Linearizations(along.edges * second, A, B), *weights) / inputs[:, None] * states
    expected = riccati_along(along, Q, R, last)
    np.testing.assert_allclose(gains, expected, rtol=0, atol=1e-10 * np.max(np.abs(expected)))


def test_a_linear_plan_has_the_gains_of_its_intervals() -> None:
    model = StateSpace([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]])
    plan = invtrack.invert(model, invtrack.rest_to_rest(0.0, 1.0, duration=1.0))
    gains = invtrack.lqr(plan, Q=1.0, R=1.0)
    assert not isinstance(gains, GainsAlong)
    np.testing.assert_array_equal(gains.gains, invtrack.lqr(model, Q=1.0, R=1.0).gains)


def test_gains_along_a_motion_track_where_those_of_its_start_let_departures_grow() -> None:
    """The pole of the cart leans by 77 degrees on the way."""
    plant = cart_pole()
    plan = invtrack.invert(plant, invtrack.rest_to_rest(0.0, 40.0, duration=2.0))
    frozen, along = invtrack.lqr(invtrack.linearize(plant), Q=1.0, R=1.0), invtrack.lqr(plan, Q=1.0, R=1.0)
    assert amplification(plan, along) < 0.1 * amplification(plan, frozen)
    controller = invtrack.TrackingController(plan, along)
    np.testing.assert_array_equal(controller.breakpoints, plan.breakpoints)
    run = invtrack.simulate(plant, controller, timestep=1e-3)
    assert run.status == "completed"
    assert invtrack.max_error(run) < 3e-6 * 40.0  # of the inputs averaged over each step


def test_gains_at_both_ends_are_those_of_rest_there() -> None:
    plan = invtrack.invert(link(hanging=True), invtrack.rest_to_rest(-np.pi / 3, np.pi / 6, duration=1.0))
    gains = invtrack.lqr(plan, Q=1.0, R=1.0)
    ends = invtrack.lqr(plan.model, Q=1.0, R=1.0)
    assert len(gains.gains) > 50
    T_i, T_f = plan.manoeuvre
    before, after = gains.gains[int(gains.interval(plan.start - 1.0))], gains.gains[int(gains.interval(plan.end + 1.0))]
    np.testing.assert_allclose(before, ends.gains[0])
    np.testing.assert_allclose(after, ends.gains[-1])
    size = np.max(np.abs(before))
    np.testing.assert_allclose(gains.gains[1], before, rtol=0, atol=1e-2 * size)  # settled by the start of the plan
    half_way = gains.gains[int(gains.interval((T_i + T_f) / 2))]
    assert np.max(np.abs(half_way - before)) > 0.1 * np.max(np.abs(after - before))


def test_gains_see_changes_of_parameters_on_the_way() -> None:
    plant, reference = link(), invtrack.rest_to_rest(0.0, np.pi / 2, duration=1.0)
    plan = invtrack.invert(plant, reference, schedule=PAYLOADS)
    gains = invtrack.lqr(plan, Q=1.0, R=1.0)
    run = invtrack.simulate(plant, invtrack.TrackingController(plan, gains), timestep=1e-3)
    assert invtrack.max_error(run) < 2e-4 * np.pi / 2
    assert amplification(plan, gains) < 1e3
    times = np.array([0.3, 0.7])
    jumps = [np.max(np.abs(np.subtract(*(gains.gains[int(gains.interval(t + side))] for side in (-1e-9, 1e-9))))) for t in times]
    inside = np.max(np.abs(np.subtract(*(gains.gains[int(gains.interval(t))] for t in (0.5, 0.501)))))
    assert min(jumps) > inside


def test_rotations_in_space_are_fed_back_along_the_motion() -> None:
    plant, distances = satellite(), (0.5, -1.0, 0.3, 1.5, -1.0, 0.8)
    plan = invtrack.invert(plant, invtrack.references.stack([invtrack.rest_to_rest(0.0, a, duration=2.0) for a in distances]))
    gains = invtrack.lqr(plan, Q=1.0, R=1.0)
    away = np.array([1e-3, -2e-3, 1e-3, 2e-3, 1e-3, -1e-3] + [0.0] * 6)
    run = invtrack.simulate(
        plant, invtrack.TrackingController(plan, gains), timestep=1e-3, end=12.0, initial_state=away, vibration_period=1.0
    )
    assert np.max(np.abs(run.error[-1])) < 1e-5


def test_eigenvalues_of_an_instant_are_not_taken_for_instability() -> None:
    """Of the aircraft rolled by 57 degrees, with gains for that, and the model of level flight: that pair would be unstable."""
    plan = invtrack.invert(pvtol(), sideways(12.0))
    controller = invtrack.TrackingController(plan, invtrack.lqr(plan, Q=1.0, R=1.0))
    times = np.arange(plan.start, plan.end, 4e-3)
    instants = Instants.undivided(times, np.full(len(times), 4e-3), times + 2e-3)
    warn_of_unstable_holds(controller, instants, plan.model)
    unknown = invtrack.TrackingController(replace(plan, linearizations=None), controller.gains)
    with pytest.warns(RuntimeWarning, match="the feedback is unstable"):
        warn_of_unstable_holds(unknown, instants, plan.model)


def test_amplification_of_a_linear_plant_is_the_norm_of_its_transition() -> None:
    """d' = [[-1, 20], [0, -1]] d for K = 0, states of equal peaks: the norm of e^-t [[1, 20 t], [0, 1]], largest near t = 1."""
    model = StateSpace([[-1.0, 20.0], [0.0, -1.0]], [[0.0], [1.0]], [[1.0, 0.0]])
    plan = invtrack.invert(model, invtrack.rest_to_rest(0.0, 1.0, duration=4.0))
    found = amplification(plan, invtrack.control.GainSchedule([np.zeros((1, 2))]))
    ratio = np.divide(*plan.trajectory.peaks[[1, 0]])
    times = np.linspace(0.0, 4.0, 4001)
    norms = [np.exp(-t) * np.linalg.norm([[1.0, 20 * t * ratio], [0.0, 1.0]], 2) for t in times]
    assert found == pytest.approx(max(norms), rel=1e-3)


def test_what_cannot_be_fed_back_is_refused() -> None:
    plan = invtrack.invert(cart_pole(), invtrack.rest_to_rest(0.0, 1.0, duration=2.0))
    with pytest.raises(ControlError, match=r"Q must be .*4"):
        invtrack.lqr(plan, Q=np.eye(3), R=1.0)
    with pytest.raises(ControlError, match="at rest before the motion: no LQR gain: Q does not weigh"):
        invtrack.lqr(plan, Q=np.diag([0.0, 1.0, 1.0, 1.0]), R=1.0)
    with pytest.raises(ControlError, match=r"gains have shape \(1, 3\), expected \(1, 4\)"):
        amplification(plan, invtrack.GainSchedule([np.zeros((1, 3))]))
