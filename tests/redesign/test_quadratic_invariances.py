"""What must not change a redesign, or must change it in one known way; and what its certificate says."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from invtrack.linear.state_space import OperatingPoint, StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.redesign.cost import cost
from invtrack.redesign.quadratic import quadratic_redesign
from invtrack.references.profiles import autonomous, constant, rest_to_rest
from invtrack.references.samples import sampled_reference
from invtrack.references.signal import PiecewiseSignal
from tests.redesign.plants import HEAVIER, MINIMUM, NONMINIMUM, TWO_DISC, TWO_DISC_WEIGHTS, WEIGHTS, there_and_back

JUMPING = SwitchedSystem([NONMINIMUM, HEAVIER, MINIMUM], [0.5, 3.0])
TIMES = np.concatenate([np.linspace(-8.0, 0.45, 60), np.linspace(0.55, 2.95, 60), np.linspace(3.05, 15.0, 60)])
CASES: dict[str, tuple[Any, dict[str, Any], Any]] = {
    "plain": (NONMINIMUM, WEIGHTS, there_and_back()),
    "jumps": (JUMPING, WEIGHTS, there_and_back()),
    "rigid body": (TWO_DISC, TWO_DISC_WEIGHTS, rest_to_rest(0.0, 1.0, 5.0)),
}


def assert_close(found: np.ndarray, expected: np.ndarray, tolerance: float = 1e-9) -> None:
    """To within a share of each column's peak."""
    size = np.max(np.abs(expected), axis=0)
    assert np.max(np.abs(found - expected) / np.where(size > 0, size, 1.0)) < tolerance


def mapped(model: Any, change: Any) -> Any:
    if isinstance(model, SwitchedSystem):
        return SwitchedSystem([change(system) for system in model.systems], model.switch_times)
    return change(model)


@pytest.mark.parametrize("case", CASES)
def test_certificate(case: str) -> None:
    model, weights, reference = CASES[case]
    plan = quadratic_redesign(model, reference, **weights)
    assert plan.method == "quadratic redesign"
    assert plan.reference is reference
    assert plan.certificate.dynamics_residual < 1e-12
    assert plan.certificate.continuity < 1e-12
    assert plan.certificate.rest_residual < 10 * plan.tolerance
    at = plan(np.linspace(plan.start, plan.end, 4000))
    by_design = np.max(np.abs(at.y - at.y_d)) / np.max(np.abs(at.y_d))
    assert plan.certificate.output_error == pytest.approx(by_design, rel=1e-2)


def test_a_reference_that_comes_back_but_for_rounding() -> None:
    """0.1 + 0.2 is not 0.3 in floating point: what is held beside the operating point then costs nothing that matters."""
    point = OperatingPoint(x0=np.zeros(3), u0=np.zeros(1), y0=np.array([0.3]))
    there = StateSpace(NONMINIMUM.A, NONMINIMUM.B, NONMINIMUM.C, operating_point=point)
    plan = quadratic_redesign(there, there_and_back(size=0.7) + constant(0.1 + 0.2), **WEIGHTS)
    expected = quadratic_redesign(NONMINIMUM, there_and_back(size=0.7), **WEIGHTS)
    assert_close(plan(TIMES).u, expected(TIMES).u)
    assert cost(plan, **WEIGHTS) == pytest.approx(cost(expected, **WEIGHTS), rel=1e-9)


@pytest.mark.parametrize("case", CASES)
def test_superposition(case: str) -> None:
    model, weights, reference = CASES[case]
    other = there_and_back(start_time=0.3)
    both = quadratic_redesign(model, reference.scaled(2.0) + other.scaled(-0.5), **weights)(TIMES)
    first, second = quadratic_redesign(model, reference, **weights)(TIMES), quadratic_redesign(model, other, **weights)(TIMES)
    assert_close(both.x, 2 * first.x - 0.5 * second.x)
    assert_close(both.u, 2 * first.u - 0.5 * second.u)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("delay", [3.7, -1e3])
def test_time_shift(case: str, delay: float) -> None:
    model, weights, reference = CASES[case]
    later = SwitchedSystem(model.systems, model.switch_times + delay) if isinstance(model, SwitchedSystem) else model
    moved, plain = quadratic_redesign(later, reference.shifted(delay), **weights), quadratic_redesign(model, reference, **weights)
    assert_close(moved(TIMES + delay).u, plain(TIMES).u)
    assert moved.preactuation == pytest.approx(plain.preactuation)


@pytest.mark.parametrize("case", CASES)
def test_similarity(case: str) -> None:
    model, weights, reference = CASES[case]
    n = len(weights["Q_x"])
    T = np.random.default_rng(3).normal(size=(n, n))
    T_inverse = np.linalg.inv(T)
    turned = {**weights, "Q_x": T_inverse.T @ weights["Q_x"] @ T_inverse}
    plain = quadratic_redesign(model, reference, **weights)(TIMES)
    other = quadratic_redesign(mapped(model, lambda s: s.transformed(T)), reference, **turned)(TIMES)
    assert_close(other.x, plain.x @ T.T)
    assert_close(other.u, plain.u)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("seed", range(3))
def test_units(case: str, seed: int) -> None:
    """States, input, output and the cost itself measured in units a million times larger or smaller."""
    model, weights, reference = CASES[case]
    rng = np.random.default_rng(seed)
    n = len(weights["Q_x"])
    state, (into, out, money) = 10.0 ** rng.choice([-6, 0, 6], size=n), 10.0 ** rng.choice([-6, 0, 6], size=3)

    def change(s: StateSpace) -> StateSpace:
        return StateSpace(state[:, None] * s.A / state, state[:, None] * s.B / into, out * s.C / state)

    scaled = {
        "R": money * weights["R"] / into**2,
        "Q_x": money * weights["Q_x"] / np.outer(state, state),
        "Q_y": money * weights["Q_y"] / out**2,
    }
    plain, other = (
        quadratic_redesign(model, reference, **weights),
        quadratic_redesign(mapped(model, change), reference.scaled(out), **scaled),
    )
    assert_close(other(TIMES).x, plain(TIMES).x * state)
    assert_close(other(TIMES).u, plain(TIMES).u * into)
    assert other.preactuation == pytest.approx(plain.preactuation, rel=1e-2)
    assert cost(other, **scaled) == pytest.approx(money * cost(plain, **weights), rel=1e-8)


@pytest.mark.parametrize("unit", [1e-6, 1e-3, 1e6])
def test_unit_of_time(unit: float) -> None:
    slower = StateSpace(NONMINIMUM.A / unit, NONMINIMUM.B / unit, NONMINIMUM.C)
    plan, plain = (
        quadratic_redesign(slower, there_and_back(duration=2.0 * unit), **WEIGHTS),
        quadratic_redesign(NONMINIMUM, there_and_back(), **WEIGHTS),
    )
    assert_close(plan(TIMES * unit).x, plain(TIMES).x)
    assert_close(plan(TIMES * unit).u, plain(TIMES).u)
    assert plan.preactuation == pytest.approx(plain.preactuation * unit, rel=1e-2)


@pytest.mark.parametrize("time", [-4.0, 0.7, 30.0])
def test_splitting_an_interval_into_two_identical_ones(time: float) -> None:
    """The second is a copy, so that state and costate are joined at a jump that is none."""
    copy = StateSpace(NONMINIMUM.A, NONMINIMUM.B, NONMINIMUM.C)
    split = quadratic_redesign(SwitchedSystem([NONMINIMUM, copy], [time]), there_and_back(), **WEIGHTS)
    plain = quadratic_redesign(NONMINIMUM, there_and_back(), **WEIGHTS)
    assert_close(split(TIMES).x, plain(TIMES).x)
    assert_close(split(TIMES).u, plain(TIMES).u)


def test_many_jumps_far_apart() -> None:
    """A year between jumps, or dozens within the motion: no transition matrix over- or underflows into the plan."""
    far = SwitchedSystem([NONMINIMUM, HEAVIER, NONMINIMUM], [-3e7, 3e7])
    assert_close(
        quadratic_redesign(far, there_and_back(), **WEIGHTS)(TIMES).u,
        quadratic_redesign(HEAVIER, there_and_back(), **WEIGHTS)(TIMES).u,
        1e-6,
    )
    models = [NONMINIMUM, HEAVIER] * 25
    dense = quadratic_redesign(SwitchedSystem(models, np.linspace(-0.9, 5.9, 49)), there_and_back(), **WEIGHTS)
    assert dense.certificate.continuity < 1e-11
    assert dense.certificate.dynamics_residual < 1e-11


def test_operating_point() -> None:
    """An absolute reference about (u0, y0): the same deviations as about zero."""
    point = OperatingPoint(x0=np.zeros(3), u0=np.array([5.0]), y0=np.array([1e3]))
    there = StateSpace(NONMINIMUM.A, NONMINIMUM.B, NONMINIMUM.C, operating_point=point)
    plain = quadratic_redesign(NONMINIMUM, there_and_back(), **WEIGHTS)
    moved = quadratic_redesign(there, there_and_back() + constant(point.y0), **WEIGHTS)
    assert_close(moved(TIMES).x, plain(TIMES).x)
    assert_close(moved(TIMES).u - point.u0, plain(TIMES).u)
    assert moved(TIMES).y == pytest.approx(plain(TIMES).y + point.y0)
    assert cost(moved, **WEIGHTS) == pytest.approx(cost(plain, **WEIGHTS))


def test_a_rough_reference_gives_a_continuous_input() -> None:
    """A kink or a jump at t = 0, then exp(-3 t) over 60 time constants: s integrates the reference, so that u does not jump."""
    burst = autonomous([[-3.0]], [[1.0]], [1.0], start=0.0, end=20.0)
    rough = burst + rest_to_rest(0.0, -1.0, 0.5, smoothness=0, start_time=-2.0)
    anchors = rough.anchors.copy()
    anchors[3, 0] = 3.0  # the burst starts from 3 instead of 1
    jump = PiecewiseSignal(rough.breakpoints, rough.generators, rough.kind, anchors)
    assert np.ptp(jump(np.zeros(2), inside=np.array([-0.1, 0.1]))) == pytest.approx(2.0)
    for reference in (rough, jump):
        plan = quadratic_redesign(TWO_DISC, reference, **TWO_DISC_WEIGHTS)
        assert plan.certificate.dynamics_residual < 1e-10
        edges = plan.breakpoints
        assert_close(plan.inputs(edges, inside=edges - 1e-6), plan.inputs(edges, inside=edges + 1e-6), 1e-9)


def test_a_reference_through_samples() -> None:
    times = np.linspace(0.0, 5.0, 501)
    smooth = there_and_back()
    sampled = sampled_reference(times, smooth(times))
    assert_close(
        quadratic_redesign(NONMINIMUM, sampled, **WEIGHTS)(TIMES).u,
        quadratic_redesign(NONMINIMUM, smooth, **WEIGHTS)(TIMES).u,
        1e-6,
    )


def test_limited_preactuation_is_remarked() -> None:
    plan = quadratic_redesign(NONMINIMUM, there_and_back(), **WEIGHTS, max_preactuation=2.0)
    assert plan.preactuation == pytest.approx(2.0)
    assert "limited to 2.0 s" in plan.remarks[0]
    whole = quadratic_redesign(NONMINIMUM, there_and_back(), **WEIGHTS)
    assert whole.remarks == ()
    assert np.max(np.abs(whole.states(whole.start))) < 1e-9 < np.max(np.abs(whole.states(-2.0)))


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("money", [1e-18, 1e18])
def test_what_cost_is_counted_in_changes_nothing(case: str, money: float) -> None:
    model, weights, reference = CASES[case]
    plain = quadratic_redesign(model, reference, **weights)
    other = quadratic_redesign(model, reference, **{name: money * np.asarray(weight) for name, weight in weights.items()})
    assert_close(other(TIMES).u, plain(TIMES).u)
    assert_close(other(TIMES).x, plain(TIMES).x)
