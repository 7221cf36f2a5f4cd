"""linearize after a change that moves the equilibrium: where that is, and in which frame the states are."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import scipy.optimize

import invtrack
from invtrack.errors import ModelError, PlantError
from invtrack.plant.configuration import configuration_of, state_of
from tests.loads import ARM, ELASTIC_HOIST, SERVO, G, plant_of
from tests.plant.mechanisms import BALL_PENDULUM


def arm() -> invtrack.Plant:
    return invtrack.trim(plant_of(ARM, inputs=["servo"], outputs=["angle"]), outputs={"angle": 0.4}).plant


def test_without_a_word_about_the_equilibrium_a_moved_one_is_refused() -> None:
    """And the call that the refusal names works."""
    plant = arm()
    with pytest.raises(PlantError, match=r'invtrack.linearize\(plant, load=0.8, equilibrium="same outputs"\), or "same controls"'):
        invtrack.linearize(plant, load=0.8)
    assert invtrack.linearize(plant, load=0.8, equilibrium="same outputs").parameters == {"load": 0.8}


def test_the_same_outputs_and_the_same_controls_by_hand() -> None:
    """60 (u - q) = (0.25 + 0.5 m) g cos q."""
    plant, load = arm(), 0.8
    u = plant.operating_point.u0[0]
    holding = invtrack.linearize(plant, load=load, equilibrium="same outputs")
    assert holding.rest == pytest.approx([0.0, 0.0], abs=1e-12)
    assert holding.operating_point.y0 == pytest.approx([0.4])
    assert holding.operating_point.u0 == pytest.approx([0.4 + (0.25 + 0.5 * load) * G * np.cos(0.4) / 60])
    sagging = invtrack.linearize(plant, load=load, equilibrium="same controls")
    q = scipy.optimize.brentq(lambda q: 60 * (u - q) - (0.25 + 0.5 * load) * G * np.cos(q), -1.0, 0.4, xtol=1e-14)
    assert sagging.operating_point.u0 == pytest.approx([u])
    assert sagging.operating_point.y0 == pytest.approx([q])
    assert sagging.rest == pytest.approx([q - 0.4, 0.0])
    inertia = 0.02 + 1.0 * 0.25**2 + load * 0.5**2 + 1e-6
    assert sagging.A[1] == pytest.approx([(-60 + (0.25 + 0.5 * load) * G * np.sin(q)) / inertia, -3 / inertia], rel=1e-6)
    for model in (holding, sagging):
        assert np.array_equal(model.operating_point.x0, plant.operating_point.x0)
    assert invtrack.SwitchedSystem([invtrack.linearize(plant), sagging], [1.0]).rest_states[1] == pytest.approx([q - 0.4, 0.0])


def test_where_nothing_moves_nothing_changes() -> None:
    plant = arm()
    plain = invtrack.linearize(plant)
    for kept in ("same outputs", "same controls"):
        other = invtrack.linearize(plant, equilibrium=kept)  # type: ignore[arg-type]
        assert other.rest == pytest.approx(np.zeros(2), abs=1e-12)
        assert other.operating_point.agrees_with(plain.operating_point)
        assert pytest.approx(plain.A, rel=1e-9) == other.A


def test_models_of_two_plants_at_two_points_are_the_same_as_those_in_one_frame() -> None:
    """Slides and hinges alone: what `trim` finds can be linearized by itself, too."""
    plant = invtrack.trim(plant_of(ELASTIC_HOIST, inputs=["winch"], outputs=["height"])).plant
    there = invtrack.trim(plant, outputs=plant.operating_point.y0, load=3.0)
    apart = [invtrack.linearize(plant), invtrack.linearize(there.plant, load=3.0)]
    framed = [apart[0], invtrack.linearize(plant, load=3.0, equilibrium=there.plant)]
    ours, theirs = (invtrack.SwitchedSystem(models, [1.0]) for models in (apart, framed))
    assert ours.rest_states == pytest.approx(theirs.rest_states, abs=1e-12)
    assert ours.rest_states[1, 0] == pytest.approx(2.0 * G / 50.0)
    assert np.array_equal(ours.systems[1].A, theirs.systems[1].A)


def pendulum() -> invtrack.Plant:
    plant = invtrack.Plant.from_xml(
        BALL_PENDULUM, inputs=["torque_x", "torque_y"], outputs=["site:bob:x", "site:bob:y"], parameters={"bob": "body:bob:mass"}
    )
    return invtrack.trim(plant, controls={"torque_x": 4.0, "torque_y": -3.0}).plant


def test_rotations_are_measured_from_where_the_plant_was() -> None:
    """A heavier bob hangs lower on a ball joint. Rates in the frame from before the change, straight from MuJoCo: the linear ones
    are off by the square of the distance from rest."""
    plant = pendulum()
    model = invtrack.linearize(plant, bob=4.0, equilibrium="same controls", allow_nonequilibrium=True)
    assert np.linalg.norm(model.rest[:3]) > 0.2
    laden, x0 = plant.model_with({"bob": 4.0}), plant.operating_point.x0
    data = plant.new_data(laden)
    direction = np.random.default_rng(0).normal(size=6)
    misses, outputs = [], []
    for size in (1e-2, 5e-3):
        x = model.rest + size * direction
        data.qpos[:], data.qvel[:], _ = configuration_of(laden, x0, x)
        mujoco.mj_forward(laden, data)
        step, ahead = 1e-6, data.qpos.copy()
        mujoco.mj_integratePos(laden, ahead, data.qvel, step)
        behind = data.qpos.copy()
        mujoco.mj_integratePos(laden, behind, data.qvel, -step)
        rate = (state_of(laden, x0, ahead, data.qvel) - state_of(laden, x0, behind, data.qvel))[:3] / (2 * step)
        found = np.concatenate([rate, data.qacc])
        misses.append(np.max(np.abs(found - model.A @ (x - model.rest))))
        outputs.append(np.max(np.abs(plant.measure(data) - model.operating_point.y0 - model.C @ (x - model.rest))))
    for missed in (misses, outputs):
        assert missed[0] < 0.05
        assert np.log2(missed[0] / missed[1]) == pytest.approx(2.0, abs=0.1)


def test_a_rotated_equilibrium_of_its_own_frame_is_refused_with_the_way_out() -> None:
    plant = pendulum()
    there = invtrack.trim(plant, controls=plant.operating_point.u0, bob=4.0).plant
    models = [invtrack.linearize(at, bob=mass, allow_nonequilibrium=True) for at, mass in ((plant, 1.5), (there, 4.0))]
    with pytest.raises(ModelError, match=r'of which no difference .*linearize\(plant, equilibrium="same outputs", \.\.\.\)'):
        invtrack.SwitchedSystem(models, [1.0])


def test_what_is_no_equilibrium_of_the_plant_is_refused() -> None:
    plant = arm()
    other = plant_of(SERVO, inputs=["servo"], outputs=["height"])
    with pytest.raises(PlantError, match=r"equilibrium must be plant 'arm' itself at another operating point.* got 'servo' with"):
        invtrack.linearize(plant, equilibrium=other)
    with pytest.raises(PlantError, match="equilibrium must be one of"):
        invtrack.linearize(plant, equilibrium="outputs")  # type: ignore[arg-type]
    with pytest.raises(PlantError, match="no equilibrium: its state changes"):
        invtrack.linearize(plant, load=0.8, equilibrium=plant.at(ctrl=[0.9]))
