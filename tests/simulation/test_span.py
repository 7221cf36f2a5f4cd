"""How long a run lasts: never millions of steps unasked, and it says what it leaves out."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import invtrack
from invtrack.errors import LongRunWarning
from invtrack.plans import Plan
from invtrack.simulation.span import LONG, UNASKED, VISIBLE, span_of_run
from tests.ringing_plants import crane, with_zeros

SLEW = invtrack.rest_to_rest(0.0, 0.6, duration=3.0)


def silent_span(plan: Plan, **options: float) -> tuple[float, float, tuple[str, ...]]:
    stated = {"period": np.nan, "timestep": 1e-3, "start": None, "end": None, **options}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LongRunWarning)
        span = span_of_run(plan, **stated)  # type: ignore[arg-type]
    return span.start, span.end, span.remarks


def test_a_run_lasts_as_long_as_its_plan_and_the_window_for_vibration() -> None:
    plan = invtrack.invert(crane(20.0), SLEW)
    assert silent_span(plan) == (plan.start, plan.end, ())
    assert silent_span(plan, period=100.0) == (plan.start, 503.0, ())
    point_mass = invtrack.invert(invtrack.StateSpace([[0, 1], [0, 0]], [[0], [1]], [[1, 0]]), SLEW)
    assert silent_span(point_mass) == (0.0, 6.0, ())  # no flexible mode: the manoeuvre's own length after it


def test_a_plan_of_hours_is_cut_and_the_run_says_where_and_at_what_share() -> None:
    """A payload that is hardly damped swings at exp(-1e-3 t): 6 h until it rests to 1e-10, 23 million steps."""
    plan = invtrack.invert(crane(0.02), SLEW)
    assert plan.end > 2e4
    controller = invtrack.TrackingController(plan, invtrack.lqr(plan.model, Q=1.0, R=1.0))
    with pytest.warns(LongRunWarning, match=r"the run ends at t = 53 s, where the plan is still .* end=plan.end") as heard:
        run = invtrack.simulate(invtrack.LinearPlant(plan.model), controller, timestep=1e-4, start=2.9, end=None)
    assert heard[0].filename == __file__  # it points at the line that called simulate
    assert len(run.time) <= UNASKED + 2000
    assert run.time[-1] == 53.0
    (remark,) = run.remarks
    t = np.linspace(53.0, 55.1, 20001)  # a turn of the payload: what it says is left is left, to within the swing's phase
    inner = plan.states(np.linspace(0.0, 3.0, 3001))
    left = np.max(np.abs(plan.states(t)) / np.max(np.abs(inner), axis=0))
    stated = float(remark.split("still ")[1].split()[0])
    assert 0.5 * left < stated < 1.05 * left


def test_where_a_plan_looks_at_rest_before_the_steps_run_out_it_is_cut_there() -> None:
    """exp(-0.05 t): rest to 1e-10 takes 460 s, to 1e-3 of the peak 138 s and what the zero's size at T_f makes of it."""
    plan = invtrack.invert(with_zeros([-0.05 + 4j, -0.05 - 4j]), SLEW)
    timestep = (plan.end - 3.0) / UNASKED / 1.5
    _, end, (remark,) = silent_span(plan, timestep=timestep)
    rest = plan.states([end + 1e5])
    shares = np.max(np.abs(plan.states(np.linspace(end, end + 40.0, 40001)) - rest), axis=0) / plan.trajectory.peaks[:4]
    assert np.max(shares) == pytest.approx(VISIBLE, rel=0.1)
    assert end < 3.0 + UNASKED * timestep
    assert "1.0e-03" in remark or "9." in remark


def test_a_preactuation_of_hours_is_cut_too() -> None:
    plan = invtrack.invert(with_zeros([1e-3 + 4j, 1e-3 - 4j]), SLEW)
    assert plan.start < -1e4
    start, _, (remark,) = silent_span(plan)
    assert start == -UNASKED * 1e-3
    assert "start=plan.start" in remark
    share = float(remark.split("already ")[1].split()[0])
    tips = np.max(np.abs(plan.states(start + np.linspace(-1.6, 0.0, 5001))) / plan.trajectory.peaks[:4])
    assert 0.3 * tips < share < 1.05 * tips


def test_what_is_asked_for_is_done_and_announced() -> None:
    plan = invtrack.invert(crane(0.02), SLEW)
    with pytest.warns(LongRunWarning, match=r"a long run: 2277\d.\d s in 2.3e\+07 steps of 0.001 s, of the order of 8 min"):
        span = span_of_run(plan, period=np.nan, timestep=1e-3, start=plan.start, end=plan.end)
    assert (span.start, span.end, span.remarks) == (plan.start, plan.end, ())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        span_of_run(plan, period=np.nan, timestep=1e-3, start=0.0, end=LONG * 1e-3)


def test_a_plan_with_max_postactuation_ends_there() -> None:
    plan = invtrack.invert(crane(0.02), SLEW, max_postactuation=20.0)
    assert silent_span(plan) == (0.0, 23.0, ())


def test_a_slow_flexible_mode_does_not_make_a_run_of_hours_either() -> None:
    plan = invtrack.invert(crane(20.0), SLEW)
    _, end, (remark,) = silent_span(plan, period=1e4)
    assert end == 3.0 + UNASKED * 1e-3
    assert "until the window for residual vibration ends" in remark
    assert "end=50003" in remark
