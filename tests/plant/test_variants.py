"""Plants with other limits and couplings: what MuJoCo then does, and that the plant they came from stays as it was."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from invtrack.errors import PlantError
from invtrack.plant.linearize import linearize
from invtrack.plant.loading import model_path
from invtrack.plant.plant import Plant
from invtrack.plant.variants import with_coupling_scaled, with_input_limits, with_parameter_values
from tests.plant.mechanisms import plant_of

CLAMPLESS = """
<mujoco model="clampless">
  <option integrator="RK4"><flag clampctrl="disable"/></option>
  <worldbody><body name="cart"><joint name="x" type="slide"/><geom size="0.1"/></body></worldbody>
  <actuator><motor name="push" joint="x"/></actuator>
</mujoco>"""


def two_disc(name: str = "two_disc") -> Plant:
    return Plant.from_xml(model_path(name), inputs=["motor"], outputs=["disc2_angle"])


def acceleration(plant: Plant, control: float, *, compiled: bool = False) -> np.ndarray:
    model = plant.compiled_with({}) if compiled else plant.model_with()
    data = plant.new_data(model)
    data.qvel[:], data.ctrl[:] = [0.3, -0.2], control
    with plant.forces(model):
        mujoco.mj_forward(model, data)
    return np.array(data.qacc)


@pytest.mark.parametrize("compiled", [False, True])
def test_more_than_the_limit_acts_like_the_limit(compiled: bool) -> None:
    free, limited = two_disc(), with_input_limits(two_disc(), {"motor": 0.5})
    for control, effective in ((0.4, 0.4), (0.7, 0.5), (-3.0, -0.5)):
        np.testing.assert_array_equal(acceleration(limited, control, compiled=compiled), acceleration(free, effective))


def test_limits_leave_the_linear_model_and_the_plant_alone() -> None:
    free = two_disc()
    limited = with_input_limits(free, {"motor": (-0.02, 0.5)})
    assert limited.input_limits.tolist() == [[-0.02, 0.5]]
    assert free.input_limits.tolist() == [[-np.inf, np.inf]]
    first, second = linearize(free), linearize(limited)
    for name in "ABCD":
        np.testing.assert_allclose(getattr(second, name), getattr(first, name), rtol=1e-9, atol=1e-9)


def test_the_velocity_part_of_the_dynamics_scales_with_the_coupling() -> None:
    plant = two_disc()
    reference = linearize(plant).A
    for scale in (0.9, 1.0, 1.2):
        A = linearize(with_coupling_scaled(plant, "velocity_coupling", scale)).A
        np.testing.assert_allclose(A[2:, 2:], scale * reference[2:, 2:], rtol=1e-9)
        np.testing.assert_allclose(A[:, :2], reference[:, :2], rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(linearize(plant).A, reference)


def test_without_coupling_it_is_the_passive_rig() -> None:
    none = with_coupling_scaled(two_disc(), "velocity_coupling", 0.0)
    np.testing.assert_allclose(linearize(none).A, linearize(two_disc("two_disc_passive")).A, atol=1e-9)


def test_model_specification_and_forces_hold_the_same_coupling() -> None:
    scaled = with_coupling_scaled(two_disc(), "velocity_coupling", 1.1)
    for model in (scaled.model, scaled.compiled_with({})):
        np.testing.assert_array_equal(model.numeric_data, scaled.couplings[0].K.ravel())
    np.testing.assert_array_equal(acceleration(scaled, 0.1, compiled=True), acceleration(scaled, 0.1))


def test_both_variants_together() -> None:
    plant = with_coupling_scaled(with_input_limits(two_disc(), {"motor": 1.0}), "velocity_coupling", 2.0)
    assert plant.input_limits.tolist() == [[-1.0, 1.0]]
    np.testing.assert_allclose(plant.couplings[0].K, 2 * two_disc().couplings[0].K)


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ({"moter": 1.0}, r"limits are given for moter; the plant's inputs are: motor"),
        ({"motor": -1.0}, "must be finite, the lowest before the highest, got -1.0"),
        ({"motor": (1.0, 0.5)}, r"the lowest before the highest, got \[1.0, 0.5\]"),
        ({"motor": float("inf")}, "must be finite"),
        ({"motor": (0.0, float("nan"))}, "must be finite"),
        ({"motor": (0.0, 1.0, 2.0)}, "must be a number or two"),
    ],
)
def test_limits_that_make_no_sense_are_refused(limits: dict[str, float], message: str) -> None:
    with pytest.raises(PlantError, match=message):
        with_input_limits(two_disc(), limits)


def test_a_model_that_does_not_clamp_is_refused(tmp_path: Path) -> None:
    plant = plant_of(tmp_path, CLAMPLESS, inputs=["push"], outputs=["joint:x"])
    with pytest.raises(PlantError, match="'clampless' disables the clamping of controls"):
        with_input_limits(plant, {"push": 1.0})


def test_couplings_that_there_are_not_are_refused() -> None:
    with pytest.raises(PlantError, match=r"has no velocity coupling 'drag'; there are: velocity_coupling"):
        with_coupling_scaled(two_disc(), "drag", 1.0)
    with pytest.raises(PlantError, match="scale must be a finite number, got nan"):
        with_coupling_scaled(two_disc(), "velocity_coupling", float("nan"))


@pytest.mark.parametrize("compiled", [False, True])
def test_parameters_set_for_good_are_those_of_the_model_and_of_one_compiled_afresh(compiled: bool) -> None:
    parameters = {"disc": "body:disc1:mass", "damping": "joint:th1:damping"}
    plant = Plant.from_xml(model_path("two_disc"), inputs=["motor"], outputs=["disc2_angle"], parameters=parameters)
    values = {"disc": 2.5 * plant.parameter_values["disc"], "damping": 0.3}
    other = with_parameter_values(plant, values)
    assert other.parameter_values == pytest.approx(values, rel=1e-12)
    assert plant.parameter_values["damping"] == 0.0
    model = other.compiled_with({}) if compiled else other.model_with()
    expected = plant.compiled_with(values)
    for name in ("body_mass", "body_subtreemass", "dof_damping"):
        np.testing.assert_allclose(getattr(model, name), getattr(expected, name), rtol=1e-9)
    with pytest.raises(PlantError, match="mass"):
        with_parameter_values(plant, {"mass": 1.0})
