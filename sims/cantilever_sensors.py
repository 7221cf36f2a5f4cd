"""Tracking through tip-mass jumps with the sensors and the sampling rate of a real controller.

The manoeuvre of cantilever_jumps.py, but the controller acts every 10 ms and, except in the case full_state, sees only the base's
and the tip's position through imperfect sensors; an observer estimates the other states. Every case runs twice, on the linear model
(the prediction) and in MuJoCo, with the same controller, the same loop and the same noise.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import invtrack
from invtrack.control import Controller
from invtrack.figures import comparison_figure, save_figure, tracking_figure
from invtrack.studies.folder import RunFolder
from invtrack.studies.options import SimOptions, run_sim
from invtrack.studies.progress import progress
from invtrack.studies.table import Column, print_table

MASSES = (0.0, 100.0, 10.0)  # [kg]
JUMPS = (np.pi / 2, 3 * np.pi / 2)  # [s]
PERIOD = 0.01  # [s]
NOISE = 1e-3  # [m], standard deviation of one sample
INPUT_NOISE = 0.02  # [N per root Hz], the disturbance that the Kalman filter expects
DELAY = 0.02  # [s]
MEASUREMENTS = ("base_position", "tip_position")
OBSERVER_POLES = (-2 + 2j, -2 - 2j, -1.5 + 1j, -1.5 - 1j, -1 + 0.5j, -1 - 0.5j)  # [rad/s]

COLUMNS = (
    Column("predicted max error", "m"),
    Column("measured max error", "m"),
    Column("predicted residual vibration", "m"),
    Column("measured residual vibration", "m"),
    Column("predicted peak input", "N"),
    Column("measured peak input", "N"),
)


@dataclass(frozen=True)
class Case:
    """A controller and the sensors it looks through."""

    name: str
    controller: Controller
    sensors: Mapping[str, invtrack.Sensor] = field(default_factory=dict)


def main(options: SimOptions) -> None:
    folder = RunFolder(options.out)
    plant = invtrack.Plant.from_xml(
        invtrack.model_path("cantilever"),
        inputs=["base_force"],
        outputs=["tip_position"],
        measurements=MEASUREMENTS,
        parameters={"tip_mass": invtrack.BodyMass("tip", inertia="fixed")},
    )
    model = invtrack.SwitchedSystem([invtrack.linearize(plant, tip_mass=mass) for mass in MASSES], JUMPS)
    plan = invtrack.invert(model, invtrack.raised_cosine(2.0), tolerance=1e-8)
    lowest, highest = plan.input_range
    limits = plant.input_limits[0]
    print(
        f"plan: {plant.inputs.names[0]} from {lowest[0]:.1f} to {highest[0]:.1f} {plant.inputs.units[0]}; the actuator passes on "
        f"{limits[0]:g} to {limits[1]:g}; start {-plan.start:.1f} s before the manoeuvre"
    )
    linear = invtrack.LinearPlant(model, input_limits=plant.input_limits)
    cases: dict[str, dict[str, Any]] = {}
    runs = []
    for case in _cases(model, plan):
        measured = _run(plant, case, options.timestep)
        predicted = _run(linear, case, options.timestep)
        cases[case.name] = _numbers(measured, predicted)
        runs.append(measured)
    print_table("Cantilever with tip-mass jumps: prediction and physics", columns=COLUMNS, rows=cases)
    print(
        f"controller period {1e3 * PERIOD:g} ms, observers measure {' and '.join(MEASUREMENTS)}; noise: standard deviation\n"
        f"{NOISE:g} m of each sample; coarse: besides, digits of {NOISE:g} m and a delay of {DELAY:g} s that the controller knows."
    )
    for run in runs:
        invtrack.save_recording(run.thinned(options.record_every), folder.file(f"{run.name}.rrd"))
    if options.figures:
        for run in runs:
            save_figure(tracking_figure(run), folder.file(f"tracking_{run.name}.png"))
        save_figure(comparison_figure(runs, window=(-10.0, 20.0)), folder.file("comparison.png"))
    folder.write_summary(
        sim="cantilever_sensors",
        model=plant.name,
        timestep=options.timestep,
        cases=cases,
        period=PERIOD,
        noise=NOISE,
        delay=DELAY,
        planned_input={"lowest": lowest[0], "highest": highest[0]},
    )
    print(
        f"written to {folder.path}: summary.json, a recording (.rrd) of each case" + (", figures (.png)" if options.figures else "")
    )


def _cases(model: invtrack.SwitchedSystem, plan: invtrack.Plan) -> list[Case]:
    gains = invtrack.lqr(model, Q=100.0, R=0.01)
    kalman = invtrack.KalmanFilter(input_noise=INPUT_NOISE, measurement_noise=NOISE)
    placed = invtrack.LuenbergerObserver(OBSERVER_POLES)
    noisy = {name: invtrack.Sensor(noise=NOISE) for name in MEASUREMENTS}
    coarse = {name: invtrack.Sensor(noise=NOISE, quantization=NOISE, delay=DELAY) for name in MEASUREMENTS}

    def with_observer(observer: Any, **settings: float) -> invtrack.OutputFeedbackController:
        return invtrack.OutputFeedbackController(plan, gains, observer, period=PERIOD, **settings)

    return [
        Case("full_state", invtrack.TrackingController(plan, gains, period=PERIOD)),
        Case("kalman_ideal_sensors", with_observer(kalman)),
        Case("kalman_noise", with_observer(kalman), noisy),
        Case("placed_noise", with_observer(placed), noisy),
        Case("kalman_coarse", with_observer(kalman, measurement_delay=DELAY), coarse),
    ]


def _run(plant: invtrack.Plant | invtrack.LinearPlant, case: Case, timestep: float) -> invtrack.RunResult:
    with progress(f"{case.name}, {plant.name}") as report:
        return invtrack.simulate(
            plant,
            case.controller,
            timestep=timestep,
            sensors=case.sensors,
            name=case.name,
            progress=report,
        )


def _numbers(measured: invtrack.RunResult, predicted: invtrack.RunResult) -> dict[str, Any]:
    """Metrics of the MuJoCo run under their own names, and the table's pairs."""
    physics, theory = invtrack.metrics(measured), invtrack.metrics(predicted)
    pairs = {
        f"{which}_{name}": numbers[name]
        for which, numbers in (("predicted", theory), ("measured", physics))
        for name in ("max_error", "residual_vibration", "peak_input")
    }
    return {**physics, **pairs, "status": measured.status}


if __name__ == "__main__":
    run_sim(main, defaults=SimOptions(out=Path("runs/cantilever_sensors"), timestep=1e-3), description=__doc__ or "")
