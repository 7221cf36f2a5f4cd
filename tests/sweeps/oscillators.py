"""A sweep of an oscillator whose stiffness is not what the plan assumes, seen through noise; also a program of its own.

    python oscillators.py OUT [--on dask] [--killed-at PART] [--worker-dies MARKER]

--killed-at: the process kills itself in the middle of writing this part. --worker-dies: the process that has a certain late point
dies of it, once; MARKER is the file by which it knows that it has done so.
"""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path
from typing import Any

import numpy as np

import invtrack
from invtrack import files
from invtrack.sweeps import Design, Swept, listed, running, sweep

POINTS = 16
ERROR_TIMES = np.linspace(-1.0, 7.0, 17)  # beyond both ends of the runs
UNSTABLE = -1e9
PERIOD = 0.05  # [s]
LATE = 14  # the point that a process dies of


def oscillator(stiffness: float) -> invtrack.StateSpace:
    return invtrack.StateSpace([[0.0, 1.0], [-stiffness, -0.4]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]])


def prepare() -> invtrack.Plan:
    return invtrack.invert(oscillator(40.0), invtrack.rest_to_rest(0.0, 1.0, duration=1.0))


def study(point: dict[str, Any], seed: int, plan: invtrack.Plan) -> invtrack.RunResult:
    """One run with an observer; a gain of the wrong sign makes it diverge, a stiffness below zero is refused."""
    marker = os.environ.get("WORKER_DIES")
    if marker and point["number"] == LATE and not Path(marker).exists():
        Path(marker).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if point["stiffness"] < 0:
        raise invtrack.InvtrackError(f"expected a stiffness above zero, got {point['stiffness']:g}")
    gains = invtrack.GainSchedule((np.array([[point["gain"], point["gain"]]]),), np.zeros(0))
    plant = invtrack.LinearPlant(oscillator(point["stiffness"]))
    if point["gain"] < 0:
        return invtrack.simulate(plant, invtrack.TrackingController(plan, gains), timestep=PERIOD, end=6.0, evaluate="stages")
    observer = invtrack.KalmanFilter(input_noise=1.0, measurement_noise=1e-3)
    controller = invtrack.OutputFeedbackController(plan, gains, observer, period=PERIOD)
    sensors = {"y1": invtrack.Sensor(noise=1e-3)}
    return invtrack.simulate(plant, controller, timestep=PERIOD, end=6.0, sensors=sensors, seed=seed)


def design(points: int = POINTS) -> Design:
    """Stiffnesses and gains of a low-discrepancy sequence, one point that diverges and one that is refused."""
    shares = (np.outer(np.arange(points), [0.7548776662, 0.5698402910]) + 0.5) % 1.0
    rows = [{"number": i, "stiffness": 38.0 + 4.0 * a, "gain": 2.0 * b} for i, (a, b) in enumerate(shares.tolist())]
    rows[3]["gain"], rows[7]["stiffness"] = UNSTABLE, -1.0
    return listed(rows)


def swept(out: Path, *, points: int = POINTS, **options: Any) -> Swept:
    return sweep(study, design(points), out=out, prepare=prepare, error_times=ERROR_TIMES, **options)


def _kill_at_part(number: int) -> None:
    """Die as the draft of this part is half written."""
    parts = 0

    def replace(draft: Path, path: Path) -> None:
        nonlocal parts
        parts += 1
        if parts == number:
            os.truncate(draft, draft.stat().st_size // 2)
            os.kill(os.getpid(), signal.SIGKILL)
        rename(draft, path)

    rename = os.replace
    files.os.replace = replace  # type: ignore[attr-defined, assignment]


def main(out: Path, *words: str) -> None:
    running.SECONDS_BETWEEN_PARTS = 0.0
    running.IN_FLIGHT = 2  # many parts, however fast the points are
    options = dict(zip(words[::2], words[1::2], strict=True))
    if "--killed-at" in options:
        _kill_at_part(int(options["--killed-at"]))
    if "--worker-dies" in options:
        os.environ["WORKER_DIES"] = options["--worker-dies"]
    if options.get("--on") == "dask":
        from distributed import Client, LocalCluster

        workers = 2 if "--worker-dies" in options else 1
        with LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None) as cluster, Client(cluster) as client:
            done = swept(out, executor=client.get_executor(pure=False))
    else:
        done = swept(out, workers=2)
    print(done.computed)


if __name__ == "__main__":
    main(Path(sys.argv[1]), *sys.argv[2:])
