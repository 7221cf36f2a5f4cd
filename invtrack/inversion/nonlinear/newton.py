"""Newton's method for a motion with given outputs, on one mesh: its steps, and what they leave to find."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from invtrack.inversion.nonlinear.shooting import Motion, Shooting

MOST_STEPS = 15
"""On one mesh."""

GROWING = 3
"""So many steps in a row, each longer than the one before it, are taken for divergence."""

INEXACT = 1e-4
"""By what share of a step the next one may come out for derivatives that are parabolas between their knots."""

ROUNDING = 1e-7
"""Steps below this that no longer fall are rounding: what is left is judged by what it makes of the outputs."""


@dataclass(frozen=True)
class Iteration:
    """One step of Newton's method.

    Args:
        amplitude: share of the motion that it was for.
        defect: largest gap between one element's end and the next one's start, as a share of each state's peak.
        output: largest miss at the matched points, as a share of the motion of the outputs.
        step: largest change of a state, as a share of its peak.
        mesh: on which of the meshes that were tried, counted from 1.
        elements: how many that mesh has.
        coefficients: of each input on one of them; 1 where it is constant over each hold.
    """

    amplitude: float
    defect: float
    output: float
    step: float
    mesh: int
    elements: int
    coefficients: int


def converged(
    shooting: Shooting, motion: Motion, tolerance: float, *, amplitude: float = 1.0, log: Sequence[Iteration] = ()
) -> tuple[Motion | None, tuple[Iteration, ...]]:
    """The motion when no more than the tolerance is left to find, None where Newton's method does not get there; and its log.

    Args:
        shooting: the conditions.
        motion: to start from.
        tolerance: of what is left after a step, as a share of peaks; see `remaining`.
        amplitude: share of the motion, for the log.
        log: of steps that led here. If the last one was on the same mesh, for the same amplitude, this goes on from it.
    """
    mesh, scheme = shooting.mesh, shooting.scheme
    found = list(log)
    growing, last = 0, np.inf
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        for _ in range(MOST_STEPS):
            nodes = shooting.nodes(motion)
            gaps, away = shooting.misses(motion, nodes)
            if not (np.all(np.isfinite(nodes)) and np.all(np.isfinite(away))):
                return None, tuple(found)
            try:
                change = shooting.step(motion, nodes, gaps, away)
            except (np.linalg.LinAlgError, ValueError):  # scipy says ValueError of what is not finite
                return None, tuple(found)
            motion = shooting.moved(motion, change)
            size = shooting.sizes(motion)
            step, defect = (float(np.max(np.abs(each) / size)) for each in (change.states, gaps))
            missed = float(np.max(np.abs(away) / np.where(shooting.motion_size > 0, shooting.motion_size, np.inf)[:, None]))
            found.append(Iteration(amplitude, defect, missed, step, shooting.number, len(mesh), scheme.count))
            if not np.isfinite(step):
                return None, tuple(found)
            if remaining(found) <= tolerance or (last <= ROUNDING and step > last / 4):
                return motion, tuple(found)
            growing = growing + 1 if step > last else 0
            last = step
            if growing >= GROWING:
                return None, tuple(found)
    return None, tuple(found)


def remaining(log: Sequence[Iteration]) -> float:
    """What is left to find after the last step d, as a share of peaks: C |d|^2, and INEXACT |d| at least.

    C is what the last two steps on one mesh, for one amplitude, show of the method's quadratic convergence: it belongs to the
    motion, and hardly to its mesh. Before there are two, d itself is left.
    """
    last = log[-1].step
    for before, after in zip(log[-2::-1], log[:0:-1], strict=True):
        if (before.mesh, before.amplitude) == (after.mesh, after.amplitude):
            return last * max(after.step / before.step**2 * last, INEXACT) if before.step > 0 else 0.0
    return last
