"""Advice: what it recommends, against a denser sweep; its program; its reasons; what it refuses."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rich.console import Console

import invtrack
from invtrack.advice import Advice, ways
from invtrack.errors import InvtrackError, NonHyperbolicError
from invtrack.plans.plan import Plan
from tests.advice.plants import crane, mass

ERROR, TIMESTEP = 0.01, 1e-2

SWING = """<mujoco model="swing"><option integrator="RK4"/>
<worldbody><body name="cart"><joint name="x" type="slide" axis="1 0 0" damping="1"/><geom type="box" size=".2 .1 .05" mass="1"/>
<body name="pole"><joint name="swing" axis="0 1 0" damping=".05"/><geom type="capsule" fromto="0 0 0 0 0 -1" size=".02" mass="1"/>
</body></body></worldbody><actuator><motor name="drive" joint="x"/></actuator></mujoco>"""
"""A cart from which a heavy pole hangs, far from linear where it is moved fast."""


@pytest.fixture(scope="module")
def lifted() -> Advice:
    """A load that a crane moves by 1 m in 3 s, which may be 10 % heavier or lighter."""
    others = {"lighter": crane(1.8, limit=60.0), "heavier": crane(2.2, limit=60.0)}
    move = invtrack.Move(1.0, duration=3.0)
    return invtrack.advise(crane(limit=60.0), move, error=ERROR, parameter_errors=others, timestep=TIMESTEP)


def only(monkeypatch: pytest.MonkeyPatch, *names: str) -> None:
    """Try these ways alone, each with one smoothness."""
    chosen = tuple(replace(way, offsets=(-1,)) for way in ways.WAYS if way.name in names)
    monkeypatch.setitem(invtrack.advise.__globals__, "WAYS", chosen)


def swept(model: invtrack.StateSpace) -> Iterator[Plan]:
    """Redesigns over weights and smoothnesses, and inverses, of the motion of 1 m in 3 s (benchmarks/advice.py has many more)."""
    for smoothness in (1, 2, 3):
        reference = invtrack.rest_to_rest(0.0, 1.0, 3.0, smoothness=smoothness)
        yield invtrack.invert(model, reference)
        for R in np.geomspace(1e-5, 3e-4, 5):
            yield invtrack.quadratic_redesign(model, reference, R=R, Q_y=1.0)


def misses(plan: Plan) -> float:
    times = np.linspace(-3.0, 6.0, 901)
    samples = plan(times)
    return float(np.max(np.abs(samples.y - samples.y_d)))


def test_the_recommended_plan_takes_at_most_half_as_much_again_as_the_least_of_a_denser_sweep(lifted: Advice) -> None:
    best = lifted.recommended
    assert best is not None
    least = min(float(np.max(np.abs(plan.input_range))) for plan in swept(crane()) if misses(plan) <= ERROR)
    assert best.peak_input <= 1.5 * least
    assert best.duration <= 3.0


def test_what_is_recommended_does_what_was_asked_and_the_figures_are_those_of_its_run(lifted: Advice) -> None:
    best = lifted.recommended
    assert best is not None
    assert best.meets
    assert best is lifted.trials[0]
    assert best.error == np.max(np.abs(best.run.output.values - best.run.reference.values)) <= ERROR
    assert best.peak_input == np.max(np.abs(best.run.applied.values)) <= 60.0
    assert best.error_off is not None
    assert best.error < best.error_off < 2 * ERROR
    assert all(best.peak_input <= 1.05 * trial.peak_input for trial in lifted.trials if trial.meets)


def test_the_program_is_what_was_run(lifted: Advice) -> None:
    best = lifted.recommended
    assert best is not None
    names: dict[str, Any] = {"model": crane(limit=60.0)}
    exec(compile(lifted.program, "program", "exec"), names)
    again = names["result"]
    assert np.array_equal(again.output.values, best.run.output.values)
    assert np.array_equal(again.applied.values, best.run.applied.values)


def test_methods_are_excluded_with_the_reason_of_their_own_refusal(lifted: Advice) -> None:
    reference = invtrack.rest_to_rest(0.0, 1.0, 3.0, smoothness=2)
    with pytest.raises(NonHyperbolicError) as refusal:
        invtrack.causal_inverse(crane(), reference)
    assert lifted.excluded["causal inverse"] == str(refusal.value)
    assert "no limit acts" in lifted.excluded["constrained redesign"]
    tried = {trial.method for trial in lifted.trials}
    assert tried.isdisjoint(lifted.excluded)
    assert {"stable inversion", "quadratic redesign", "feedback alone", "ZV shaper under feedback", "ZPETC"} <= tried
    assert {trial.smoothness for trial in lifted.trials} >= {1, 2, 4}


def test_feedback_alone_and_shapers_lag_behind_what_plans_ahead(lifted: Advice) -> None:
    errors = {trial.method: trial.error for trial in reversed(lifted.trials)}
    assert errors["stable inversion"] < ERROR < errors["feedback alone"]
    assert "error" in next(trial for trial in lifted.trials if trial.method == "feedback alone").misses


def test_tables_say_it_all(lifted: Advice) -> None:
    text = str(lifted)
    assert text.startswith("linear model: quadratic redesign of a motion of 3 s, smoothness 1\n")
    assert "recommended" in text
    assert "not causal inverse: " in text
    assert lifted.program in text
    html = lifted._repr_html_()
    assert html.count("<tr") == len(lifted.trials) + 1
    assert "<script" not in html
    console = Console(width=60, record=True, file=None, quiet=True)
    lifted.show(console)
    numbers = lifted.as_dict()
    assert numbers["recommended"]["peak_input"] == lifted.trials[0].peak_input
    assert len(numbers["trials"]) == len(lifted.trials)


def test_the_fastest_motion_comes_near_what_the_limit_lets_be(monkeypatch: pytest.MonkeyPatch) -> None:
    only(monkeypatch, "constrained redesign", "stable inversion")
    pushed = invtrack.advise(mass(limit=4.0), invtrack.Move(1.0, duration=2.0), error=ERROR, fastest=True, timestep=TIMESTEP)
    best = pushed.recommended
    assert best is not None
    assert best.meets
    assert best.peak_input <= 4.0
    # Half the way at full force, the other half against it, takes 2 sqrt(1 m / 4 m/s^2) = 1 s.
    assert 0.9 < best.duration < 1.4
    assert all(trial.duration >= best.duration for trial in pushed.trials if trial.meets)


def test_redesign_is_tried_on_the_motion_where_it_did_best_on_the_linear_model(monkeypatch: pytest.MonkeyPatch) -> None:
    ways_of = {way.name: way for way in ways.WAYS}
    leader = replace(ways_of["quadratic redesign"], lines=ways.WAYS[0].lines, offsets=(-1,))
    chosen = (leader, *(ways_of[name] for name in ("quadratic redesign of the motion", "constrained redesign of the motion")))
    monkeypatch.setitem(invtrack.advise.__globals__, "WAYS", chosen)
    monkeypatch.setitem(invtrack.advise.__globals__, "SHORTER", ())
    plant = invtrack.Plant.from_xml(SWING, inputs=["drive"], outputs=["joint:x"])
    found = invtrack.advise(plant, invtrack.Move(2.0, duration=2.5), error=0.02, timestep=TIMESTEP)
    best = {trial.method: trial for trial in found.best}
    linear, motion = best["quadratic redesign"], best["quadratic redesign of the motion"]
    assert motion.meets
    assert motion.smoothness == linear.smoothness
    departures = [invtrack.max_error(trial.run, wanted="planned_output") for trial in (linear, motion)]
    assert departures[1] < departures[0] / 10
    assert "no limits to keep" in found.excluded["constrained redesign of the motion"]


def test_what_nothing_does_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    only(monkeypatch, "stable inversion", "feedback alone")
    reference = invtrack.rest_to_rest(0.0, 1.0, duration=0.5, smoothness=2)
    found = invtrack.advise(mass(limit=4.0), reference, error=ERROR, timestep=TIMESTEP)
    assert found.recommended is None
    assert found.program == ""
    assert found.reason.startswith(
        "nothing that was tried keeps to an error of at most 1 % of the motion and the limits; nearest comes"
    )
    assert all(trial.smoothness is None and trial.duration == 0.5 for trial in found.trials)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"error": 0.0}, "error, a share of the motion such as 0.01, must lie between 0 and 1"),
        ({"timestep": math.inf}, "timestep must be a positive, finite time"),
        ({"reference": 1.0}, r"reference must be a Move\(by, duration\) or a signal"),
        ({"reference": invtrack.Move([1.0, 2.0], 1.0)}, r"expected a motion of the 1 output\(s\)"),
        ({"parameter_errors": 0.1}, "parameter_errors must be a dict of other linear models by their names"),
        ({"reference": invtrack.rest_to_rest(0.0, 1.0, 1.0), "fastest": True}, "fastest needs a motion whose duration is open"),
        ({"max_preactuation": -1.0}, "max_preactuation"),
        ({"progress": 1}, "progress must be a function"),
        ({"limits": 5.0}, "expected limits such as"),
    ],
)
def test_what_does_not_fit_is_refused(options: dict[str, Any], says: str) -> None:
    arguments = {"reference": invtrack.Move(1.0, 1.0), **options}
    with pytest.raises(InvtrackError, match=says):
        invtrack.advise(mass(), arguments.pop("reference"), **arguments)


@pytest.mark.parametrize(("by", "duration"), [(0.0, 1.0), (np.nan, 1.0), (1.0, 0.0), (1.0, -1.0), ("far", 1.0)])
def test_a_move_that_is_none_is_refused(by: Any, duration: float) -> None:
    with pytest.raises(InvtrackError):
        invtrack.Move(by, duration)
