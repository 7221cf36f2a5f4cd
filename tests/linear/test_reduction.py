"""Reduced models against chains of masses whose modes, zeros and static shapes are known in closed form, and against the beam."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg

import invtrack
from invtrack import control, linear, plans
from invtrack.arrays import Array
from invtrack.errors import ControlError, ModelError, PlanError
from invtrack.linear import Reduction, StateSpace, SwitchedSystem, balanced_truncation, modal_truncation, zeros_along
from invtrack.mechanisms import Beam


def chain(masses: list[float], stiffness: list[float], *, damping: float = 1e-3, output: int = -1) -> StateSpace:
    """Masses in a row on springs between them, free at both ends, the force on the first; damping in proportion to stiffness."""
    n = len(masses)
    K = np.zeros((n, n))
    for i, k in enumerate(stiffness):
        K[i : i + 2, i : i + 2] += k * np.array([[1.0, -1.0], [-1.0, 1.0]])
    M_inverse = np.diag(1 / np.array(masses))
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-M_inverse @ K, -damping * M_inverse @ K]])
    B = np.concatenate([np.zeros(n), M_inverse[:, 0]])[:, None]
    return StateSpace(A, B, np.eye(2 * n)[[output % n]])


MASSES, SPRINGS = [1.0, 0.5, 0.5, 0.5, 0.4], [40.0, 400.0, 900.0, 2500.0]


def of_chain(masses: list[float], stiffness: list[float], w: Array, *, damping: float = 1e-3) -> Array:
    """From the force on the first mass to the place of the last (k,), by the dynamic stiffness K (1 + damping jw) - M w^2."""
    n = len(masses)
    K = np.diag([*stiffness, 0.0]) + np.diag([0.0, *stiffness]) - np.diag(stiffness, 1) - np.diag(stiffness, -1)
    return np.array([np.linalg.inv(K * (1 + damping * 1j * s) - np.diag(masses) * s**2)[n - 1, 0] for s in w])


def response(system: StateSpace, w: Array) -> Array:
    """C (jw - A)^-1 B + D (k,)."""
    resolvents = [1j * s * np.eye(system.n_states) - system.A for s in w]
    return np.array([(system.C @ np.linalg.solve(matrix, system.B) + system.D)[0, 0] for matrix in resolvents])


def undamped(masses: list[float], springs: list[float]) -> Array:
    """Natural frequencies (n,) [rad/s] by the symmetric eigenvalue problem."""
    A = chain(masses, springs, damping=0.0).A
    n = len(masses)
    M = np.diag(masses)
    return np.sqrt(np.maximum(scipy.linalg.eigh(-M @ A[n:, :n], M, eigvals_only=True), 0.0))


@pytest.mark.parametrize("modes", [1, 2, 3])
def test_the_modes_that_are_kept_are_those_of_the_plant(modes: int) -> None:
    model = chain(MASSES, SPRINGS)
    reduction = modal_truncation(model, band=3.0, modes=modes)
    small = reduction.reduced.systems[0]
    assert (reduction.n_states, reduction.modes) == (2 + 2 * modes, modes)
    frequencies = np.sort(np.abs(np.linalg.eigvals(small.A)))
    assert frequencies[:2] == pytest.approx(0.0, abs=1e-6)
    assert frequencies[2::2] == pytest.approx(undamped(MASSES, SPRINGS)[1 : modes + 1], rel=1e-9)
    assert response(small, np.array([1e-3])) * (1j * 1e-3) ** 2 == pytest.approx(1 / sum(MASSES), rel=1e-3)


def test_what_is_lost_is_what_the_inverse_of_the_reduced_model_leaves_on_the_full_one() -> None:
    model = chain(MASSES, SPRINGS)
    reduction = modal_truncation(model, band=6.0, accuracy=0.02)
    w = np.linspace(0.5, 6.0, 50)
    G, G_r = of_chain(MASSES, SPRINGS, w), response(reduction.reduced.systems[0], w)
    assert reduction.output_error(w)[:, 0, 0] == pytest.approx(G / G_r - 1, rel=1e-6, abs=1e-9)
    assert np.max(np.abs(G / G_r - 1)) <= reduction.lost * 1.001 <= 0.02  # the grid may miss a smooth maximum by so much
    fewer = modal_truncation(model, band=6.0, modes=reduction.modes - 1)
    assert fewer.lost > 0.02
    assert reduction.considered[-2:] == ((reduction.modes - 1, fewer.lost), (reduction.modes, reduction.lost))
    assert reduction.cut_gain == pytest.approx(np.max(np.abs(G - G_r)), rel=1e-2)


def test_residual_stiffness_is_right_at_rest_and_makes_the_relative_degree_zero() -> None:
    model = chain(MASSES, SPRINGS)
    plain, stiff = (modal_truncation(model, band=6.0, modes=1, residual_stiffness=add) for add in (False, True))
    slow = np.array([0.05])
    left, kept = ((of_chain(MASSES, SPRINGS, slow) - response(r.reduced.systems[0], slow))[0] for r in (plain, stiff))
    assert abs(kept) < 1e-3 * abs(left)
    assert stiff.lost < plain.lost / 5
    assert [report.relative_degree for report in (*plain.zeros_after, *stiff.zeros_after)] == [(2,), (0,)]
    # Five masses in a row: the force takes five springs, so ten derivatives, to the last one, but for damping at each spring.
    assert plain.zeros_before[0].relative_degree == (6,)
    cut = np.eye(10) - stiff.V @ stiff.W[0]  # what was cut is at rest where x = N u
    assert cut @ (model.A @ stiff.N + model.B) == pytest.approx(0.0, abs=1e-8)


@pytest.mark.parametrize("payload", [0.4, 0.1, 1.5])
def test_balanced_truncation_keeps_the_rigid_body_of_every_payload(payload: float) -> None:
    plant = SwitchedSystem([chain(MASSES, SPRINGS), chain([*MASSES[:-1], payload], SPRINGS)], [1.0])
    reduction = balanced_truncation(plant, band=5.0, accuracy=0.02)
    assert reduction.n_states < 10
    w = np.linspace(0.2, 5.0, 40)
    for k, small in enumerate(reduction.reduced.systems):
        assert reduction.W[k] @ reduction.V == pytest.approx(np.eye(reduction.n_states), abs=1e-9)
        rigid = np.sort(np.abs(np.linalg.eigvals(small.A)))[:2]
        assert rigid == pytest.approx(0.0, abs=1e-6)
        masses = [*MASSES[:-1], MASSES[-1] if k == 0 else payload]
        assert response(small, np.array([1e-3])) * (1j * 1e-3) ** 2 == pytest.approx(1 / sum(masses), rel=1e-3)
        assert np.max(np.abs(of_chain(masses, SPRINGS, w) / response(small, w) - 1)) <= 0.02
        assert pytest.approx(0.0, abs=1e-12) == small.C @ small.B


def test_states_inputs_and_outputs_in_other_units_are_reduced_alike() -> None:
    model = chain(MASSES, SPRINGS)
    units = 10.0 ** np.array([3, -2, 0, 5, 1, -4, 2, 0, -1, 3.0])
    other = StateSpace(model.A * units / units[:, None], 1e4 * model.B / units[:, None], 1e-3 * model.C * units)
    for method in (modal_truncation, balanced_truncation):
        one, two = method(model, band=6.0, accuracy=0.02), method(other, band=6.0, accuracy=0.02)
        assert two.n_states == one.n_states
        assert two.lost == pytest.approx(one.lost, rel=1e-4)


@pytest.fixture(scope="module")
def beam() -> SwitchedSystem:
    mechanism = Beam(segments=8)
    plant = invtrack.Plant.from_xml(
        mechanism.mjcf(), inputs=["force"], outputs=[mechanism.tip_output], parameters={"payload": "body:payload:mass"}
    )
    return SwitchedSystem([invtrack.linearize(plant, payload=mass) for mass in (0.5, 0.25)], [0.5])


def tracking_error(plan: invtrack.Plan, reduction: Reduction, *, feedback: bool) -> float:
    """How far the full model is off the output planned on the reduced one, as a share of the slew."""
    gains = control.lifted_gains(invtrack.lqr(reduction.reduced, Q=1.0, R=1e-2), reduction) if feedback else None
    controller = invtrack.TrackingController(plans.lifted(plan, reduction), gains)
    run = invtrack.simulate(invtrack.LinearPlant(reduction.full), controller, timestep=4e-3, end=2.0)
    return invtrack.max_error(run, wanted="planned_output")


def test_a_plan_on_the_reduced_beam_is_followed_by_the_full_one(beam: SwitchedSystem) -> None:
    slew = invtrack.rest_to_rest(0.0, 1.0, duration=1.0)
    constant = modal_truncation(beam.systems[0], band=30.0, accuracy=0.01)
    assert constant.n_states <= 8
    exact = invtrack.invert(constant.reduced, slew, tolerance=1e-6)
    assert tracking_error(exact, constant, feedback=False) < constant.lost
    assert tracking_error(exact, constant, feedback=True) < constant.lost / 10
    switched = balanced_truncation(beam, band=30.0, accuracy=0.01)
    assert switched.n_states <= 10
    optimal = invtrack.quadratic_redesign(switched.reduced, slew, R=1e-6, Q_y=1.0, tolerance=1e-6)
    assert tracking_error(optimal, switched, feedback=True) < switched.lost


def test_feedback_of_the_kept_modes_leaves_those_that_were_cut_where_they_are(beam: SwitchedSystem) -> None:
    full = beam.systems[0]
    reduction = modal_truncation(full, band=30.0, modes=2)
    K = invtrack.lqr(reduction.reduced, Q=1.0, R=1e-2)
    (lifted,) = control.lifted_gains(K, reduction).gains
    small = reduction.reduced.systems[0]
    moved = np.linalg.eigvals(small.A - small.B @ K.gains[0])
    cut = [s for s in np.linalg.eigvals(full.A) if np.min(np.abs(s - np.linalg.eigvals(small.A))) > 1e-3 * abs(s) + 1e-3]
    expected = np.sort_complex(np.concatenate([moved, cut]))
    assert np.sort_complex(np.linalg.eigvals(full.A - full.B @ lifted)) == pytest.approx(expected, rel=1e-5)


def test_zeros_along_the_beam_go_through_infinity_and_come_back_real() -> None:
    mechanism = Beam(segments=8, damping=0.0)
    plant = invtrack.Plant.from_xml(mechanism.mjcf(), inputs=["force"], outputs=mechanism.station_outputs)
    model = invtrack.linearize(plant)
    n = 1 + 1  # two modes: the rigid body and one more
    V = np.vstack([np.ones(1), np.zeros((8, 1))]), mechanism.chain.flexible_modes()[1][:, :1]
    T = np.hstack(V)
    M = mechanism.chain.mass_matrix
    S = np.linalg.solve(T.T @ M @ T, T.T @ M)
    w = mechanism.chain.flexible_modes()[0][0]
    A = np.block([[np.zeros((n, n)), np.eye(n)], [np.diag([0.0, -(w**2)]), np.zeros((n, n))]])
    B = np.concatenate([np.zeros(n), S @ np.linalg.solve(M, np.eye(9)[:, 0])])[:, None]
    C = np.hstack([model.C[:, :9] @ T, np.zeros((10, n))])
    found = zeros_along(StateSpace(A, B, C), mechanism.stations, [0.0, 0.2, 0.5, 0.9, 1.2])
    # Closed form of two modes: y / u = 1 / (m s^2) + b phi / (s^2 + w^2), zeros s^2 = -w^2 / (1 + m b phi).
    mass, b = M[0, 0], B[-1, 0]
    phi = np.interp(found.places, mechanism.stations, C[:, 1])
    for values, shape in zip(found.zeros, phi, strict=True):
        square = -(w**2) / (1 + mass * b * shape)
        expected = np.sqrt(complex(square)) * np.array([1, -1])
        assert np.sort_complex(values) == pytest.approx(np.sort_complex(expected), rel=1e-6)
    (crossing,) = found.through_infinity
    assert 1 + mass * b * np.interp(crossing, mechanism.stations, C[:, 1]) == pytest.approx(0.0, abs=1e-9)
    assert np.max(np.abs(found.zeros[0].real)) < 1e-6  # at the base: clamped beam
    assert np.max(np.abs(found.zeros[-1].imag)) < 1e-6  # at the tip: real, one to the right


def test_what_cannot_be_reduced_is_refused_for_its_reason(beam: SwitchedSystem) -> None:
    with pytest.raises(ModelError, match="others in each interval"):
        modal_truncation(beam, band=30.0)
    with pytest.raises(ModelError, match="band must be a positive frequency"):
        modal_truncation(beam.systems[0], band=0.0)
    with pytest.raises(ModelError, match="finds no model in fewer states"):
        modal_truncation(chain([1.0, 1.0], [10.0]), band=5.0, accuracy=1e-9)
    two = StateSpace(np.diag([-1.0, -2.0]), np.eye(2), [[1.0, 1.0]])
    with pytest.raises(ModelError, match="as many inputs as outputs"):
        balanced_truncation(two, band=1.0)
    with pytest.raises(ModelError, match="damped modes"):
        balanced_truncation(chain([1.0, 1.0], [10.0], damping=0.0), band=1.0)
    reduction = modal_truncation(beam.systems[0], band=30.0)
    with pytest.raises(ControlError, match="for the reduced model"):
        control.lifted_gains(np.zeros((1, 3)), reduction)
    other = invtrack.invert(linear.modal_truncation(beam.systems[1], band=30.0).reduced, invtrack.rest_to_rest(0.0, 1.0, 1.0))
    with pytest.raises(PlanError, match="another model"):
        plans.lifted(other, reduction)
    with pytest.raises(ModelError, match="one input"):
        zeros_along(StateSpace(np.diag([-1.0, -2.0]), np.eye(2), np.eye(2)), [0.0, 1.0], [0.5])
