"""The input before the manoeuvre: closed forms, and the bound against the plan on a dense grid."""

from __future__ import annotations

import numpy as np
import pytest

from invtrack.control import TrackingController, lqr
from invtrack.errors import PlanError, TrajectoryError
from invtrack.inversion import feasibility
from invtrack.inversion.exact import invert
from invtrack.inversion.modified.modified_inversion import modified_inversion
from invtrack.linear.state_space import OperatingPoint, StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.actuation import plan_actuation_time
from invtrack.plans.export import sampled_plan
from invtrack.plans.plan import Plan
from invtrack.plans.preactuation import preactuation_bound
from invtrack.plans.sampled import plan_from
from invtrack.redesign import Limits, constrained_redesign
from invtrack.redesign.quadratic import quadratic_redesign
from invtrack.references.generator import Generator
from invtrack.references.profiles import raised_cosine, rest_to_rest
from invtrack.references.signal import PiecewiseSignal
from invtrack.results import peak_input, peak_input_above_rest, postactuation_time, preactuation_time
from invtrack.simulation import LinearPlant, simulate
from tests.cited_plants import cantilever_paper
from tests.inversion.modified_cases import HE3, HE3_POLES, HOVER, TWO_DISC, moved_pair
from tests.linear.random_plants import block, plant_with
from tests.ringing_plants import crane, with_zeros

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
        assert plan_actuation_time(plan, "before", level) == pytest.approx(np.log(3 * integral / (level * peak)), rel=1e-5)


def test_level_is_met_from_there_on() -> None:
    plan = plan_named("helicopter, pair moved")
    lead = plan_actuation_time(plan, "before", 0.05)
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
    assert plan_actuation_time(plan, "before") == 0.0
    assert bound(np.array([-1.0]))[0] == 0.0


def test_refusals() -> None:
    plan = invert(ALL_PASS, PULSE)
    with pytest.raises(TrajectoryError, match=r"level, .* must lie between 0 and 1, got 1\.5"):
        plan_actuation_time(plan, "before", 1.5)
    with pytest.raises(TrajectoryError, match=r"before the manoeuvre's start t_0 = 0 s, got 1 s"):
        preactuation_bound(plan)([-1.0, 1.0])
    sine = Generator(np.array([[0.0, 1.0], [-1.0, 0.0]]), np.array([[1.0, 0.0]]))
    endless = PiecewiseSignal(np.array([0.0]), (sine,), np.zeros(2, dtype=np.intp), np.array([[0.0, 1.0], [0.0, 1.0]]))
    with pytest.raises(TrajectoryError, match="not at rest before its manoeuvre"):
        preactuation_bound(invert(ALL_PASS, endless))


def test_what_acts_is_counted_from_rest_and_by_the_envelope_in_plan_and_run_alike() -> None:
    """Antistable zeros 0.5 +- 6j about operating points that take an input: case by case the same time, and that of the samples."""
    for u_0 in (0.0, 1.0, 100.0):
        point = OperatingPoint(x0=np.zeros(4), u0=np.array([u_0]), y0=np.zeros(1))
        model = with_zeros([0.5 + 6j, 0.5 - 6j], operating_point=point)
        plan = invert(model, rest_to_rest(0.0, 1.0, duration=2.0))
        t = np.linspace(-40.0, 2.0, 420_001)
        away = np.abs(plan.inputs(t)[:, 0] - u_0)
        first = -t[np.flatnonzero(away > 0.01 * away.max())[0]]
        assert first == pytest.approx(7.5444, abs=2e-4)
        assert preactuation_time(plan) == pytest.approx(first, abs=2e-4)
        run = simulate(LinearPlant(model), TrackingController(plan, lqr(model, Q=1.0, R=1.0)), timestep=2e-3)
        assert preactuation_time(run) == pytest.approx(first, abs=4e-3)
        assert peak_input(run) == pytest.approx(peak_input(plan), rel=1e-3)
        assert peak_input_above_rest(run) == pytest.approx(peak_input_above_rest(plan), rel=1e-3)


@pytest.mark.parametrize("damping", [0.02, 0.3, 1.0])
def test_a_lightly_damped_stable_zero_is_said_to_ring_on(damping: float) -> None:
    """A crane: what plan and remarks say of the swing after the manoeuvre is what dense samples of it show."""
    plan = invert(crane(damping), rest_to_rest(0.0, 0.6, duration=3.0))
    ringing = plan.ringing
    assert ringing is not None
    # A point mass m on a rope l with damping c at its pivot: s^2 + c / (m l^2) s + g / l.
    assert ringing.frequency == pytest.approx(np.sqrt(9.81), rel=1e-9)
    assert ringing.damping == pytest.approx(damping / 10.0 / (2 * np.sqrt(9.81)), rel=1e-6)
    turn = 2 * np.pi / ringing.frequency
    first = np.abs(plan.inputs(np.linspace(3.0, 3.0 + turn, 4001))[:, 0])
    peak = max(first.max(), np.abs(plan.inputs(np.linspace(0.0, 3.0, 20_001))).max())
    assert first.max() / peak <= ringing.share * (1 + 1e-9)
    assert first.max() / peak > ringing.share * np.exp(-ringing.damping * 2 * np.pi)
    late = 3.0 + ringing.duration + np.linspace(-turn, 2 * turn, 60_001)
    above = late[np.abs(plan.inputs(late)[:, 0]) > 0.01 * peak]
    assert above[-1] - 3.0 == pytest.approx(ringing.duration, abs=turn * 1e-3)
    assert postactuation_time(plan) == ringing.duration
    assert ringing.remark in plan.remarks
    assert f"rings on for {ringing.duration:.4g} s" in repr(plan)
    assert f"remark: {ringing.remark}" in str(feasibility(crane(damping), plan.reference))


def test_a_smoother_reference_says_how_much_less_it_rings() -> None:
    rough, smooth = (invert(crane(1.0), rest_to_rest(0.0, 0.6, duration=6.0, smoothness=k)).ringing for k in (1, 6))
    assert rough is not None
    assert smooth is not None
    assert smooth.share < rough.share / 3
    assert smooth.duration < rough.duration


def test_well_damped_zeros_and_what_is_hardly_excited_are_passed_over() -> None:
    slew = rest_to_rest(0.0, 0.6, duration=3.0)
    assert invert(crane(20.0), slew).ringing is None  # damping ratio 0.32
    gentle = rest_to_rest(0.0, 0.6, duration=40.0, smoothness=6)
    assert invert(crane(1.0), gentle).ringing is None
    assert invert(StateSpace([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]]), slew).ringing is None


def test_plans_that_begin_before_their_tails_and_samples_of_plans_have_their_times_too() -> None:
    """A sampled plan has no modes of its own: its preactuation is that of the plan it comes from."""
    plan = invert(TWO_DISC, SLEW, tolerance=1e-6)
    again = plan_from(sampled_plan(plan, rate=500.0))
    assert plan_actuation_time(again, "before") == pytest.approx(plan_actuation_time(plan, "before"), abs=5e-3)
    weights = {"R": 1.0, "Q_y": 10.0}
    free = quadratic_redesign(TWO_DISC, SLEW, **weights)
    low = 0.9 * float(free.input_range[1][0])
    limited = constrained_redesign(TWO_DISC, SLEW, **weights, limits=Limits(input=low))
    t = np.linspace(limited.start, limited.manoeuvre[0], 200_001)
    away = np.abs(limited.inputs(t)[:, 0])
    peak = np.abs(limited.inputs(np.linspace(*limited.manoeuvre, 50_001))).max()
    first = -t[np.flatnonzero(away > 0.01 * max(peak, away.max()))[0]]
    assert limited.breakpoints[0] < limited.manoeuvre[0]
    assert plan_actuation_time(limited, "before") == pytest.approx(first, abs=1e-3)
    bound = preactuation_bound(limited)
    assert bound.t_0 == limited.breakpoints[0]  # where the modes end: what limits act on lies behind it
    earlier = bound.t_0 - np.linspace(0.0, 20.0, 20_001)
    share = np.abs(limited.inputs(earlier)[:, 0]) / bound(earlier)
    assert 0.5 < share.max() <= 1 + 1e-9


def test_an_output_held_at_its_end_counts_from_the_rest_on_each_side() -> None:
    """Holding the output takes 0.662 after the slew and nothing before it: the modes before it do not see that."""
    plan = invert(with_zeros([0.5 + 6j, 0.5 - 6j]), rest_to_rest(0.0, 1.0, duration=2.0))
    assert plan.rest_inputs[:, 0] == pytest.approx([0.0, 24.0 / 36.25], abs=1e-9)  # den(0) / num(0)
    low, high = plan.input_range
    assert peak_input_above_rest(plan) == pytest.approx(max(high[0] - 24.0 / 36.25, -low[0]))


def test_a_limit_of_the_postactuation_says_what_it_leaves_out() -> None:
    reference = rest_to_rest(0.0, 0.6, duration=3.0)
    plan = invert(crane(1.0), reference, max_postactuation=20.0)
    assert plan.end == 23.0
    assert plan.postactuation == 20.0
    (said,) = [remark for remark in plan.remarks if "postactuation" in remark]
    assert said.startswith("postactuation limited to 20.0 s: the plan ends ")
    t = np.linspace(23.0, 25.1, 4001)
    left = np.max(np.abs(plan.trajectory.at(t, None) - plan.trajectory.after.held) / plan.trajectory.peaks)
    assert 0.5 * left < float(said.split(" of its peak")[0].split()[-1]) < 1.05 * left
    assert invert(crane(1.0), reference, max_postactuation=1e4).end == invert(crane(1.0), reference).end
    with pytest.raises(PlanError, match="max_postactuation must not be negative"):
        invert(crane(1.0), reference, max_postactuation=-1.0)
    redesigned = quadratic_redesign(crane(1.0), reference, R=1e-4, Q_y=1.0, max_postactuation=0.5)
    assert redesigned.postactuation == 0.5
    moved = modified_inversion(crane(1.0), reference, axis_distance=0.1, real_part=-1.0, max_postactuation=0.5)
    assert moved.postactuation == 0.5
