"""Exact and modified inverse side by side: how fast the input before the manoeuvre fades, and how alike the rest is."""

from __future__ import annotations

import numpy as np
from hover.aircraft import ATTITUDES, INPUTS, channel

import invtrack
from invtrack.inversion import ModifiedMotion, ModifiedTrajectory

FADED = 1e-3
"""The fit of the decay reaches back to where the input has fallen to this share of what it is at the start of the manoeuvre."""

SAMPLES = 200
"""Of each half-period, for its mean."""

RESOLUTION = 0.01  # [s]


def inverse_poles(plan: invtrack.Plan) -> np.ndarray:
    """Poles [1/s] of the inverse behind a plan: the plant's zeros, or where they were moved to and those of the error.

    Of a plan whose outputs are bent the zeros that this does not put to rest.
    """
    if isinstance(plan, ModifiedMotion):
        return plan.left
    if isinstance(plan, ModifiedTrajectory):
        modification = plan.modification[0]
        return np.concatenate([modification.zeros_after, modification.error_poles])
    return invtrack.linear.zeros(plan.model.systems[0])


def decay_pair(plan: invtrack.Plan) -> complex | None:
    """The antistable pole [1/s] of the inverse nearest to the axis, in the upper half-plane: it sets the preactuation.

    None where there is none: the input is then at rest until outputs begin to be bent.
    """
    antistable = [complex(pole) for pole in inverse_poles(plan) if pole.real > 0 and pole.imag >= 0]
    return min(antistable, key=lambda pole: pole.real, default=None)


def fitted_decay_rate(run: invtrack.RunResult, pair: complex) -> float:
    """Slope [1/s] of log |u| before the start of the manoeuvre: a line through its means over half-periods of the pair.

    |u| is the norm of the applied inputs. A pair alpha +- j omega makes it exp(alpha t) times a function with half the period of
    omega, which the means leave out.
    """
    half_period, start = np.pi / pair.imag, run.manoeuvre[0]
    count = int(np.ceil(np.log(1 / FADED) / pair.real / half_period))
    middle = (run.time[:-1] + run.time[1:]) / 2
    before = middle < start
    offsets = (np.arange(count * SAMPLES) + 0.5) * half_period / SAMPLES
    log_magnitude = np.interp(start - offsets, middle[before], np.log(np.linalg.norm(run.applied.values[before], axis=1)))
    means = log_magnitude.reshape(count, SAMPLES).mean(axis=1)
    return float(-np.polyfit(half_period * np.arange(count), means, 1)[0])


def likeness(exact: invtrack.Plan, modified: invtrack.Plan) -> dict[str, dict[str, float]]:
    """Of each control and attitude: its peaks over both plans; largest difference and correlation in the manoeuvre.

    The difference is a share of the exact plan's peak.
    """
    model = exact.model.systems[0]
    overall = np.arange(exact.start, exact.end, RESOLUTION)
    within = np.arange(*exact.manoeuvre, RESOLUTION)
    rows = {}
    for label, name in {**{name: name for name in INPUTS}, **ATTITUDES}.items():
        peaks = [float(np.max(np.abs(_values(plan, overall, model, name)))) for plan in (exact, modified)]
        first, second = (_values(plan, within, model, name) for plan in (exact, modified))
        rows[label] = {
            "exact_peak": peaks[0],
            "modified_peak": peaks[1],
            "largest_difference": float(np.max(np.abs(second - first))) / peaks[0],
            "correlation": float(np.corrcoef(first, second)[0, 1]),
        }
    return rows


def _values(plan: invtrack.Plan, times: np.ndarray, model: invtrack.StateSpace, name: str) -> np.ndarray:
    if name in model.inputs.names:
        return channel(plan.inputs(times), model.inputs.names, name)
    return channel(plan.states(times), model.states.names, name)
