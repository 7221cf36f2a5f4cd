"""What a run holds beside its arrays, as text, and the run again without their values."""

from __future__ import annotations

from typing import Any

import numpy as np

from invtrack.arrays import Array
from invtrack.channels import Channels
from invtrack.results.result import Event, RunResult, Signal

SAMPLED = ("state", "state_reference", "output", "reference", "planned_output")
"""Signals at the N + 1 times."""

HELD = ("commanded", "applied", "parameters", "measured", "estimate")
"""Signals that hold over the N steps; the last two only of controllers with sensors."""


def run_header(run: RunResult) -> dict[str, Any]:
    """Everything of a run but its arrays and its compiled model, for JSON: floats survive it exactly, NaN included."""
    return {
        "name": run.name,
        "model": run.model,
        "manoeuvre": [float(time) for time in run.manoeuvre],
        "rest_inputs": run.rest_inputs.tolist(),
        "timestep": float(run.timestep),
        "evaluate": run.evaluate,
        "integrator": run.integrator,
        "vibration_period": float(run.vibration_period),
        "events": [[float(event.time), event.kind, event.text, event.until] for event in run.events],
        "remarks": list(run.remarks),
        "parameter_bodies": dict(run.parameter_bodies),
        "status": run.status,
        "message": run.message,
        "qpos_shape": run.qpos.shape,
        "samples": run.time.size,
        "signals": {
            name: {"rows": signal.values.shape[0], "names": signal.channels.names, "units": signal.channels.units}
            for name, signal in ((name, getattr(run, name)) for name in SAMPLED + HELD)
        },
    }


def run_without_values(header: dict[str, Any], mjb: bytes) -> RunResult:
    """The run of a header, with arrays of the right shapes whose values are yet to be filled in."""
    return RunResult(
        name=header["name"],
        model=header["model"],
        time=np.empty(header["samples"]),
        **{name: _signal(header["signals"][name]) for name in SAMPLED + HELD},
        manoeuvre=(header["manoeuvre"][0], header["manoeuvre"][1]),
        rest_inputs=np.array(header["rest_inputs"], dtype=float),
        timestep=header["timestep"],
        evaluate=header["evaluate"],
        integrator=header["integrator"],
        vibration_period=header["vibration_period"],
        events=tuple(Event(time, kind, text, until) for time, kind, text, until in header["events"]),
        remarks=tuple(header["remarks"]),
        parameter_bodies=header["parameter_bodies"],
        qpos=np.empty(header["qpos_shape"]),
        status=header["status"],
        message=header["message"],
        mjb=mjb,
    )


def columns_of(run: RunResult) -> dict[str, Array]:
    """Views of all series of a run, one a channel, by the names that they have in a table: `output tip_position [m]`."""
    columns = {"time [s]": run.time}
    for name in SAMPLED + HELD:
        signal: Signal = getattr(run, name)
        for number, (channel, unit) in enumerate(zip(signal.channels.names, signal.channels.units, strict=True)):
            label = f"{name} {channel} [{unit}]" if unit else f"{name} {channel}"
            while label in columns:  # brackets in names and units can make two labels alike
                label += "'"
            columns[label] = signal.values[:, number]
    columns.update({f"qpos {number}": run.qpos[:, number] for number in range(run.qpos.shape[1])})
    return columns


def _signal(stored: dict[str, Any]) -> Signal:
    channels = Channels(stored["names"], stored["units"])
    return Signal(np.empty((stored["rows"], len(channels))), channels)
