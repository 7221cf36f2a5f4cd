"""The time in which something happens, with which figures and recordings open."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from invtrack.plans.plan import Plan
from invtrack.results.inputs import actuation_time
from invtrack.results.result import RunResult

MARGIN = 0.03
"""What is left free on either side, as a share of what happens."""


def shown_interval(motions: Sequence[RunResult | Plan]) -> tuple[float, float]:
    """The time [s] that is shown of runs or plans at first, no more than there is of them.

    The manoeuvre, with the preactuation and postactuation times of `invtrack.results`, and after it at least half its length and
    one period of vibration; but what follows takes half of the interval at most.
    """
    starts, ends = [], []
    for motion in motions:
        begin, end = motion.manoeuvre
        starts.append(begin - (actuation_time(motion, "before").value or 0.0))
        period = motion.vibration_period if isinstance(motion, RunResult) else np.nan
        ring_down = period if np.isfinite(period) else 0.0
        ends.append(end + max(ring_down, 0.5 * (end - begin), actuation_time(motion, "after").value or 0.0))
    first = min(motion.time[0] if isinstance(motion, RunResult) else motion.start for motion in motions)
    last = max(motion.time[-1] if isinstance(motion, RunResult) else motion.end for motion in motions)
    start = max(min(starts), first)
    finished = max(motion.manoeuvre[1] for motion in motions)
    end = min(max(ends), finished + max(finished - start, 0.0), last)  # what follows takes half of the time at most
    margin = MARGIN * (end - start)
    return float(max(start - margin, first)), float(min(end + margin, last))
