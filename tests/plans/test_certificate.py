"""The certificate must be able to fail: trajectories that are wrong in one known way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from invtrack.inversion.exact import invert
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem, as_switched
from invtrack.plans.certificate import Certificate, certify
from invtrack.plans.plan import Plan
from invtrack.plans.trajectory import Trajectory, TwoSidedSegments
from invtrack.references.profiles import raised_cosine, rest_to_rest
from tests.cited_plants import cantilever_paper

LIGHT, HEAVY = StateSpace(*cantilever_paper(0.0)), StateSpace(*cantilever_paper(100.0))
JUMP = SwitchedSystem([LIGHT, HEAVY], [2.0])
REFERENCE = raised_cosine(2.0)


@pytest.fixture(scope="module")
def plan() -> Plan:
    return invert(JUMP, REFERENCE)


def check(plan: Plan, *, model: SwitchedSystem = JUMP, trajectory: Trajectory | None = None) -> Certificate:
    return certify(model, trajectory or plan.trajectory, REFERENCE, (plan.start, plan.end))


def with_rows(trajectory: Trajectory, rows: slice, factor: float) -> Trajectory:
    """The trajectory with some rows of its values [x; u; y] multiplied by a factor."""
    scale = np.ones(trajectory.rows)
    scale[rows] = factor
    return trajectory.mapped(np.diag(scale))


def test_the_right_trajectory_passes(plan: Plan) -> None:
    found = check(plan)
    assert max(found.dynamics_residual, found.output_error, found.continuity) < 1e-12
    assert found.rest_residual <= 1.1 * plan.tolerance


def test_a_wrong_input_gain_shows_in_the_dynamics(plan: Plan) -> None:
    for error in (1e-3, 1e-6):
        found = check(plan, trajectory=with_rows(plan.trajectory, slice(6, 7), 1 + error))
        assert 0.01 * error < found.dynamics_residual < 10 * error


def test_a_wrong_plant_shows_in_the_dynamics(plan: Plan) -> None:
    swapped = SwitchedSystem([HEAVY, LIGHT], [2.0])
    assert check(plan, model=swapped).dynamics_residual > 1e-2
    late = SwitchedSystem([LIGHT, HEAVY], [2.1])
    assert check(plan, model=late).dynamics_residual > 1e-3


def test_a_wrong_motion_shows_in_the_output(plan: Plan) -> None:
    other = invert(JUMP, REFERENCE.scaled(1.01))
    assert check(plan, trajectory=other.trajectory).output_error == pytest.approx(0.01, rel=1e-2)


def test_an_output_that_the_state_does_not_deliver_is_not_believed(plan: Plan) -> None:
    """At rest for ever, but claiming y = y_d: a trajectory of the plant, not one that tracks."""
    idle = with_rows(plan.trajectory, slice(0, 7), 0.0)
    found = check(plan, trajectory=idle)
    assert found.dynamics_residual < 1e-12
    assert found.output_error == pytest.approx(2.0, rel=1e-3)


def test_a_torn_state_shows_as_a_jump(plan: Plan) -> None:
    first, *others = plan.trajectory.groups
    assert isinstance(first, TwoSidedSegments)
    torn = replace(plan.trajectory, groups=(replace(first, start=first.start + np.eye(1, first.start.shape[1])[0]), *others))
    assert check(plan, trajectory=torn).continuity > 1e-2


def test_a_start_that_is_too_late_shows_as_unrest(plan: Plan) -> None:
    found = certify(JUMP, plan.trajectory, REFERENCE, (-5.0, plan.end))
    assert found.rest_residual > 1e-2
    assert invert(JUMP, REFERENCE, max_preactuation=5.0).certificate.rest_residual == pytest.approx(found.rest_residual, rel=0.5)


def test_a_plan_of_rest_is_certified_too() -> None:
    found = invert(LIGHT, REFERENCE.scaled(0.0)).certificate
    assert (found.dynamics_residual, found.output_error, found.continuity, found.rest_residual) == pytest.approx((0, 0, 0, 0))


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_residuals_do_not_depend_on_units_even_for_a_channel_that_stays_still(unit: float) -> None:
    A, B = np.array([[0.0, 1, 0], [0, 0, 1], [-1, -2, -3.0]]), np.array([[0.0, 0], [1, 0], [1, 1]])
    C = unit * np.array([[1.0, 0.3, 0.1], [0.2, -1.0, 1.0]])
    moving = rest_to_rest([0.0, 0.0], [unit, 0.0], 1.0)
    model = as_switched(StateSpace(A, B, C))
    plan = invert(model, moving)
    assert plan.certificate.output_error < 1e-12
    off = with_rows(plan.trajectory, slice(0, 3), 1 + 1e-3)
    assert 1e-4 < certify(model, off, moving, (plan.start, plan.end)).output_error < 1e-2
