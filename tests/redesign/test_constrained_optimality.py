"""Plans within limits are the best ones there are: against brute force, against perturbations, and where limits do not matter."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
import scipy.optimize
import scipy.signal
from numpy.typing import NDArray

from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import as_switched
from invtrack.plans.plan import Plan
from invtrack.redesign.constrained import ConstrainedTrajectory, constrained_redesign
from invtrack.redesign.cost import cost
from invtrack.redesign.limits import Limits, StateLimit
from invtrack.redesign.quadratic import quadratic_redesign
from invtrack.references.profiles import rest_to_rest
from tests.redesign.plants import (
    DIRECT,
    FULL,
    FULL_WEIGHTS,
    NONMINIMUM,
    STRONGER,
    TWO_DISC,
    TWO_DISC_WEIGHTS,
    UNSTABLE,
    WEIGHTS,
    simulated,
    there_and_back,
    two_channels,
)

Array = NDArray[np.float64]

CASES: dict[str, tuple[Any, Any, dict[str, Any]]] = {
    "plain": (NONMINIMUM, there_and_back(), WEIGHTS),
    "direct": (DIRECT, there_and_back(), WEIGHTS),
    "unstable": (UNSTABLE, there_and_back(), WEIGHTS),
    "jump": (STRONGER, there_and_back(), WEIGHTS),
    "two channels": (FULL, two_channels(), FULL_WEIGHTS),
    "rigid body": (TWO_DISC, rest_to_rest(0.0, 1.0, 10.0), TWO_DISC_WEIGHTS),
}


def densely(plan: Plan, count: int = 20_001) -> Array:
    """Times over the plan, those just beside its breakpoints included."""
    edges = plan.breakpoints
    return np.unique(np.concatenate([np.linspace(plan.start, plan.end, count), edges - 1e-9, edges + 1e-9]))


def largest_input(plan: Plan) -> Array:
    low, high = plan.input_range
    return np.maximum(-low, high)


def twist_of(plan: Plan) -> Array:
    x = plan.states(densely(plan))
    return np.asarray(x[:, 0] - x[:, 2])


def twist_limit(limit: float) -> StateLimit:
    return StateLimit("twist", {"x1": 1.0, "x3": -1.0}, limit)


@pytest.mark.parametrize("case", CASES)
def test_limits_far_away_change_nothing(case: str) -> None:
    model, reference, weights = CASES[case]
    free = quadratic_redesign(model, reference, **weights)
    limited = constrained_redesign(model, reference, limits=Limits(input=1.01 * largest_input(free)), **weights)
    times = densely(free, 500)
    assert np.max(np.abs(limited(times).u - free(times).u)) == pytest.approx(0.0, abs=1e-13 * float(np.max(largest_input(free))))
    assert limited.active == ()
    assert "no limit is active" in limited.remarks[-1]


@pytest.mark.parametrize("case", ["plain", "direct", "unstable"])
def test_order_of_convergence_to_the_optimum_without_limits(case: str) -> None:
    """A limit one part in 1e7 below the peak changes nothing but the method: what is left is linear interpolation, of order h^2."""
    model, reference, weights = CASES[case]
    free = quadratic_redesign(model, reference, **weights)
    limits = Limits(input=(1 - 1e-7) * largest_input(free))
    times = np.linspace(-4.0, 10.0, 3000)
    wanted = free(times).u
    errors = []
    for step in (0.2, 0.1, 0.05):
        plan = constrained_redesign(model, reference, limits=limits, step=step, **weights)
        errors.append(float(np.max(np.abs(plan(times).u - wanted)) / np.max(np.abs(wanted))))
    assert all(3.0 < a / b < 5.0 for a, b in itertools.pairwise(errors))
    assert errors[-1] < 3e-3


@pytest.mark.parametrize(("case", "share"), [*((case, 0.6) for case in CASES), ("plain", 0.9)])
def test_limited_input(case: str, share: float) -> None:
    model, reference, weights = CASES[case]
    free = quadratic_redesign(model, reference, **weights)
    limit = share * largest_input(free)
    plan = constrained_redesign(model, reference, limits=Limits(input=limit), step=0.05, **weights)
    u = plan.inputs(densely(plan))
    assert np.all(np.max(np.abs(u), axis=0) <= limit * (1 + 1e-9))
    assert plan.certificate.dynamics_residual < 1e-11
    assert plan.certificate.continuity < 1e-10
    assert plan.certificate.rest_residual < 1e-9
    assert cost(plan, **weights) > cost(free, **weights)
    assert {active.name for active in plan.active} <= {f"input {name!r}" for name in as_switched(model).inputs.names}
    for active in plan.active:
        first = active.stretches[0]
        channel = int(active.name[-2]) - 1
        value = plan.inputs([(first.start + first.end) / 2])[0, channel]
        assert value == pytest.approx(active.limit, rel=1e-4)


def hat_responses(model: StateSpace, nodes: Array, times: Array) -> tuple[Array, Array]:
    """Inputs (k, m) and states (k, m, n) of hat functions on the inner of even nodes: the first, simulated, and its delays."""
    first = np.interp(times, nodes, np.eye(len(nodes))[1])
    states = simulated(model, lambda t: np.interp(t, nodes, np.eye(len(nodes))[1])[:, None], times)
    late = (len(times) - 1) // (len(nodes) - 1) * np.arange(len(nodes) - 2)
    index = np.arange(len(times)) - late[:, None]
    return np.where(index >= 0, first[index], 0.0), np.where((index >= 0)[:, :, None], states[index], 0.0)


def least_squares(model: StateSpace, reference: Any, nodes: Array, times: Array) -> tuple[Array, Array, Array]:
    """M, d with |M c - d|^2 the cost of sum c_j hat_j by Simpson's rule, and the states (k, m, n)."""
    hats, states = hat_responses(model, nodes, times)
    weight = np.full(len(times), 2.0)
    weight[1::2], weight[[0, -1]] = 4.0, 1.0
    root = np.sqrt(weight * (times[1] - times[0]) / 3)
    y = states @ model.C[0] + model.D[0, 0] * hats
    M = np.vstack([np.sqrt(0.2) * hats.T, np.sqrt(0.3) * states[:, :, 0].T, np.sqrt(0.1) * states[:, :, 2].T, np.sqrt(4.0) * y.T])
    wanted = np.concatenate([np.zeros(3 * len(times)), 2.0 * reference(times)[:, 0]])
    return np.tile(root, 4)[:, None] * M, np.tile(root, 4) * wanted, states


@pytest.mark.parametrize(("system", "limit"), [(NONMINIMUM, (-0.5, 0.5)), (DIRECT, (-0.9, 0.9)), (UNSTABLE, (-0.05, 0.3))])
def test_bounded_least_squares_finds_the_same_input(system: StateSpace, limit: tuple[float, float]) -> None:
    """The oracle knows nothing of Riccati equations: hat functions on a window so long that nothing is left at its ends.

    The unstable plant's input is at its low limit where the first window ends: what lies beyond must not be left out.
    """
    reference, nodes = there_and_back(), np.arange(-10.0, 22.01, 0.125)
    times = np.linspace(nodes[0], nodes[-1], 8 * (len(nodes) - 1) + 1)
    M, d, _ = least_squares(system, reference, nodes, times)
    Q, R = np.linalg.qr(M)
    found = scipy.optimize.lsq_linear(R, Q.T @ d, bounds=limit, method="bvls", tol=1e-14)
    plan = constrained_redesign(system, reference, limits=Limits(input=limit), step=0.125, **WEIGHTS)
    assert cost(plan, **WEIGHTS) == pytest.approx(np.sum((M @ found.x - d) ** 2), rel=1e-4)
    inner = (nodes[1:-1] > -1.0) & (nodes[1:-1] < 8.0)
    assert np.max(np.abs(plan.inputs(nodes[1:-1])[inner, 0] - found.x[inner])) < 1e-3 * limit[1]


def test_sequential_programming_finds_the_same_plan_within_a_state_limit() -> None:
    reference, limit, nodes = there_and_back(), 0.1, np.arange(-4.0, 10.01, 0.25)
    times = np.linspace(nodes[0], nodes[-1], 16 * (len(nodes) - 1) + 1)
    M, d, states = least_squares(NONMINIMUM, reference, nodes, times)
    H, g = M.T @ M, M.T @ d
    rows = states[:, ::4, 1].T  # x2 at every fourth time
    found = scipy.optimize.minimize(
        lambda c: c @ H @ c - 2 * g @ c,
        np.zeros(len(g)),
        jac=lambda c: 2 * (H @ c - g),
        method="SLSQP",
        constraints=[
            {"type": "ineq", "fun": lambda c: limit - rows @ c, "jac": lambda c: -rows},
            {"type": "ineq", "fun": lambda c: limit + rows @ c, "jac": lambda c: rows},
        ],
        options={"maxiter": 500, "ftol": 1e-12},
    )
    assert found.success
    limits = Limits(states=[StateLimit("middle", {"x2": 1.0}, limit)])
    plan = constrained_redesign(NONMINIMUM, reference, limits=limits, step=0.25, **WEIGHTS)
    assert cost(plan, **WEIGHTS) == pytest.approx(found.fun + d @ d, rel=1e-3)
    assert {(active.name, active.side) for active in plan.active} == {("'middle'", "low"), ("'middle'", "high")}


def test_every_feasible_change_costs_more() -> None:
    """Random changes of either sign, cut off at the limit: the cost rises with each, evaluated by simulation and Simpson's rule."""
    reference, limit = there_and_back(), 1.0
    plan = constrained_redesign(NONMINIMUM, reference, limits=Limits(input=limit), step=0.05, **WEIGHTS)
    times = np.linspace(-10.0, 20.0, 6001)
    weight = np.full(len(times), 2.0)
    weight[1::2], weight[[0, -1]] = 4.0, 1.0
    planned = plan.inputs(times)[:, 0]

    def price(change: Array) -> float:
        u = np.clip(planned + change, -limit, limit)
        x = scipy.signal.lsim((NONMINIMUM.A, NONMINIMUM.B, np.eye(3), np.zeros((3, 1))), u, times - times[0])[1]
        miss = x @ NONMINIMUM.C[0] - reference(times)[:, 0]
        return float(weight @ (0.2 * u**2 + 0.3 * x[:, 0] ** 2 + 0.1 * x[:, 2] ** 2 + 4.0 * miss**2) * 0.005 / 3)

    least = price(np.zeros(len(times)))
    assert least == pytest.approx(cost(plan, **WEIGHTS), rel=1e-5)
    rng = np.random.default_rng(0)
    for _ in range(6):
        centre, width, size = rng.uniform(-2.0, 6.0), rng.uniform(0.3, 1.5), rng.uniform(0.1, 0.3)
        bump = size * np.exp(-(((times - centre) / width) ** 2))
        assert min(price(bump), price(-bump)) > least
        assert cost(plan, **WEIGHTS) < price(bump)


@pytest.mark.parametrize(("duration", "shares"), [(5.0, (0.7, 0.4)), (30.0, (0.6,))])
def test_limited_twist_of_the_two_disc_rig(duration: float, shares: tuple[float, ...]) -> None:
    reference = rest_to_rest(0.0, 1.0, duration)
    free = quadratic_redesign(TWO_DISC, reference, **TWO_DISC_WEIGHTS)
    peak = float(np.max(np.abs(twist_of(free))))
    costs = [cost(free, **TWO_DISC_WEIGHTS)]
    for share in shares:
        plan = constrained_redesign(
            TWO_DISC, reference, limits=Limits(states=[twist_limit(share * peak)]), step=0.1, **TWO_DISC_WEIGHTS
        )
        assert np.max(np.abs(twist_of(plan))) <= share * peak * (1 + 1e-6)
        assert plan.overshoot <= 1e-6
        assert plan.certificate.dynamics_residual < 1e-11
        assert plan.certificate.continuity < 1e-10
        assert {active.name for active in plan.active} == {"'twist'"}
        costs.append(cost(plan, **TWO_DISC_WEIGHTS))
    assert all(a < b for a, b in itertools.pairwise(costs))  # the tighter the dearer


def test_the_arcs_at_the_limits_do_not_depend_on_the_step() -> None:
    """With a limited rate, the twist's limit is touched beside the arc on it, rate limit to rate limit: the optimum's own."""
    limits = Limits(input=0.045, input_rate=0.05, states=[twist_limit(0.02)])
    weights = {"R": 1.0, "Q_y": 10.0}
    coarse, fine = (
        constrained_redesign(TWO_DISC, rest_to_rest(0.0, 1.0, 10.0), limits=limits, step=step, **weights) for step in (0.02, 0.01)
    )
    for found, expected in zip(coarse.active, fine.active, strict=True):
        assert (found.name, found.side) == (expected.name, expected.side)
        assert [(each.start, each.end) for each in found.stretches] == [
            pytest.approx((each.start, each.end), abs=0.03) for each in expected.stretches
        ]
    assert {each.name: len(each.stretches) for each in fine.active}["'twist'"] == 3
    assert cost(fine, **weights) <= cost(coarse, **weights) <= cost(fine, **weights) * (1 + 3e-6)


def test_limited_rate() -> None:
    free = quadratic_redesign(NONMINIMUM, there_and_back(), **WEIGHTS)
    costs = [cost(free, **WEIGHTS)]
    fine = np.linspace(-3.0, 8.0, 20_001)
    peak = float(np.max(np.abs(np.gradient(free.inputs(fine)[:, 0], fine))))
    for limit in (0.8 * peak, 0.4 * peak):
        plan = constrained_redesign(NONMINIMUM, there_and_back(), limits=Limits(input_rate=limit), step=0.05, **WEIGHTS)
        times = np.linspace(plan.start, plan.end, 40_001)
        u = plan.inputs(times)[:, 0]
        assert np.max(np.abs(np.diff(u))) <= limit * (times[1] - times[0]) * (1 + 1e-8)
        costs.append(cost(plan, **WEIGHTS))
    assert all(a < b for a, b in itertools.pairwise(costs))


def test_a_limited_rate_forbids_the_input_to_jump_where_its_gain_does() -> None:
    edge = np.array([1.25, 1.25])
    beside = edge + np.array([-1e-6, 1e-6])
    limits = Limits(input=1.2)
    jumping = constrained_redesign(STRONGER, there_and_back(), limits=limits, step=0.05, **WEIGHTS)
    free = quadratic_redesign(STRONGER, there_and_back(), **WEIGHTS)
    assert np.ptp(free.inputs(edge, inside=beside)) > 0.1
    smooth = constrained_redesign(STRONGER, there_and_back(), limits=Limits(input=1.2, input_rate=50.0), step=0.05, **WEIGHTS)
    assert np.ptp(smooth.inputs(edge, inside=beside)) < 1e-10
    assert cost(smooth, **WEIGHTS) >= cost(jumping, **WEIGHTS) * (1 - 1e-9)


def test_any_feasible_plan_costs_more() -> None:
    """A slower slew's and a scaled plan, both without limits and within the limit."""
    reference = there_and_back()
    free = quadratic_redesign(NONMINIMUM, reference, **WEIGHTS)
    limit = 0.5 * float(largest_input(free)[0])
    plan = constrained_redesign(NONMINIMUM, reference, limits=Limits(input=limit), step=0.05, **WEIGHTS)
    half = quadratic_redesign(NONMINIMUM, reference.scaled(0.5), **WEIGHTS)
    assert largest_input(half)[0] <= limit * (1 + 1e-9)
    # Against the same reference: half the motion is what the scaled plan misses.
    times = np.linspace(half.start - 5.0, half.end + 5.0, 40_001)
    at = half(times)
    rate = 0.2 * at.u[:, 0] ** 2 + 0.3 * at.x[:, 0] ** 2 + 0.1 * at.x[:, 2] ** 2 + 4.0 * (at.y - reference(times))[:, 0] ** 2
    assert cost(free, **WEIGHTS) < cost(plan, **WEIGHTS) < np.trapezoid(rate, times)


def test_the_tails_keep_within_the_limits_too() -> None:
    """A limit of a twentieth of the peak: the plan takes minutes, most of them outside the first window."""
    reference = rest_to_rest(0.0, 1.0, 5.0)
    free = quadratic_redesign(TWO_DISC, reference, **TWO_DISC_WEIGHTS)
    limit = 0.05 * float(largest_input(free)[0])
    plan: ConstrainedTrajectory = constrained_redesign(
        TWO_DISC, reference, limits=Limits(input=limit), step=0.1, **TWO_DISC_WEIGHTS
    )
    assert np.max(np.abs(plan.inputs(densely(plan)))) <= limit * (1 + 1e-9)
    assert plan.breakpoints[0] < -60.0
    assert plan.certificate.continuity < 1e-10
    assert np.abs(plan([plan.start, plan.end]).y[:, 0] - [0.0, 1.0]) == pytest.approx(np.zeros(2), abs=1e-8)


def test_limits_that_the_solver_cannot_resolve_in_short_steps_are_kept_in_longer_ones() -> None:
    """Rate and twist far below what the slew would like: at the usual step the solver stalls."""
    limits = Limits(input=0.045, input_rate=0.01, states=[StateLimit("twist", {"x1": 1.0, "x3": -1.0}, 0.003)])
    slew, weights = rest_to_rest(0.0, 1.0, 5.0), {"R": 1.0, "Q_y": 10.0}
    plan = constrained_redesign(TWO_DISC, slew, limits=limits, **weights)
    coarse = constrained_redesign(TWO_DISC, slew, limits=limits, step=0.12, **weights)
    at = plan(densely(plan))
    assert np.max(np.abs(at.x @ [1.0, 0.0, -1.0, 0.0])) <= 0.003 * (1 + 2e-6)
    assert np.max(np.abs(at.u)) <= 0.045
    assert cost(plan, **weights) == pytest.approx(cost(coarse, **weights), rel=1e-6)
    assert cost(plan, **weights) <= cost(coarse, **weights)
