"""Redesign through jumps that move the equilibrium: what costs is the departure from the rest of the interval in force."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import scipy.linalg
import scipy.optimize
from numpy.typing import NDArray

import invtrack
from invtrack.errors import RedesignError
from invtrack.linear.propagation import zero_order_hold
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.redesign.cost import cost
from invtrack.redesign.limits import Limits, StateLimit
from invtrack.references.signal import PiecewiseSignal
from tests.equilibria import Equilibrium, at_rest_in
from tests.inversion.test_moved_equilibria import elastic_hoist
from tests.redesign.plants import HEAVIER, MINIMUM, NONMINIMUM, WEIGHTS, there_and_back

Array = NDArray[np.float64]

JUMPS = (0.8, 2.4)
EQUILIBRIA: tuple[Equilibrium, ...] = (
    ([0.2, -0.1, 0.0], [1.0], [0.3]),
    ([0.5, 0.1, -0.2], [4.0], [0.1]),
    ([-0.1, 0.0, 0.3], [-2.0], [-0.2]),
)
SYSTEMS = (NONMINIMUM, HEAVIER, MINIMUM)
MODEL = SwitchedSystem([at_rest_in(*pair) for pair in zip(SYSTEMS, EQUILIBRIA, strict=True)], JUMPS)
# It comes from the first output at rest and goes to the last one.
REFERENCE = there_and_back() + 0.3 + invtrack.rest_to_rest(0.0, -0.5, 1.0, start_time=2.0)


@dataclass(frozen=True)
class Discretized:
    """The same problem in absolute coordinates, inputs held over N steps from far before to far behind: |rows u - wanted|^2."""

    rows: Array
    wanted: Array
    times: Array
    rest: Array

    @classmethod
    def of(cls, step: float, start: float, end: float, reference: PiecewiseSignal) -> Discretized:
        steps = round((end - start) / step)
        edges = start + step * np.arange(steps + 1)
        middle = edges[:-1] + step / 2
        owner = np.searchsorted(JUMPS, middle)
        root = np.sqrt(step) * scipy.linalg.block_diag(
            np.sqrt(WEIGHTS["R"]), np.sqrt(WEIGHTS["Q_x"]), np.sqrt(WEIGHTS["Q_y"])
        )  # diagonal ones
        whole = [zero_order_hold(system.A, system.B, step) for system in SYSTEMS]
        half = [zero_order_hold(system.A, system.B, step / 2) for system in SYSTEMS]
        X, offset = np.zeros((3, steps)), np.asarray(EQUILIBRIA[0][0], dtype=float)
        rows, wanted = [], []
        for k, interval in enumerate(owner):
            x0, u0, y0 = (np.asarray(value, dtype=float) for value in EQUILIBRIA[interval])
            here = np.zeros((1, steps))
            here[0, k] = 1.0

            def carried(
                maps: tuple[Array, Array], X: Array = X, offset: Array = offset, here: Array = here, x0: Array = x0, u0: Array = u0
            ) -> tuple[Array, Array]:
                A_d, B_d = maps
                return A_d @ X + B_d @ here, x0 + A_d @ (offset - x0) - B_d @ u0

            X_m, offset_m = carried(half[interval])
            C = SYSTEMS[interval].C
            rows.append(root @ np.vstack([here, X_m, C @ X_m]))
            miss = reference(middle[k]) - y0 - C @ (offset_m - x0)
            wanted.append(root @ np.concatenate([u0, x0 - offset_m, miss]))
            X, offset = carried(whole[interval])
        rest = np.array([EQUILIBRIA[k][1] for k in owner], dtype=float)[:, 0]
        return cls(np.vstack(rows), np.concatenate(wanted), middle, rest)

    def least(self) -> tuple[float, Array]:
        u = np.linalg.lstsq(self.rows, self.wanted)[0]
        return self.cost(u), u

    def least_within(self, low: float, high: float) -> tuple[float, Array]:
        u = scipy.optimize.lsq_linear(self.rows, self.wanted, bounds=(low, high), tol=1e-12).x
        return self.cost(u), u

    def cost(self, u: Array) -> float:
        return float(np.sum((self.rows @ u - self.wanted) ** 2))


@pytest.fixture(scope="module")
def plan() -> invtrack.Plan:
    return invtrack.quadratic_redesign(MODEL, REFERENCE, **WEIGHTS)


def test_it_is_the_least_cost_of_a_discretized_problem(plan: invtrack.Plan) -> None:
    """Errors of order step^2: extrapolated from two steps."""
    costs, inputs = zip(*(Discretized.of(step, -6.0, 10.0, REFERENCE).least() for step in (0.04, 0.02)), strict=True)
    least = (4 * costs[1] - costs[0]) / 3
    assert cost(plan, **WEIGHTS) == pytest.approx(least, rel=2e-5)
    assert plan.optimality_gap < 1e-10  # type: ignore[attr-defined]
    task = Discretized.of(0.02, -6.0, 10.0, REFERENCE)
    assert np.max(np.abs(inputs[1] - plan.inputs(task.times)[:, 0])) < 1e-3 * np.ptp(inputs[1])


def test_the_state_is_continuous_and_the_input_is_not(plan: invtrack.Plan) -> None:
    """B is the same in all intervals, so that u - u0 is continuous in the optimum."""
    at = np.array(JUMPS)
    before, after = plan(at, inside=at - 0.1), plan(at, inside=at + 0.1)
    assert before.x == pytest.approx(after.x, abs=1e-12)
    assert (after.u - before.u)[:, 0] == pytest.approx([3.0, -6.0], abs=1e-11)
    assert plan.certificate.worst(exact=False) < 1e-12


def test_any_other_input_costs_more(plan: invtrack.Plan) -> None:
    task = Discretized.of(0.04, -6.0, 10.0, REFERENCE)
    best, u = task.least()
    rng = np.random.default_rng(3)
    for _ in range(5):
        bump = rng.normal() * np.exp(-(((task.times - rng.uniform(-1.0, 5.0)) / 0.5) ** 2))
        assert all(task.cost(u + sign * 0.1 * bump) > best for sign in (-1, 1))


def test_where_nothing_is_asked_of_the_output_the_jumps_are_passed_at_least_cost() -> None:
    plan = invtrack.quadratic_redesign(MODEL, REFERENCE, R=0.2, Q_x=np.diag([0.3, 0.1, 0.1]), Q_y=0.0)
    assert cost(plan, R=0.2, Q_x=np.diag([0.3, 0.1, 0.1]), Q_y=0.0) > 1e-3
    assert plan.optimality_gap < 1e-10
    assert plan.certificate.worst(exact=False) < 1e-12


def limited(**limits: Any) -> invtrack.Plan:
    return invtrack.constrained_redesign(MODEL, REFERENCE, **WEIGHTS, limits=Limits(**limits), step=0.01)


def dense(plan: invtrack.Plan) -> tuple[Array, Array]:
    """Times of a plan and times inside the pieces meant, both sides of all breakpoints among them."""
    edges = np.unique(np.concatenate([[-6.0], plan.breakpoints, [10.0]]))
    middle = (edges[:-1] + edges[1:]) / 2
    times = edges[:-1, None] + np.diff(edges)[:, None] * np.linspace(0.0, 1.0, 7)
    return times.ravel(), np.repeat(middle, 7)


def test_limits_are_absolute_in_every_interval(plan: invtrack.Plan) -> None:
    times, inside = dense(plan)
    u = plan.inputs(times, inside=inside)
    low, high = -2.05, float(u.max()) - 0.5  # it is at rest at -2 in the end
    assert u.min() < low
    found = limited(input=(low, high))
    times, inside = dense(found)
    u = found.inputs(times, inside=inside)
    assert (u.min(), u.max()) == pytest.approx((low, high), abs=1e-9)
    expected = Discretized.of(0.04, -6.0, 10.0, REFERENCE).least_within(low, high)[0]
    assert cost(found, **WEIGHTS) == pytest.approx(expected, rel=3e-3)
    assert cost(found, **WEIGHTS) > cost(plan, **WEIGHTS)
    at = np.array(JUMPS)
    assert found(at, inside=at - 1e-3).x == pytest.approx(found(at, inside=at + 1e-3).x, abs=1e-9)


def test_limits_that_are_wide_enough_change_nothing(plan: invtrack.Plan) -> None:
    found = limited(input=(-20.0, 20.0), output=(-5.0, 5.0), states=[StateLimit("first", {"x1": 1.0}, 5.0)])
    times = np.linspace(-6.0, 10.0, 101)
    assert np.array_equal(found(times).u, plan(times).u)


def test_a_limited_rate_holds_through_the_jump_of_the_input_at_rest() -> None:
    found = limited(input_rate=30.0)
    at = np.array(JUMPS)
    before, after = found.inputs(at, inside=at - 1e-3), found.inputs(at, inside=at + 1e-3)
    assert before == pytest.approx(after, abs=1e-9)
    times, inside = dense(found)
    rates = np.diff(found.inputs(times, inside=inside)[:, 0].reshape(-1, 7), axis=1) / np.diff(times.reshape(-1, 7), axis=1)
    assert np.max(np.abs(rates[20:-20])) == pytest.approx(30.0, rel=1e-5)


def test_outputs_and_states_keep_absolute_limits(plan: invtrack.Plan) -> None:
    times, inside = dense(plan)
    values = plan(times, inside=inside)
    high, most = float(values.y.max()) - 0.1, float(values.x[:, 0].max()) - 0.05
    found = limited(output=(-5.0, high), states=[StateLimit("first", {"x1": 1.0}, (-5.0, most))])
    times, inside = dense(found)
    values = found(times, inside=inside)
    assert np.max(values.y) == pytest.approx(high, abs=1e-5)
    assert np.max(values.x[:, 0]) <= most + 1e-5


def test_rest_outside_a_limit_is_refused_in_absolute_units() -> None:
    with pytest.raises(
        RedesignError, match="at rest after the manoeuvre input 'u1' is -2, expected strictly between its limits -1"
    ):
        limited(input=(-1.0, 9.0))


def test_models_at_rest_elsewhere_do_not_share_an_input() -> None:
    other = SwitchedSystem([*MODEL.systems[:2], at_rest_in(MINIMUM, ([0.0, 0, 0], [3.0], [-0.2]))], JUMPS)
    with pytest.raises(RedesignError, match="model 1 of 2 is at rest with another input or output than the first"):
        invtrack.quadratic_redesign([MODEL, other], REFERENCE, **WEIGHTS)


def test_variants_of_one_plant_go_through_the_same_jumps() -> None:
    softer = SwitchedSystem(
        [at_rest_in(StateSpace(0.97 * s.A, s.B, s.C), e) for s, e in zip(SYSTEMS, EQUILIBRIA, strict=True)], JUMPS
    )
    plan = invtrack.quadratic_redesign([MODEL, softer], REFERENCE, **WEIGHTS)
    alone = invtrack.quadratic_redesign(MODEL, REFERENCE, **WEIGHTS)
    assert plan.optimality_gap < 1e-9
    for variant in plan.variants:
        assert variant.certificate.worst(exact=False) < 1e-10
    assert cost(plan.variants[0], **WEIGHTS) > cost(alone, **WEIGHTS)


def test_the_rope_that_takes_a_load_does_what_the_redesign_says() -> None:
    """The plan's input alone, on the linear plant: the output that was planned, errors included."""
    model = SwitchedSystem([elastic_hoist(1.0, 0.4), elastic_hoist(3.0, 0.4)], [1.0])
    lift = invtrack.rest_to_rest(0.0, 1.0, 2.4, smoothness=5)
    plan = invtrack.quadratic_redesign(model, lift, R=1e-7, Q_y=1.0, tolerance=1e-8)
    result = invtrack.simulate(
        invtrack.LinearPlant(model),
        invtrack.TrackingController(plan),
        evaluate="stages",
        timestep=2e-3,
        initial_state=plan(plan.start).x[0],
    )
    interval = model.interval((result.time[:-1] + result.time[1:]) / 2)
    rest = {"u_0": model.rest_inputs[interval], "x_0": model.rest_states[interval]}
    stretch = np.array([[1.0, 0.0, -1.0, 0.0]])  # of the rope, from that under the load in force
    weights: dict[str, Any] = {"R": 1e-7, "Q_x": stretch.T @ stretch, "Q_y": 1.0}
    assert invtrack.results.run_cost(result, **weights, **rest) == pytest.approx(cost(plan, **weights), rel=1e-3)
    planned = np.max(np.abs(plan(result.time).y - plan(result.time).y_d))
    assert 1e-3 < planned < 0.1
    assert np.max(np.abs(result.output.values - result.planned_output.values)) < 1e-6 * planned
