"""The input before the manoeuvre: closed forms, and the bound against the plan on a dense grid."""

from __future__ import annotations

import numpy as np
import pytest

from invtrack.errors import TrajectoryError
from invtrack.inversion.exact import invert
from invtrack.inversion.modified.modified_inversion import modified_inversion
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.plan import Plan
from invtrack.plans.preactuation import plan_preactuation_time, preactuation_bound
from invtrack.redesign.quadratic import quadratic_redesign
from invtrack.references.profiles import raised_cosine, rest_to_rest
from invtrack.references.signal import Generator, PiecewiseSignal
from tests.cited_plants import cantilever_paper
from tests.inversion.modified_cases import HE3, HE3_POLES, HOVER, TWO_DISC, moved_pair
from tests.linear.random_plants import block, plant_with

ALL_PASS = StateSpace([[-2.0]], [[1.0]], [[-3.0]], [[1.0]])  # (s - 1)/(s + 2)
SLEW = rest_to_rest(0.0, 1.0, 5.0, smoothness=3)
PULSE = SLEW + rest_to_rest(0.0, -1.0, 5.0, smoothness=3, start_time=2.0)


def plan_named(name: str) -> Plan:
    light, heavy = (StateSpace(*cantilever_paper(m)) for m in (0.0, 100.0))
    _, move = moved_pair(2.0)
    plans = {
        "all-pass": lambda: invert(ALL_PASS, PULSE),
        "torsional rig": lambda: invert(TWO_DISC, SLEW),
        "cantilever with a jump": lambda: invert(SwitchedSystem([light, heavy], [2.0]), raised_cosine(2.0)),
        "helicopter": lambda: invert(HE3, HOVER),
        "helicopter, pair moved": lambda: modified_inversion(HE3, HOVER, move=move, error_poles=HE3_POLES, design="robust"),
        "three zeros": lambda: invert(plant_with(np.random.default_rng(6), (2,), block(0.3, 0.35 + 1j)), SLEW),
        "output held before": lambda: invert(TWO_DISC, rest_to_rest(1.0, 3.0, 5.0, smoothness=3)),
        "redesign": lambda: quadratic_redesign(TWO_DISC, SLEW, R=1.0, Q_x=0.0, Q_y=10.0),
    }
    return plans[name]()  # type: ignore[no-untyped-call]


@pytest.mark.parametrize(
    "name",
    [
        "all-pass",
        "torsional rig",
        "cantilever with a jump",
        "helicopter",
        "helicopter, pair moved",
        "three zeros",
        "output held before",
        "redesign",
    ],
)
def test_bound_holds_and_is_tight(name: str) -> None:
    plan = plan_named(name)
    bound = preactuation_bound(plan)
    assert bound.semisimple
    t = bound.t_0 - np.linspace(1e-9, 12.0 / bound.alpha, 30_001)
    u_rest = plan.inputs(np.array([bound.t_0 - 60.0 / bound.alpha]))[0]
    share = np.linalg.norm(plan.inputs(t) - u_rest, axis=1) / bound(t)
    assert share.max() <= 1 + 1e-9
    assert share.max() > 0.7


def test_closed_form() -> None:
    """u = y_d' / ... of (s + 2)/(s - 1): u(t) = -3 e^t times the integral of e^-s y_d(s) for t < 0."""
    nodes, weights = np.polynomial.legendre.leggauss(60)
    s = np.concatenate([1.0 + nodes, 3.5 + 1.5 * nodes, 6.0 + nodes])
    integral = np.sum(np.concatenate([weights, 1.5 * weights, weights]) * np.exp(-s) * PULSE(s)[:, 0])
    plan = invert(ALL_PASS, PULSE)
    bound = preactuation_bound(plan)
    assert bound.alpha == pytest.approx(1.0, rel=1e-12)
    assert pytest.approx(3 * integral, rel=1e-9) == bound.M
    t = np.linspace(-1.0, 8.0, 200_001)
    peak = np.max(np.abs(plan.inputs(t)))
    for level in (0.01, 0.1):
        assert plan_preactuation_time(plan, level) == pytest.approx(np.log(3 * integral / (level * peak)), rel=1e-5)


def test_level_is_met_from_there_on() -> None:
    plan = plan_named("helicopter, pair moved")
    lead = plan_preactuation_time(plan, 0.05)
    t = np.linspace(-20.0, 25.0, 90_001)
    size = np.linalg.norm(plan.inputs(t), axis=1)
    limit = 0.05 * size.max()
    assert np.all(size[t < -lead] <= limit * (1 + 1e-6))
    assert np.linalg.norm(plan.inputs(np.array([-lead]))) == pytest.approx(limit, rel=1e-4)


def test_fitted_rate_is_that_of_the_slowest_zero() -> None:
    plan = plan_named("cantilever with a jump")
    t = -np.linspace(20.0, 60.0, 50)
    rate = np.polyfit(t, np.log(np.abs(plan.inputs(t)[:, 0])), 1)[0]
    assert rate == pytest.approx(preactuation_bound(plan).alpha, rel=0.01)


def test_bound_scales_with_the_reference_and_moves_with_it() -> None:
    plain, moved = preactuation_bound(invert(TWO_DISC, SLEW)), preactuation_bound(invert(TWO_DISC, SLEW.scaled(-3.0).shifted(40.0)))
    assert (moved.alpha, moved.M) == (pytest.approx(plain.alpha, rel=1e-9), pytest.approx(3 * plain.M, rel=1e-6))
    assert moved.t_0 == plain.t_0 + 40.0


def test_defective_zero_yields_some_of_its_rate() -> None:
    plant = plant_with(np.random.default_rng(2), (1,), np.array([[1.0, 1.0], [0.0, 1.0]]), mixed=False)
    plan = invert(plant, SLEW)
    bound = preactuation_bound(plan)
    assert not bound.semisimple
    assert 0.9 < bound.alpha < 1.0
    t = -np.linspace(1e-9, 100.0, 20_001)
    share = np.abs(plan.inputs(t)[:, 0]) / bound(t)
    assert 0.7 < share.max() <= 1 + 1e-9


def test_without_antistable_zeros_there_is_none() -> None:
    plan = invert(plant_with(np.random.default_rng(1), (2,), block(-0.4 + 1j)), SLEW)
    bound = preactuation_bound(plan)
    assert (bound.M, bound.alpha) == (0.0, np.inf)
    assert plan_preactuation_time(plan) == 0.0
    assert bound(np.array([-1.0]))[0] == 0.0


def test_refusals() -> None:
    plan = invert(ALL_PASS, PULSE)
    with pytest.raises(TrajectoryError, match=r"level, .* must lie between 0 and 1, got 1\.5"):
        plan_preactuation_time(plan, 1.5)
    with pytest.raises(TrajectoryError, match=r"before the manoeuvre's start t_0 = 0 s, got 1 s"):
        preactuation_bound(plan)([-1.0, 1.0])
    sine = Generator(np.array([[0.0, 1.0], [-1.0, 0.0]]), np.array([[1.0, 0.0]]))
    endless = PiecewiseSignal(np.array([0.0]), (sine,), np.zeros(2, dtype=np.intp), np.array([[0.0, 1.0], [0.0, 1.0]]))
    with pytest.raises(TrajectoryError, match="not at rest before its manoeuvre"):
        preactuation_bound(invert(ALL_PASS, endless))
