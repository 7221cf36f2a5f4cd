"""Francis regulators: their equations, their refusals, and the maps made of them."""

from __future__ import annotations

import numpy as np
import pytest

from invtrack.errors import InversionError, TrajectoryError
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.references.exosystem import exosystem, polynomial_exosystem, sinusoidal_exosystem, step_exosystem
from invtrack.regulation.francis import francis
from invtrack.regulation.francis_map import single_francis, switched_francis
from tests.cited_plants import CANTILEVER_TIP_MASSES, TWO_DISC_A, TWO_DISC_B, TWO_DISC_C, cantilever_paper
from tests.linear.random_plants import block, plant_with

CANTILEVER = [StateSpace(*cantilever_paper(m)) for m in CANTILEVER_TIP_MASSES]
PAPER_A = [[0, 1, 0, 0], [-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]


@pytest.mark.parametrize("frequency", [0.0, 0.3, 2.0, 40.0])
def test_a_sinusoid_is_answered_by_the_frequency_response(frequency: float) -> None:
    """x = Re[(jw - A)^-1 B u0 e^jwt] with C (jw - A)^-1 B u0 = 1, from the transfer function."""
    plant = plant_with(np.random.default_rng(7), (2, 1), block(-1.0, 0.5 + 2j, 3.0))
    A_e = [[0.0, frequency], [-frequency, 0.0]]  # the first state is cos(wt + phase) where (1, j) e^jwt is the complex solution
    C_e = [[1.0, 0.0], [0.0, 0.0]]
    regulator = francis(plant, A_e, C_e)
    response = np.linalg.solve(1j * frequency * np.eye(plant.n_states) - plant.A, plant.B)
    u = np.linalg.solve(plant.C @ response + plant.D, [1.0, 0.0])
    assert regulator.Gamma @ [1.0, 1j] == pytest.approx(u, rel=1e-10, abs=1e-10 * np.abs(u).max())
    assert regulator.Pi @ [1.0, 1j] == pytest.approx(response @ u, rel=1e-9, abs=1e-10 * np.abs(response @ u).max())
    assert max(regulator.dynamics_residual, regulator.output_residual) < 1e-12


def test_nilpotent_and_mixed_exosystems_solve_both_equations() -> None:
    for plant in CANTILEVER:
        for A_e, C_e in ((np.array(PAPER_A, dtype=float), np.eye(4)[[3]]), (block(-0.4, 0.9, 0.2 + 3j), np.ones((1, 4)))):
            regulator = francis(plant, A_e, C_e)
            Pi, Gamma = regulator.Pi, regulator.Gamma
            assert Pi @ A_e == pytest.approx(plant.A @ Pi + plant.B @ Gamma, abs=1e-10)
            assert plant.C @ Pi == pytest.approx(C_e, abs=1e-12)


def test_units_of_the_exosystem_and_its_coordinates() -> None:
    plant, C_e = CANTILEVER[1], np.array([[0.3, -1.0, 0.5, 1.0]])
    A_e, T = block(0.2 + 1j, -0.5, 0.0), np.diag([1e-6, 1.0, 1e6, 1.0]) @ np.random.default_rng(2).normal(size=(4, 4))
    Pi = francis(plant, A_e, C_e).Pi
    turned = francis(plant, T @ np.linalg.solve(T.T, A_e.T).T, np.linalg.solve(T.T, C_e.T).T)
    assert turned.Pi @ T == pytest.approx(Pi, abs=1e-10 * np.abs(Pi).max())


@pytest.mark.parametrize(("zero", "shown"), [(2j, r"0\+-2j"), (0.7, "0.7"), (0.0, "0")])
def test_a_mode_that_is_a_zero_is_refused_with_both(zero: complex, shown: str) -> None:
    plant = plant_with(np.random.default_rng(4), (2,), block(-1.0, zero))
    A_e = block(zero, 1.3j)
    with pytest.raises(InversionError, match=rf"mode at {shown} meets the plant's zero at {shown}"):
        francis(plant, A_e, np.ones((1, len(A_e))))


def test_the_undamped_rig_refuses_its_own_antiresonance_only() -> None:
    """Two discs without damping and coupling, torque on both: zeros on the imaginary axis."""
    A = TWO_DISC_A.copy()
    A[:, [1, 3]] = np.eye(4)[:, [0, 2]] @ np.eye(2)  # no damping, no velocity coupling
    A[[0, 2]] = np.eye(4)[[1, 3]]
    plant = StateSpace(A, TWO_DISC_B, TWO_DISC_C)
    frequency = np.sqrt(2.8956 * 1.8139 / 0.27 + 3.1555)  # numerator of th2/tau: 0.27 s^2 + 0.27 k1 + 1.8139 k2
    with pytest.raises(InversionError, match=r"mode at 0\+-4\.755j meets the plant's zero at 0\+-4\.755j"):
        francis(plant, block(1j * frequency), [[1.0, 0.0]])
    assert francis(plant, block(1j * 1.01 * frequency), [[1.0, 0.0]]).output_residual < 1e-12


def test_shapes_that_do_not_fit() -> None:
    with pytest.raises(TrajectoryError, match=r"expected A_e \(q, q\) and C_e \(1, q\) .* got \(2, 2\) and \(1, 3\)"):
        francis(CANTILEVER[0], np.eye(2), np.ones((1, 3)))
    with pytest.raises(TrajectoryError, match="A_e or C_e has entries that are not finite"):
        francis(CANTILEVER[0], [[np.nan]], [[1.0]])
    with pytest.raises(TrajectoryError, match="C_e must be real numbers, got 'y'"):
        francis(CANTILEVER[0], [[0.0]], "y")


def test_switched_francis_takes_the_regulator_of_each_interval_and_jumps() -> None:
    model = SwitchedSystem(CANTILEVER, [1.0, 2.0])
    sway = sinusoidal_exosystem([1.1], start=0.0, end=3.0)
    regulation = switched_francis(model, sway)
    for t, plant in ((0.5, CANTILEVER[0]), (1.5, CANTILEVER[1]), (2.5, CANTILEVER[2])):
        exact = francis(plant, sway.A[1], sway.C[1])
        assert regulation.x_map(t)[0] == pytest.approx(exact.Pi, abs=1e-12)
        assert regulation.u_map(t)[0] == pytest.approx(exact.Gamma, abs=1e-10)
    assert regulation.x_map([-1.0, 4.0]) == pytest.approx(np.zeros((2, 6, 3)), abs=1e-300)
    assert regulation.x_map(1.0, inside=0.9)[0] == pytest.approx(regulation.x_map(0.5)[0])
    assert regulation.method == "switched Francis"
    certificate = regulation.certificate
    assert max(certificate.dynamics_residual, certificate.output_error) < 1e-13
    assert certificate.continuity > 0.1  # the transients that it leaves
    assert regulation.admissible.shape == (3, 0)


def test_a_francis_plan_is_what_its_map_says_and_is_certified_as_discontinuous() -> None:
    regulation = switched_francis(SwitchedSystem(CANTILEVER, [1.0, 2.0]), sinusoidal_exosystem([1.1], start=0.0, end=3.0))
    x_e, t = np.array([0.2, 1.0, -0.5]), np.array([-1.0, 0.3, 0.99, 1.4, 2.6, 5.0])
    plan, states = regulation.plan(x_e), regulation.exosystem.states(x_e, 0.0, t)
    assert plan.states(t) == pytest.approx(np.einsum("mij,mj->mi", regulation.x_map(t), states), abs=1e-12)
    assert plan.inputs(t) == pytest.approx(np.einsum("mij,mj->mi", regulation.u_map(t), states), abs=1e-10)
    assert plan(t).y == pytest.approx(plan(t).y_d, abs=1e-12)
    assert plan.certificate.continuity > 0.1


def test_single_francis_misses_the_equations_of_the_other_intervals() -> None:
    model, ramp = SwitchedSystem(CANTILEVER, [1.0, 2.0]), polynomial_exosystem(1)
    regulation = single_francis(model, ramp, interval=2)
    exact = francis(CANTILEVER[2], ramp.A[0], ramp.C[0])
    assert regulation.x_map([-5.0, 1.5, 9.0]) == pytest.approx(np.array([exact.Pi] * 3), abs=1e-12)
    sway = sinusoidal_exosystem([1.1])
    assert single_francis(model, sway).certificate.dynamics_residual > 1e-3
    assert single_francis(CANTILEVER[0], sway).certificate.dynamics_residual < 1e-13
    with pytest.raises(InversionError, match="interval must be a whole number from 0 to 2, got 3"):
        single_francis(model, sway, interval=3)


def test_outputs_are_counted() -> None:
    with pytest.raises(TrajectoryError, match="the exosystem has 2 outputs, the plant 1"):
        switched_francis(CANTILEVER[0], exosystem([[0.0]], [[1.0], [1.0]]))


def test_a_plant_with_a_zero_at_the_origin_needs_none_to_rest() -> None:
    """y = velocity: a constant output cannot be held by a bounded state, no output can."""
    plant = StateSpace([[0, 1, 0], [-1, -1, 0], [0, 1, -2]], [[0], [1], [0]], [[0, 1, 0]])
    swing = sinusoidal_exosystem([1.0], bias=False, start=0.0, end=2 * np.pi)
    assert switched_francis(plant, swing).x_map(-1.0) == pytest.approx(np.zeros((1, 3, 2)), abs=1e-300)
    with pytest.raises(InversionError, match="mode at 0 meets the plant's zero at 0"):
        switched_francis(plant, step_exosystem())
