"""The pictures of the comparison: each run, all runs, close-ups of the jumps, the long run, and the decay of a wrong estimate."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from regulator import manoeuvre
from regulator.rig import LONG

import invtrack
from invtrack.figures import Decay, around_figure, comparison_figure, decay_figure
from invtrack.studies import Session

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BEFORE, AFTER = 10.0, 20.0  # [s] shown around the manoeuvre's start
CLOSE_UPS = ("exact_map", "switched_francis", "switched_francis_from_exact_state")


def figures(estimate: tuple[np.ndarray, np.ndarray, float], rate: float) -> dict[str, Callable[[Session], Figure]]:
    """By file name. estimate: times, size and designed rate of the error of the exosystem's estimate; rate: of the long run."""
    return {
        "comparison": _comparison,
        "around_jumps": _around_jumps,
        "long_run": _long_run,
        "decay": lambda done: _decay(estimate, done[f"{LONG}estimated"], rate),
    }


def _comparison(done: Session) -> Figure:
    from_rest = [name for name, run in done.runs.items() if run.time[0] < 0 and not name.startswith(LONG)]
    return comparison_figure(done.among(from_rest), window=(-BEFORE, AFTER))


def _around_jumps(done: Session) -> Figure:
    first, second = manoeuvre.JUMPS
    times = {"start": 0.0, "0 to 100 kg": first, "100 to 10 kg": second, "end": manoeuvre.END}
    return around_figure(done.among(CLOSE_UPS), times=times, before=0.5, after=1.0)


def _long_run(done: Session) -> Figure:
    runs = done.among(name for name in done.runs if name.startswith(LONG))
    return comparison_figure(runs, window=(-BEFORE, float(runs[0].manoeuvre[1]) + BEFORE))


def _decay(estimate: tuple[np.ndarray, np.ndarray, float], run: invtrack.RunResult, rate: float) -> Figure:
    """What a wrong estimate does: its own error, and a long run's tracking error with its rate."""
    part = (run.time >= run.manoeuvre[0]) & (run.time <= run.manoeuvre[1])
    decays = [
        Decay("error of the estimated $x_e$", *estimate),
        Decay(f"$|y - y_d|$ of {run.name} [m]", run.time[part], np.max(np.abs(run.error[part]), axis=1), rate),
    ]
    return decay_figure("From a wrong estimate: measured errors and designed rates", decays)
