"""MuJoCo's global callbacks, served by compiled code for the models that are registered, beside whatever else is installed."""

from __future__ import annotations

import copy
import ctypes
import threading
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np
import pytest

from invtrack.errors import PlantError
from invtrack.plant.linearize import linearize
from invtrack.plant.loading import model_path
from invtrack.plant.mujoco_warnings import mujoco_warnings
from invtrack.plant.native.layout import data_count, data_pointer
from invtrack.plant.native.slots import CallbackSlots
from invtrack.plant.plant import Plant
from tests.plant.mechanisms import LAGGED_SLIDER, cantilever


@pytest.fixture(autouse=True)
def _clean_callbacks() -> Iterator[None]:
    yield
    left = mujoco.get_mjcb_control(), mujoco.get_mjcb_passive()
    mujoco.set_mjcb_control(None)
    mujoco.set_mjcb_passive(None)
    assert left == (None, None)


def two_disc() -> Plant:
    return Plant.from_xml(model_path("two_disc"), inputs=["motor"], outputs=["disc2_angle"])


def accelerations(model: mujoco.MjModel) -> np.ndarray:
    """Of a model of the rig that turns, without torque."""
    data = mujoco.MjData(model)
    data.qvel[:] = 1.0, -2.0
    mujoco.mj_forward(model, data)
    return np.array(data.qacc)


def test_a_callback_of_the_user_goes_on_beside_the_couplings() -> None:
    """Another model keeps the callback that was installed for it, also while compiled couplings act on ours."""
    plant = two_disc()
    model, other = plant.model_with(), mujoco.MjModel.from_xml_string(LAGGED_SLIDER)
    with plant.forces(model):
        coupled = accelerations(model)
    calls: list[mujoco.MjModel] = []

    def pull(called: mujoco.MjModel, data: mujoco.MjData) -> None:
        calls.append(called)
        data.qfrc_passive[0] += 5.0

    mujoco.set_mjcb_passive(pull)
    with plant.forces(model):
        assert np.array_equal(accelerations(model), coupled)
        data = mujoco.MjData(other)
        mujoco.mj_forward(other, data)
    assert data.qacc == pytest.approx([5 / 2])  # F = m a
    assert mujoco.get_mjcb_passive() is pull
    assert len(calls) == 1
    mujoco.set_mjcb_passive(None)


def test_other_models_and_copies_do_not_feel_the_couplings() -> None:
    plant = two_disc()
    model = plant.model_with()
    free = accelerations(model)
    with plant.forces(model):
        assert np.max(np.abs(accelerations(model) - free)) > 1e-3
        assert np.array_equal(accelerations(copy.copy(model)), free)
        assert np.array_equal(accelerations(plant.model), free)


def test_plants_can_be_loaded_changed_and_linearized_inside_a_block() -> None:
    plant = two_disc()
    with plant.forces():
        coupled = accelerations(plant.model)
        other = cantilever()
        linear = linearize(other, tip_mass=10.0)
        assert other.compiled_with({"tip_mass": 10.0}).nv == 3
        assert np.array_equal(accelerations(plant.model), coupled)
    assert np.array_equal(linear.A, linearize(other, tip_mass=10.0).A)


def test_blocks_may_end_in_any_order() -> None:
    """As runs in threads do: the callback stays until the last of them has ended."""
    plants = [two_disc() for _ in range(3)]
    blocks = [plant.forces() for plant in plants]
    expected = []
    for plant, block in zip(plants, blocks, strict=True):
        block.__enter__()
        expected.append(accelerations(plant.model))
    for number in (1, 0):
        blocks[number].__exit__(None, None, None)
    assert np.array_equal(accelerations(plants[2].model), expected[2])
    assert not np.array_equal(accelerations(plants[0].model), expected[0])
    blocks[2].__exit__(None, None, None)
    assert mujoco.get_mjcb_passive() is None


def test_more_blocks_than_there_are_slots_are_refused() -> None:
    few = CallbackSlots("control", size=2)
    refused = pytest.raises(PlantError, match=r"2 runs and blocks .* no more are possible at a time")
    with few.block(1, 1), few.block(2, 2), refused, few.block(3, 3):
        pass
    with few.block(3, 3), few.block(4, 4):
        pass


def test_layout_of_mjdata_is_found_for_any_model(tmp_path: Path) -> None:
    """Pointers and counts found on one model are those of another."""
    floor = '<geom type="plane" size="1 1 1"/>'
    ball = '<body pos="{} 0 0.09"><freejoint/><geom size="0.1"/></body>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{floor}{ball.format(0)}{ball.format(3)}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert data.ncon == 2
    for name in ("qvel", "qfrc_passive", "xpos", "xmat", "cvel", "cdof", "subtree_com"):
        assert number_at(data._address + data_pointer(name), np.int64) == getattr(data, name).ctypes.data
    assert number_at(data._address + data_count("ncon"), np.int32) == 2
    assert number_at(data._address + data_count("nl"), np.int32) == 0


def number_at(address: int, dtype: type) -> int:
    """The number of this type at an address."""
    kind = {np.int64: ctypes.c_int64, np.int32: ctypes.c_int32}[dtype]
    return int(kind.from_address(address).value)


def test_warnings_go_to_the_block_of_the_thread_in_which_they_arise() -> None:
    found: dict[str, list[str]] = {}
    both = threading.Barrier(2)

    def diverge(name: str, *, badly: bool) -> None:
        model = mujoco.MjModel.from_xml_string(LAGGED_SLIDER)
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        data = mujoco.MjData(model)
        with mujoco_warnings() as texts:
            both.wait()
            data.qvel[:] = np.nan if badly else 0.0
            mujoco.mj_step(model, data)
            both.wait()
        found[name] = texts

    threads = [threading.Thread(target=diverge, args=(name,), kwargs={"badly": name == "bad"}) for name in ("bad", "good")]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found["good"] == []
    assert any("QVEL" in text for text in found["bad"])
