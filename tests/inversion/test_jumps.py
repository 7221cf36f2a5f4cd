"""Solvability at parameter jumps on plants small enough to work out by hand.

Left and right of a jump: zeta' = u, eta' = a eta + zeta, y = zeta + c eta. With the output at y, eta' = (a - c) eta + y: one zero,
a - c. zeta = y - c eta must be continuous as well as eta.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from invtrack.errors import BoundednessError, CompatibilityError, NonHyperbolicError
from invtrack.inversion.exact import invert
from invtrack.inversion.feasibility import feasibility
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.plan import Plan
from invtrack.references.profiles import piecewise_polynomial, raised_cosine, rest_to_rest
from tests.linear.random_plants import block, plant_with

MOTION = rest_to_rest(0.0, 1.0, 2.0)
RAMP = piecewise_polynomial([0.0, 1.0], [[0.0, 0.0, 3.0, -2.0]])


def system(a: float, c: float = 0.0, gain: float = 1.0) -> StateSpace:
    return StateSpace([[0.0, 0.0], [1.0, a]], [[1.0], [0.0]], [[gain, gain * c]])


def assert_certified(plan: Plan, tolerance: float = 1e-10) -> None:
    certificate = plan.certificate
    assert max(certificate.dynamics_residual, certificate.output_error, certificate.continuity) < tolerance
    assert certificate.rest_residual < 3 * plan.tolerance


def test_an_unstable_mode_fewer_before_than_after_has_no_bounded_inverse() -> None:
    """Zero -1, then +1: before the jump eta is fixed by the past, after it by the future."""
    with pytest.raises(BoundednessError, match=r"0 antistable zero\(s\) before .* 0 unknown\(s\) for the 1\s+condition\(s\)"):
        invert(SwitchedSystem([system(-1.0), system(1.0)], [1.0]), MOTION)


def test_an_interval_that_no_unknown_can_steer_is_named() -> None:
    """Zero -1, then +50 for 10 s, then -1: the past fixes eta at the first jump, and e^500 times the miss is not a solution."""
    with pytest.raises(BoundednessError, match=r"the internal state that the past .* leave at the jump at t = 1 s"):
        invert(SwitchedSystem([system(-1.0), system(50.0), system(-1.0)], [1.0, 11.0]), MOTION)


def test_an_output_that_changes_at_rest_is_compatible_and_the_fast_unstable_mode_after_it_the_reason() -> None:
    """y = x_1, then x_1 - x_1' / 20, at rest: x_1' = 20 (x_1 - y) from 0 grows as e^20t; the jump itself asks nothing more."""
    A, B = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, -1.0]]), np.array([[0.0], [1.0], [0.0]])
    position, mixed = StateSpace(A, B, [[1.0, 0.0, 0.0]]), StateSpace(A, B, [[1.0, -0.05, 0.0]])
    plant = SwitchedSystem([position, mixed], [-0.05])
    with pytest.raises(BoundednessError, match=r"leave at the jump at t = -0.05 s is off the one that stays bounded"):
        invert(plant, MOTION)
    report = feasibility(plant, MOTION)
    assert report.failed.startswith("boundedness")
    assert report.jumps[0].fixed_miss == 0.0


@pytest.mark.parametrize("jump", [1.0, 1.5])
def test_unless_the_reference_happens_to_bring_it_to_the_right_place(jump: float) -> None:
    """eta' = -eta + y with y = f + f' gives eta = f: at rest when f is, and the jump finds nothing to keep bounded."""
    f = Polynomial([0.0, 1.0]) ** 3 * Polynomial([1.0, -1.0]) ** 3
    reference = piecewise_polynomial([0.0, 1.0], [(f + f.deriv()).coef])
    plan = invert(SwitchedSystem([system(-1.0), system(1.0)], [jump]), reference)
    assert_certified(plan)
    t = np.linspace(0.0, 0.999, 30)
    assert plan(t).x[:, 1] == pytest.approx(f(t), abs=1e-14)
    assert plan(2.0).x == pytest.approx(np.zeros((1, 2)), abs=1e-13)


def test_an_unstable_mode_more_before_than_after_is_not_unique() -> None:
    """Zero +1, then -1: any eta at the jump will do. The plan says so and is still exact."""
    plan = invert(SwitchedSystem([system(1.0), system(-1.0)], [1.0]), MOTION)
    assert_certified(plan)
    assert any("not unique (1 free direction(s))" in remark for remark in plan.remarks)


def test_least_norm_is_taken_where_the_solution_is_not_unique() -> None:
    """Nothing asked for, nothing done."""
    plan = invert(SwitchedSystem([system(1.0), system(-1.0)], [1.0]), MOTION.scaled(0.0))
    assert plan(np.linspace(-5, 5, 11)).x == pytest.approx(np.zeros((11, 2)), abs=1e-300)


def test_an_output_that_changes_can_be_what_makes_the_solution_unique() -> None:
    """Zero +1, y = zeta; then zero -3, y = zeta + eta. zeta is 1/2 at t = 1 whatever eta, so eta = y - zeta = 0 there."""
    model = SwitchedSystem([system(1.0), system(-2.0, c=1.0)], [1.0])
    plan = invert(model, MOTION)
    assert_certified(plan)
    assert plan.remarks == ()
    assert plan(1.0).x[0] == pytest.approx([0.5, 0.0], abs=1e-12)
    # Before the motion eta decays backward as e^t, from the value that the forward motion takes to 0.
    nodes, weights = np.polynomial.legendre.leggauss(30)
    start = -np.sum(weights / 2 * np.exp(-(nodes + 1) / 2) * MOTION((nodes + 1) / 2)[:, 0])
    assert plan([0.0, -3.0]).x[:, 1] == pytest.approx([start, start * np.exp(-3)], rel=1e-10)


def test_an_output_that_changes_can_ask_too_much() -> None:
    """Zero +1 before and after, but a new output: one unknown, one compatibility row and one end condition."""
    model = SwitchedSystem([system(1.0), system(2.0, c=1.0)], [1.0])
    with pytest.raises((BoundednessError, CompatibilityError)):
        invert(model, MOTION)


def test_an_output_that_changes_with_nothing_left_to_choose() -> None:
    """Zero -1, then -3 with y = zeta + eta: eta is fixed by the past, and the new output is not the wanted one."""
    with pytest.raises(CompatibilityError, match=r"at the jump at t = 1 s the state cannot be continuous and the output exact"):
        invert(SwitchedSystem([system(-1.0), system(-2.0, c=1.0)], [1.0]), MOTION)


def test_a_new_gain_of_the_sensor_must_show_in_the_reference() -> None:
    """y = zeta, then y = 2 zeta: a reference that does not double cannot be met, one that does can."""
    model = SwitchedSystem([system(1.0), system(1.0, gain=2.0)], [1.5])
    with pytest.raises(CompatibilityError, match=r"at the jump at t = 1.5 s .* output 'y1' would jump from 1 to 2, .* asks for 1 "):
        invert(model, RAMP)
    doubling = piecewise_polynomial([0.0, 1.0, 1.5, 2.5], [[0.0, 0.0, 3.0, -2.0], [1.0], [2.0, 0.0, -6.0, 4.0]])
    plan = invert(model, doubling)
    assert_certified(plan)
    sides = plan([1.5, 1.5], inside=[1.4, 1.6])
    assert sides.y[:, 0] == pytest.approx([1.0, 2.0])
    assert sides.y_d[:, 0] == pytest.approx([1.0, 2.0])


def test_a_relative_degree_that_changes() -> None:
    """Relative degree 2, then 1 (an output with some of the velocity in it), then 2 again with one zero fewer."""
    A, B = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.7]]), np.array([[0.0], [1.0], [0.0]])
    position, mixed = StateSpace(A, B, [[1.0, 0.0, 0.0]]), StateSpace(A, B, [[1.0, 0.5, 0.0]])  # zeros 0.7; 0.7 and -2
    plan = invert(SwitchedSystem([position, mixed], [3.0]), MOTION)
    assert_certified(plan)
    with pytest.raises(CompatibilityError):  # while moving, position and mixture differ
        invert(SwitchedSystem([position, mixed], [1.0]), MOTION)


@pytest.mark.parametrize("internal", [system(0.0), StateSpace([[0.0, 0.0], [1.0, 1e-15]], [[1.0], [0.0]], [[1.0, 0.0]])])
def test_a_zero_on_the_axis_between_jumps_does_no_harm(internal: StateSpace) -> None:
    """Over an interval that ends it stays bounded: eta' = y there, and eta' = eta + y before and after."""
    plan = invert(SwitchedSystem([system(1.0), internal, system(1.0)], [0.5, 1.0]), MOTION)
    assert_certified(plan)
    between = plan(np.linspace(0.5, 1.0, 201))
    gained = np.trapezoid(between.y_d[:, 0], between.time)
    assert between.x[-1, 1] - between.x[0, 1] == pytest.approx(gained, abs=1e-5)


@pytest.mark.parametrize("internal", [np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0, 2.0], [-2.0, 0.0]])])
def test_repeated_and_oscillating_zeros_on_the_axis_between_jumps_do_no_harm(internal: np.ndarray) -> None:
    rng = np.random.default_rng(1)
    ends, between = (plant_with(rng, (2,), dynamics, mixed=False) for dynamics in (block(-1.0, 2.0), internal))
    assert_certified(invert(SwitchedSystem([ends, between, ends], [0.5, 1.0]), MOTION))


def test_axis_zeros_at_the_ends_are_refused() -> None:
    """x_2' = y has to stop where y does; and starting from rest it leaves nothing to choose for x_2' = x_2 + y after the jump."""
    with pytest.raises(NonHyperbolicError, match=r"zeros at 0 lie on the imaginary axis .* outputs held at \[1.0\] after"):
        invert(SwitchedSystem([system(1.0), system(0.0)], [1.0]), MOTION)
    with pytest.raises(BoundednessError, match="0 antistable zero"):
        invert(SwitchedSystem([system(0.0), system(1.0)], [1.0]), MOTION)


def test_nothing_overflows_over_long_intervals_with_fast_zeros() -> None:
    """Zeros at +-50 over intervals of 1e4 s: e^(5e5) is far beyond the largest number."""
    rng = np.random.default_rng(0)
    models = [plant_with(rng, (2,), block(50.0, -50.0), mixed=False) for _ in range(2)]
    same_output = [StateSpace(m.A, m.B, m.C) for m in (models[0], models[1], models[0])]
    for switches in ([0.0, 1e4], [5e3, 1.5e4]):
        plan = invert(SwitchedSystem(same_output, switches), rest_to_rest(0.0, 1.0, 1.0, start_time=5e3))
        assert_certified(plan)
        assert np.all(np.isfinite(plan(np.linspace(-1e4, 3e4, 101)).u))


def test_many_jumps() -> None:
    """A payload that comes and goes a hundred times."""
    light, heavy = (plant_with(np.random.default_rng(s), (2,), block(0.8, -0.5), mixed=False) for s in (1, 2))
    times = np.linspace(0.03, 6.0, 100)
    plan = invert(SwitchedSystem([light, heavy] * 50 + [light], times), raised_cosine(2.0))
    assert_certified(plan)


def turned_pair(seed: int) -> SwitchedSystem:
    """Two plants y'' = row x + u with two hyperbolic zeros each and the same C* = [C; C A], whose second row is one state alone."""
    rng = np.random.default_rng(seed)
    T = np.eye(4)  # [y; y'; eta] = T x: y' = x_3
    T[0], T[1] = rng.normal(size=4), np.eye(4)[2]
    T[2:] = rng.normal(size=(2, 4))
    B = np.linalg.solve(T, np.array([0.0, 1.0, 0.0, 0.0]))[:, None]
    systems = []
    for _ in range(2):
        V = rng.normal(size=(2, 2))
        zeros = V @ np.diag([-rng.uniform(0.5, 2.0), rng.uniform(0.5, 2.0)]) @ np.linalg.inv(V)
        normal = np.block([[np.array([[0.0, 1.0, 0.0, 0.0]])], [rng.normal(size=(1, 4))], [rng.normal(size=(2, 2)), zeros]])
        systems.append(StateSpace(np.linalg.solve(T, normal @ T), B, T[:1]))
    return SwitchedSystem(systems, [1.0])


@pytest.mark.parametrize("seed", range(12))
def test_a_derivative_that_is_one_state_on_both_sides_is_no_condition(seed: int) -> None:
    plant = turned_pair(seed)
    reference = rest_to_rest(0.0, 1.0, 3.0, smoothness=4)
    report = feasibility(plant, reference)
    assert report.solvable, report.message
    assert report.jumps[0].compatibility_rows == 0
    assert_certified(invert(plant, reference), 1e-9)


def test_a_plant_whose_jump_was_once_taken_for_a_condition() -> None:
    """C* = [C; C A] is the same on both sides, its second row one state alone; a bounded inverse exists (shooting in 90 digits)."""
    first = [[1.5, -3, -2.625, 1.25], [-0.75, -1.125, -0.5, 0.125], [0.625, -2.25, -0.75, 0.875], [-3.25, -0.75, 1.75, -0.5]]
    second = [[-1.875, 2.625, 0.375, -1.375], [4, -6.625, -4, 3.125], [-0.5, 1.125, 0, -0.625], [10.75, -16.25, -9.75, 7.75]]
    B, C = [[-1.0], [1.0], [-1.0], [2.0]], [[2.0, -2, -2, 1]]
    plan = invert(SwitchedSystem([StateSpace(A, B, C) for A in (first, second)], [3.0]), rest_to_rest(0.0, 1.0, 6.0, smoothness=4))
    assert_certified(plan)
