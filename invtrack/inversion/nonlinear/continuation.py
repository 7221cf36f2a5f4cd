"""From rest to the whole motion: Newton's method at once, else by amplitudes that grow as far as it follows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from invtrack.inversion.nonlinear.newton import Iteration, converged
from invtrack.inversion.nonlinear.shooting import Motion, Shooting

SMALLEST = 1 / 256
"""Steps of amplitude that continuation gives up below."""

CLOSE = 1e-4
"""A step of Newton's method with which an amplitude on the way counts as found."""

GROWTH = 1.6
"""By how much the step of amplitude grows after one that was found."""

Progress = Callable[[float], None]


@dataclass(frozen=True, eq=False)
class Followed:
    """How far continuation came.

    Args:
        motion: of the largest amplitude found, None where there is none.
        amplitude: that amplitude, 1 for the whole motion.
        shooting: the conditions that it meets.
        log: all steps of Newton's method.
    """

    motion: Motion | None
    amplitude: float
    shooting: Shooting
    log: tuple[Iteration, ...]


def follow(problem: Callable[[float], Shooting | None], first: Motion, tolerance: float, progress: Progress | None) -> Followed:
    """The motion for amplitude 1, from a first guess; where that fails, from that guess by smaller amplitudes.

    Each amplitude starts where the line through the last two that were found leads to.

    Args:
        problem: from an amplitude between 0 and 1 to its conditions, None where its end has no equilibrium.
        first: a motion to start from, that for amplitude 0.
        tolerance: of what is left after the last Newton step, as a share of peaks.
        progress: called with the amplitude that has been found.
    """
    whole = problem(1.0)
    assert whole is not None  # the caller has made sure of the equilibrium at the end
    motion, log = converged(whole, first, tolerance)
    if motion is not None:
        if progress is not None:
            progress(1.0)
        return Followed(motion, 1.0, whole, log)
    found, step = [(0.0, first)], 0.5
    while step >= SMALLEST:
        amplitude = min(1.0, found[-1][0] + step)
        shooting = problem(amplitude)
        if shooting is not None:
            guess = _predicted(found, amplitude, shooting)
            motion, more = converged(shooting, guess, tolerance if amplitude == 1.0 else CLOSE, amplitude=amplitude)
            log += more
            if motion is not None:
                found = [found[-1], (amplitude, motion)]
                step *= GROWTH
                if progress is not None:
                    progress(amplitude)
                if amplitude == 1.0:
                    return Followed(motion, 1.0, shooting, log)
                continue
        step /= 2
    reached, motion = found[-1]
    return Followed(motion if reached else None, reached, problem(reached) or whole, log)


def _predicted(found: list[tuple[float, Motion]], amplitude: float, shooting: Shooting) -> Motion:
    if len(found) < 2:
        return found[-1][1]
    (a, old), (b, new) = found
    ratio = (amplitude - b) / (b - a)
    dynamics = shooting.dynamics[0]
    points = dynamics.retract(new.points, ratio * dynamics.difference(new.points, old.points))
    coefficients = new.coefficients + ratio * (new.coefficients - old.coefficients)
    return Motion(points, np.asarray(coefficients), np.asarray(new.bend + ratio * (new.bend - old.bend)))
