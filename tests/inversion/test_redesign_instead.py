"""Where no inverse serves, or only at a price: what is missing is named, and the call of quadratic_redesign given there works."""

from __future__ import annotations

import re

import numpy as np
import pytest

import invtrack
from invtrack.errors import CompatibilityError
from invtrack.inversion.exact import invert
from invtrack.inversion.modified.modified_inversion import modified_inversion
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.plan import Plan
from invtrack.references.profiles import rest_to_rest
from invtrack.references.signal import PiecewiseSignal, stack
from tests.linear.random_plants import block, plant_with

DRUM, STIFFNESS, EMPTY, LADEN = 5.0, 50.0, 1.0, 3.0
JUMP = 1.0
LIFT = rest_to_rest(0.0, 1.0, 2.4, smoothness=5)


def hoist(mass: float, damping: float = 0.0) -> StateSpace:
    """A drum of 5 kg that a force moves, and a load on an elastic rope of 50 N/m: positions and velocities, the load's measured."""
    A = np.array(
        [[0.0, 1, 0, 0], [-STIFFNESS, -damping, STIFFNESS, damping], [0, 0, 0, 1], [STIFFNESS, damping, -STIFFNESS, -damping]]
    )
    A[1] /= DRUM
    A[3] /= mass
    return StateSpace(A, [[0.0], [1 / DRUM], [0], [0]], [[0.0, 0, 1, 0]], outputs=["load"])


def called(text: str, model: StateSpace | SwitchedSystem, reference: PiecewiseSignal) -> Plan:
    """The plan of the quadratic_redesign call that stands in a text, weights as they stand there."""
    weights = re.search(r"invtrack\.quadratic_redesign\(model, reference, R=(.+?), Q_y=(.+?\]?\)?)\)", text)
    assert weights is not None
    numbers = [[float(entry) for entry in re.findall(r"\d[\d.]*(?:e[+-]?\d+)?", group)] for group in weights.groups()]
    R, Q_y = (entries[0] if len(entries) == 1 else np.diag(entries) for entries in numbers)
    return invtrack.quadratic_redesign(model, reference, R=R, Q_y=Q_y)


def largest_error(plan: Plan) -> float:
    t = np.linspace(plan.manoeuvre[0] - 5.0, plan.manoeuvre[1] + 10.0, 20_001)
    values = plan(t)
    return float(np.max(np.abs(values.y - values.y_d)))


@pytest.mark.parametrize("damping", [0.0, 0.4])
def test_a_rope_that_takes_a_load(damping: float) -> None:
    """y'' = k (x_drum - y) / m: with the rope's force as it was, three times the load is accelerated by a third."""
    model = SwitchedSystem([hoist(EMPTY, damping), hoist(LADEN, damping)], [JUMP])
    before = LIFT(JUMP, derivative=2)[0]
    message = (
        rf"at t = 1 s .* the second derivative of output 'load' would jump from {before:.4g} to {before * EMPTY / LADEN:.4g}, .* "
        rf"the reference asks for {before:.4g} "
    )
    with pytest.raises(CompatibilityError, match=message) as caught:
        invert(model, LIFT)
    plan = called(str(caught.value), model, LIFT)
    assert plan.certificate.dynamics_residual < 1e-8
    assert largest_error(plan) < 0.01


def test_where_the_acceleration_passes_through_zero_the_next_derivative_is_named() -> None:
    """In the middle of the lift y'' = 0 on both sides, so that y''' is the first to jump."""
    model = SwitchedSystem([hoist(EMPTY), hoist(LADEN)], [1.2])
    before = LIFT(1.2, derivative=3)[0]
    with pytest.raises(CompatibilityError, match=rf"the third derivative of output 'load' would jump from {before:.4g} to"):
        invert(model, LIFT)


def test_the_output_of_several_is_named() -> None:
    def pair(mass: float) -> StateSpace:
        one, other = hoist(2.0), hoist(mass)
        none = np.zeros((4, 4))
        return StateSpace(
            np.block([[one.A, none], [none, other.A]]),
            np.block([[one.B, np.zeros((4, 1))], [np.zeros((4, 1)), other.B]]),
            np.block([[one.C, np.zeros((1, 4))], [np.zeros((1, 4)), other.C]]),
            outputs=["left", "right"],
        )

    model, reference = SwitchedSystem([pair(EMPTY), pair(LADEN)], [JUMP]), stack([1e-3 * LIFT, 2.0 * LIFT])
    with pytest.raises(CompatibilityError, match="the second derivative of output 'right' would jump") as caught:
        invert(model, reference)
    plan = called(str(caught.value), model, reference)
    t = np.linspace(-2.0, 8.0, 4001)
    error = np.max(np.abs(plan(t).y - plan(t).y_d), axis=0)
    assert np.all(error < 0.01 * np.array([1e-3, 2.0]))  # each in its own size


def test_a_plan_that_strays_says_so_and_what_to_do() -> None:
    """(0.05 - s)(s + 3) / (s^2 (s + 1)(s + 2)): the zero moved forty times as far out in a motion of a fortieth of its time."""
    A = np.eye(4, k=1)
    A[3] = [0.0, 0.0, -2.0, -3.0]
    plant = StateSpace(A, [[0.0], [0], [0], [1]], [[0.15, -2.95, -1, 0]], outputs=["tip"])
    reference = rest_to_rest(0.0, 2.0, 0.5, smoothness=3)
    plan = modified_inversion(plant, reference, move={0.05: 2.0}, design="robust")
    assert plan.max_error[0] > 10 * 2.0
    assert f"output 'tip' strays from its reference by {plan.max_error[0] / 2:.3g} times the wanted motion" in plan.remarks[-1]
    instead = called(plan.remarks[-1], plant, reference)
    assert largest_error(instead) < 2.0


def test_what_holding_takes_is_said() -> None:
    """Without a rigid-body mode the output's end value takes an input for ever, which a quadratic cost does not allow."""
    plant = plant_with(np.random.default_rng(1), (2,), block(0.01, -3.0))
    plan = modified_inversion(plant, rest_to_rest(0.0, 1.0, 0.5, smoothness=3), move={0.01: 2.0})
    assert "for a reference that ends where holding the output takes no input" in plan.remarks[-1]
    there_and_back = rest_to_rest(0.0, 1.0, 0.5, smoothness=3) - rest_to_rest(0.0, 1.0, 0.5, start_time=0.5, smoothness=3)
    assert largest_error(called(plan.remarks[-1], plant, there_and_back)) < 1.0


def test_a_modest_error_is_not_remarked_upon() -> None:
    plant = plant_with(np.random.default_rng(1), (2,), block(0.5, -3.0))
    plan = modified_inversion(plant, rest_to_rest(0.0, 1.0, 5.0, smoothness=3), move={0.5: 1.0})
    assert plan.relative_error < 10
    assert not any("strays" in remark for remark in plan.remarks)
