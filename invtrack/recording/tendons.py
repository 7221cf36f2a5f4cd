"""Spatial tendons as line strips that move."""

from __future__ import annotations

from dataclasses import dataclass, fields

import mujoco
import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray

from invtrack.arrays import Array
from invtrack.recording.shapes import tendon_rgba, to_bytes
from invtrack.recording.stream import Stream

PULLEY = -2
"""What MuJoCo writes into wrap_obj where a tendon's path is interrupted."""


@dataclass(frozen=True)
class TendonPath:
    """Line strips of a tendon over the frames: one, and one more for every pulley.

    points: of all strips of all frames, in order, (P, 3) [m].
    """

    points: NDArray[np.float32]
    points_in_strips: NDArray[np.int64]
    strips_in_frames: NDArray[np.int64]

    @classmethod
    def joined(cls, parts: list[TendonPath]) -> TendonPath:
        """The path over the frames of all parts."""
        return cls(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(cls)))

    def strips(self, frame: int) -> list[NDArray[np.float32]]:
        """The strips of a frame, (k, 3) each [m]."""
        first = int(np.sum(self.strips_in_frames[:frame]))
        ends = np.cumsum(self.points_in_strips)
        strips = range(first, first + int(self.strips_in_frames[frame]))
        return [self.points[ends[strip] - self.points_in_strips[strip] : ends[strip]] for strip in strips]


@dataclass(frozen=True)
class Wrapping:
    """Where the tendons of F frames run, or of one without the first axis.

    firsts, counts: of each tendon (F, tendons) the first of its rows and their number. points: in rows (F, W, 3) [m]. objects: what
    each row (F, W) is on, PULLEY for one that is no point.
    """

    firsts: NDArray[np.int32]
    counts: NDArray[np.int32]
    points: NDArray[np.floating]
    objects: NDArray[np.int32]

    @classmethod
    def of(cls, data: mujoco.MjData) -> Wrapping:
        """MuJoCo's own arrays, of the frame that `data` shows."""
        return cls(data.ten_wrapadr, data.ten_wrapnum, data.wrap_xpos.reshape(-1, 3), data.wrap_obj.reshape(-1))

    @classmethod
    def empty(cls, frames: int, data: mujoco.MjData) -> Wrapping:
        """Arrays for as many frames, yet to be filled in."""
        one = cls.of(data)
        integers = [np.empty((frames, *values.shape), dtype=np.int32) for values in (one.firsts, one.counts, one.objects)]
        return cls(integers[0], integers[1], np.empty((frames, *one.points.shape), dtype=np.float32), integers[2])


def tendon_path(wrapping: Wrapping, tendon: int) -> TendonPath:
    """The path of a spatial tendon, cut at its pulleys, whose own rows are no points."""
    rows, first = np.arange(wrapping.objects.shape[1]), wrapping.firsts[:, tendon, np.newaxis]
    used = (rows >= first) & (rows < first + wrapping.counts[:, tendon, np.newaxis])
    frame_of, pulleys, points = np.nonzero(used)[0], wrapping.objects[used] == PULLEY, wrapping.points[used]
    piece = np.cumsum(np.concatenate([[False], frame_of[1:] != frame_of[:-1]]) | pulleys)
    sizes = np.bincount(piece[~pulleys])
    is_strip = sizes > 1
    drawn = ~pulleys & is_strip[np.minimum(piece, sizes.size - 1)]
    _, begins = np.unique(piece[drawn], return_index=True)
    return TendonPath(points[drawn], sizes[is_strip], np.bincount(frame_of[drawn][begins], minlength=len(used)))


def is_path(model: mujoco.MjModel, tendon: int) -> bool:
    """Whether a tendon has a path in space, rather than a sum of joint coordinates."""
    return bool(model.wrap_type[model.tendon_adr[tendon]] != mujoco.mjtWrap.mjWRAP_JOINT)


def send_tendon(
    stream: Stream,
    path: str,
    frames: NDArray[np.int64],
    times: Array,
    whose: tuple[mujoco.MjModel, int],
    strips: TendonPath,
) -> None:
    """Send a tendon over time.

    Args:
        stream: to which it is sent.
        path: of the entity.
        frames, times: numbers of the samples that are drawn, and their times [s] (F,).
        whose: the model, and the tendon's number in it.
        strips: where it runs.
    """
    model, tendon = whose
    style = rr.LineStrips3D.from_fields(
        colors=to_bytes(tendon_rgba(model, tendon)[np.newaxis]), radii=[float(model.tendon_width[tendon])]
    )
    stream.log(path, style)
    # As Rerun's own conversion, which makes an object of each strip.
    points = rr.components.Position3DBatch(strips.points).as_arrow_array()
    starts = np.concatenate([[0], np.cumsum(strips.points_in_strips)]).astype(np.int32)
    columns = rr.LineStrips3D.columns(
        strips=pa.ListArray.from_arrays(starts, points, type=rr.components.LineStrip3DBatch._ARROW_DATATYPE)
    )
    stream.send(path, frames, times, columns.partition(strips.strips_in_frames), held=True)
