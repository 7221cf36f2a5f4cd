"""Linear models against printed matrices, hand-derived ones, and MuJoCo's own transition matrices."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
import scipy.linalg
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from invtrack.plant.linearize import linearize
from invtrack.plant.plant import Plant
from tests.cited_plants import CANTILEVER_TIP_MASSES, PAPER_FROM_MJCF, cantilever_paper
from tests.plant.mechanisms import BALL_PENDULUM, FREE_BODY, LAGGED_SLIDER, cantilever, hinge_pendulum, plant_of

G = 9.81


@pytest.mark.parametrize("tip_mass", CANTILEVER_TIP_MASSES)
@pytest.mark.parametrize("step", [1e-5, 1e-3, 1e-1])
def test_cantilever_in_the_papers_coordinates(tip_mass: float, step: float) -> None:
    linear = linearize(cantilever(), step=step, tip_mass=tip_mass).transformed(PAPER_FROM_MJCF)
    for found, printed in zip((linear.A, linear.B, linear.C), cantilever_paper(tip_mass), strict=True):
        assert np.max(np.abs(found - printed)) < 1e-12 * np.max(np.abs(printed))
    assert np.array_equal(linear.D, [[0.0]])


def test_names_and_operating_point_go_with_the_model() -> None:
    plant = cantilever()
    linear = linearize(plant, tip_mass=10.0)
    assert (linear.states.names, linear.inputs.names, linear.outputs.names) == (
        plant.states.names,
        plant.inputs.names,
        plant.outputs.names,
    )
    assert linear.operating_point.agrees_with(plant.operating_point)
    assert set(linear.error_estimates) == {"A", "B", "C", "D"}


def test_position_rows_are_exact() -> None:
    assert np.array_equal(linearize(cantilever()).A[:3], np.hstack([np.zeros((3, 3)), np.eye(3)]))


def test_actuator_with_a_lag(tmp_path: Path) -> None:
    """2 x'' = -30 x - 0.7 x' + 3 a, a' = (u - a) / 0.05; the accelerometer has the same row as x''."""
    plant = plant_of(tmp_path, LAGGED_SLIDER, inputs=["drive"], outputs=["acceleration[0]"])
    linear = linearize(plant.at(qpos=[0.2], act=[2.0], ctrl=[2.0]))  # 30 * 0.2 = 3 * 2
    np.testing.assert_allclose(linear.A, np.array([[0, 1, 0], [-15, -0.35, 1.5], [0, 0, -20]]), atol=1e-11)
    np.testing.assert_allclose(linear.B, np.array([[0], [0], [20]]), atol=1e-11)
    np.testing.assert_allclose(linear.C, np.array([[-15, -0.35, 1.5]]), atol=1e-11)
    assert linear.operating_point.x0 == pytest.approx([0.2, 0, 2])


@pytest.mark.parametrize("quarter_turns", [0, 1, 2, 3])
def test_ball_joint_pendulum_at_any_heading(tmp_path: Path, quarter_turns: int) -> None:
    """Rotation vector r in the body's frame: (I + m l^2) r'' = -m g l r about x and y, I r'' = 0 about z.

    Site displacement in the body's frame (-l ry, l rx), turned by the heading into the world's.
    """
    heading = quarter_turns * np.pi / 2
    plant = plant_of(tmp_path, BALL_PENDULUM, inputs=["torque_x", "torque_y"], outputs=["site:bob:x", "site:bob:y"])
    linear = linearize(plant.at(qpos=[np.cos(heading / 2), 0, 0, np.sin(heading / 2)]))
    m, length = 1.5, 0.8
    inertia = np.array([0.1 + m * length**2, 0.2 + m * length**2, 0.3])
    expected_A = np.block(
        [[np.zeros((3, 3)), np.eye(3)], [np.diag([-m * G * length, -m * G * length, 0] / inertia), np.zeros((3, 3))]]
    )
    np.testing.assert_allclose(linear.A, expected_A, atol=1e-9)
    assert linear.B[3:] == pytest.approx(np.diag(1 / inertia)[:, :2], abs=1e-9)
    turn = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
    assert linear.C[:, :2] == pytest.approx(turn @ np.array([[0, -length], [length, 0]]), abs=1e-9)
    assert linear.C[:, 2:] == pytest.approx(np.zeros((2, 4)), abs=1e-9)


def test_free_body_is_a_double_integrator_along_its_own_axis(tmp_path: Path) -> None:
    plant = plant_of(tmp_path, FREE_BODY, inputs=["thrust"], outputs=["site:centre:x"])
    linear = linearize(plant.at(qpos=[1, 2, 3, np.sqrt(0.5), 0, np.sqrt(0.5), 0]))  # the body's z axis lies along the world's x
    np.testing.assert_allclose(linear.A, np.block([[np.zeros((6, 6)), np.eye(6)], [np.zeros((6, 12))]]), atol=1e-12)
    assert linear.B[:, 0] == pytest.approx(np.r_[np.zeros(6), 1 / 3, np.zeros(5)], abs=1e-12)
    assert linear.C[0] == pytest.approx(np.eye(12)[0], abs=1e-12)


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture], derandomize=True)
@given(angle=st.floats(-3.1, 3.1), step=st.sampled_from([1e-4, 1e-3, 1e-2]))
def test_pendulum_held_at_any_angle_with_honest_error_estimates(tmp_path: Path, angle: float, step: float) -> None:
    """I theta'' = -m g l sin(theta) - c theta' + torque about the angle that the torque holds."""
    m, length, damping = 1.2, 0.5, 0.3
    inertia = m * length**2 + 1e-9
    plant = hinge_pendulum(tmp_path).at(qpos=[angle], ctrl=[m * G * length * np.sin(angle)])
    linear = linearize(plant, step=step)
    expected_A = np.array([[0, 1], [-m * G * length * np.cos(angle) / inertia, -damping / inertia]])
    for name, expected in (("A", expected_A), ("B", np.array([[0], [1 / inertia]])), ("C", np.array([[1, 0]]))):
        error = np.max(np.abs(getattr(linear, name) - expected))
        assert error <= 2 * np.max(linear.error_estimates[name]) + 1e-13 * max(1, np.max(np.abs(expected)))
    assert np.all(linear.error_estimates["A"] < 1e-5)
    assert not np.any(linear.error_estimates["A"][0])  # position' = velocity
    assert linear.operating_point.y0 == pytest.approx([angle])


def transition_error(plant: Plant, timestep: float) -> float:
    """Distance of MuJoCo's discrete transition matrices from the exact discretization of the linear model."""
    linear, model = linearize(plant), plant.model_with()
    model.opt.timestep = timestep
    n, p = linear.n_states, linear.n_outputs
    A, B = np.zeros((n, n)), np.zeros((n, p))
    mujoco.mjd_transitionFD(model, plant.new_data(model), 1e-6, True, A, B, None, None)
    exact = scipy.linalg.expm(timestep * np.block([[linear.A, linear.B], [np.zeros((p, n + p))]]))[:n]
    return float(np.max(np.abs(np.hstack([A, B]) - exact)))


def test_euler_transition_matrices_tend_to_the_discretized_model(tmp_path: Path) -> None:
    """One Euler step is the exact flow of the linear model to second order in the time step."""
    plant = hinge_pendulum(tmp_path, integrator="Euler").at(qpos=[0.4], ctrl=[1.2 * G * 0.5 * np.sin(0.4)])
    errors = [transition_error(plant, h) for h in (8e-3, 4e-3, 2e-3)]
    assert errors[-1] < 1e-4
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.1)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(2, abs=0.1)


def test_controls_that_are_no_input_are_held(tmp_path: Path) -> None:
    """The pendulum tilted about y by a constant torque_y, with torque_x as only input: about x it hangs by l cos(tilt)."""
    tilt, m, length = 0.3, 1.5, 0.8
    plant = plant_of(tmp_path, BALL_PENDULUM, inputs=["torque_y"], outputs=["site:bob:x"])
    held = plant.at(qpos=[np.cos(tilt / 2), 0, np.sin(tilt / 2), 0], ctrl=[0, m * G * length * np.sin(tilt)])
    linear = linearize(held)
    assert linear.operating_point.u0 == pytest.approx([m * G * length * np.sin(tilt)])
    assert linear.A[4, 1] == pytest.approx(-m * G * length * np.cos(tilt) / (0.2 + m * length**2), rel=1e-9)


def test_narrow_control_range_is_respected(tmp_path: Path) -> None:
    linear = linearize(hinge_pendulum(tmp_path, limit=1e-4))
    assert linear.B[1, 0] == pytest.approx(1 / (1.2 * 0.25 + 1e-9), rel=1e-9)


def test_result_does_not_depend_on_the_integrator(tmp_path: Path) -> None:
    models = [linearize(hinge_pendulum(tmp_path, integrator=name)) for name in ("RK4", "Euler", "implicit", "implicitfast")]
    assert all(np.array_equal(model.A, models[0].A) for model in models)


def test_nonequilibrium_can_be_asked_for(tmp_path: Path) -> None:
    linear = linearize(hinge_pendulum(tmp_path, keyframe="tilted"), allow_nonequilibrium=True)
    assert linear.A[1, 0] == pytest.approx(-G / 0.5 * np.cos(0.4), rel=1e-8)
