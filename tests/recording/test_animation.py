"""Moving pictures: faces that close around their geoms, what is in front hides what is behind, and one picture for each instant."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import mujoco
import numpy as np
import pytest
from PIL import Image

from invtrack.errors import FileError, RecordingError
from invtrack.recording import save_animation
from invtrack.recording.camera import FIELD_OF_VIEW, Camera
from invtrack.recording.painter import FINER, SKY, Painter
from invtrack.recording.solids import normals, solid
from invtrack.results.interval import shown_interval
from invtrack.results.result import RunResult

GEOMS = {
    "box": ('type="box" size="0.3 0.2 0.1"', 8 * 0.3 * 0.2 * 0.1),
    "cylinder": ('type="cylinder" size="0.2 0.5"', np.pi * 0.2**2 * 1.0),
    "sphere": ('type="sphere" size="0.4"', 4 / 3 * np.pi * 0.4**3),
    "ellipsoid": ('type="ellipsoid" size="0.3 0.2 0.5"', 4 / 3 * np.pi * 0.3 * 0.2 * 0.5),
    "capsule": ('type="capsule" size="0.2 0.3"', np.pi * 0.2**2 * 0.6 + 4 / 3 * np.pi * 0.2**3),
    "mesh": ('type="mesh" mesh="wedge"', 0.5 * 0.4 * 0.3 * 0.2),
}

WEDGE = """<asset><mesh name="wedge" vertex="0 0 0  0.4 0 0  0 0.3 0  0 0 0.2  0.4 0 0.2  0 0.3 0.2"/></asset>"""


def model_with(geoms: str) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(f"<mujoco>{WEDGE}<worldbody>{geoms}</worldbody></mujoco>")


@pytest.mark.parametrize("kind", GEOMS)
def test_faces_close_around_the_volume_of_the_geom(kind: str) -> None:
    attributes, volume = GEOMS[kind]
    corners, faces = solid(model_with(f"<geom {attributes}/>"), 0, unlimited=1.0)
    edges = [(int(face[i]), int(face[(i + 1) % len(face)])) for face in faces for i in range(len(face))]
    assert len(set(edges)) == len(edges)
    assert {(end, start) for start, end in edges} == set(edges)  # every edge once in either direction: closed
    # Divergence theorem, on triangles; flat faces stay a little inside of round geoms.
    found = sum(
        np.dot(corners[face[0]], np.cross(corners[face[i]], corners[face[i + 1]])) / 6
        for face in faces
        for i in range(1, len(face) - 1)
    )
    assert 0.9 * volume < found <= volume * (1 + 1e-5)
    assert np.linalg.norm(normals(corners, faces), axis=1) == pytest.approx(1.0)


def test_what_is_in_front_hides_what_is_behind_and_stands_where_a_pinhole_camera_sees_it() -> None:
    model = model_with(
        '<geom type="sphere" size="0.5" pos="0 2 0" rgba="0 0 1 1"/><geom type="sphere" size="0.3" pos="0 0 0" rgba="1 0 0 1"/>'
        '<geom type="sphere" size="0.2" pos="1 0 0" rgba="0 1 0 1"/>'
    )
    painter = Painter(model, Camera(np.array([0.0, -4.0, 0.0]), np.zeros(3), np.array([0.0, 0.0, 1.0])), (200, 160))
    picture = painter.picture(np.zeros((1, 3)), np.array([[0.0, 0.0, 0.0, 1.0]]))
    assert picture.size == (200 * FINER, 160 * FINER)
    middle, scale = np.array([100, 80]) * FINER, 80 * FINER / np.tan(FIELD_OF_VIEW / 2)
    beside = np.array([int(scale / 4), 0])
    red, green, blue = (np.array(picture.getpixel(tuple(place))) for place in (middle, middle + beside, [2, 2]))
    assert np.argmax(red) == 0
    assert red[2] == 0
    assert np.argmax(green) == 1
    assert tuple(blue) == SKY
    pixels = np.asarray(picture)
    columns = np.flatnonzero(np.any((pixels[..., 1] > 60) & (pixels[..., 0] == 0), axis=0))  # of the green sphere
    half_angle = np.arcsin(0.2 / np.hypot(1.0, 4.0))
    edges = [middle[0] + scale * np.tan(np.arctan(0.25) + side * half_angle) for side in (-1, 1)]
    assert [columns[0], columns[-1]] == pytest.approx(edges, abs=3)


@pytest.mark.parametrize("ending", [".webp", ".gif"])
def test_there_is_a_picture_for_each_instant_of_each_run(run: RunResult, tmp_path: Path, ending: str) -> None:
    runs = [run, dataclasses.replace(run, name="again")]
    path = save_animation(runs, tmp_path / "new" / f"motion{ending}", rate=10.0, width=200, height=160)
    begin, end = shown_interval([run])
    with Image.open(path) as picture:
        assert getattr(picture, "n_frames", 1) == len(np.arange(begin, end, 0.1))
        assert picture.size == (2 * 200 + 4, 160)
        assert picture.info["loop"] == 0
        first = np.asarray(picture.convert("RGB"), dtype=int)
        picture.seek(picture.n_frames - 1)  # type: ignore[attr-defined]
        last = np.asarray(picture.convert("RGB"), dtype=int)
    assert np.count_nonzero(np.any(np.abs(first - last) > 40, axis=2)) > 100  # it moves
    left, right = last[40:130, :200], last[40:130, 204:]
    assert np.mean(np.abs(left - right)) < 4.0  # the same run twice
    assert [each.name for each in path.parent.iterdir()] == [path.name]


def test_what_cannot_be_drawn_is_refused(run: RunResult, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="at least one run to draw"):
        save_animation([], tmp_path / "motion.webp")
    with pytest.raises(RecordingError, match=r"a path that ends in \.webp or \.gif"):
        save_animation(run, tmp_path / "motion.mp4")
    with pytest.raises(RecordingError, match="'inversion' has no MuJoCo model with finite positions"):
        save_animation(dataclasses.replace(run, mjb=b""), tmp_path / "motion.webp")
    with pytest.raises(RecordingError, match="up to 50 pictures per second, got 100"):
        save_animation(run, tmp_path / "motion.webp", rate=100.0)
    with pytest.raises(RecordingError, match="height"):
        save_animation(run, tmp_path / "motion.webp", height=10)
    (tmp_path / "file").touch()
    with pytest.raises((FileError, OSError)):
        save_animation(run, tmp_path / "file" / "motion.webp", rate=2.0, width=160, height=160)
