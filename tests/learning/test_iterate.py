"""Learning from run to run: contraction as theory has it, noise, rehearsals, refusals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import invtrack
from invtrack.errors import LearningError
from invtrack.learning import Learning, iterate
from invtrack.results import Signal

A, B, C = [[0.0, 1.0], [-9.0, -2.0]], [[0.0], [9.0]], [[1.0, 0.0]]
MODEL = invtrack.StateSpace(A, B, C)
REFERENCE = invtrack.rest_to_rest(0.0, 1.0, 3.0, smoothness=4)
SPAN = (-0.5, 8.0)
BAND = 12.0


def plan_for(y_d: invtrack.PiecewiseSignal) -> invtrack.Plan:
    return invtrack.invert(MODEL, y_d)


def driven(gain: float, *, noise: float = 0.0, count: list[int] | None = None) -> Callable[[invtrack.Plan], invtrack.RunResult]:
    """Open loop on a plant whose input acts `gain` times as much as the model says: H = gain at all frequencies."""
    plant = invtrack.LinearPlant(invtrack.StateSpace(A, gain * np.array(B), C))

    def drive(plan: invtrack.Plan) -> invtrack.RunResult:
        if count is not None:
            count.append(1)
        start = plan.states(SPAN[0])[0]
        controller = invtrack.TrackingController(plan)
        span = {"start": SPAN[0], "end": SPAN[1], "timestep": 2e-3}
        run = invtrack.simulate(plant, controller, initial_state=start, **span)  # type: ignore[arg-type]
        if not noise:
            return run
        rng = np.random.default_rng(len(count or []))
        seen = run.output.values[:-1] + noise * rng.standard_normal(run.output.values[:-1].shape)
        return replace(run, measured=Signal(seen, run.output.channels))

    return drive


@pytest.mark.parametrize(("plant", "learned"), [(1.1, 1.0), (0.9, 1.0), (1.1, 0.5)])
def test_the_error_contracts_by_one_less_gain_times_response(plant: float, learned: float) -> None:
    found = iterate(driven(plant), plan_for, REFERENCE, band=BAND, gain=learned, runs=4, window=SPAN)
    assert found.contractions == pytest.approx(abs(1 - learned * plant), rel=2e-3)
    assert found.best.number == 3
    assert found.plan.reference is REFERENCE
    assert found.plan.manoeuvre == REFERENCE.manoeuvre
    assert invtrack.max_error(found.steps[0].run) == pytest.approx(abs(1 - plant), rel=1e-3)


def test_what_a_plan_of_a_nonminimum_phase_plant_has_learned_is_a_plan_like_every_other() -> None:
    model = invtrack.StateSpace([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-6.0, -11.0, -6.0]], [[0.0], [0.0], [1.0]], [[4.0, -2.0, 0.0]])
    other = invtrack.StateSpace([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-6.0, -10.0, -6.0]], model.B, model.C)

    def drive(plan: invtrack.Plan) -> invtrack.RunResult:
        controller = invtrack.TrackingController(plan, invtrack.lqr(model, Q=10.0, R=1.0))
        return invtrack.simulate(invtrack.LinearPlant(other), controller, timestep=5e-3)

    found = iterate(drive, lambda y_d: invtrack.invert(model, y_d), REFERENCE, band=BAND, runs=5, rehearsal=drive)
    assert found.predicted == pytest.approx(found.contractions[: len(found.predicted)])
    assert np.all(found.contractions < 0.2)
    assert found.best.error < 1e-4 * found.steps[0].error
    plan = found.plan
    assert plan.start < plan.manoeuvre[0] < plan.manoeuvre[1] < plan.end
    assert np.max(np.abs(plan(REFERENCE.breakpoints).y - plan(REFERENCE.breakpoints).y_d)) > 1e-3  # not what it delivers by itself


def test_a_case_that_does_not_contract_is_refused_before_anything_is_driven() -> None:
    count: list[int] = []
    with pytest.raises(LearningError, match=r"does not contract: in rehearsal run 1 leaves 1\.\d+ times .* so nothing was driven"):
        iterate(driven(2.5, count=count), plan_for, REFERENCE, band=BAND, rehearsal=driven(2.5))
    assert not count
    with pytest.raises(LearningError, match=r"in rehearsal run 'run' stopped at .* so nothing was driven"):
        iterate(driven(1.1, count=count), plan_for, REFERENCE, band=BAND, rehearsal=lambda plan: _broken(driven(1.1)(plan)))
    assert not count


def test_noise_is_learned_down_to_what_the_band_lets_through() -> None:
    noise, count = 1e-3, [0]
    found = iterate(driven(1.1, noise=noise, count=count), plan_for, REFERENCE, band=BAND, runs=10, window=SPAN)
    pieces, samples = BAND * (SPAN[1] - SPAN[0]) / np.pi, (SPAN[1] - SPAN[0]) / 2e-3
    passed = noise * np.sqrt(pieces / samples)
    assert found.best.error < 2 * passed
    assert invtrack.max_error(found.best.run) < 10 * passed  # of the output itself; in single samples noise is 20 times as large
    assert "of the error of the run before" in found.stopped


def test_it_stops_at_the_target_and_tells_each_step() -> None:
    seen: list[int] = []
    found = iterate(
        driven(1.1), plan_for, REFERENCE, band=BAND, target=1e-3, window=SPAN, progress=lambda step: seen.append(step.number)
    )
    assert found.stopped == f"run {found.best.number} is within the target"
    assert found.best.error <= 1e-3 < found.steps[-2].error
    assert seen == list(range(len(found.steps)))
    assert f"<Learned in {len(seen)} runs: error within the band " in repr(found)


def test_spectra_tell_where_the_error_is() -> None:
    learning = Learning(plan_for, REFERENCE, band=BAND, window=SPAN)
    for _ in range(2):
        learning.add(driven(1.1)(learning.plan))
    omega, amplitudes = learning.spectra()
    assert omega[0] == 0.0 < omega[-1] <= BAND
    assert amplitudes[1] == pytest.approx(0.1 * amplitudes[0], rel=0.05, abs=1e-6)
    assert learning.growing() is None


def _broken(run: invtrack.RunResult) -> invtrack.RunResult:
    return replace(run, status="diverged", message="stopped at t = 1 s: it broke")


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"band": -1.0}, "band must be a positive number"),
        ({"band": BAND, "gain": 2.0}, "gain must lie above 0 and below 2"),
        ({"band": BAND, "runs": 0}, "runs"),
        ({"band": BAND, "target": 0.0}, "target must be a positive error"),
        ({"band": BAND, "rehearsal": 3}, "rehearsal must be a function"),
        ({"band": BAND, "window": (-100.0, 8.0)}, "expected one over the window that is learned"),
    ],
)
def test_malformed_calls_are_refused(options: dict[str, object], says: str) -> None:
    with pytest.raises(LearningError, match=says):
        iterate(driven(1.1), plan_for, REFERENCE, **options)  # type: ignore[arg-type]


def test_runs_that_teach_nothing_are_refused() -> None:
    learning = Learning(plan_for, REFERENCE, band=BAND)
    with pytest.raises(LearningError, match="nothing has been learned yet"):
        _ = learning.best
    run = driven(1.1)(learning.plan)
    with pytest.raises(LearningError, match="there is nothing to learn from a run that diverged"):
        learning.add(_broken(run))
    two = Signal(np.tile(run.output.values, 2), invtrack.Channels(["a", "b"]))
    with pytest.raises(LearningError, match="expected 1 as in the reference"):
        learning.add(replace(run, output=two))
