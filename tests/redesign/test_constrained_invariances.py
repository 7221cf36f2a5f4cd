"""What must not change a plan within limits, how its limits are stated and refused, and that a plant follows it."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from invtrack.control.lqr import lqr
from invtrack.control.tracking_controller import TrackingController
from invtrack.errors import RedesignError
from invtrack.linear.state_space import OperatingPoint, StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.export import sampled_plan
from invtrack.redesign.constrained import ConstrainedTrajectory, constrained_redesign
from invtrack.redesign.cost import cost
from invtrack.redesign.limited import quadratic_program
from invtrack.redesign.limits import Limits, StateLimit
from invtrack.redesign.quadratic import quadratic_redesign
from invtrack.references.profiles import constant, rest_to_rest
from invtrack.simulation.closed_loop import simulate
from invtrack.simulation.linear_plant import LinearPlant
from tests.redesign.plants import (
    FULL,
    FULL_WEIGHTS,
    HEAVIER,
    NONMINIMUM,
    STRONGER,
    TWO_DISC,
    TWO_DISC_WEIGHTS,
    WEIGHTS,
    there_and_back,
    two_channels,
)

Array = NDArray[np.float64]

LIMITS = Limits(input=(-0.3, 1.0), input_rate=1.5, output=(-0.05, 0.7), states=[StateLimit("middle", {"x2": 1.0}, 0.12)])
TIMES = np.concatenate([np.linspace(-6.0, 1.2, 80), np.linspace(1.3, 12.0, 120)])


def limited(model: Any = NONMINIMUM, reference: Any = None, limits: Limits = LIMITS, **options: Any) -> ConstrainedTrajectory:
    reference = there_and_back() if reference is None else reference
    return constrained_redesign(model, reference, limits=limits, **{"step": 0.1, **WEIGHTS, **options})


@functools.cache
def plain_plan() -> ConstrainedTrajectory:
    """What the others are compared with."""
    return limited()


def assert_close(found: Array, expected: Array, tolerance: float = 1e-5) -> None:
    """To within a share of each column's peak: a plan is as exact as its solver, not more."""
    assert np.max(np.abs(found - expected) / np.max(np.abs(expected), axis=0)) < tolerance


def test_all_kinds_of_limits_at_once() -> None:
    plan = plain_plan()
    at = plan(np.linspace(plan.start, plan.end, 30_001))
    # Rates by difference quotients, so that nothing of the plan's own derivative is used.
    values = (at.u[:, 0], np.diff(at.u[:, 0]) / np.diff(at.time), at.y[:, 0], at.x[:, 1])
    for value, (low, high) in zip(values, ((-0.3, 1.0), (-1.5, 1.5), (-0.05, 0.7), (-0.12, 0.12)), strict=True):
        assert np.min(value) >= low - 1.1e-6 * high
        assert np.max(value) <= high * (1 + 1.1e-6)
    assert plan.method == "constrained redesign"
    assert plan.certificate.dynamics_residual < 1e-11
    assert {active.name for active in plan.active} <= {"input 'u1'", "rate of input 'u1'", "output 'y1'", "'middle'"}
    assert len(plan.active) >= 2
    for active in plan.active:
        assert str(active) in plan.remarks
        assert all(each.start <= each.end and each.multiplier >= 0 for each in active.stretches)
    assert len(sampled_plan(plan, rate=100.0).time) > 1000


@pytest.mark.parametrize(("case", "delay"), [("plain", -1e3), ("jump", 3.7)])
def test_time_shift(case: str, delay: float) -> None:
    limits = LIMITS if case == "plain" else Limits(input=1.2)
    model: Any = NONMINIMUM if case == "plain" else STRONGER
    later = SwitchedSystem(STRONGER.systems, STRONGER.switch_times + delay) if case == "jump" else model
    plain = limited(model, limits=limits)
    moved = limited(later, there_and_back().shifted(delay), limits)
    assert_close(moved(TIMES + delay).u, plain(TIMES).u)
    assert [len(active.stretches) for active in moved.active] == [len(active.stretches) for active in plain.active]


def test_units() -> None:
    """States, input, output and cost measured in units a thousand times larger or smaller, limits with them."""
    rng = np.random.default_rng(1)
    state, (into, out, money) = 10.0 ** rng.choice([-3, 0, 3], size=3), 10.0 ** rng.choice([-3, 0, 3], size=3)
    s = NONMINIMUM
    other = StateSpace(state[:, None] * s.A / state, state[:, None] * s.B / into, out * s.C / state)
    weights = {
        "R": money * WEIGHTS["R"] / into**2,
        "Q_x": money * WEIGHTS["Q_x"] / np.outer(state, state),
        "Q_y": money * WEIGHTS["Q_y"] / out**2,
    }
    limits = Limits(
        input=(-0.3 * into, 1.0 * into),
        input_rate=1.5 * into,
        output=(-0.05 * out, 0.7 * out),
        states=[StateLimit("middle", {"x2": 1.0}, 0.12 * state[1])],
    )
    plain, scaled = plain_plan(), limited(other, there_and_back().scaled(out), limits, **weights)
    assert_close(scaled(TIMES).u, plain(TIMES).u * into)
    assert_close(scaled(TIMES).x, plain(TIMES).x * state)
    assert cost(scaled, **weights) == pytest.approx(money * cost(plain, **WEIGHTS), rel=1e-7)


def test_operating_point() -> None:
    """Limits of inputs and outputs are absolute, those of states are deviations."""
    point = OperatingPoint(x0=np.zeros(3), u0=np.array([5.0]), y0=np.array([1e2]))
    there = StateSpace(NONMINIMUM.A, NONMINIMUM.B, NONMINIMUM.C, operating_point=point)
    absolute = Limits(**{**vars(LIMITS), "input": (4.7, 6.0), "output": (99.95, 100.7)})
    moved = limited(there, there_and_back() + constant(point.y0), absolute)
    plain = plain_plan()
    assert_close(moved(TIMES).u - point.u0, plain(TIMES).u)
    assert_close(moved(TIMES).x, plain(TIMES).x)
    assert {(a.name, a.side) for a in moved.active} == {(a.name, a.side) for a in plain.active}
    with pytest.raises(RedesignError, match=r"before the manoeuvre input 'u1' is 5, expected strictly between .* -1 and 1"):
        limited(there, there_and_back() + constant(point.y0), Limits(input=1.0))


def test_order_of_channels() -> None:
    swap = np.array([[0.0, 1.0], [1.0, 0.0]])
    turned = StateSpace(FULL.A, FULL.B @ swap, swap @ FULL.C)
    weights = {**FULL_WEIGHTS, "R": swap @ FULL_WEIGHTS["R"] @ swap, "Q_y": swap @ FULL_WEIGHTS["Q_y"] @ swap}
    limits = Limits(input=[0.3, 0.5], output=([-0.5, -np.inf], [0.6, np.inf]))
    plain = limited(FULL, two_channels(), limits, **FULL_WEIGHTS)
    other = limited(
        turned, two_channels().scaled(swap), Limits(input=[0.5, 0.3], output=([-np.inf, -0.5], [np.inf, 0.6])), **weights
    )
    assert_close(other(TIMES).u @ swap, plain(TIMES).u)
    assert_close(other(TIMES).y @ swap, plain(TIMES).y)


def test_a_jump_between_equal_plants_changes_nothing() -> None:
    copy = StateSpace(NONMINIMUM.A, NONMINIMUM.B, NONMINIMUM.C)
    assert_close(limited(SwitchedSystem([NONMINIMUM, copy], [2.5]))(TIMES).u, plain_plan()(TIMES).u)


def test_a_model_that_recurs_may_be_one_object_or_several() -> None:
    again = StateSpace(NONMINIMUM.A, NONMINIMUM.B, NONMINIMUM.C)
    one, several = (limited(SwitchedSystem([NONMINIMUM, HEAVIER, last], [0.7, 2.2])) for last in (NONMINIMUM, again))
    assert np.array_equal(one.breakpoints, several.breakpoints)
    assert_close(one.states(TIMES), several.states(TIMES))
    assert_close(one.inputs(TIMES), several.inputs(TIMES))


def test_a_plant_follows_the_plan() -> None:
    plan = limited(SwitchedSystem([NONMINIMUM, HEAVIER], [1.25]), limits=Limits(input=1.0, input_rate=2.0))
    run = simulate(LinearPlant(plan.model), TrackingController(plan, lqr(plan.model, Q=1.0, R=1.0)), timestep=0.01)
    assert run.status == "completed"
    planned = plan(run.time)
    assert np.max(np.abs(run.state.values - planned.x)) < 1e-4 * np.max(np.abs(planned.x))
    assert np.max(np.abs(run.applied.values)) < 1.0 + 1e-3


def test_limited_preactuation_is_remarked() -> None:
    plan = limited(max_preactuation=1.0)
    assert plan.preactuation == pytest.approx(1.0)
    assert "preactuation limited to 1.0 s" in plan.remarks[0]


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        (lambda: Limits(), "at least one finite limit, got none.*quadratic_redesign"),
        (lambda: Limits(input=np.inf), "at least one finite limit"),
        (lambda: Limits(input=0.0), r"limit 'input': expected positive numbers, got \[0\.0\]"),
        (lambda: Limits(input=-1.0), "expected positive numbers"),
        (lambda: Limits(input=np.nan), "entries that are not numbers"),
        (lambda: Limits(input="strong"), "limit 'input' must be real numbers, got 'strong'"),
        (lambda: Limits(input=[1.0, 2.0]), r"expected a number or 1 for the inputs \['u1'\], got shape \(2,\)"),
        (lambda: Limits(output=(1.0, -1.0)), r"expected each low below its high, got low \[1\.0\], high \[-1\.0\]"),
        (lambda: Limits(input_rate=(-1.0, 0.0, 1.0)), r"a tuple \(low, high\) of two, got 3"),
        (
            lambda: Limits(states=[StateLimit("twist", {"th1": 1.0}, 1.0)]),
            r"of the states \['x1', 'x2', 'x3'\].*\['th1'\] are unknown",
        ),
        (lambda: Limits(states=[StateLimit("none", {}, 1.0)]), "expected weights of some of the states"),
        (lambda: Limits(states=[StateLimit("zero", {"x1": 0.0}, 1.0)]), "weights of 'zero' must not all be zero"),
        (lambda: Limits(states=[StateLimit("twist", {"x1": 1.0}, 0.0)]), "limit 'twist': expected positive numbers"),
        (
            lambda: Limits(input=(0.5, 1.0)),
            r"before the manoeuvre input 'u1' is 0, expected .*0\.5 and 1 \(off by 0\.5\)",
        ),
        (lambda: Limits(input=(0.0, 1.0)), "expected strictly between its limits 0 and 1"),
        (lambda: Limits(input_rate=(0.1, 1.0)), "rate of input 'u1' is 0, expected strictly between"),
        (
            lambda: Limits(states=[StateLimit("apart", {"x1": 1.0}, (0.2, 0.4))]),
            r"'apart' is 0, expected strictly between .*0\.2 and 0\.4",
        ),
    ],
)
def test_limits_that_make_no_sense(limits: Callable[[], Limits], message: str) -> None:
    with pytest.raises(RedesignError, match=message):
        limited(limits=limits())


def test_a_held_value_outside_a_limit() -> None:
    with pytest.raises(RedesignError, match=r"at rest after the manoeuvre output 'y1' is 1, .*-1 and 0\.9 \(off by 0\.1"):
        limited(TWO_DISC, rest_to_rest(0.0, 1.0, 5.0), Limits(output=(-1.0, 0.9)), **TWO_DISC_WEIGHTS)


@pytest.mark.parametrize("step", [0.0, -1.0, np.nan])
def test_step(step: float) -> None:
    with pytest.raises(RedesignError, match="step must be a positive number of seconds"):
        limited(step=step)
    with pytest.raises(RedesignError, match=r"more than 40000; take a larger step"):
        limited(step=1e-6)


def test_jumps_too_far_apart_for_any_grid() -> None:
    far = SwitchedSystem([NONMINIMUM, HEAVIER, NONMINIMUM], [-3e7, 3e7])
    with pytest.raises(RedesignError, match=r"limits act from -3e\+07 to 3e\+07 s, .* more than 40000"):
        limited(far, step=None)


GEAR = {"A": [[0.0, 1.0], [0.0, 0.0]], "B": [[0.0], [1.0]]}


@pytest.mark.parametrize("extra", [{}, {"states": [StateLimit("speed", {"x2": 1.0}, 0.1)]}], ids=["alone", "beside another"])
def test_limits_that_conflict(extra: dict[str, Any]) -> None:
    """A cart whose measured position doubles at a jump: with x the position there, low <= x and 2 x <= high. 0.9 and 1.2 miss each
    other by 0.9 - d = (1.2 + d) / 2, d = 0.2, however long the plan takes.
    """
    doubled = SwitchedSystem([StateSpace(**GEAR, C=[[1.0, 0.0]]), StateSpace(**GEAR, C=[[2.0, 0.0]])], [0.3])
    still = constant([1.0], at=0.0) + rest_to_rest(0.0, 0.0, 1.0)
    weights = {"R": 1.0, "Q_x": np.diag([0.0, 0.1]), "Q_y": 1.0}
    message = r"output 'y1' between 0\.9 and 1\.2 by 0\.2; one of these alone would be enough: output 'y1' between 0\.7 and 1\.4$"
    with pytest.raises(RedesignError, match=message):
        limited(doubled, still, Limits(output=(0.9, 1.2), **extra), **weights)
    kept = limited(doubled, still, Limits(output=(0.699, 1.401), **extra), **weights)
    free = quadratic_redesign(doubled, still, **weights)
    assert cost(kept, **weights) > cost(free, **weights)


def test_a_solver_that_gives_up_has_found_no_conflict(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(quadratic_program, "MOST_ITERATIONS", 1)
    with pytest.raises(RedesignError, match="solver gave up on the limited redesign: MaxIterations after 1 iterations"):
        limited()


def test_an_output_error_that_costs_nothing_leaves_everything_at_rest() -> None:
    plan = limited(Q_y=0.0)
    assert not np.any(plan(TIMES).u)
    assert plan.active == ()
