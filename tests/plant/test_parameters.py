"""Named parameters against models compiled afresh with the new values."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from invtrack.errors import PlantError
from invtrack.plant.plant import Plant
from tests.plant.mechanisms import BALL_PENDULUM, LIGHT_CARRIER, SPRINGS, cantilever, plant_of

SPRING_PARAMETERS: dict[str, str] = {
    "cart_mass": "body:cart:mass",
    "arm_mass": "body:arm:mass:scaled",
    "k_cart": "joint:x:stiffness",
    "c_swing": "joint:swing:damping",
    "k_link": "tendon:link:stiffness",
    "c_link": "tendon:link:damping",
}
CHANGES: dict[str, float] = {"cart_mass": 31.0, "arm_mass": 9.5, "k_cart": 0.0, "c_swing": 0.9, "k_link": 77.0, "c_link": 0.0}


@pytest.fixture
def springs(tmp_path: Path) -> Plant:
    return plant_of(tmp_path, SPRINGS, inputs=["push"], outputs=["joint:x"], parameters=SPRING_PARAMETERS)


def light_carrier(folder: Path) -> Plant:
    parameters = {"payload": "body:payload:mass"}
    return plant_of(folder, LIGHT_CARRIER, inputs=["push"], outputs=["joint:x"], parameters=parameters)


def motion(model: mujoco.MjModel, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Acceleration and inertia matrix at a random state under a random control."""
    rng, data, inertia = np.random.default_rng(seed), mujoco.MjData(model), np.zeros((model.nv, model.nv))
    data.qpos[:], data.qvel[:], data.ctrl[:] = rng.normal(size=model.nq), rng.normal(size=model.nv), rng.normal(size=model.nu)
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, inertia)
    return np.array(data.qacc), inertia


def assert_same_motion(first: mujoco.MjModel, second: mujoco.MjModel) -> None:
    for seed in range(10):
        for a, b in zip(motion(first, seed), motion(second, seed), strict=True):
            assert np.max(np.abs(a - b)) <= 1e-13 * np.max(np.abs(b))


@pytest.mark.parametrize("tip_mass", [0.0, 1e-9, 10.0, 100.0, 1e6])
def test_every_field_equals_that_of_a_model_compiled_with_the_mass(tip_mass: float) -> None:
    """Also what MuJoCo derives from masses, and the flags that the compiler sets with the file's mass of 0."""
    plant = cantilever()
    changed, compiled = plant.model_with({"tip_mass": tip_mass}), plant.compiled_with({"tip_mass": tip_mass})
    compared = 0
    for name in dir(compiled):
        value = getattr(compiled, name)
        if isinstance(value, np.ndarray) and not name.startswith("_"):
            assert np.array_equal(getattr(changed, name), value), name
            compared += 1
    assert compared > 100
    assert_same_motion(changed, compiled)


@pytest.mark.parametrize("name", CHANGES)
def test_each_kind_of_parameter_equals_a_model_compiled_with_it(springs: Plant, name: str) -> None:
    values = {name: CHANGES[name]}
    assert springs.parameters[name].read(springs.model_with(values)) == CHANGES[name]
    assert_same_motion(springs.model_with(values), springs.compiled_with(values))


def test_each_kind_of_parameter_matters(springs: Plant) -> None:
    unchanged, _ = motion(springs.model, 0)
    for name, value in CHANGES.items():
        assert np.max(np.abs(motion(springs.model_with({name: value}), 0)[0] - unchanged)) > 1e-3


def test_all_parameters_together(springs: Plant) -> None:
    assert_same_motion(springs.model_with(CHANGES), springs.compiled_with(CHANGES))


def test_change_in_mid_run_keeps_the_state_and_gives_the_new_acceleration() -> None:
    plant = cantilever()
    model = plant.model_with()
    data = plant.new_data(model)
    data.qvel[:], data.ctrl[:] = [0.3, -0.1, 0.2], 40.0
    mujoco.mj_step(model, data, 200)
    qpos, qvel, time = data.qpos.copy(), data.qvel.copy(), data.time
    plant.apply(model, {"tip_mass": 100.0})
    assert np.array_equal(data.qpos, qpos)
    assert np.array_equal(data.qvel, qvel)
    assert data.time == time
    mujoco.mj_forward(model, data)
    fresh = plant.compiled_with({"tip_mass": 100.0})
    expected = mujoco.MjData(fresh)
    expected.qpos[:], expected.qvel[:], expected.ctrl[:] = qpos, qvel, data.ctrl
    mujoco.mj_forward(fresh, expected)
    assert np.array_equal(data.qacc, expected.qacc)


def test_there_and_back_is_exactly_the_file(springs: Plant) -> None:
    model = springs.model_with(CHANGES)
    springs.apply(model, springs.parameter_values)
    for seed in range(3):
        assert np.array_equal(motion(model, seed)[0], motion(springs.model, seed)[0])


def test_derived_constants_matter(tmp_path: Path) -> None:
    """Writing the mass without recomputing what derives from it goes wrong: the comparisons above would notice."""
    plant = light_carrier(tmp_path)
    expected, _ = motion(plant.compiled_with({"payload": 100.0}), 0)
    assert motion(plant.model_with({"payload": 100.0}), 0)[0] == pytest.approx(expected, rel=1e-9)
    mutant = plant.model_with()
    mutant.body_mass[mujoco.mj_name2id(mutant, mujoco.mjtObj.mjOBJ_BODY, "payload")] = 100.0
    assert np.max(np.abs(motion(mutant, 0)[0] / expected - 1)) > 0.1


def test_fixed_inertia_is_a_point_mass_and_scaled_inertia_a_denser_body(tmp_path: Path) -> None:
    """Ball pendulum at rest under torque: r'' = torque / (I + m l^2)."""

    def acceleration(parameter: str) -> float:
        plant = plant_of(tmp_path, BALL_PENDULUM, inputs=["torque_x"], outputs=["site:bob:y"], parameters={"mass": parameter})
        model = plant.model_with({"mass": 4.5})  # three times the file's 1.5 kg
        data = plant.new_data(model)
        data.ctrl[0] = 1.0
        mujoco.mj_forward(model, data)
        return float(data.qacc[0])

    assert acceleration("body:bob:mass") == pytest.approx(1 / (0.1 + 4.5 * 0.64))
    assert acceleration("body:bob:mass:scaled") == pytest.approx(1 / (0.3 + 4.5 * 0.64))


def test_units_and_bodies(springs: Plant) -> None:
    channels = springs.parameter_channels
    assert dict(zip(channels.names, channels.units, strict=True)) == {
        "cart_mass": "kg",
        "arm_mass": "kg",
        "k_cart": "N/m",
        "c_swing": "N m s/rad",
        "k_link": "",  # of a slide and a hinge: the tendon's length has no unit
        "c_link": "",
    }
    assert springs.parameter_bodies == {"cart_mass": "cart", "arm_mass": "arm"}


def test_values_in_the_file(springs: Plant) -> None:
    values = springs.parameter_values
    assert values.pop("cart_mass") == pytest.approx(700 * 0.4 * 0.2 * 0.2)
    assert values.pop("arm_mass") > 0
    assert values == {"k_cart": 5, "c_swing": 0.1, "k_link": 4, "c_link": 0.2}


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"tip": 1.0}, r"no parameter 'tip'; there are: cart_mass, arm_mass"),
        ({"cart_mass": -1.0}, r"'cart_mass' must be finite and not negative \[kg\], got -1.0"),
        ({"cart_mass": float("nan")}, "must be finite"),
        ({"c_link": float("inf")}, "must be finite"),
        ({"cart_mass": 0.0}, "leaves a moving body without mass"),
    ],
)
def test_bad_values_are_refused_and_leave_the_model_whole(springs: Plant, values: dict[str, float], message: str) -> None:
    model = springs.model_with()
    with pytest.raises(PlantError, match=message):
        springs.apply(model, {"k_link": 5.0, **values})
    assert springs.parameters["k_link"].read(model) == 4.0
    assert np.array_equal(model.body_mass, springs.model.body_mass)


def test_inertia_cannot_scale_from_zero_mass(tmp_path: Path) -> None:
    parameters = {"payload": "body:payload:mass:scaled"}
    with pytest.raises(PlantError, match=r'mass in the file is 0\.0 kg; give it .* use "body:payload:mass"'):
        plant_of(tmp_path, LIGHT_CARRIER, inputs=["push"], outputs=["joint:x"], parameters=parameters)


def test_models_of_other_plants_are_refused(springs: Plant) -> None:
    with pytest.raises(PlantError, match="expected a model that came from plant 'springs'"):
        springs.apply(cantilever().model_with(), {"k_link": 1.0})


@pytest.mark.parametrize("parameter", ["cart_mass", "arm_mass", "arm_inertia"])
def test_compiling_refuses_options_that_overwrite_the_parameter(tmp_path: Path, parameter: str) -> None:
    parameters = {**SPRING_PARAMETERS, "arm_inertia": "body:arm:inertia[0]"}
    text = SPRINGS.replace("<option", '<compiler inertiafromgeom="true"/><option')
    plant = plant_of(tmp_path, text, inputs=["push"], outputs=["joint:x"], parameters=parameters)
    with pytest.raises(PlantError, match=r"inertiafromgeom or settotalmass overwrite it"):
        plant.compiled_with({parameter: 2.0})
