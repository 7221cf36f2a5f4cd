"""MuJoCo's global callbacks, confined to one model and one block."""

from __future__ import annotations

import copy
from collections.abc import Iterator

import mujoco
import numpy as np
import pytest

from invtrack.plant.couplings import Callback, mujoco_callbacks
from invtrack.plant.linearize import linearize
from tests.plant.mechanisms import FREE_BODY, LAGGED_SLIDER, cantilever


@pytest.fixture(autouse=True)
def _clean_callbacks() -> Iterator[None]:
    yield
    left = mujoco.get_mjcb_control(), mujoco.get_mjcb_passive()
    mujoco.set_mjcb_control(None)
    mujoco.set_mjcb_passive(None)
    assert left == (None, None)


def model_and_data(mjcf: str = LAGGED_SLIDER) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(mjcf)
    return model, mujoco.MjData(model)


def command(value: float) -> Callback:
    def control(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        data.ctrl[:] = value

    return control


def pull(force: float) -> Callback:
    def passive(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        data.qfrc_passive[0] += force

    return passive


def acceleration(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    mujoco.mj_forward(model, data)
    return float(data.qacc[0])


def test_callbacks_act_inside_the_block_and_not_after_it() -> None:
    model, data = model_and_data()
    with mujoco_callbacks(model, control=command(2.0), passive=pull(5.0)):
        assert acceleration(model, data) == pytest.approx(5 / 2)  # F = m a; the control passes through a lag
        assert data.act_dot == pytest.approx([2.0 / 0.05])
    data.ctrl[:] = 0
    assert acceleration(model, data) == pytest.approx(0)


def test_passive_force_is_seen_in_every_stage_of_rk4() -> None:
    """A force linear in velocity, given as a callback, moves the mass as the same damping in the file does."""
    damped, reference = model_and_data()
    by_callback, data = model_and_data()
    by_callback.dof_damping[:] = 0

    def damp(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        data.qfrc_passive -= 0.7 * data.qvel

    reference.qvel[:] = data.qvel[:] = 1
    with mujoco_callbacks(by_callback, passive=damp):
        for model, each in ((damped, reference), (by_callback, data)):
            mujoco.mj_step(model, each, 50)
    assert data.qpos == pytest.approx(reference.qpos, abs=1e-14)


def test_callbacks_are_cleared_after_an_exception_in_the_block() -> None:
    model, _ = model_and_data()
    with pytest.raises(KeyError, match="stop"), mujoco_callbacks(model, control=command(1.0), passive=pull(1.0)):
        raise KeyError("stop")
    assert (mujoco.get_mjcb_control(), mujoco.get_mjcb_passive()) == (None, None)


def test_exception_inside_a_callback_reaches_the_caller() -> None:
    model, data = model_and_data()

    def broken(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        raise RuntimeError("controller failed")

    with pytest.raises(RuntimeError, match="controller failed"), mujoco_callbacks(model, control=broken):
        mujoco.mj_step(model, data)
    assert mujoco.get_mjcb_control() is None


def test_other_models_and_copies_do_not_see_the_callbacks() -> None:
    model, _ = model_and_data()
    others = copy.copy(model), model_and_data()[0], model_and_data(FREE_BODY)[0]
    with mujoco_callbacks(model, passive=pull(5.0)):
        for other in others:
            assert acceleration(other, mujoco.MjData(other)) == pytest.approx(0)


def test_interleaved_plants_each_see_their_own() -> None:
    """Two models stepped in turn inside nested blocks move as each does alone."""

    def alone(force: float) -> np.ndarray:
        model, data = model_and_data()
        with mujoco_callbacks(model, passive=pull(force)):
            mujoco.mj_step(model, data, 20)
        return np.array(data.qpos)

    (first, first_data), (second, second_data) = model_and_data(), model_and_data()
    with mujoco_callbacks(first, passive=pull(1.0)):
        mujoco.mj_step(first, first_data, 10)
        with mujoco_callbacks(second, passive=pull(-3.0)):
            for _ in range(10):
                mujoco.mj_step(second, second_data)
                mujoco.mj_step(first, first_data)
                mujoco.mj_step(second, second_data)
    assert np.array_equal(first_data.qpos, alone(1.0))
    assert np.array_equal(second_data.qpos, alone(-3.0))


def test_inner_block_on_the_same_model_takes_over_and_gives_back() -> None:
    model, data = model_and_data()
    with mujoco_callbacks(model, passive=pull(2.0)):
        with mujoco_callbacks(model, passive=pull(8.0)):
            assert acceleration(model, data) == pytest.approx(4)
        assert acceleration(model, data) == pytest.approx(1)


def test_plants_can_be_loaded_changed_and_linearized_inside_a_block() -> None:
    model, data = model_and_data()
    with mujoco_callbacks(model, control=command(1.0), passive=pull(4.0)):
        plant = cantilever()
        linear = linearize(plant, tip_mass=10.0)
        assert plant.compiled_with({"tip_mass": 10.0}).nv == 3
        assert acceleration(model, data) == pytest.approx(2)
    assert np.array_equal(linear.A, linearize(plant, tip_mass=10.0).A)
