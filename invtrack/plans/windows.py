"""Stretches of time over which a trajectory's equations are integrated: as long as the motion is slow, fine next to breakpoints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from invtrack.arrays import Array, Indices
from invtrack.plans.trajectory import Trajectory

PANEL_ANGLE = 1.0
"""Length of a panel times the pace of the values in it, at most; 10 Gauss points are then exact to rounding."""

GROWTH = 1.5
"""Panels grow by this factor with their distance from a breakpoint, at which what is fast dies out."""

MOST_LAYERS = 80
"""Panels next to a breakpoint at most: what is faster still is over before times resolve it."""

PANELS_IN_A_ROW, FEWEST = 40, 4
"""Panels of which a window of one piece consists at most, where what is fast does not die out; and how few windows will do then."""

PANELS_PER_WINDOW = 1_000
"""Panels that a window is put together from at most, where the pieces of a reference are far shorter than the motion is slow."""

SHARE_OF_MANOEUVRE, MOST_RADIANS = 0.1, 1e5
"""Windows are no longer than this share of the manoeuvre, or than so many radians of the plant; yet always one of these."""

TOTAL_PANELS = 8_000
"""Panels in all, about; beyond, windows are skipped evenly."""


@dataclass(frozen=True, eq=False)
class Windows:
    """Panels that cross no breakpoint, and the windows that they make up without a gap.

    Args:
        starts, ends: of the panels (k,) [s].
        piece: of the trajectory, in which each lies (k,).
        first: the number of the first panel of each window (w,).
    """

    starts: Array
    ends: Array
    piece: Indices
    first: Indices

    @property
    def last(self) -> Indices:
        """The number of the last panel of each window (w,)."""
        return np.append(self.first[1:], len(self.starts)) - 1

    @property
    def owner(self) -> Indices:
        """The window of each panel (k,)."""
        return np.repeat(np.arange(len(self.first)), np.diff(np.append(self.first, len(self.starts))))


def windows(trajectory: Trajectory, switch_times: Array, plant_paces: Array, span: tuple[float, float], per_piece: int) -> Windows:
    """Windows as long as the values of a trajectory are slow, over `span` [s], none of which crosses a switch time.

    A part that is fast, but dies out within a radian of its own, lives next to one end of a piece: there panels are as short as
    it is fast, and grow with their distance from it. Pieces that are shorter than a window make one up with their neighbours. So
    no slow error hides between many short panels. Yet no window is as long as a part of the manoeuvre and many radians of the
    plant, where rounding of terms that cancel would be all there is to see.

    Args:
        trajectory: whose equations are to be integrated.
        switch_times: of the plant (N,) [s].
        plant_paces: of the plant in each interval (N + 1,) [rad/s].
        span: from where to where.
        per_piece: windows between the ends of a piece at most, spread evenly over it.
    """
    inner = trajectory.breakpoints
    start, end = min(span[0], inner[0]), max(span[1], inner[-1])
    edges = np.unique(np.concatenate([[start], inner, switch_times[(switch_times > start) & (switch_times < end)], [end]]))
    begin, finish, length, middle = edges[:-1], edges[1:], np.diff(edges), (edges[:-1] + edges[1:]) / 2
    piece = trajectory.locate(middle)
    interval = np.searchsorted(switch_times, middle, side="right")
    slowest = PANEL_ANGLE / np.max(length)  # beyond the longest stretch nothing counts
    fine, coarse, radian = (
        PANEL_ANGLE / np.maximum(paces, slowest)
        for paces in (trajectory.paces()[piece], trajectory.lasting_paces()[piece], plant_paces[interval])
    )
    reach = np.maximum(np.minimum((inner[-1] - inner[0]) * SHARE_OF_MANOEUVRE / radian, MOST_RADIANS), 1.0) * radian
    coarse = np.minimum(coarse, reach)
    reach = np.minimum(reach, PANELS_IN_A_ROW * coarse)
    alone, depth = length >= reach, np.minimum(length / 2, coarse)
    layers = np.clip(np.ceil(np.log(np.maximum(depth / fine, 1.0)) / np.log(GROWTH)), 0, MOST_LAYERS).astype(np.intp)
    room = np.where(length > 2 * depth, length - 2 * depth, 0.0)
    block = np.minimum(reach, room)
    row = np.ceil(block / coarse).astype(np.intp)  # panels of one window between the ends
    most = np.where(alone, np.maximum(per_piece // np.maximum(row, 1), FEWEST), 1)
    between = np.where(room > 0, np.clip(np.ceil(room / np.where(room > 0, block, 1.0)), 1, most), 0).astype(np.intp)
    count = np.where((room > 0) | (layers > 0), 2 * layers + 2, 1) + between * row
    number = _numbered(alone, interval, np.minimum(length / reach, 1.0), count)
    found: list[tuple[Array, ...]] = []

    def add(chosen: Indices, joints: Array, part: Array | int) -> None:
        """Panels between joints (c, k + 1) [s] in the stretches `chosen` (c,), which make up `part` of a window."""
        each = (joints[:, :-1], joints[:, 1:], piece[chosen, None], number[chosen, None], part)
        found.append(tuple(np.broadcast_to(values, joints[:, 1:].shape).ravel() for values in each))

    chosen = np.flatnonzero(number % int(np.ceil(np.sum(count) / TOTAL_PANELS)) == 0)
    whole, cut = chosen[count[chosen] == 1], chosen[count[chosen] > 1]
    add(whole, np.column_stack([begin[whole], finish[whole]]), 0)
    for steps in np.unique(layers[cut]).tolist():
        same = cut[layers[cut] == steps]
        layer = np.concatenate([[0.0], GROWTH ** np.arange(-steps, 1.0)]) * depth[same, None]
        add(same, begin[same, None] + layer, 0)
        add(same, finish[same, None] - layer[:, ::-1], np.where(alone[same], per_piece + 1, 0)[:, None])
    for amount, panels in np.unique(np.column_stack([between, row])[cut], axis=0).tolist():
        same = cut[(between[cut] == amount) & (row[cut] == panels)]
        starts = begin[same] + (depth[same] + (room[same] - block[same]) * np.linspace(0.0, 1.0, amount)[:, None])
        joints = starts[:, :, None] + block[same, None] * np.linspace(0.0, 1.0, panels + 1)
        place = np.where(alone[same], np.arange(1, amount + 1)[:, None], 0)
        add(np.tile(same, amount), joints.reshape(-1, panels + 1), place.reshape(-1, 1))
    starts, ends, owner, window, part = (np.concatenate(values) for values in zip(*found, strict=True))
    order = np.lexsort([starts, part, window])
    return Windows(
        starts=starts[order],
        ends=ends[order],
        piece=owner[order],
        first=np.flatnonzero(np.append(True, np.any(np.diff([window[order], part[order]]), axis=0))),
    )


def _numbered(alone: Array, interval: Indices, share: Array, count: Indices) -> Indices:
    """The window of each stretch: its own where it is long enough, else the same as its neighbours' up to a share of one in all."""
    filled, panels = np.floor(np.cumsum(share)), np.cumsum(count) // PANELS_PER_WINDOW
    marks = np.column_stack([alone, interval, filled, panels])
    changes = np.any(marks[1:] != marks[:-1], axis=1) | alone[1:]
    return np.concatenate([[0], np.cumsum(changes)])
