"""The paper's figures 2 to 9, with HE3 in the place of its plant."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np
from hover.aircraft import ATTITUDES, INPUTS, NONLINEAR, OUTPUTS, channel

import invtrack
from invtrack.figures import Line, overlay_figure
from invtrack.studies import Session

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SAMPLES = 8001
BEFORE, AFTER = 8.0, 10.0  # [s] shown around the manoeuvre
LONG_BEFORE = 60.0  # [s] shown where the preactuation is the subject
FAINTEST = 1e-6  # |u| below this is not drawn on the logarithmic axis
SMALLEST = 1e-12  # errors below this are drawn at it
UNITS = {"U": "m/s", "W": "m/s", "V": "m/s", "R": "rad/s"}
MOTIONS = {"U": "forward", "W": "downward", "V": "lateral", "R": "yaw rate"}

Plans = Mapping[str, invtrack.Plan]
Runs = Mapping[str, invtrack.RunResult]
Panels = list[tuple[str, dict[str, Line]]]


def papers_figures(plans: Plans) -> dict[str, Callable[[Session], Figure]]:
    """By file name; the session's runs in MuJoCo have the plans' names."""
    T_i, T_f = next(iter(plans.values())).manoeuvre
    wanted, near, long = (T_i - 1.0, T_f + 1.0), (T_i - BEFORE, T_f + AFTER), (T_i - LONG_BEFORE, T_f)

    def figure(subject: str, panels: Panels, window: tuple[float, float]) -> Figure:
        return _overlay(subject, panels, window, (T_i, T_f))

    def runs(done: Session) -> Runs:
        return {run.name: run for run in done.among(plans)}

    return {
        "figure_2_desired_velocities": lambda done: figure("desired velocities", _desired(plans, 0), wanted),
        "figure_3_desired_accelerations": lambda done: figure("desired accelerations", _desired(plans, 1), wanted),
        "figure_4_lateral_and_vertical_velocity": lambda done: figure(
            "lateral and vertical velocity", _outputs("VW", plans, runs(done)), wanted
        ),
        "figure_5_forward_velocity_and_yaw_rate": lambda done: figure(
            "forward velocity and yaw rate (desired: zero)", _outputs("UR", plans, runs(done)), near
        ),
        "figure_6_inputs": lambda done: figure(
            "feedforward inputs, collective and longitudinal cyclic", _inputs(INPUTS[:2], plans), near
        ),
        "figure_7_inputs": lambda done: figure(
            "feedforward inputs, lateral cyclic and tail rotor", _inputs(INPUTS[2:], plans), near
        ),
        "figure_8_attitudes": lambda done: figure("pitch and roll", _attitudes(plans, runs(done)), near),
        "figure_9_preactuation": lambda done: figure("preactuation in the feedforward", _magnitudes(plans), long),
    }


def errors_in_mujoco(done: Session) -> Figure:
    """The size of each output's error in MuJoCo, of the plans for the linear model and for the rigid body."""
    runs = {run.name: run for run in done.among([name + planned for name in ("exact", "modified") for planned in ("", NONLINEAR)])}
    panels: Panels = []
    for column, name in enumerate(OUTPUTS):
        sizes = {case: np.maximum(np.abs(run.error[:, column]), SMALLEST) for case, run in runs.items()}
        panels.append(
            (f"log10 of |error of {name}| [{UNITS[name]}]", {case: (runs[case].time, np.log10(e)) for case, e in sizes.items()})
        )
    T_i, T_f = next(iter(runs.values())).manoeuvre
    return _overlay("errors in MuJoCo", panels, (T_i - BEFORE, T_f + AFTER), (T_i, T_f))


def _overlay(subject: str, panels: Panels, window: tuple[float, float], manoeuvre: tuple[float, float]) -> Figure:
    return overlay_figure(f"hover (HE3): {subject}", panels=panels, window=window, manoeuvre=manoeuvre)


def _times(plans: Plans) -> np.ndarray:
    T_i, T_f = next(iter(plans.values())).manoeuvre
    return np.linspace(T_i - LONG_BEFORE, T_f + AFTER, SAMPLES)


def _desired(plans: Plans, derivative: int) -> Panels:
    time = _times(plans)
    wanted = next(iter(plans.values())).reference(time, derivative=derivative)
    kind, unit = (("velocity", "m/s"), ("acceleration", "m/s²"))[derivative]
    return [(f"{MOTIONS[name]} {kind} [{unit}]", {"desired": (time, wanted[:, list(OUTPUTS).index(name)])}) for name in "VW"]


def _outputs(names: str, plans: Plans, runs: Runs) -> Panels:
    time = _times(plans)
    panels: Panels = []
    for name in names:
        column = list(OUTPUTS).index(name)
        curves: dict[str, Line] = {case: (time, plan(time).y[:, column]) for case, plan in plans.items()}
        curves |= {f"{case}, MuJoCo": (run.time, run.output.values[:, column]) for case, run in runs.items()}
        panels.append((f"{MOTIONS[name]} {name} [{UNITS[name]}]", curves))
    return panels


def _inputs(names: tuple[str, ...], plans: Plans) -> Panels:
    time = _times(plans)
    return [
        (
            f"{name.replace('_', ' ')} [HE3's unit]",
            {case: (time, channel(plan.inputs(time), plan.model.inputs.names, name)) for case, plan in plans.items()},
        )
        for name in names
    ]


def _attitudes(plans: Plans, runs: Runs) -> Panels:
    time = _times(plans)
    panels: Panels = []
    for label, name in ATTITUDES.items():
        curves: dict[str, Line] = {
            case: (time, channel(plan.states(time), plan.model.states.names, name)) for case, plan in plans.items()
        }
        curves |= {f"{case}, MuJoCo": (run.time, run.state[name]) for case, run in runs.items()}
        panels.append((f"{label} [rad]", curves))
    return panels


def _magnitudes(plans: Plans) -> Panels:
    time = _times(plans)
    magnitudes = {case: np.linalg.norm(plan.inputs(time), axis=1) for case, plan in plans.items()}
    return [
        ("|u| [HE3's unit]", {case: (time, values) for case, values in magnitudes.items()}),
        (
            "log10 of |u|",
            {case: (time, np.log10(np.where(values > FAINTEST, values, np.nan))) for case, values in magnitudes.items()},
        ),
    ]
