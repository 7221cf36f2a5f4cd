"""Loads picked up in mid-run against gravity: exact on the linear model, and in MuJoCo off by what is not linear."""

from __future__ import annotations

import numpy as np
import pytest

import invtrack
from tests.loads import ARM, ELASTIC_HOIST, QUADROTOR, RIGID_HOIST, SERVO, G, plant_of

PICKED_UP = 1.0


def switched(plant: invtrack.Plant, load: float, equilibrium: str = "same outputs") -> invtrack.SwitchedSystem:
    """The plant, which picks up its load at 1 s."""
    laden = invtrack.linearize(plant, load=load, equilibrium=equilibrium)  # type: ignore[arg-type]
    return invtrack.SwitchedSystem([invtrack.linearize(plant), laden], [PICKED_UP])


def largest_error(plant: object, controller: object, timestep: float = 2e-3) -> float:
    result = invtrack.simulate(plant, controller, evaluate="stages", timestep=timestep)  # type: ignore[arg-type]
    assert result.status == "completed"
    return float(np.max(np.abs(result.output.values - result.planned_output.values)))


def test_a_hoist_with_a_rigid_rope() -> None:
    """The input jumps by the weight of the load and by what accelerates it; a linear mechanism: MuJoCo does what the model says."""
    plant = plant_of(RIGID_HOIST, inputs=["winch"], outputs=["height"], keyframe="held")
    model = switched(plant, 3.0)
    assert model.rest_inputs[:, 0] == pytest.approx([1.0 * G, 3.0 * G])
    plan = invtrack.invert(model, invtrack.rest_to_rest(0.0, 1.0, 2.5, smoothness=3))
    controller = invtrack.TrackingController(plan)
    assert plan.certificate.output_error < 1e-12
    assert largest_error(invtrack.LinearPlant(model), controller) < 1e-9
    assert largest_error(plant, controller) < 1e-9
    result = invtrack.simulate(plant, controller)
    assert invtrack.max_error(result) < 1e-5
    assert [event.text for event in result.events if event.kind == "parameter"] == ["load = 3 kg"]


def test_a_quadrotor_takes_a_load_in_flight() -> None:
    """Its load sits at its centre of mass: hovering takes more thrust, and nothing else changes that the outputs know of."""
    names = ["front", "left", "back", "right"]
    outputs = ["place[0]", "place[1]", "place[2]", "attitude[3]"]
    plant = plant_of(QUADROTOR, inputs=names, outputs=outputs, body="frame", keyframe="hover")
    model = switched(plant, 1.5)
    assert model.rest_inputs == pytest.approx(np.array([[G / 4] * 4, [1.5 * G / 4] * 4]))
    assert np.max(np.abs(model.rest_states)) < 1e-12
    gains = invtrack.lqr(model, Q=10.0, R=1.0)
    differences, hover = [], np.array([0.0, 0.0, 1.0, 0.0])
    for size in (0.1, 0.05):
        there = np.array([1.0, -0.5, 0.4, 0.1]) * size
        reference = invtrack.rest_to_rest(hover, hover + there, 2.5, smoothness=5)
        plan = invtrack.invert(model, reference)
        controller = invtrack.TrackingController(plan, gains)
        assert largest_error(invtrack.LinearPlant(model), controller, 5e-3) < 1e-5 * size
        differences.append(largest_error(plant, controller, 5e-3))
    assert np.log2(differences[0] / differences[1]) == pytest.approx(2.0, abs=0.1)


def test_an_elastic_rope_is_refused_and_its_redesign_does_what_it_says() -> None:
    plant = invtrack.trim(plant_of(ELASTIC_HOIST, inputs=["winch"], outputs=["height"])).plant
    model = switched(plant, 3.0)
    lift = invtrack.rest_to_rest(0.0, 1.0, 2.5, smoothness=5) + model.rest_outputs[0]
    with pytest.raises(
        invtrack.errors.CompatibilityError, match=r"second derivative of output 'height' would jump .*quadratic_redesign"
    ):
        invtrack.invert(model, lift)
    assert model.rest_states[1] == pytest.approx([2.0 * G / 50.0, 0.0, 0.0, 0.0], abs=1e-9)  # the rope stretches, the load stays
    plan = invtrack.quadratic_redesign(model, lift, R=1e-7, Q_y=1.0, tolerance=1e-7)
    planned = np.max(np.abs(plan(np.linspace(-3.0, 6.0, 2001)).y - lift(np.linspace(-3.0, 6.0, 2001))))
    assert 1e-3 < planned < 0.1
    controller = invtrack.TrackingController(plan, invtrack.lqr(model, Q=1.0, R=1e-2))
    for real in (invtrack.LinearPlant(model), plant):
        result = invtrack.simulate(real, controller, evaluate="stages", timestep=2e-3)
        assert invtrack.max_error(result) == pytest.approx(planned, rel=1e-3)
        assert np.max(np.abs(result.output.values - result.planned_output.values)) < 1e-5 * planned


def test_a_servo_that_sags_or_holds_is_one_and_the_same_plant() -> None:
    """It sags by 3 g / 800 with the controls as they were, or holds with a setpoint as much higher: of a linear mechanism both are
    descriptions of the same motions, so the plans are the same, too."""
    plant = invtrack.trim(plant_of(SERVO, inputs=["servo"], outputs=["height"]), outputs={"height": 0.2}).plant
    sagging, holding = (switched(plant, 5.0, kept) for kept in ("same controls", "same outputs"))
    sag = 3.0 * G / 800.0
    assert (sagging.rest_states[1, 0], sagging.rest_outputs[1, 0]) == pytest.approx((-sag, 0.2 - sag))
    assert (holding.rest_inputs[1] - holding.rest_inputs[0])[0] == pytest.approx(sag)
    reference = invtrack.rest_to_rest(0.2, 0.5, 2.0, smoothness=3)
    plans = [invtrack.invert(model, reference) for model in (sagging, holding)]
    times = np.linspace(-0.5, 3.0, 71)
    assert plans[0].states(times) == pytest.approx(plans[1].states(times), abs=1e-9)
    assert plans[0].inputs(times) == pytest.approx(plans[1].inputs(times), abs=1e-9)
    for plan, model in zip(plans, (sagging, holding), strict=True):
        for real in (invtrack.LinearPlant(model), plant):
            assert largest_error(real, invtrack.TrackingController(plan)) < 1e-8
    # Left alone it sags.
    still = invtrack.invert(sagging, invtrack.rest_to_rest(0.2, 0.2, 1.0))
    held = invtrack.simulate(plant, Constant(still), start=0.0, end=4.0)
    assert held.output.values[-1, 0] == pytest.approx(0.2 - sag, abs=1e-6)


class Constant(invtrack.TrackingController):
    """The first input of a plan for ever."""

    def mean_feedforward(self, instants: invtrack.control.Instants) -> np.ndarray:
        return np.tile(self.plan.inputs([self.plan.start - 1.0]), (len(instants.time), 1))


def test_an_arm_that_holds_its_load() -> None:
    """The weight's torque is a cosine, linear about where the arm is held: the difference falls with the motion's square."""
    plant = invtrack.trim(plant_of(ARM, inputs=["servo"], outputs=["angle"]), outputs={"angle": 0.4}).plant
    model = switched(plant, 0.8)
    torque = 0.6 * G * 0.5 * np.cos(0.4)
    assert (model.rest_inputs[1] - model.rest_inputs[0])[0] == pytest.approx(torque / 60.0)
    differences = []
    for size in (0.2, 0.1):
        plan = invtrack.invert(model, invtrack.rest_to_rest(0.4, 0.4 + size, 2.0, smoothness=3))
        assert largest_error(invtrack.LinearPlant(model), invtrack.TrackingController(plan)) < 1e-9
        differences.append(largest_error(plant, invtrack.TrackingController(plan)))
    assert np.log2(differences[0] / differences[1]) == pytest.approx(2.0, abs=0.15)
