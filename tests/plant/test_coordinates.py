"""The state in tangent space and MuJoCo's coordinates."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from invtrack.errors import PlantError
from invtrack.plant.configuration import configuration_of, split, state_of
from tests.plant.mechanisms import BALL_PENDULUM, FREE_BODY, LAGGED_SLIDER

MECHANISMS = (BALL_PENDULUM, FREE_BODY, LAGGED_SLIDER)


def random_point(model: mujoco.MjModel, rng: np.random.Generator) -> np.ndarray:
    qpos = rng.normal(size=model.nq)
    mujoco.mj_normalizeQuat(model, qpos)
    return np.concatenate([qpos, rng.normal(size=model.nv + model.na)])


@pytest.mark.parametrize("mjcf", MECHANISMS)
def test_state_and_configuration_are_inverse(mjcf: str) -> None:
    model, rng = mujoco.MjModel.from_xml_string(mjcf), np.random.default_rng(1)
    for _ in range(20):
        x0 = random_point(model, rng)
        x = rng.uniform(-1.5, 1.5, 2 * model.nv + model.na)
        assert state_of(model, x0, *configuration_of(model, x0, x)) == pytest.approx(x, abs=1e-13)


@pytest.mark.parametrize("mjcf", MECHANISMS)
def test_operating_point_itself_is_the_zero_state(mjcf: str) -> None:
    model = mujoco.MjModel.from_xml_string(mjcf)
    x0 = random_point(model, np.random.default_rng(2))
    assert state_of(model, x0, *split(model, x0)) == pytest.approx(np.zeros(2 * model.nv + model.na), abs=1e-15)


def test_both_signs_of_a_quaternion_are_the_same_state() -> None:
    model = mujoco.MjModel.from_xml_string(BALL_PENDULUM)
    x0 = random_point(model, np.random.default_rng(3))
    qpos, qvel, act = configuration_of(model, x0, [0.3, -0.2, 0.5, 0, 0, 0])
    assert state_of(model, x0, -qpos, qvel, act) == pytest.approx(state_of(model, x0, qpos, qvel, act), abs=1e-14)


def test_rotation_is_measured_in_the_frame_of_the_body_at_the_operating_point() -> None:
    model = mujoco.MjModel.from_xml_string(BALL_PENDULUM)
    quarter_about_z = np.array([np.sqrt(0.5), 0, 0, np.sqrt(0.5)])
    about_world_x, turned = np.array([np.cos(0.1), np.sin(0.1), 0, 0]), np.zeros(4)
    mujoco.mju_mulQuat(turned, about_world_x, quarter_about_z)  # first the quarter turn, then 0.2 rad about the world's x axis
    x = state_of(model, np.r_[quarter_about_z, 0, 0, 0], turned, np.zeros(3))
    assert x[:3] == pytest.approx([0, -0.2, 0], abs=1e-14)  # the world's x axis is the body's -y axis


def test_tangent_rate_is_the_velocity() -> None:
    """Where MuJoCo moves with qvel for a short time, x has moved by qvel times that time."""
    model = mujoco.MjModel.from_xml_string(FREE_BODY)
    x0, qvel, h = random_point(model, np.random.default_rng(4)), np.array([1.0, -2, 3, 0.5, -0.4, 0.3]), 1e-3
    qpos, _, _ = split(model, x0)
    mujoco.mj_integratePos(model, qpos, qvel, h)
    assert state_of(model, x0, qpos, np.zeros(6))[:6] == pytest.approx(h * qvel, abs=1e-14)


@pytest.mark.parametrize(("part", "sizes"), [("qpos", (2, 1, 1)), ("qvel", (1, 3, 1)), ("act", (1, 1, 0))])
def test_wrong_sizes_are_refused(part: str, sizes: tuple[int, int, int]) -> None:
    model = mujoco.MjModel.from_xml_string(LAGGED_SLIDER)
    with pytest.raises(PlantError, match=rf"{part} has shape .*expected \(1,\)"):
        state_of(model, np.zeros(3), *(np.zeros(size) for size in sizes))


def test_wrong_state_size_is_refused() -> None:
    with pytest.raises(PlantError, match=r"x has shape \(4,\), expected \(3,\)"):
        configuration_of(mujoco.MjModel.from_xml_string(LAGGED_SLIDER), np.zeros(3), np.zeros(4))
