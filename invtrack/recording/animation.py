"""Runs as a small moving picture, side by side: for a page that is read before anything is installed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from invtrack.arguments import file_path, items, require_text
from invtrack.arrays import finite_number, shown, whole_number
from invtrack.errors import RecordingError
from invtrack.files import replaced_when_complete
from invtrack.recording.camera import camera_of
from invtrack.recording.followed import FollowedPoint, followed_points
from invtrack.recording.painter import Color, Painter
from invtrack.recording.scene import Scene, make_scene
from invtrack.recording.series import tracking_error
from invtrack.results.interval import shown_interval
from invtrack.results.result import RunResult, require_run

FORMATS = {".webp": "WEBP", ".gif": "GIF"}
LONGEST = 8.0  # [s] that it takes at the most: longer intervals are played faster
INK: Color = (40, 46, 54)
WANTED: Color = (150, 158, 168)
GOAL: Color = (0, 158, 115)
PATHS: tuple[Color, ...] = ((0, 114, 178), (213, 94, 0), (204, 121, 167), (230, 159, 0))
TEXT, MARGIN = 15, 10  # pixels: height of letters, space around text
SMALLEST, LARGEST = 160, 4096  # pixels, of a side of a run's picture
GAP = 4  # pixels between the pictures of two runs
RING = 6.5  # pixels: radius of the circle around the wanted point


def save_animation(
    results: RunResult | Sequence[RunResult],
    path: str | Path,
    *,
    rate: float = 15.0,
    width: int = 400,
    height: int = 300,
    camera: str | None = None,
) -> Path:
    """Write a moving picture of runs side by side, which repeats for ever, and return its path.

    Of each run: the mechanism; the paths of points whose coordinates are outputs, wanted pale and actual coloured, with a ring
    around where the point is wanted; the run's name, the time, and the largest |y - y_d| of the outputs of the first unit. It shows
    what recordings open with, at the mechanism's own pace or, longer than 8 s, faster, from where recordings look. Geoms are
    painted from back to front as flat faces, without a graphics library or a display.

    Args:
        results: the runs, with MuJoCo models.
        path: of the file, which ends in .webp or .gif.
        rate: pictures per second, up to 50.
        width, height: of each run's picture [pixels], from 160 to 4096.
        camera: name of a camera of the model, as for `save_recording`.

    Raises RecordingError where there is no run, a run has no MuJoCo model or no finite positions, no camera has the name, the path
    has another ending, or numbers are out of range; FileError where the file cannot be written.
    """
    runs = [results] if isinstance(results, RunResult) else items("results", results, expected="runs", error=RecordingError)
    if not runs:
        raise RecordingError("expected at least one run to draw, got none")
    for run in runs:
        require_run(run)
    if not 0 < finite_number("rate", rate, unit="1/s", error=RecordingError) <= 50:
        raise RecordingError(f"expected a rate of more than 0 and up to 50 pictures per second, got {shown(rate)}")
    size = (
        whole_number("width", width, lowest=SMALLEST, highest=LARGEST, error=RecordingError),
        whole_number("height", height, lowest=SMALLEST, highest=LARGEST, error=RecordingError),
    )
    if camera is not None:
        require_text("camera", camera, error=RecordingError)
    target = file_path(path)
    if target.suffix.lower() not in FORMATS:
        raise RecordingError(f"expected a path that ends in {' or '.join(FORMATS)}, got {target}")
    interval = shown_interval(runs)
    scenes = [_scene_of(run, interval) for run in runs]
    looked_at = camera_of(runs, scenes, interval, camera, aspect=width / height)
    assert looked_at is not None
    drawn = [
        _Drawn(run, scene, Painter(scene.model, looked_at, size), PATHS[number % len(PATHS)])
        for number, (run, scene) in enumerate(zip(runs, scenes, strict=True))
    ]
    speed = max(1.0, (interval[1] - interval[0]) / LONGEST)
    times = np.arange(interval[0], interval[1], speed / rate)
    pictures = [_beside([each.picture(time) for each in drawn]) for time in times]
    with replaced_when_complete(target) as draft:
        target.parent.mkdir(parents=True, exist_ok=True)
        options = {"quality": 80, "method": 4} if target.suffix.lower() == ".webp" else {"optimize": True}
        pictures[0].save(
            draft,
            format=FORMATS[target.suffix.lower()],
            save_all=True,
            append_images=pictures[1:],
            duration=round(1000 / rate),
            loop=0,
            **options,
        )
    return target


class _Drawn:
    """One run, picture by picture."""

    def __init__(self, run: RunResult, scene: Scene, painter: Painter, color: Color) -> None:
        self.run, self.scene, self.painter, self.color = run, scene, painter, color
        self.times = run.time[scene.frames]
        self.points: list[FollowedPoint] = followed_points(run, scene)
        units = run.output.channels.units
        self.unit = units[0]
        self.errors = np.max(np.abs(tracking_error(run)[:, [unit == self.unit for unit in units]]), axis=1)

    def picture(self, time: float) -> Image.Image:
        """The run at a time [s]."""
        frame = int(np.clip(np.searchsorted(self.times, time), 0, len(self.times) - 1))
        scene = self.scene
        canvas = self.painter.picture(scene.positions[frame], scene.quaternions[frame])
        for point in self.points:
            self.painter.line(canvas, point.wanted, WANTED, 1.2)
        for tendon in scene.tendons.values():
            for strip in tendon.strips(frame):
                self.painter.line(canvas, np.asarray(strip, dtype=float), INK, 1.0)
        for point in self.points:
            self.painter.line(canvas, point.actual[: frame + 1], self.color, 2.0)
            self.painter.ring(canvas, point.wanted[frame], GOAL, RING)
        shrunk = canvas.resize(self.painter.size, Image.Resampling.LANCZOS)
        font, draw = ImageFont.load_default(TEXT), ImageDraw.Draw(shrunk)
        error = self.errors[int(scene.frames[frame])]
        draw.text((MARGIN, MARGIN), self.run.name.replace("_", " "), fill=self.color, font=ImageFont.load_default(TEXT + 3))
        below = self.painter.size[1] - MARGIN
        draw.text((MARGIN, below), f"t = {time:.2f} s", fill=INK, font=font, anchor="ls")
        draw.text((self.painter.size[0] - MARGIN, below), f"error {_rounded(error)} {self.unit}", fill=INK, font=font, anchor="rs")
        return shrunk


def _scene_of(run: RunResult, interval: tuple[float, float]) -> Scene:
    scene = make_scene(run, interval)
    if scene is None:
        raise RecordingError(f"run {run.name!r} has no MuJoCo model with finite positions to draw; draw runs of a Plant")
    return scene


def _rounded(error: float) -> str:
    """With as many digits as can be read in passing."""
    return f"{error:.2f}" if not error < 5e-3 else f"{error:.0e}"


def _beside(pictures: list[Image.Image]) -> Image.Image:
    width, height = pictures[0].size
    joined = Image.new("RGB", (len(pictures) * (width + GAP) - GAP, height), "white")
    for number, picture in enumerate(pictures):
        joined.paste(picture, (number * (width + GAP), 0))
    return joined
