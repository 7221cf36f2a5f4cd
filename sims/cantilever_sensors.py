"""Tracking through tip-mass jumps with the sensors and the sampling rate of a real controller.

The manoeuvre of cantilever_jumps.py, but the controller acts every 10 ms and, except in the case full_state, sees only the base's
and the tip's position through imperfect sensors; an observer estimates the other states. Every case runs twice, on the linear model
(the prediction) and in MuJoCo, with the same controller, the same loop and the same noise.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

import invtrack
from invtrack.control import Controller
from invtrack.figures import comparison_figure, tracking_figure
from invtrack.studies import Case, Column, Rows, Session, Setup, Study, StudyOptions, Table

MASSES = (0.0, 100.0, 10.0)  # [kg]
JUMPS = (np.pi / 2, 3 * np.pi / 2)  # [s]
PERIOD = 0.01  # [s]
NOISE = 1e-3  # [m], standard deviation of one sample
INPUT_NOISE = 0.02  # [N per root Hz], the disturbance that the Kalman filter expects
DELAY = 0.02  # [s]
MEASUREMENTS = ("base_position", "tip_position")
LINEAR = "_linear"  # ends the names of cases on the linear model
OBSERVER_POLES = (-2 + 2j, -2 - 2j, -1.5 + 1j, -1.5 - 1j, -1 + 0.5j, -1 - 0.5j)  # [rad/s]

COMPARED = {"max_error": "m", "residual_vibration": "m", "peak_input": "N"}
COLUMNS = [
    Column(f"{which} {metric.replace('_', ' ')}", unit) for metric, unit in COMPARED.items() for which in ("predicted", "measured")
]


def build(options: StudyOptions) -> Setup:
    plant = invtrack.Plant.from_xml(
        invtrack.model_path("cantilever"),
        inputs=["base_force"],
        outputs=["tip_position"],
        measurements=MEASUREMENTS,
        parameters={"tip_mass": "body:tip:mass"},
    )
    model = invtrack.SwitchedSystem([invtrack.linearize(plant, tip_mass=mass) for mass in MASSES], JUMPS)
    plan = invtrack.invert(model, invtrack.raised_cosine(2.0), tolerance=1e-8)
    lowest, highest = plan.input_range
    limits = plant.input_limits[0]
    return Setup(
        _cases(plant, model, plan),
        sections={
            "period": PERIOD,
            "noise": NOISE,
            "delay": DELAY,
            "planned_input": {"lowest": lowest[0], "highest": highest[0]},
        },
        figures={"comparison": lambda done: comparison_figure(_in_mujoco(done), window=(-10.0, 20.0))},
        report=[
            f"plan: {plant.inputs.names[0]} from {lowest[0]:.1f} to {highest[0]:.1f} {plant.inputs.units[0]}; the actuator passes "
            f"on {limits[0]:g} to {limits[1]:g}; start {-plan.start:.1f} s before the manoeuvre",
            Table("Cantilever with tip-mass jumps: prediction and physics", COLUMNS, _pairs),
            f"controller period {1e3 * PERIOD:g} ms, observers measure {' and '.join(MEASUREMENTS)}; noise: standard\n"
            f"deviation {NOISE:g} m of each sample; coarse: besides, digits of {NOISE:g} m and a delay of {DELAY:g} s that the\n"
            "controller knows.",
        ],
    )


def _cases(plant: invtrack.Plant, model: invtrack.SwitchedSystem, plan: invtrack.Plan) -> list[Case]:
    """Each in MuJoCo and on the linear model, with the same controller and the same noise."""
    gains = invtrack.lqr(model, Q=100.0, R=0.01)
    kalman = invtrack.KalmanFilter(input_noise=INPUT_NOISE, measurement_noise=NOISE)
    placed = invtrack.LuenbergerObserver(OBSERVER_POLES)
    noisy = {name: invtrack.Sensor(noise=NOISE) for name in MEASUREMENTS}
    coarse = {name: invtrack.Sensor(noise=NOISE, quantization=NOISE, delay=DELAY) for name in MEASUREMENTS}
    linear = invtrack.LinearPlant(model, input_limits=plant.input_limits)

    def with_observer(observer: Any, **settings: float) -> invtrack.OutputFeedbackController:
        return invtrack.OutputFeedbackController(plan, gains, observer, period=PERIOD, **settings)

    def pair(name: str, controller: Controller, sensors: Mapping[str, invtrack.Sensor]) -> list[Case]:
        settings = {"sensors": sensors}
        return [
            Case(name, plant, controller, settings=settings, figures={"tracking": tracking_figure}),
            Case(name + LINEAR, linear, controller, settings=settings, recorded=False),
        ]

    return [
        *pair("full_state", invtrack.TrackingController(plan, gains, period=PERIOD), {}),
        *pair("kalman_ideal_sensors", with_observer(kalman), {}),
        *pair("kalman_noise", with_observer(kalman), noisy),
        *pair("placed_noise", with_observer(placed), noisy),
        *pair("kalman_coarse", with_observer(kalman, measurement_delay=DELAY), coarse),
    ]


def _in_mujoco(done: Session) -> list[invtrack.RunResult]:
    return done.among(name for name in done.runs if not name.endswith(LINEAR))


def _pairs(done: Session) -> Rows:
    """Prediction and physics of each case in one row."""
    rows: dict[str, Any] = {}
    for name, numbers in done.numbers.items():
        which = "predicted" if name.endswith(LINEAR) else "measured"
        row = rows.setdefault(name.removesuffix(LINEAR), {column.key: None for column in COLUMNS})
        row |= {f"{which}_{metric}": numbers.get(metric, numbers["status"]) for metric in COMPARED}
    return rows


STUDY = Study("cantilever_sensors", build, description=__doc__, defaults=StudyOptions(timestep=1e-3))

if __name__ == "__main__":
    STUDY.main()
