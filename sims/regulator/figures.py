"""The pictures of the comparison: each run, all runs, close-ups of the jumps, the long run, and the decay of a wrong estimate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from regulator import manoeuvre

import invtrack
from invtrack.figures import Decay, around_figure, comparison_figure, decay_figure, save_figure, tracking_figure
from invtrack.studies.folder import RunFolder

CLOSE_UPS = ("exact_map", "switched_francis", "switched_francis_from_exact_state")


def draw(runs: Sequence[invtrack.RunResult], long_runs: Sequence[invtrack.RunResult], folder: RunFolder) -> None:
    """Figures of the runs."""
    from_rest = [run for run in runs if run.time[0] < 0]
    for run in from_rest:
        save_figure(tracking_figure(run), folder.file(f"tracking_{run.name}.png"))
    save_figure(comparison_figure(from_rest, window=(-10.0, 20.0)), folder.file("comparison.png"))
    first, second = manoeuvre.JUMPS
    times = {"start": 0.0, "0 to 100 kg": first, "100 to 10 kg": second, "end": manoeuvre.END}
    compared = [run for run in runs if run.name in CLOSE_UPS]
    save_figure(around_figure(compared, times=times, before=0.5, after=1.0), folder.file("around_jumps.png"))
    window = (-10.0, float(long_runs[0].manoeuvre[1]) + 10.0)
    save_figure(comparison_figure(long_runs, window=window), folder.file("long_run.png"))


def draw_decay(estimate: tuple[np.ndarray, np.ndarray, float], run: invtrack.RunResult, rate: float, folder: RunFolder) -> None:
    """What a wrong estimate does: its own error (times, size, designed rate), and a long run's tracking error with its rate."""
    part = (run.time >= run.manoeuvre[0]) & (run.time <= run.manoeuvre[1])
    decays = [
        Decay("error of the estimated $x_e$ [1]", *estimate),
        Decay(f"$|y - y_d|$ of {run.name} [m]", run.time[part], np.max(np.abs(run.error[part]), axis=1), rate),
    ]
    save_figure(decay_figure("From a wrong estimate: measured errors and designed rates", decays), folder.file("decay.png"))
