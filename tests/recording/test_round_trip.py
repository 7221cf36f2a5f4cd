from __future__ import annotations

import dataclasses
from pathlib import Path

import mujoco
import numpy as np
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rerun.chunk import OptimizationProfile, RrdReader

from invtrack.channels import Channels
from invtrack.recording import load_recording, samples, save_recording
from invtrack.results.result import RunResult, Signal
from tests.recording.conftest import Recorded, mechanism_run
from tests.synthetic_runs import diverged, two_mode_run


def test_a_run_comes_back_bit_for_bit(run: RunResult, tmp_path: Path) -> None:
    path = save_recording(run, tmp_path / "new folder" / "run.rrd")
    (loaded,) = load_recording(path).values()
    assert loaded.equals(run)
    assert loaded.events == tuple(run.events)
    assert loaded.state.values.dtype == np.float64
    assert loaded.mjb == run.mjb
    assert sorted(file.name for file in path.parent.iterdir()) == ["run.parquet", "run.rrd"]
    (loaded,) = load_recording(path.with_suffix(".parquet")).values()
    assert loaded.equals(run)


@settings(max_examples=15, deadline=None)
@given(
    values=arrays(np.float64, (4, 3), elements=st.floats(width=64)),
    names=st.lists(st.text(max_size=8), min_size=3, max_size=3, unique=True),
    units=st.lists(st.sampled_from(["m", "m/s", "", "N·m", "[odd] unit"]), min_size=3, max_size=3),
    case=st.text(st.characters(exclude_categories=["Cs", "Cc"]), min_size=1, max_size=12),
)
@example(values=np.zeros((4, 3)), names=["", " ", "  "], units=["m", "m", "m"], case="\\")  # the two that Rerun's own
@example(values=np.zeros((4, 3)), names=["", " ", "  "], units=["m", "m", "m"], case="a\\ %5C")  # escapes do not survive
def test_every_float_and_every_name_survives(
    values: np.ndarray, names: list[str], units: list[str], case: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    def signal(rows: int) -> Signal:
        return Signal(values[:rows].copy(), Channels(names, units))

    sampled = {name: signal(4) for name in ("state", "state_reference", "output", "reference", "planned_output")}
    held = {name: signal(3) for name in ("commanded", "applied", "parameters")}
    time = np.array([-1.0, -1 / 3, 1e-12, 1e3])
    settings_of_run = {
        "manoeuvre": (-1 / 3, 0.1),
        "rest_inputs": np.full((2, 3), np.nan),
        "timestep": 1e-12,
        "evaluate": "stages",
        "integrator": "",
        "vibration_period": 0.1,
    }
    saved = RunResult(name=case, model="", time=time, **sampled, **held, **settings_of_run)  # type: ignore[arg-type]
    loaded = load_recording(save_recording(saved, tmp_path_factory.mktemp("any") / "run.rrd"))[case]
    assert loaded.equals(saved)
    finite = ~np.isnan(values)
    assert np.array_equal(np.signbit(loaded.output.values[finite]), np.signbit(values[finite]))  # equality does not see -0.0


def test_cases_come_back_by_name_in_the_order_they_were_saved(run: RunResult, tmp_path: Path) -> None:
    short = mechanism_run("a shorter one", steps=40)
    silent = dataclasses.replace(run, name="10 % / ünïcode", events=(), mjb=b"", qpos=np.zeros((0, 0)), parameter_bodies={})
    path = save_recording([run, short, silent], tmp_path / "cases.rrd")
    loaded = load_recording(path)
    assert list(loaded) == ["inversion", "a shorter one", "10 % / ünïcode"]
    assert all(loaded[case.name].equals(case) for case in (run, short, silent))


def test_a_plant_without_geometry_and_parameters(run: RunResult, tmp_path: Path) -> None:
    none = Signal(np.zeros((run.time.size - 1, 0)), Channels())
    linear = dataclasses.replace(run, parameters=none, parameter_bodies={}, mjb=b"", qpos=np.zeros((0, 0)))
    path = save_recording(linear, tmp_path / "linear.rrd")
    assert load_recording(path)["inversion"].equals(linear)
    assert not [entity for entity in Recorded(path).batches if "/scene" in entity]


def test_a_run_that_stopped_at_its_first_sample(run: RunResult, tmp_path: Path) -> None:
    def cut(signal: Signal, rows: int) -> Signal:
        return Signal(signal.values[:rows].copy(), signal.channels)

    sampled = {name: cut(getattr(run, name), 1) for name in ("state", "state_reference", "output", "reference", "planned_output")}
    held = {name: cut(getattr(run, name), 0) for name in ("commanded", "applied", "parameters")}
    stopped = dataclasses.replace(run, time=run.time[:1], qpos=run.qpos[:1], status="diverged", **sampled, **held)
    path = save_recording(stopped, tmp_path / "stopped.rrd")
    assert load_recording(path)["inversion"].equals(stopped)


@pytest.mark.parametrize("profile", [None, OptimizationProfile.LIVE, OptimizationProfile.OBJECT_STORE])
def test_a_rearranged_file_holds_the_same_run(run: RunResult, tmp_path: Path, profile: OptimizationProfile | None) -> None:
    path = save_recording(run, tmp_path / "run.rrd")
    rearranged = tmp_path / "rearranged.rrd"
    RrdReader(path).stream().collect(optimize=profile).write_rrd(rearranged, application_id="other", recording_id="other")
    path.with_suffix(".parquet").rename(rearranged.with_suffix(".parquet"))
    assert load_recording(rearranged)["inversion"].equals(run)


def test_rows_stand_on_their_samples(run: RunResult, tmp_path: Path) -> None:
    recorded = Recorded(save_recording(run, tmp_path / "run.rrd"))
    output, force = "/inversion/output/\\[m\\]", "/inversion/applied/\\[N\\]"
    assert recorded.column(output, "step") == list(range(run.time.size))
    seconds = np.array([duration.total_seconds() for duration in recorded.column(output, "time")])
    assert np.abs(seconds - run.time).max() <= 1e-6  # the resolution of datetime.timedelta
    assert recorded.column(force, "step") == list(range(run.time.size - 1))


def test_a_continuous_input_stands_at_mid_step(run: RunResult, tmp_path: Path) -> None:
    recorded = Recorded(save_recording(dataclasses.replace(run, evaluate="stages"), tmp_path / "run.rrd"))
    seconds = np.array([duration.total_seconds() for duration in recorded.column("/inversion/applied/\\[N\\]", "time")])
    assert np.abs(seconds - run.time[:-1] - 0.5 * run.timestep).max() <= 1e-6


def test_every_series_has_a_name_and_a_unit(run: RunResult, tmp_path: Path) -> None:
    recorded = Recorded(save_recording([run, mechanism_run("other", steps=20)], tmp_path / "run.rrd"))
    series = recorded.having("Scalars:scalars")
    assert len(series) > 20
    for path in series:
        (names,) = recorded.column(path, "SeriesLines:names")
        assert len(names) == len(recorded.column(path, "Scalars:scalars")[0])
        assert all(name == "events" or name.endswith("]") for name in names)
    assert recorded.column("/inversion/output/\\[m\\]", "SeriesLines:names") == [["inversion: tip_position [m]"]]


def test_the_error_is_output_minus_reference_and_its_logarithm(run: RunResult, tmp_path: Path) -> None:
    recorded = Recorded(save_recording(run, tmp_path / "run.rrd"))
    error = np.ravel(recorded.column("/inversion/error/\\[m\\]", "Scalars:scalars"))
    assert np.allclose(error + run.reference.values[:, 0], run.output.values[:, 0], rtol=0, atol=1e-15)
    decades = np.ravel(recorded.column("/inversion/log10_error/\\[m\\]", "Scalars:scalars"))
    large = np.abs(error) > 1e-12
    assert np.allclose(10.0 ** decades[large], np.abs(error[large]), rtol=1e-12)
    assert decades.min() > -17  # exact agreement is shown at the level of rounding, not at minus infinity


def test_events_stand_at_their_times(run: RunResult, tmp_path: Path) -> None:
    recorded = Recorded(save_recording(run, tmp_path / "run.rrd"))
    texts = [text for (text,) in recorded.column("/inversion/events", "TextLog:text")]
    seconds = [duration.total_seconds() for duration in recorded.column("/inversion/events", "time")]
    assert [event.text in text for event, text in zip(run.events, texts, strict=True)] == [True] * 3
    assert seconds == pytest.approx([0.0, 0.3, 0.8], abs=1e-6)
    steps = recorded.column("/inversion/events", "step")
    assert run.time[steps] == pytest.approx(seconds, abs=0.5 * run.timestep)


def test_metrics_and_the_reasons_of_those_that_are_not_defined_stand_beside_the_run(run: RunResult, tmp_path: Path) -> None:
    recorded = Recorded(save_recording(run, tmp_path / "run.rrd"))
    ((text,),) = recorded.column("/inversion/metrics", "TextDocument:text")
    assert "| peak input | 0.5 N |" in text  # the clipped sine
    assert "| residual vibration | - |" in text
    assert "residual vibration: run 'inversion' ends at t = " in text
    assert "- the run ends at t = 0.8 s" in text


def test_every_view_shows_entities_that_exist(run: RunResult, tmp_path: Path) -> None:
    path = save_recording([run, mechanism_run("other one", steps=20)], tmp_path / "run.rrd")
    layout, recorded = Recorded(path, blueprint=True), Recorded(path)
    queries = [query for view in layout.having("ViewContents:query") for query in layout.column(view, "ViewContents:query")[0]]
    assert "/other\\ one/output/\\[m\\]" in queries
    assert {query for query in queries if query != "$origin/**"} <= set(recorded.batches)


def test_cases_of_one_application_share_a_layout_in_which_each_has_the_same_place(run: RunResult, tmp_path: Path) -> None:
    linear = dataclasses.replace(mechanism_run("linear", steps=20), mjb=b"", qpos=np.zeros((0, 0)), parameter_bodies={})
    estimated = dataclasses.replace(run, name="estimated", estimate=run.commanded, measured=run.commanded)
    queries = []
    for case in (run, linear, estimated):
        path = save_recording(case, tmp_path / f"{case.name}.rrd", application="study")
        assert load_recording(path)[case.name].equals(case)
        assert {store.application_id for store in (*RrdReader(path).recordings(), *RrdReader(path).blueprints())} == {
            "invtrack study"
        }
        layout = Recorded(path, blueprint=True)
        queries.append({q for view in layout.having("ViewContents:query") for q in layout.column(view, "ViewContents:query")[0]})
        assert {"/case/output/\\[m\\]", "/case/planned_output/\\[m\\]"} <= queries[-1]
        assert {"/case/output/\\[m\\]", "/case/error/\\[m\\]"} <= set(Recorded(path).batches)
    assert queries[0] == queries[2]  # the last one opened decides, so that it must do for all


def test_cases_of_different_lengths_and_channels_share_one_file_of_several_row_groups(
    run: RunResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(samples, "GROUP", 100)  # the last group of a case is full, begun, or one sample
    observed = dataclasses.replace(run, name="observed", measured=run.applied, estimate=run.commanded)
    cases = [observed, *(mechanism_run(f"{steps} steps", steps=steps) for steps in (99, 100, 42)), two_mode_run()]
    path = save_recording(cases, tmp_path / "cases.rrd")
    loaded = load_recording(path)
    assert [loaded[case.name].equals(case) for case in cases] == [True] * 5
    assert sorted(file.name for file in tmp_path.iterdir()) == ["cases.parquet", "cases.rrd"]


def test_other_programs_read_the_table(run: RunResult, tmp_path: Path) -> None:
    path = save_recording([run, mechanism_run("other", steps=20)], tmp_path / "run.rrd").with_suffix(".parquet")
    table = pq.read_table(path)
    ours = table.filter(pc.equal(table["case"], "inversion"))
    assert table.column_names[:3] == ["case", "time [s]", "state slide [m]"]
    assert np.array_equal(ours["time [s]"].to_numpy(), run.time)
    assert np.array_equal(ours["output tip_position [m]"].to_numpy(), run.output["tip_position"])
    assert np.array_equal(ours["qpos 1"].to_numpy(), run.qpos[:, 1])
    held = ours["applied base_force [N]"]
    assert held.null_count == 1  # after the last step
    assert np.array_equal(held.drop_null().to_numpy(), run.applied["base_force"])
    assert ours["state_reference hinge [rad]"].null_count == 0  # a NaN is a value
    assert {run.name, "other"} == set(table["case"].to_pylist())


def test_channels_whose_labels_agree_are_kept_apart(run: RunResult, tmp_path: Path) -> None:
    alike = Channels(("a [m]", "a", "a [m] [m]"), ("m] [m", "m] [m] [m", ""))
    values = np.arange(3.0 * len(run.time)).reshape(-1, 3)
    case = dataclasses.replace(run, output=Signal(values, alike), reference=Signal(-values, alike))
    assert load_recording(save_recording(case, tmp_path / "run.rrd"))["inversion"].equals(case)


def test_the_bits_of_a_nan_and_the_sign_of_zero_survive(run: RunResult, tmp_path: Path) -> None:
    odd = np.array([0x7FF8000000000123, 0xFFF8000000000001, 0x7FF0000000000000, 0x8000000000000000, 1], dtype=np.uint64)
    values = run.output.values.copy()
    values[:5, 0] = odd.view(np.float64)
    case = dataclasses.replace(run, output=Signal(values, run.output.channels))
    loaded = load_recording(save_recording(case, tmp_path / "run.rrd"))["inversion"].output.values
    assert np.array_equal(loaded.view(np.uint64), values.view(np.uint64))


def test_a_run_that_diverged_comes_back_with_its_last_samples(tmp_path: Path) -> None:
    run = diverged(two_mode_run(), at=5.0)
    path = save_recording(run, tmp_path / "run.rrd")
    assert load_recording(path)["exact"].equals(run)
    assert np.isinf(load_recording(path)["exact"].output.values[-1, 0])


def test_a_free_body_keeps_its_quaternions(tmp_path: Path) -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body name="drone"><freejoint/><geom type="box" size="0.3 0.2 0.1"/></body></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    data.qvel[:] = 1.0, -2.0, 3.0, 0.5, 4.0, -1.0
    qpos = np.empty((301, 7))
    for step in range(301):
        qpos[step] = data.qpos
        mujoco.mj_step(model, data)
    binary = np.zeros(mujoco.mj_sizeModel(model), dtype=np.uint8)
    mujoco.mj_saveModel(model, None, binary)
    run = dataclasses.replace(mechanism_run(), qpos=qpos, mjb=binary.tobytes(), parameter_bodies={})
    path = save_recording(run, tmp_path / "run.rrd")
    assert load_recording(path)["inversion"].equals(run)
    recorded = Recorded(path)
    shown = np.array(recorded.column("/inversion/scene/bodies/drone", "Transform3D:quaternion"))[:, 0]
    at = recorded.column("/inversion/scene/bodies/drone", "step")
    unit = qpos[at, 3:] / np.linalg.norm(qpos[at, 3:], axis=1, keepdims=True)
    assert np.allclose(shown, unit[:, [1, 2, 3, 0]], atol=1e-6)
