"""`invtrack doctor`: whether everything that invtrack stands on works on this machine."""

from __future__ import annotations

import json
import os
import platform
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np

from invtrack.command.printed import Printed
from invtrack.control import TrackingController, lqr
from invtrack.errors import InvtrackError
from invtrack.figures import save_figure, tracking_figure
from invtrack.inversion import invert
from invtrack.plant import Plant, linearize, model_path
from invtrack.references import rest_to_rest
from invtrack.results import RunResult, max_error
from invtrack.simulation import simulate


@dataclass(frozen=True, kw_only=True)
class Doctor(Printed):
    """Check MuJoCo, the compiled loop, threads, recordings and figures on this machine; status 1 where one of them fails."""

    def execute(self) -> int:
        """Print one line for each check; 0, or 1 where one failed."""
        found: dict[str, dict[str, object]] = {}
        for name, check in CHECKS.items():
            begin = time.perf_counter()
            try:
                text, good = check(), True
            except (InvtrackError, ImportError, OSError, RuntimeError, ValueError) as error:
                text, good = f"{type(error).__name__}: {error}", False
            found[name] = {"works": good, "finding": text, "seconds": round(time.perf_counter() - begin, 2)}
        if self.json:
            print(json.dumps(found, indent=2))
        elif not self.quiet:
            for name, result in found.items():
                print(f"{'ok    ' if result['works'] else 'FAILED'} {name}: {result['finding']}")
        return 0 if all(result["works"] for result in found.values()) else 1


def _versions() -> str:
    import matplotlib
    import mujoco
    import numba
    import rerun
    import scipy

    libraries = {"numpy": np, "scipy": scipy, "mujoco": mujoco, "numba": numba, "rerun": rerun, "matplotlib": matplotlib}
    versions = ", ".join(f"{name} {module.__version__}" for name, module in libraries.items())
    return f"invtrack {version('invtrack')}, Python {platform.python_version()} on {platform.platform()}; {versions}"


def _plan() -> tuple[Plant, TrackingController]:
    plant = Plant.from_xml(model_path("cantilever"), inputs=["base_force"], outputs=["tip_position"])
    model = linearize(plant)
    plan = invert(model, rest_to_rest(0.0, 1.0, duration=2.0, smoothness=4))
    return plant, TrackingController(plan, lqr(model, Q=100.0, R=0.01))


def _planning() -> str:
    certificate = _plan()[1].plan.certificate
    return f"an inverse that meets its equations to {max(certificate.dynamics_residual, certificate.output_error):.1g}"


def _loop() -> str:
    import mujoco

    plant, controller = _plan()
    steps, start = 20_000, controller.plan.manoeuvre[0]
    span = {"start": start, "timestep": 1e-3, "initial_state": controller.plan.states(start)[0]}
    simulate(plant, controller, end=start + 0.1, **span)
    model = plant.model_with()
    model.opt.timestep = 1e-3
    data = plant.new_data(model)
    begin = time.process_time()
    mujoco.mj_step(model, data, nstep=steps)
    bare = time.process_time() - begin
    begin = time.process_time()
    run = simulate(plant, controller, end=start + 1e-3 * steps, **span)
    share = bare / (time.process_time() - begin)
    return f"{run.status}, max error {max_error(run):.1g} m, at {share:.2f} of the speed of mj_step"


def _cores() -> str:
    return f"{len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity') else os.cpu_count()} cores for sweeps"


def _short_run() -> RunResult:
    plant, controller = _plan()
    return simulate(plant, controller, start=-1.0, end=3.0, timestep=5e-3, initial_state=controller.plan.states(-1.0)[0])


def _recordings() -> str:
    from invtrack.recording import load_recording, save_recording  # loads Rerun

    run = _short_run()
    with tempfile.TemporaryDirectory() as folder:
        path = save_recording(run, Path(folder) / "run.rrd")
        if not load_recording(path)["run"].equals(run):
            raise InvtrackError("a recording that was written and read back is another one")
        return f"{sum(each.stat().st_size for each in path.parent.iterdir()) / 1e3:.0f} kB written, and read back bit for bit"


def _figures() -> str:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.png"
        save_figure(tracking_figure(_short_run()), path)
        return f"{path.stat().st_size / 1e3:.0f} kB drawn without a display"


CHECKS: dict[str, Callable[[], str]] = {
    "versions": _versions,
    "planning": _planning,
    "simulation": _loop,
    "processors": _cores,
    "recordings": _recordings,
    "figures": _figures,
}
