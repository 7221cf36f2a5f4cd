"""Planned trajectories: sides of breakpoints, absolute units, times far away."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from invtrack.errors import TrajectoryError
from invtrack.inversion.exact import invert
from invtrack.linear.state_space import OperatingPoint, StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.plan import Plan
from invtrack.redesign.quadratic import quadratic_redesign
from invtrack.references.exosystem import sinusoidal_exosystem
from invtrack.references.profiles import constant, raised_cosine
from invtrack.references.signal import stack
from invtrack.regulation.exosystem_map import exosystem_map
from tests.cited_plants import CANTILEVER_TIP_MASSES, cantilever_paper


@pytest.fixture(scope="module")
def plan() -> Plan:
    systems = [StateSpace(*cantilever_paper(m)) for m in CANTILEVER_TIP_MASSES]
    return invert(SwitchedSystem(systems, [2.0, 5.0]), raised_cosine(2.0))


def test_input_has_two_values_at_a_jump_and_state_and_output_have_one(plan: Plan) -> None:
    for jump in plan.model.switch_times:
        left, right = plan(jump, inside=jump - 0.1), plan(jump, inside=jump + 0.1)
        assert left.x == pytest.approx(right.x, abs=1e-11)
        assert left.y == pytest.approx(right.y, abs=1e-11)
        assert abs(left.u[0, 0] - right.u[0, 0]) > 1.0
        assert plan(jump).u == pytest.approx(right.u)  # a breakpoint belongs to the piece on its right
        near = plan([jump - 1e-7, jump + 1e-7])
        assert near.u == pytest.approx(np.vstack([left.u, right.u]), abs=1e-3)


def test_rest_far_away_in_either_direction(plan: Plan) -> None:
    far = plan([-1e6, -1e4, 1e4, 1e6])
    assert far.x == pytest.approx(np.zeros((4, 6)), abs=1e-300)
    assert far.u == pytest.approx(np.zeros((4, 1)), abs=1e-300)


def test_what_is_left_at_start_and_end_is_the_tolerance(plan: Plan) -> None:
    peak = np.max(np.abs(plan(np.linspace(0, 2 * np.pi, 2001)).x), axis=0)
    ends = np.abs(plan([plan.start, plan.end]).x) / peak
    assert np.all(np.max(ends, axis=1) <= 1.05 * plan.tolerance)
    assert np.all(np.max(ends, axis=1) >= 0.8 * plan.tolerance)  # and not needlessly early


def test_operating_point_is_added_to_input_and_output_only() -> None:
    """u = u0 + ..., y = y0 + ...: the reference is absolute, the state a deviation."""
    A, B, C = cantilever_paper(0.0)
    point = OperatingPoint(x0=np.zeros(6), u0=np.array([4.0]), y0=np.array([-2.0]))
    plain = invert(StateSpace(A, B, C), raised_cosine(2.0))
    moved = invert(StateSpace(A, B, C, operating_point=point), raised_cosine(2.0) + constant(-2.0))
    t = np.linspace(-20.0, 20.0, 101)
    assert moved(t).x == pytest.approx(plain(t).x, abs=1e-10)
    assert moved(t).u == pytest.approx(plain(t).u + 4.0, abs=1e-8)
    assert moved(t).y == pytest.approx(plain(t).y - 2.0, abs=1e-11)
    assert moved(t).y_d == pytest.approx(moved(t).y, abs=1e-11)


def test_input_range_of_a_plan_without_beginning_or_end_is_its_value_there() -> None:
    plan = exosystem_map(StateSpace([[-1.0]], [[1.0]], [[1.0]]), sinusoidal_exosystem([2.0])).plan([0.0, 1.0, 0.0])
    lowest, highest = plan.input_range
    assert lowest == highest == plan.inputs(plan.start)[0]


@pytest.mark.parametrize("method", [invert, lambda model, signal: quadratic_redesign(model, signal, R=1.0, Q_y=1.0)])
def test_what_is_no_reference_is_refused(method: Callable[..., Plan]) -> None:
    plant = StateSpace([[-1.0]], [[1.0]], [[1.0]])
    with pytest.raises(TrajectoryError, match=r"expected a reference such as .*, got function"):
        method(plant, lambda t: t)
    with pytest.raises(TrajectoryError, match=r"the reference has 2 channels, the plant 1 outputs \['y1'\]; stack"):
        method(plant, stack([raised_cosine(2.0), raised_cosine(2.0)]))
