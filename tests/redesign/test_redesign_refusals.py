"""What cannot be redesigned is refused with its reason and what would help."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import invtrack
from invtrack.errors import InvtrackError, PlanError, RedesignError, TrajectoryError
from invtrack.linear.state_space import StateSpace
from invtrack.redesign.cost import cost
from invtrack.redesign.quadratic import quadratic_redesign
from invtrack.references.generator import Generator
from invtrack.references.profiles import rest_to_rest
from invtrack.references.signal import PiecewiseSignal, stack
from tests.redesign.plants import NONMINIMUM, TWO_DISC, TWO_DISC_WEIGHTS, there_and_back

GOOD: dict[str, Any] = {"R": 1.0, "Q_y": 1.0}
# An undamped oscillator of 2 rad/s beside the plant: seen by the output only, moved by the input only, or neither.
OSCILLATOR = np.array([[0.0, 1.0], [-4.0, 0.0]])


def beside(b: list[float], c: list[float], oscillator: np.ndarray = OSCILLATOR) -> StateSpace:
    A = np.block([[NONMINIMUM.A, np.zeros((3, 2))], [np.zeros((2, 3)), oscillator]])
    return StateSpace(A, np.vstack([NONMINIMUM.B, np.array(b)[:, None]]), np.hstack([NONMINIMUM.C, [c]]))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"R": 0.0}, r"R must be positive definite.*invtrack\.invert"),
        ({"R": -1.0}, "R must be positive semidefinite"),
        ({"R": np.eye(2)}, r"R must be a number or a \(1, 1\) matrix for the inputs \['u1'\], got shape \(2, 2\)"),
        ({"R": "dear"}, "R must be numbers, got 'dear'"),
        ({"Q_x": np.diag([1.0, -1e-3, 1.0])}, "Q_x must be positive semidefinite"),
        ({"Q_x": [[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]}, "Q_x must be symmetric"),
        ({"Q_x": np.eye(3) + 0.1j * np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 0]])}, "a constant Q_x must be real"),
        ({"Q_x": np.eye(2)}, r"\(3, 3\) matrix for the states \['x1', 'x2', 'x3'\]"),
        ({"Q_y": math.nan}, "Q_y has entries that are not finite"),
        ({"Q_y": -1.0}, "Q_y must be positive semidefinite"),
        ({"tolerance": 1.0}, "tolerance must lie between 0 and 1"),
        ({"max_preactuation": -1.0}, "max_preactuation must not be negative"),
        ({"schedule": NONMINIMUM}, "schedule must be a list of changes"),
        ({"schedule": [invtrack.Change(1.0, mass=2.0)]}, "schedule is for a Plant"),
        ({"accuracy": ...}, "accuracy must be real numbers"),
        ({"accuracy": 1.0}, "accuracy must lie between 0 and 1"),
    ],
)
def test_options(options: dict[str, Any], message: str) -> None:
    with pytest.raises(PlanError, match=message):
        quadratic_redesign(NONMINIMUM, there_and_back(), **{**GOOD, **options})


def test_a_held_value_that_costs_for_ever() -> None:
    with pytest.raises(RedesignError, match=r"cost is infinite: after the manoeuvre the outputs \['y1'\].*held at \[1\.0\]"):
        quadratic_redesign(NONMINIMUM, rest_to_rest(0.0, 1.0, 2.0), **GOOD)
    with pytest.raises(RedesignError, match="cost is infinite: before the manoeuvre"):
        quadratic_redesign(NONMINIMUM, rest_to_rest(1.0, 0.0, 2.0), **GOOD)


def test_a_rigid_body_whose_position_costs() -> None:
    """Input-free holding is not enough: a weight on the position itself goes on costing."""
    with pytest.raises(RedesignError, match="cost is infinite: after"):
        quadratic_redesign(TWO_DISC, rest_to_rest(0.0, 1.0, 5.0), **{**TWO_DISC_WEIGHTS, "Q_x": 1.0})


def test_a_reference_that_never_stops() -> None:
    swing = Generator(np.array([[0.0, 1.0], [-1.0, 0.0]]), np.array([[1.0, 0.0]]))
    endless = PiecewiseSignal(np.array([0.0, 1.0]), (swing,), np.zeros(3, dtype=np.intp), np.tile([0.0, 1.0], (3, 1)))
    with pytest.raises(TrajectoryError, match="goes on moving before"):
        quadratic_redesign(NONMINIMUM, endless, **GOOD)


def test_channels() -> None:
    with pytest.raises(TrajectoryError, match=r"2 channels, the plant 1 outputs \['y1'\]"):
        quadratic_redesign(NONMINIMUM, stack([there_and_back(), there_and_back()]), **GOOD)


def test_a_mode_on_the_axis_that_the_cost_does_not_see() -> None:
    model = beside([0.0, 1.0], [0.0, 0.0])
    with pytest.raises(RedesignError, match=r"neither Q_x nor Q_y weighs the mode at .*2j rad/s"):
        quadratic_redesign(model, there_and_back(), **GOOD)
    weighed = quadratic_redesign(model, there_and_back(), **GOOD, Q_x=np.diag([0, 0, 0, 1.0, 0]))
    assert weighed.certificate.dynamics_residual < 1e-11


def test_a_mode_that_no_input_moves() -> None:
    with pytest.raises(RedesignError, match=r"no input moves the mode at .*2j rad/s"):
        quadratic_redesign(beside([0.0, 0.0], [1.0, 0.0]), there_and_back(), **GOOD)
    with pytest.raises(RedesignError, match=r"no input moves the mode at 0\.1"):
        quadratic_redesign(beside([0.0, 0.0], [1.0, 0.0], OSCILLATOR + 0.1 * np.eye(2)), there_and_back(), **GOOD)
    fading = quadratic_redesign(beside([0.0, 0.0], [1.0, 0.0], OSCILLATOR - 0.1 * np.eye(2)), there_and_back(), **GOOD)
    assert fading.certificate.dynamics_residual < 1e-11


def test_an_unstable_mode_that_the_cost_does_not_see_stays_at_rest_before_and_after() -> None:
    """Beside the plant, moved by the input, weighed by nothing: it costs nothing, yet the plan must keep it bounded."""
    plan = quadratic_redesign(beside([0.0, 1.0], [0.0, 0.0], OSCILLATOR + 0.1 * np.eye(2)), there_and_back(), **GOOD)
    assert np.max(np.abs(plan.states([plan.start, plan.end]))) < 1e-8
    assert plan.certificate.dynamics_residual < 1e-11


def test_cost_checks_its_weights_too() -> None:
    plan = quadratic_redesign(NONMINIMUM, there_and_back(), **GOOD)
    with pytest.raises(InvtrackError, match="Q_y must be a number"):
        cost(plan, R=1.0, Q_y=np.eye(3))
