"""What a slew leaves, and what it asks for, with a plant that is, or is not, as it was planned for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from slews.methods import BEAM, Slew, switched

import invtrack

PERIODS = 5.0  # of the slowest mode, over which vibration is looked at once the time is over
LEVELS = (0.05, 0.1, 0.2)
KINDS = ("payload", "stiffness", "instant")


def measured(run: invtrack.RunResult, total: float) -> dict[str, float]:
    """Of a run whose time is over at `total` [s]; all of it counted, and after that the vibration."""
    after = run.time >= total
    angles = np.column_stack([run.state[name] for name in BEAM.hinges])
    y = run.output.values[:, 0]
    return {
        "residual_vibration": float(np.ptp(y[after])),
        "final_error": float(np.max(np.abs(y[after]))),
        "residual_energy": float(np.max(BEAM.strain_energy(angles[after]))),
        "peak_input": float(np.max(np.abs(run.applied.values))),
        "peak_strain": float(np.max(np.abs(BEAM.surface_strain(angles)))),
    }


def settings(slew: Slew) -> dict[str, Any]:
    """Of a run: it begins when the time does, whatever the plan would have done before, and lasts until the window ends."""
    return {"start": 0.0, "end": slew.total + PERIODS * slew.flexible[0].damped_period}


def tried(
    slew: Slew, controller: invtrack.TrackingController, *, timestep: float, error: Mapping[str, float] | None = None
) -> dict[str, float]:
    """What a controller leaves on the linear model of a beam with errors, by their kind, as shares: {"payload": 0.1}."""
    off = {"payload": 0.0, "stiffness": 0.0, "instant": 0.0, **(error or {})}
    masses = [(1 + off["payload"]) * mass for mass in slew.masses]
    real = switched(masses, (1 + off["instant"]) * slew.instant, stiffness=1 + off["stiffness"])
    run = invtrack.simulate(invtrack.LinearPlant(real), controller, timestep=timestep, **settings(slew))
    return measured(run, slew.total)


def with_errors(slew: Slew, controller: invtrack.TrackingController, *, timestep: float) -> dict[str, Any]:
    """The same with the right model, and with each kind and size of error: the worse of both signs."""
    result: dict[str, Any] = {"total": slew.total, **tried(slew, controller, timestep=timestep)}
    for kind in KINDS:
        for level in LEVELS:
            both = [tried(slew, controller, timestep=timestep, error={kind: sign * level}) for sign in (-1, 1)]
            for name in ("residual_vibration", "residual_energy"):
                result[f"{name}_{kind}_{level:g}"] = max(each[name] for each in both)
    return result
