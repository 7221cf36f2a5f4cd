"""Multipliers of active limits: against finite differences of the optimal cost, by optimality conditions, and in every unit."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import scipy.signal
import scipy.sparse
from numpy.typing import NDArray

from invtrack.channels import Channels
from invtrack.errors import RedesignError
from invtrack.linear.state_space import StateSpace
from invtrack.redesign.constrained import ConstrainedTrajectory, constrained_redesign
from invtrack.redesign.cost import cost
from invtrack.redesign.limited import optimality
from invtrack.redesign.limited.quadratic_program import Minimum, QuadraticProgram
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
    UNSTABLE,
    WEIGHTS,
    there_and_back,
    two_channels,
)

Array = NDArray[np.float64]

ALL: dict[str, Any] = {"input": (-0.1, 1.0), "input_rate": (-1.5, 1.2), "output": (-0.05, 0.4), "middle": (-0.12, 0.13)}


def planned(
    model: Any = NONMINIMUM, reference: Any = None, *, weights: dict[str, Any] = WEIGHTS, step: float = 0.1, **stated: Any
) -> ConstrainedTrajectory:
    stated = dict(stated)
    middle = stated.pop("middle", None)
    states = [] if middle is None else [StateLimit("middle", {"x2": 1.0}, middle)]
    reference = there_and_back() if reference is None else reference
    return constrained_redesign(model, reference, limits=Limits(**stated, states=states), step=step, **weights)


@functools.cache
def plan_with_all_limits() -> ConstrainedTrajectory:
    return planned(**ALL)


@pytest.mark.parametrize(
    ("model", "limit"),
    [(NONMINIMUM, 0.9), (DIRECT, 0.8), (UNSTABLE, 0.1), (STRONGER, 1.0)],
    ids=["plain", "direct", "unstable", "jump"],
)
def test_the_price_of_an_input_limit_is_minus_the_slope_of_the_optimal_cost(model: Any, limit: float) -> None:
    """The cost is that of the plans' values by quadrature, which knows of no multipliers; central differences."""
    plan = planned(model, input=limit)
    h = 1e-3 * limit
    above, below = (cost(planned(model, input=value), **WEIGHTS) for value in (limit + h, limit - h))
    assert plan.shadow_prices["input 'u1'"] == pytest.approx((below - above) / (2 * h), rel=1e-4)
    assert plan.shadow_prices["input 'u1'"] > 0
    curvature = (above - 2 * cost(plan, **WEIGHTS) + below) / h**2
    assert curvature > 0  # the optimal cost is a convex function of the limit


@pytest.mark.parametrize(("name", "side"), [("input", 1), ("input_rate", 0), ("output", 1), ("middle", 0), ("middle", 1)])
def test_the_sensitivity_of_each_side_is_the_slope_of_the_optimal_cost(name: str, side: int) -> None:
    """With all kinds of limits at once. Those on states and outputs hold to 1e-6, which is seen in the differences."""
    h = 1e-3 * abs(ALL[name][side])
    costs = []
    for change in (-h, h):
        value = list(ALL[name])
        value[side] += change
        costs.append(cost(planned(**{**ALL, name: tuple(value)}), **WEIGHTS))
    slope = (costs[1] - costs[0]) / (2 * h)
    called = {"input": "input 'u1'", "input_rate": "rate of input 'u1'", "output": "output 'y1'", "middle": "'middle'"}[name]
    found = [a.sensitivity for a in plan_with_all_limits().active if (a.name, a.side) == (called, ("low", "high")[side])]
    assert (found[0] if found else 0.0) == pytest.approx(slope, rel=5e-3, abs=1e-4)


def test_all_kinds_of_limits_act_in_the_cases_above() -> None:
    assert {each.name for each in plan_with_all_limits().active} == set(plan_with_all_limits().shadow_prices)


def test_the_minimum_principle() -> None:
    """With the costate p' = -A'p - 2 Q_x x - 2 C'Q_y (y - y_d) from rest after the end, by simulation of the plan's own values:

    2 R u + B'p vanishes off the limits, and on them its size is the density of the multiplier, with the sign that holds u there.
    """
    plan = planned(input=(-0.05, 0.9), step=0.005)
    times = np.linspace(plan.end, plan.start, 40_001)  # backward, in which the costate is stable
    at = plan(times)
    s = NONMINIMUM
    forcing = 2 * at.x @ WEIGHTS["Q_x"] + 2 * WEIGHTS["Q_y"] * (at.y - at.y_d) @ s.C
    costate = scipy.signal.lsim((s.A.T, np.eye(3), np.eye(3), np.zeros((3, 3))), forcing, times[0] - times)[1]
    slope = 2 * WEIGHTS["R"] * at.u[:, 0] + costate @ s.B[:, 0]
    size = float(np.max(np.abs(slope)))
    assert {each.side for each in plan.active} == {"low", "high"}
    on = np.zeros(len(times), dtype=bool)
    for each in plan.active:
        for stretch in each.stretches:
            on |= (times > stretch.start - 0.01) & (times < stretch.end + 0.01)
            inside = (times > stretch.start) & (times < stretch.end)
            density = slope[inside] if each.side == "low" else -slope[inside]
            assert np.min(density) > -1e-3 * size
            assert stretch.multiplier == pytest.approx(float(np.sum(density) * (times[0] - times[1])), rel=2e-3)
    assert np.max(np.abs(slope[~on])) < 1e-3 * size


def test_a_limit_loosened_during_one_stretch_only() -> None:
    """Two humps, the second one smaller: the input is at its limit twice, and each time has its own price.

    A hump that is alone, so far from the other that neither knows of it, costs more by just as much.
    """
    first, second = there_and_back(), there_and_back(size=0.8, start_time=60.0)
    both = planned(reference=first + second, input=0.9)
    high = next(each for each in both.active if each.side == "high")
    alone = [planned(reference=each, input=0.9).active for each in (first, second)]
    assert len(high.stretches) == 2
    for stretch, single in zip(high.stretches, alone, strict=True):
        assert stretch.multiplier == pytest.approx(next(a for a in single if a.side == "high").multiplier, rel=1e-6)
    assert high.multiplier == pytest.approx(sum(stretch.multiplier for stretch in high.stretches), rel=1e-12)
    assert high.stretches[0].multiplier > high.stretches[1].multiplier > 0


def test_the_price_does_not_depend_on_the_step() -> None:
    coarse, fine = (planned(input=0.9, step=step) for step in (0.05, 0.0125))
    assert coarse.shadow_prices["input 'u1'"] == pytest.approx(fine.shadow_prices["input 'u1'"], rel=2e-4)


@pytest.mark.parametrize("scale", [1e-300, 1e-18, 1e18, 1e290])
def test_a_common_scale_of_the_weights_changes_nothing(scale: float) -> None:
    plain = plan_with_all_limits()
    other = planned(weights={name: scale * weight for name, weight in WEIGHTS.items()}, **ALL)
    times = np.linspace(-4.0, 9.0, 301)
    assert np.max(np.abs(other.inputs(times) - plain.inputs(times))) < 1e-10
    assert other.optimality is not None
    assert plain.optimality is not None
    assert other.optimality.cost / scale == pytest.approx(plain.optimality.cost, rel=1e-10)
    for name, price in plain.shadow_prices.items():
        assert other.shadow_prices[name] / scale == pytest.approx(price, rel=1e-8)
    assert [(a.name, a.side, len(a.stretches)) for a in other.active] == [(a.name, a.side, len(a.stretches)) for a in plain.active]


def test_prices_are_in_cost_per_unit_of_the_limit() -> None:
    """An input counted in thousandths has a limit a thousand times as large, each unit of which is worth a thousandth."""
    milli = StateSpace(NONMINIMUM.A, NONMINIMUM.B / 1e3, NONMINIMUM.C)
    plain, other = planned(input=0.9), planned(milli, input=900.0, weights={**WEIGHTS, "R": WEIGHTS["R"] / 1e6})
    assert other.shadow_prices["input 'u1'"] * 1e3 == pytest.approx(plain.shadow_prices["input 'u1'"], rel=1e-6)


@pytest.mark.parametrize(
    ("model", "reference", "weights", "stated"),
    [
        (NONMINIMUM, there_and_back(), WEIGHTS, ALL),
        (STRONGER, there_and_back(), WEIGHTS, {"input": 1.0, "input_rate": 3.0}),
        (FULL, two_channels(), FULL_WEIGHTS, {"input": [0.3, 0.5], "output": ([-0.5, -np.inf], [0.6, np.inf])}),
        (TWO_DISC, rest_to_rest(0.0, 1.0, 10.0), {"R": 1.0, "Q_y": 10.0}, {"input": 0.045, "input_rate": 0.05}),
    ],
    ids=["all", "jump", "two channels", "rigid body"],
)
def test_a_plan_certifies_that_it_is_the_best_one(model: Any, reference: Any, weights: Any, stated: Any) -> None:
    plan = planned(model, reference, weights=weights, **stated)
    assert plan.optimality is not None
    assert plan.optimality.duality_gap < 1e-8
    assert plan.optimality.stationarity < 1e-9
    assert plan.optimality.cost == pytest.approx(cost(plan, **weights), rel=1e-8)
    assert all(stretch.multiplier >= 0 for each in plan.active for stretch in each.stretches)


def test_the_gap_bounds_what_a_worse_point_gives_away() -> None:
    """min (z1^2 + z2^2) / 2 - z1 - 2 z2 with z1 = z2 <= 1: the optimum is -2 at z = (1, 1), and the limit's multiplier is 1."""
    program = QuadraticProgram(
        P=scipy.sparse.csr_array(np.eye(2)),
        q=np.array([-1.0, -2.0]),
        E=scipy.sparse.csr_array(np.array([[1.0, -1.0]])),
        e=np.zeros(1),
        G=scipy.sparse.csr_array(np.array([[1.0, 0.0]])),
        h=np.ones(1),
    )
    found = program.solve()
    assert found is not None
    assert found.z == pytest.approx([1.0, 1.0], abs=1e-8)
    assert found.of_limits == pytest.approx([1.0], abs=1e-8)
    assert found.of_equations == pytest.approx([-1.0], abs=1e-8)
    best = optimality.measured_optimality(program, found.z, found, 10.0)
    assert best.cost == pytest.approx(8.0, rel=1e-8)
    assert best.duality_gap < 1e-8
    best.require()
    for z in ([0.5, 0.5], [0.9, 0.9], [1.0 - 1e-3, 1.0 - 1e-3]):
        worse = optimality.measured_optimality(program, np.array(z), found, 10.0)
        assert worse.duality_gap * worse.cost == pytest.approx(worse.cost - 8.0, rel=1e-6)
        with pytest.raises(RedesignError, match=r"may not be the best one: its duality gap is .* of its cost"):
            worse.require()
    wrong = Minimum(found.z, found.of_equations, np.zeros(1))
    with pytest.raises(RedesignError, match="misses stationarity by"):
        optimality.measured_optimality(program, found.z, wrong, 10.0).require()


def test_without_active_limits_nothing_has_a_price() -> None:
    free = quadratic_redesign(NONMINIMUM, there_and_back(), **WEIGHTS)
    plan = planned(input=2.0 * float(np.max(np.abs(free.input_range))))
    assert plan.shadow_prices == {"input 'u1'": 0.0}
    assert plan.optimality is None
    assert str(plan).splitlines()[-1].split() == ["input", "'u1'", "-", "high", f"{plan.limits[0].high:.6g}", "0", "0", "0"]


def test_text() -> None:
    model = StateSpace(
        NONMINIMUM.A,
        NONMINIMUM.B,
        NONMINIMUM.C,
        states=Channels(["a", "b", "c"], ["m", "m", "m/s"]),
        inputs=Channels(["motor"], ["N"]),
        outputs=Channels(["tip"], ["m"]),
    )
    limits = Limits(input=0.9, input_rate=1.5, output=2.0, states=[StateLimit("sum", {"a": 1.0, "b": 1.0}, 5.0)])
    plan = constrained_redesign(model, there_and_back(), limits=limits, step=0.1, **WEIGHTS)
    high = next(each for each in plan.active if (each.name, each.side) == ("input 'motor'", "high"))
    assert str(high).startswith("input 'motor' is at its high limit 0.9 N for ")
    assert str(high).endswith(f"; raising it lowers the cost by {high.multiplier:.4g} per N")
    low = next(each for each in plan.active if (each.name, each.side) == ("rate of input 'motor'", "low"))
    assert str(low).endswith(f"; lowering it lowers the cost by {low.multiplier:.4g} per N/s")
    lines = str(plan).splitlines()
    assert lines[1].startswith(f"cost {cost(plan, **WEIGHTS):.6g}; the best plan within the limits costs less by a share of ")
    assert lines[2].split() == ["limit", "unit", "side", "value", "active", "[s]", "stretches", "cost", "saved", "per", "unit"]
    assert len(lines) == 3 + 2 * 4
    assert [limit.unit for limit in plan.limits] == ["N", "N/s", "m", "m"]
    (row,) = (line.split() for line in lines if line.startswith("input 'motor'") and " high " in line)
    assert row[2:] == ["N", "high", "0.9", f"{high.duration:.4g}", str(len(high.stretches)), f"{high.multiplier:.4g}"]


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        (lambda: None, r"expected limits such as invtrack\.Limits\(input=5\.0\), got None"),
        (lambda: {"input": 1.0}, r"expected limits such as .* got \{'input': 1\.0\}"),
        (lambda: Limits, "expected limits such as"),
        (lambda: [Limits(input=1.0)], "expected limits such as"),
        (lambda: Limits(states="twist"), r"must be a list of StateLimits such as .* got 'twist'"),
        (lambda: Limits(states=None), "must be a list of StateLimits"),  # type: ignore[arg-type]
        (lambda: Limits(states={"twist": 1.0}), "must be a list of StateLimits"),  # type: ignore[arg-type]
        (lambda: Limits(states=StateLimit("a", {"x1": 1.0}, 1.0)), "must be a list of StateLimits"),  # type: ignore[arg-type]
        (lambda: Limits(states=[("a", {"x1": 1.0}, 1.0)]), "must be a list of StateLimits"),  # type: ignore[list-item]
        (lambda: Limits(states=[StateLimit("a", {"x1": 1.0}, 1.0)] * 2), r"needs a name of its own, .* got \['a', 'a'\]"),
        (lambda: Limits(states=[StateLimit(None, {"x1": 1.0}, 1.0)]), "must be a text, by which messages call the limit, got None"),  # type: ignore[arg-type]
        (lambda: Limits(states=[StateLimit("a", {1: 1.0}, 1.0)]), r"of which \[1\] are unknown"),  # type: ignore[dict-item]
        (lambda: Limits(states=[StateLimit("a", {"x1": "b"}, 1.0)]), "weights of 'a' must be real numbers"),  # type: ignore[dict-item]
        (lambda: Limits(states=[StateLimit("a", {"x1": np.nan}, 1.0)]), "weights of 'a' must be finite"),
        (lambda: Limits(states=[StateLimit("a", [1.0, 2.0], 1.0)]), "weights of 'a' must be finite, one number for each of"),
        (lambda: Limits(states=[StateLimit("a", {"x1": 1.0}, None)]), "limit 'a' must be real numbers"),  # type: ignore[arg-type]
        (lambda: Limits(states=[StateLimit("a", {"x1": 1.0}, (1.0,))]), r"expected a tuple \(low, high\) of two"),  # type: ignore[arg-type]
        (lambda: Limits(input=None), "limit 'input' must be real numbers"),  # type: ignore[arg-type]
        (lambda: Limits(input=1j), "limit 'input' must be real numbers"),
        (lambda: Limits(input=(None, 1.0)), "limit 'input' must be real numbers"),  # type: ignore[arg-type]
        (lambda: Limits(input={"u1": 1.0}), "limit 'input' must be real numbers"),  # type: ignore[arg-type]
        (lambda: Limits(output=(np.nan, 1.0)), "limit 'output' has entries that are not numbers"),
        (lambda: Limits(input_rate=[[1.0]]), r"expected a number or 1 for the inputs .* got shape \(1, 1\)"),
    ],
)
def test_what_is_no_limit(limits: Callable[[], Any], message: str) -> None:
    with pytest.raises(RedesignError, match=message):
        constrained_redesign(NONMINIMUM, there_and_back(), limits=limits(), **WEIGHTS)
