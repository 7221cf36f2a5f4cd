"""models/cantilever.xml against the printed matrices."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from invtrack.plant.plant import Plant
from tests.cited_plants import CANTILEVER_M, CANTILEVER_S, CANTILEVER_TIP_MASSES, PAPER_FROM_MJCF
from tests.plant.mechanisms import cantilever

T = PAPER_FROM_MJCF[:3, :3]


@pytest.fixture(scope="module")
def plant() -> Plant:
    return cantilever()


@pytest.mark.parametrize("tip_mass", CANTILEVER_TIP_MASSES)
def test_inertia_matrix(plant: Plant, tip_mass: float) -> None:
    model = plant.model_with({"tip_mass": tip_mass})
    data, inertia = mujoco.MjData(model), np.zeros((3, 3))
    data.qpos[:] = [3.0, -2.0, 1.2]  # the matrix is the same wherever the mechanism stands
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, inertia)
    M = CANTILEVER_M + np.diag([0, tip_mass, 0])
    assert inertia == pytest.approx(T.T @ M @ T, rel=1e-14, abs=1e-13)


def test_stiffness_is_linear_and_as_printed(plant: Plant) -> None:
    data = mujoco.MjData(plant.model)
    for q in np.random.default_rng(6).normal(scale=3, size=(10, 3)):
        data.qpos[:] = q
        mujoco.mj_forward(plant.model, data)
        assert data.qfrc_passive == pytest.approx(-T.T @ CANTILEVER_S @ T @ q, abs=1e-12)


def test_nothing_else_acts(plant: Plant) -> None:
    """Without spring deflection and force the mechanism coasts at any velocity: no damping, no gravity, no contact."""
    model = plant.model_with({"tip_mass": 100.0})
    data = mujoco.MjData(model)
    data.qpos[0], data.qvel[:] = 2.0, [1.0, -2.0, 3.0]
    mujoco.mj_forward(model, data)
    assert data.qacc == pytest.approx(np.zeros(3), abs=1e-13)
    assert (data.nefc, data.ncon) == (0, 0)


def test_sensors_are_the_tip_and_the_base(plant: Plant) -> None:
    data = mujoco.MjData(plant.model)
    data.qpos[:] = [3.0, -1.25, 0.7]
    mujoco.mj_forward(plant.model, data)
    assert data.sensor("tip_position").data == pytest.approx([1.75])
    assert data.sensor("base_position").data == pytest.approx([3.0])
    assert data.body("tip").xpos == pytest.approx([1.75, 0, 1])  # what is seen moves with what is measured


def test_energy_is_conserved_by_rk4(plant: Plant) -> None:
    model = plant.model_with({"tip_mass": 10.0})
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = [0, 0.5, 0.3], [0.1, 0, 0.2]
    M, S = T.T @ (CANTILEVER_M + np.diag([0, 10.0, 0])) @ T, T.T @ CANTILEVER_S @ T

    def energy() -> float:
        return float(data.qvel @ M @ data.qvel + data.qpos @ S @ data.qpos) / 2

    before = energy()
    mujoco.mj_step(model, data, 2000)
    assert energy() == pytest.approx(before, rel=1e-10)
