"""Each way in which a nonlinear motion has no plan, or none that can be trusted, with its own reason."""

from __future__ import annotations

import numpy as np
import pytest

import invtrack
from invtrack.references import stack
from tests.inversion.nonlinear.mechanisms import CART_POLE, cart_pole, link, model, pvtol, sideways

ARM = model(
    "arm",
    """<worldbody><body><joint name="q" type="hinge" axis="0 -1 0" damping=".1" range="{range}"/>
    <geom type="capsule" fromto="0 0 0 1 0 0" size=".02" mass="1"/><site name="tip" pos="1 0 0"/></body></worldbody>
    <actuator><motor name="u" joint="q"/></actuator>""",
)

CRANE = model(
    "crane",
    """<worldbody><body><joint name="trolley" type="slide" axis="1 0 0" damping="1"/>
    <geom type="box" size=".1 .05 .05" mass="1"/><body><joint name="rope" type="hinge" axis="0 1 0"/>
    <geom type="sphere" pos="0 0 -1" size=".05" mass=".5"/></body></body></worldbody>
    <actuator><motor name="force" joint="trolley"/></actuator>""",
)


def arm(limits: str = "-3 3") -> invtrack.Plant:
    plant = invtrack.Plant.from_xml(ARM.replace("{range}", limits), inputs=["u"], outputs=["site:tip:z"])
    return invtrack.trim(plant, outputs=[0.0]).plant


def slew(distance: float, **options: float) -> invtrack.PiecewiseSignal:
    return invtrack.rest_to_rest(0.0, distance, duration=2.0, **options)  # type: ignore[arg-type]


def test_another_number_of_inputs_than_outputs() -> None:
    plant = invtrack.Plant.from_xml(CART_POLE, inputs=["force"], outputs=["joint:cart", "joint:pole"])
    with pytest.raises(invtrack.errors.RelativeDegreeError, match=r"as many inputs as outputs, got 1 inputs \['force'\] for 2"):
        invtrack.invert(plant, stack([slew(1.0), slew(0.0)]))


def test_a_reference_that_begins_elsewhere() -> None:
    with pytest.raises(invtrack.errors.PlanError, match=r"begins at \[1.0\], the plant stands at \[0.0\].*invtrack.trim"):
        invtrack.invert(cart_pole(), invtrack.rest_to_rest(1.0, 2.0, duration=2.0))


def test_an_operating_point_that_is_no_equilibrium() -> None:
    plant = invtrack.Plant.from_xml(ARM.replace("{range}", "-3 3"), inputs=["u"], outputs=["site:tip:z"])
    with pytest.raises(invtrack.errors.PlanError, match=r"'arm' is no equilibrium.*rates of up to 14.5.*invtrack.trim"):
        invtrack.invert(plant, slew(0.5))


def test_a_reference_that_goes_on_moving() -> None:
    ramp = invtrack.references.piecewise_polynomial([0.0, 1.0], [[0.0, 0.0, 0.0, 1.0]], held=(0.0, 1.0))
    endless = invtrack.references.sinusoidal_exosystem([2.0]).reference([0.0, 0.0, 1.0], at=0.0)
    with pytest.raises(invtrack.errors.TrajectoryError, match=r"goes on moving before its breakpoints.*from rest to rest"):
        invtrack.invert(cart_pole(), endless)
    with pytest.raises(invtrack.errors.TrajectoryError, match="not smooth enough: its derivative of order 1 jumps at t = 1 s"):
        invtrack.invert(cart_pole(), ramp)


def test_a_wrong_number_of_channels() -> None:
    with pytest.raises(invtrack.errors.TrajectoryError, match="1 channels, the plant 2 outputs"):
        invtrack.invert(pvtol(), slew(1.0))


def test_outputs_out_of_reach() -> None:
    with pytest.raises(invtrack.errors.PlanError, match=r"no equilibrium near the motion with the outputs \[1.2\].*end at \[0.9"):
        invtrack.invert(arm(), slew(1.2))


def test_another_number_of_unstable_zeros_at_the_end() -> None:
    """A pole on a joint whose spring does not hold it upright at the start, and does at the end."""
    body = """<worldbody><body><joint name="tilt" type="hinge" axis="0 1 0" damping=".1"/>
    <inertial pos="0 0 0" mass="1" diaginertia=".1 .1 .1"/>
    <body pos="0 0 0.3"><joint name="pole" type="hinge" axis="0 1 0" damping=".05" stiffness="0.3"/>
    <geom type="capsule" fromto="0 0 0 0 0 .5" size=".02" mass=".5"/></body></body></worldbody>
    <actuator><motor name="torque" joint="tilt"/></actuator>"""
    plant = invtrack.Plant.from_xml(
        model("swing", body), inputs=["torque"], outputs=["joint:tilt"], parameters={"spring": "joint:pole:stiffness"}
    )
    with pytest.raises(invtrack.errors.BoundednessError, match=r"start has 1 unstable zero.*at the end has 0"):
        invtrack.invert(plant, slew(0.1), schedule=[invtrack.Change(1.0, spring=3.0)])


def test_a_decoupling_that_vanishes_on_the_way() -> None:
    """At the top of its circle the torque moves the tip's height no longer."""
    with pytest.raises(invtrack.errors.RelativeDegreeError, match=r"lose hold of the outputs on the way: B_y"):
        invtrack.invert(arm(), slew(1 - 1e-8))


def test_a_limit_that_would_act_on_the_way() -> None:
    with pytest.raises(invtrack.errors.PlantError, match="limit of joint q"):
        invtrack.invert(arm("-0.2 0.3"), slew(0.5))


def test_zeros_on_the_imaginary_axis_that_are_left_swinging() -> None:
    plant = invtrack.Plant.from_xml(CRANE, inputs=["force"], outputs=["joint:trolley"])
    with pytest.raises(invtrack.errors.NonHyperbolicError, match=r"does not come to rest.*imaginary axis"):
        invtrack.invert(plant, slew(1.0))


def test_a_schedule_with_unknown_parameters() -> None:
    with pytest.raises(invtrack.errors.PlanError, match=r"unknown parameters \['mass'\]; the plant's are: payload"):
        invtrack.invert(link(), slew(1.0), schedule=[invtrack.Change(0.5, mass=1.0)])
    with pytest.raises(invtrack.errors.PlanError, match="schedule must hold changes such as"):
        invtrack.invert(link(), slew(1.0), schedule=[0.5])  # type: ignore[list-item]
    with pytest.raises(invtrack.errors.PlanError, match=r"two changes at t = 0.5 s"):
        invtrack.invert(link(), slew(1.0), schedule=[invtrack.Change(0.5, payload=p) for p in (0.3, 0.4)])


def test_too_many_holds() -> None:
    with pytest.raises(invtrack.errors.PlanError, match=r"in holds of 0.0001 s, \d+ in number, of which 20000 are planned at most"):
        invtrack.invert(cart_pole(), slew(1.0), hold=1e-4)


def test_motions_beyond_what_the_inputs_can_do() -> None:
    """Sideways faster than the craft can lean: thrust would have to turn over."""
    with pytest.raises(invtrack.errors.PlanError, match=r"no motion found: Newton's method follows it up to"):
        invtrack.invert(pvtol(), sideways(4000.0))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"hold": 0.0}, "hold must be a positive number of seconds"),
        ({"accuracy": 0.0}, "accuracy must lie between 0 and 1"),
        ({"tolerance": 2.0}, "tolerance must lie between 0 and 1"),
        ({"max_preactuation": -1.0}, "max_preactuation must not be negative"),
        ({"R": 1.0}, "R chooses among inputs that are left over"),
    ],
)
def test_options_out_of_range(options: dict[str, float], message: str) -> None:
    with pytest.raises(invtrack.errors.PlanError, match=message):
        invtrack.invert(cart_pole(), slew(1.0), **options)  # type: ignore[arg-type]


def test_options_for_a_plant_are_refused_for_a_linear_model() -> None:
    plant = cart_pole()
    with pytest.raises(invtrack.errors.PlanError, match=r"schedule is for a Plant.* is a SwitchedSystem"):
        invtrack.invert(invtrack.linearize(plant), slew(1.0), schedule=[invtrack.Change(0.5, payload=1.0)])


def test_more_input_than_the_actuator_passes_on() -> None:
    """The trolley and its load, 2.5 kg in all, need up to 5 N or so; beside the motion, the input's range is named."""
    crane = CRANE.replace('joint="trolley"/>', 'joint="trolley" ctrlrange="-2 2"/>').replace(
        'type="hinge"', 'type="hinge" damping=".2"'
    )
    plant = invtrack.Plant.from_xml(crane, inputs=["force"], outputs=["joint:trolley"])
    with pytest.raises(invtrack.errors.PlanError, match=r"'force' goes from -\S+ to \S+, of which its actuator passes on -2 to 2"):
        invtrack.invert(plant, slew(2.0))
    plan = invtrack.invert(plant, slew(0.2))
    assert np.all(np.abs(plan.input_range) < 2.0)
