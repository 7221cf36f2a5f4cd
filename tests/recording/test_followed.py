"""Points whose coordinates are outputs: where they go and should go, and where the viewer starts to show it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import invtrack
from invtrack.recording import save_recording
from invtrack.recording.followed import followed_points
from invtrack.recording.scene import make_scene
from invtrack.results.interval import shown_interval
from tests.recording.conftest import Recorded

OUTPUTS = ["site:centre:x", "site:centre:z"]


@pytest.fixture(scope="module")
def flown() -> invtrack.RunResult:
    """A vehicle flown aside by its linear inverse, which loses height; it rests for a long time before."""
    plant = invtrack.Plant.from_xml(invtrack.model_path("vtol"), inputs=["thrust", "turn"], outputs=OUTPUTS, keyframe="hover")
    aside, up = (invtrack.rest_to_rest(0.0, way, duration=2.0) for way in (3.0, 0.0))
    model = invtrack.linearize(plant)
    plan = invtrack.invert(model, invtrack.references.stack([aside, up]))
    controller = invtrack.TrackingController(plan, invtrack.lqr(model, Q=1.0, R=1.0))
    return invtrack.simulate(plant, controller, timestep=5e-3, start=-20.0, end=4.0)


def test_the_point_is_where_the_outputs_say_and_is_wanted_where_the_reference_says(flown: invtrack.RunResult) -> None:
    scene = make_scene(flown, shown_interval([flown]))
    assert scene is not None
    (point,) = followed_points(flown, scene)
    assert point.name == "site:centre"
    assert point.actual[:, [0, 2]] == pytest.approx(flown.output.values[scene.frames], abs=1e-12)
    assert np.array_equal(point.wanted[:, [0, 2]], flown.reference.values[scene.frames])
    assert np.array_equal(point.wanted[:, 1], point.actual[:, 1])
    assert np.max(np.abs(point.wanted - point.actual)) > 0.1


def test_paths_and_ghost_are_in_the_recording_and_the_viewer_starts_with_the_motion(
    flown: invtrack.RunResult, tmp_path: Path
) -> None:
    recorded = Recorded(save_recording(flown, tmp_path / "run.rrd"))
    root = "/run/scene/followed/site\\:centre"
    assert {f"{root}/path", f"{root}/wanted", f"{root}/ghost"} <= set(recorded.batches)
    begin, _ = shown_interval([flown])
    assert flown.time[0] < begin - 5.0  # a rest that nobody wants to wait for
    for path in (f"{root}/ghost", "/run/output/\\[m\\]", "/run/applied/\\[N\\]"):
        whole, shown = ([time.total_seconds() for time in recorded.column(path, name) if time] for name in ("time", "manoeuvre"))
        assert whole[0] == pytest.approx(flown.time[0], abs=1.0)
        assert shown[0] >= begin - 1e-6
        assert shown[0] == pytest.approx(begin, abs=0.1)
        assert len(shown) < len(whole)
        assert shown[1:] == whole[-len(shown) + 1 :]
