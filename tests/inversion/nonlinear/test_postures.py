"""The posture that holds each wanted output at rest: what is fed back without an inverse."""

from __future__ import annotations

import numpy as np
import pytest

import invtrack
from invtrack.errors import PlanError
from invtrack.inversion import steady_state_feedforward
from tests.inversion.nonlinear.mechanisms import cart_pole, flexible_joint, two_flexible_joints

MASS, REACH, STIFFNESS, GRAVITY = 1.0, 0.25, 100.0, 9.81  # of the raised link: to its centre of mass [m]; its spring [N m/rad]


def test_it_holds_a_raised_link_against_gravity_with_its_spring_bent() -> None:
    """m g l cos(angle) at every angle of the link; the motor is ahead of it by that over the stiffness."""
    plant = flexible_joint()
    reference = invtrack.rest_to_rest(0.0, np.pi / 2, duration=1.0, smoothness=5)
    plan = steady_state_feedforward(plant, reference)
    t = np.linspace(-0.5, 1.5, 203)
    at = plan(t)
    angle = reference(t)[:, 0]
    torque = MASS * GRAVITY * REACH * np.cos(angle)
    bend = torque / STIFFNESS
    motor = angle + bend - (angle[0] + bend[0])  # states count from where the plant stands
    assert at.u[:, 0] == pytest.approx(torque, abs=1e-6)
    assert at.x[:, 0] == pytest.approx(motor, abs=1e-6)
    assert at.x[:, 1] == pytest.approx(-(bend - bend[0]), abs=1e-6)
    assert at.x[:, 2:] == pytest.approx(0.0, abs=1e-12)
    assert at.y[:, 0] == pytest.approx(angle, abs=1e-6)
    assert plan.rest_inputs[:, 0] == pytest.approx(torque[[0, -1]], abs=1e-9)


def test_it_says_that_it_is_no_motion() -> None:
    plan = steady_state_feedforward(cart_pole(), invtrack.rest_to_rest(0.0, 3.0, duration=2.0))
    assert any("not a trajectory of the plant" in remark for remark in plan.remarks)
    assert plan.certificate.dynamics_residual > 1e-3
    assert (plan.start, plan.end) == (0.0, 2.0)
    assert plan.states([1.0])[0] == pytest.approx([1.5, 0.0, 0.0, 0.0], abs=1e-9)  # the pole upright, all at rest


def test_a_load_that_is_picked_up_takes_another_input_from_then_on() -> None:
    plant = invtrack.Plant.from_xml(
        """<mujoco model="hoist"><option gravity="0 0 -9.81" integrator="RK4"/><worldbody><body name="load">
        <joint name="lift" type="slide" axis="0 0 1" damping="0.4"/><inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 0.1"/>
        </body></worldbody><actuator><motor name="winch" joint="lift"/></actuator></mujoco>""",
        inputs=["winch"],
        outputs=["joint:lift"],
        parameters={"load": "body:load:mass"},
    )
    plant = invtrack.trim(plant).plant
    changes = [invtrack.Change(1.0, load=3.0)]
    plan = steady_state_feedforward(plant, invtrack.rest_to_rest(0.0, 1.0, duration=2.5), schedule=changes)
    assert plan.inputs([0.5, 1.0, 1.0, 2.0], inside=[0.5, 0.9, 1.1, 2.0])[:, 0] == pytest.approx([9.81, 9.81, 29.43, 29.43])
    assert plan.schedule == ((1.0, {"load": 3.0}),)


def test_feedback_around_it_carries_links_that_sag_around_the_inputs_of_the_start() -> None:
    plant, ways = two_flexible_joints(), (1.0, -0.7)
    reference = invtrack.references.stack([invtrack.rest_to_rest(0.0, way, duration=1.0, smoothness=5) for way in ways])
    plan = steady_state_feedforward(plant, reference)
    controller = invtrack.TrackingController(plan, invtrack.lqr(plan, Q=1.0, R=1.0))
    run = invtrack.simulate(plant, controller, timestep=2e-3, end=40.0)
    assert np.max(np.abs(run.error[-1])) < 1e-3  # it comes to the posture, late
    assert invtrack.max_error(run) > 0.1


def test_a_reference_that_never_moves_is_held() -> None:
    plan = steady_state_feedforward(flexible_joint(), invtrack.references.constant(0.0))
    assert plan.inputs([-5.0, 0.5, 5.0])[:, 0] == pytest.approx(np.full(3, MASS * GRAVITY * REACH))


def test_what_cannot_be_held_is_refused() -> None:
    plant = invtrack.Plant.from_xml(
        """<mujoco model="pendulum"><option gravity="0 0 -9.81"/><worldbody><body><joint name="lift" type="hinge" axis="0 -1 0"/>
        <geom type="capsule" fromto="0 0 0 1 0 0" size=".02" mass="1"/><site name="tip" pos="1 0 0"/></body></worldbody>
        <actuator><motor name="torque" joint="lift"/></actuator></mujoco>""",
        inputs=["torque"],
        outputs=["site:tip:z"],
    )
    plant = invtrack.trim(plant).plant
    with pytest.raises(PlanError, match=r"plant 'pendulum' has no equilibrium near the motion with the outputs \[1\.2\]"):
        steady_state_feedforward(plant, invtrack.rest_to_rest(0.0, 1.2, duration=1.0))
    with pytest.raises(PlanError, match="schedule is for a Plant; a linear model that switches is a SwitchedSystem"):
        steady_state_feedforward(
            invtrack.linearize(cart_pole()),
            invtrack.rest_to_rest(0.0, 1.0, duration=1.0),
            schedule=[invtrack.Change(1.0, mass=1.0)],
        )
