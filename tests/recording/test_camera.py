"""From where the scene is looked at: what moves is in the picture, across it and upright, or a camera of the model decides."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import mujoco
import numpy as np
import pytest

from invtrack.errors import RecordingError
from invtrack.recording import save_recording
from invtrack.recording.camera import FIELD_OF_VIEW, Camera, camera_of
from invtrack.recording.components import component_names
from invtrack.recording.scene import make_scene
from invtrack.results.interval import shown_interval
from invtrack.results.result import RunResult
from tests.recording.conftest import Recorded, mechanism_run

MJCF = """
<mujoco>
  <option gravity="{gravity}"/>
  <worldbody>
    {cameras}
    <body name="ball">
      <joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint type="slide" axis="0 0 1"/>
      <geom size="0.05"/><camera name="riding" pos="0 -1 0" xyaxes="1 0 0 0 0 1"/>
    </body>
  </worldbody>
</mujoco>
"""

FIXED = '<camera name="aside" pos="0 -4 1" xyaxes="1 0 0 0 0 1" fovy="30"/><camera name="above" pos="0 0 5" fovy="55"/>'


def moving(path: np.ndarray, *, cameras: str = "", gravity: str = "0 0 -9.81") -> RunResult:
    """A ball that follows a path (601, 3) [m]."""
    model = mujoco.MjModel.from_xml_string(MJCF.format(cameras=cameras, gravity=gravity))
    binary = np.zeros(mujoco.mj_sizeModel(model), dtype=np.uint8)
    mujoco.mj_saveModel(model, None, binary)
    return dataclasses.replace(mechanism_run(steps=600), qpos=path, mjb=binary.tobytes(), parameter_bodies={}, manoeuvre=(0.0, 1.2))


def line(*way: float) -> np.ndarray:
    return np.linspace(0.0, 1.0, 601)[:, np.newaxis] * way


def camera(run: RunResult, name: str | None = None) -> Camera:
    interval = shown_interval([run])
    found = camera_of([run], [make_scene(run, interval)], interval, name)
    assert found is not None
    return found


def in_picture(at: Camera, points: np.ndarray) -> np.ndarray:
    """Where points (k, 3) are in the picture (k, 2), right and up, 1 at the edge of a square one."""
    forward = at.target - at.position
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, at.up)
    right /= np.linalg.norm(right)
    rays = points - at.position
    scale = np.tan(FIELD_OF_VIEW / 2) * (rays @ forward)
    return np.column_stack([rays @ right, rays @ np.cross(right, forward)]) / scale[:, np.newaxis]


@pytest.mark.parametrize("way", [(3.0, 0.0, 0.0), (-3.0, 0.0, 0.0), (0.0, 40.0, 10.0), (1.0, -1.0, 0.2), (0.0, 0.0, 0.01)])
def test_the_motion_goes_from_left_to_right_and_fills_the_picture(way: tuple[float, float, float]) -> None:
    run = moving(line(*way))
    shown = in_picture(camera(run), run.qpos)
    assert np.all(np.abs(shown) < 1.0)
    assert shown[-1, 0] >= shown[0, 0]
    level, height = np.hypot(*way[:2]), way[2]
    if level > 1.0:
        assert shown[-1, 0] - shown[0, 0] > 1.0
        assert (shown[-1, 1] - shown[0, 1]) / (shown[-1, 0] - shown[0, 0]) == pytest.approx(height / level, abs=0.1)


def test_the_view_is_along_the_direction_of_least_motion_and_steeper_where_the_motion_is_flat() -> None:
    turn = np.linspace(0.0, 2 * np.pi, 601)
    rest = np.zeros(601)
    upright = camera(moving(np.column_stack([np.cos(turn), rest, np.sin(turn)])))
    flat = camera(moving(np.column_stack([np.cos(turn), np.sin(turn), rest])))
    steepness = [(at.position - at.target)[2] / np.linalg.norm(at.position - at.target) for at in (upright, flat)]
    assert steepness[0] < 0.25 < 0.6 < steepness[1]
    across = upright.target - upright.position
    assert abs(across[0]) < 1e-6 * abs(across[1])


def test_down_is_where_gravity_points() -> None:
    at = camera(moving(line(1.0, 0.0, 0.0), gravity="0 9.81 0"))
    assert at.up == pytest.approx([0.0, -1.0, 0.0])
    assert camera(moving(line(1.0, 0.0, 0.0), gravity="0 0 0")).up == pytest.approx([0.0, 0.0, 1.0])


def test_a_fixed_camera_of_the_model_shows_as_much_as_it_says() -> None:
    run = moving(line(2.0, 0.0, 0.0), cameras=FIXED)
    at = camera(run)
    assert at.up == pytest.approx([0.0, 0.0, 1.0])
    assert at.target == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)
    # Half the height of what it shows where the ball moves, 4 m ahead.
    assert in_picture(at, np.array([[0.0, 0.0, 1.0 + 4.0 * np.tan(np.radians(15.0))]]))[0, 1] == pytest.approx(1.0)
    above = camera(run, "above")
    assert above.position == pytest.approx([0.0, 0.0, 5.0], abs=1e-9)
    assert above.target == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)


def test_a_moving_camera_is_taken_when_it_is_named() -> None:
    run = moving(line(2.0, 0.0, 0.0))
    start = run.qpos[np.searchsorted(run.time, shown_interval([run])[0])]
    at = camera(run, "riding")
    assert at.target == pytest.approx(start, abs=0.02)
    assert camera(run).position != pytest.approx(at.position, abs=0.1)


def test_a_camera_that_is_not_there_is_refused(tmp_path: Path) -> None:
    run = moving(line(2.0, 0.0, 0.0), cameras=FIXED)
    with pytest.raises(RecordingError, match="no camera 'front'; it has: 'aside', 'above', 'riding'"):
        save_recording(run, tmp_path / "run.rrd", camera="front")
    with pytest.raises(RecordingError, match="camera 'front' was asked for, but no run carries a model"):
        save_recording(dataclasses.replace(run, mjb=b""), tmp_path / "run.rrd", camera="front")


def test_all_cases_of_a_recording_are_seen_from_the_same_place(tmp_path: Path) -> None:
    one, two = moving(line(1.0, 0.0, 0.0)), dataclasses.replace(moving(line(4.0, 0.0, 0.0)), name="far")
    blueprint = Recorded(save_recording([one, two], tmp_path / "both.rrd"), blueprint=True)
    eyes = [path for path in blueprint.batches if path.endswith("EyeControls3D")]
    assert len(eyes) == 2
    places = [np.array(blueprint.column(path, "EyeControls3D:position")).ravel() for path in eyes]
    assert places[0] == pytest.approx(places[1])
    assert places[0][0] > 1.0  # in the middle of both


def test_components_of_vectors_and_rotations_have_names() -> None:
    model = mujoco.MjModel.from_xml_string("""
        <mujoco><worldbody><body name="box"><freejoint/><geom size="0.1"/><site name="imu"/></body></worldbody>
        <sensor><gyro name="gyro" site="imu"/><framequat name="turn" objtype="body" objname="box"/><user name="own" dim="3"/>
        <touch name="touch" site="imu"/></sensor></mujoco>""")
    assert component_names(model) == {
        **{f"gyro[{i}]": f"gyro.{axis}" for i, axis in enumerate("xyz")},
        **{f"turn[{i}]": f"turn.{axis}" for i, axis in enumerate("wxyz")},
    }
