"""The claim of the parameter-jump paper in MuJoCo: exact tracking through both jumps, from rest."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

import invtrack
from invtrack.control.protocol import AffineLaw, Instants
from invtrack.testing import RunAssertionError, RunCache, assert_residual_vibration, assert_tracks
from tests.simulation.rigs import JUMPS, MASSES, Rig, cantilever_rig

STEP = 1e-3


@pytest.fixture(scope="module")
def rig() -> Rig:
    return cantilever_rig()


@pytest.fixture(scope="module")
def run(rig: Rig, invtrack_run: RunCache) -> invtrack.RunResult:
    return invtrack_run(rig.plant, rig.controller, timestep=STEP, name="inversion")


def short_run(rig: Rig, controller: invtrack.TrackingController | None = None, **options: object) -> invtrack.RunResult:
    """From the plan's state a little before the manoeuvre: what is looked at happens around the jumps."""
    start = -2.0
    settings: dict[str, object] = {"timestep": 4e-3, "start": start, "end": 8.0, **options}
    return invtrack.simulate(rig.plant, controller or rig.controller, initial_state=rig.plan(start).x[0], **settings)  # type: ignore[arg-type]


def test_from_rest_the_tip_follows_through_both_jumps(run: invtrack.RunResult) -> None:
    assert run.status == "completed"
    assert not np.any(run.state.values[0])
    assert np.ptp(run.reference.values) == pytest.approx(2.0)
    assert_tracks(run, within=1e-6)


def test_residual_vibration_against_an_inverse_that_ignores_the_jumps(rig: Rig, run: invtrack.RunResult) -> None:
    assert_residual_vibration(run, at_most=2e-6)
    frozen = invtrack.invert(rig.model.systems[0], rig.reference)
    frozen_run = invtrack.simulate(
        rig.plant,
        invtrack.TrackingController(frozen, rig.gains),
        schedule=[invtrack.Change(t, **values) for t, values in rig.plan.schedule],
        timestep=4e-3,
        name="frozen_inversion",
    )
    assert invtrack.residual_vibration(frozen_run) > 1e5 * invtrack.residual_vibration(run)


def test_with_another_payload_and_no_feedback_the_mode_of_the_loaded_mechanism_rings(rig: Rig, invtrack_run: RunCache) -> None:
    settings = {"timestep": 4e-3, "start": -2.0, "end": 40.0, "initial_state": rig.plan(-2.0).x[0]}
    off = invtrack_run(rig.plant, invtrack.TrackingController(rig.plan), factors={"tip_mass": 1.05}, **settings)
    assert set(off.parameters["tip_mass"]) == {0.0, 105.0, 10.5}
    with pytest.raises(RunAssertionError, match="tip_position vibrates on after the manoeuvre") as failure:
        assert_residual_vibration(off, at_most=1e-3, duration=30.0)
    rings = failure.value.oscillation
    assert rings is not None
    modes = np.linalg.eigvals(invtrack.linearize(rig.plant, tip_mass=10.5).A).imag
    assert np.min(np.abs(2 * np.pi * rings.frequency / modes[modes > 0.1] - 1)) < 1e-3
    assert rings.damping == pytest.approx(0.0, abs=1e-3)


def test_the_feedback_has_nothing_to_do(rig: Rig, run: invtrack.RunResult) -> None:
    feedforward = rig.plan(run.time[:-1] + np.diff(run.time) / 2).u
    effort = run.commanded.values - feedforward
    assert np.max(np.abs(effort)) <= 1e-6 * np.max(np.abs(feedforward))
    assert invtrack.results.peak_input(run) == pytest.approx(268, abs=1)


def test_continuous_hold_is_exact_to_what_the_preactuation_leaves(rig: Rig) -> None:
    result = invtrack.simulate(rig.plant, rig.controller, timestep=4e-3, evaluate="stages")
    assert invtrack.max_error(result) <= 1e-9


@pytest.mark.parametrize(("evaluate", "steps", "order"), [("held", (8e-3, 4e-3, 2e-3), 2), ("stages", (0.16, 0.08, 0.04), 4)])
def test_order_of_the_error_in_the_step(rig: Rig, evaluate: str, steps: tuple[float, ...], order: int) -> None:
    errors = [invtrack.max_error(short_run(rig, evaluate=evaluate, timestep=step)) for step in steps]
    slopes = np.diff(np.log(errors)) / np.diff(np.log(steps))
    np.testing.assert_allclose(slopes, order, atol=0.25)


def test_recorded_input_replayed_gives_the_recorded_states_bitwise(rig: Rig) -> None:
    result = short_run(rig)
    model = rig.plant.model_with({"tip_mass": MASSES[0]})
    data = rig.plant.new_data(model)
    data.qpos[:] = result.qpos[0]
    data.qvel[:] = result.state.values[0, 3:]
    masses = result.parameters["tip_mass"]
    edges = np.union1d([result.time[0], 0.0, *JUMPS, 2 * np.pi], [result.time[-1]])
    for i, u in enumerate(result.applied.values):
        if i and masses[i] != masses[i - 1]:
            rig.plant.apply(model, {"tip_mass": masses[i]})
        k = np.searchsorted(edges, result.time[i] + 1e-6) - 1
        model.opt.timestep = (edges[k + 1] - edges[k]) / np.ceil((edges[k + 1] - edges[k]) / 4e-3 * (1 - 1e-9))
        data.ctrl[:] = u
        mujoco.mj_step(model, data)
        assert np.array_equal(data.qpos, result.qpos[i + 1])
        assert np.array_equal(data.qvel, result.state.values[i + 1, 3:])


def test_jumps_are_recorded_as_events_and_parameters(run: invtrack.RunResult) -> None:
    changes = [event for event in run.events if event.kind == "parameter"]
    assert [event.time for event in changes] == list(JUMPS)
    assert [event.text for event in changes] == ["tip_mass = 100 kg", "tip_mass = 10 kg"]
    before, after = (run.parameters["tip_mass"][run.time[:-1] < JUMPS[0]], run.parameters["tip_mass"][run.time[:-1] >= JUMPS[0]])
    assert np.all(before == 0)
    assert after[0] == 100


class LateController(invtrack.TrackingController):
    """Mutant: everything one step late."""

    def begin(self, instants: Instants) -> AffineLaw:
        law = super().begin(instants)
        late = np.maximum(np.arange(len(law.offset)) - 1, 0)
        return AffineLaw(law.offset[late], self.gains.gains, self.gains.interval(instants.inside)[late])


class WrongSideController(invtrack.TrackingController):
    """Mutant: gains and plan are taken from the interval before the one that an instant belongs to."""

    def begin(self, instants: Instants) -> AffineLaw:
        edges = self.breakpoints

        def earlier(inside: np.ndarray) -> np.ndarray:
            piece = np.searchsorted(edges, inside)
            return np.where(piece > 0, edges[np.maximum(piece - 1, 0)] - 1e-3, inside)

        wrong = replace(instants, inside=earlier(instants.inside), part_inside=earlier(instants.part_inside), planned=None)
        return super().begin(wrong)


def test_mutants_of_the_controller_break_the_tracking(rig: Rig) -> None:
    good = invtrack.max_error(short_run(rig))
    wrong_sign = invtrack.GainSchedule(tuple(-gain for gain in rig.gains.gains), rig.gains.switch_times)
    for mutant in (
        invtrack.TrackingController(rig.plan, wrong_sign),
        LateController(rig.plan, rig.gains),
        WrongSideController(rig.plan, rig.gains),
    ):
        result = short_run(rig, mutant)
        assert result.status == "diverged" or invtrack.max_error(result) > 20 * good


def test_masses_off_and_jumps_late_are_seen(rig: Rig) -> None:
    good = invtrack.max_error(short_run(rig))
    off = [invtrack.Change(JUMPS[0], tip_mass=105.0), invtrack.Change(JUMPS[1], tip_mass=10.5)]
    late = [invtrack.Change(t + 0.05, tip_mass=m) for t, m in zip(JUMPS, MASSES[1:], strict=True)]
    for schedule in (off, late):
        assert invtrack.max_error(short_run(rig, schedule=schedule)) > 100 * good
