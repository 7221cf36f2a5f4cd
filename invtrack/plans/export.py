"""A planned trajectory sampled for hardware, what a real-time target plays at its own rate, and the plan read back from it."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, get_args

import numpy as np

from invtrack.arguments import file_path, one_of
from invtrack.arrays import Array, real_number, shown
from invtrack.errors import FileError, PlanError, TrajectoryError
from invtrack.plans.dynamics import mechanism
from invtrack.plans.plan import Plan, require_plan
from invtrack.plans.sampled import SampledPlan, origin_of, plan_from, read_samples, write_samples

Inputs = Literal["midpoint", "average", "sample"]

GAUSS_NODES = {"midpoint": 1, "average": 5}

LARGEST_PLAN = 20_000_000
"""Rows that fit into memory with room for a dozen columns; a plan beyond that is a mistyped rate."""

SIDE = 1e-6
"""Share of a period by which an instant may miss a breakpoint through rounding and still count as the breakpoint."""


def export_plan(
    plan: Plan,
    path: str | Path,
    *,
    rate: float,
    inputs: Inputs = "midpoint",
    start: float | None = None,
    end: float | None = None,
) -> Path:
    """Write `sampled_plan` to a CSV file in one piece; returns the path.

    Args:
        plan, rate, inputs, start, end: see `sampled_plan`.
        path: of the file, ending in .csv.

    Raises TrajectoryError as `sampled_plan` does; FileError for another suffix than .csv, and where the file cannot be written.
    """
    return write_samples(sampled_plan(plan, rate=rate, inputs=inputs, start=start, end=end), file_path(path))


def read_plan(path: str | Path, *, plant: object = None) -> Plan:
    """The plan in a file that `export_plan` wrote: as it was sampled, to be followed, drawn and simulated.

    Between the rows it is polynomial: u_ff is held, or linear for the inputs "sample"; x_ref and y are the cubics that agree with
    the rows and with the plant's equations at both ends of each row's time; y_d is a spline through its samples. Before the first
    and after the last row it holds what stands there. Model, manoeuvre, certificate and remarks are those of the exported plan.

    A plan on the motion of a Plant, as `invert(plant, reference)` makes it, is read back with that plant: it says how states go on
    from row to row, how they differ where it turns in space, and what is linear along the motion, for `lqr(plan, ...)`.

    Args:
        path: of the file.
        plant: the Plant that the plan was made for, where it stood then; plans on linear models do without.

    Raises FileError where the file cannot be read, holds no plan, or holds one that needs a plant and gets none, or another.
    """
    samples = read_samples(file_path(path))
    moving = None if plant is None else mechanism(plant)
    if plant is not None and moving is None:
        raise FileError(f"plant must be the invtrack.Plant that the plan was made for, got {shown(plant)}")
    try:
        return plan_from(samples, moving)
    except PlanError as error:
        raise FileError(f"{path}: {error}") from error
    except (KeyError, TypeError, ValueError) as error:
        raise FileError(f"{path} does not say which plan it comes from ({error}); export the plan again") from error


def sampled_plan(
    plan: Plan,
    *,
    rate: float,
    inputs: Inputs = "midpoint",
    start: float | None = None,
    end: float | None = None,
) -> SampledPlan:
    """The plan at t_k = start + k / rate up to `end`: x_ref, y_d and planned y at t_k, u_ff for the time until t_(k+1).

    Headers are the names and units of the plan's model. x_ref is the deviation from the operating point that `plan` was planned
    about, that before all jumps; u_ff, y_d and y are absolute. At a breakpoint y_d, y and u are taken from its right.

    Args:
        plan: what is sampled.
        rate: number of samples per second [Hz].
        inputs: what u_ff[k] is. "midpoint" (default): the input in the middle of the hold, so that a zero-order hold follows the
            plan with an error of order rate^-2. "average": its mean over the hold, with an error of the same order; it keeps the
            impulse where the input is fast against the rate. In both cases a hold across breakpoints, where u may jump, gets the
            mean of the stretches between them, weighted by their durations, so that the order stays. "sample": the input at t_k,
            for targets that interpolate; with a zero-order hold the error is of order 1 / rate.
        start, end: times [s]; by default where the plan leaves rest and where it has come to rest again.

    Raises TrajectoryError for a rate that is not positive, end before start, an unknown kind of inputs, or too many rows.
    """
    require_plan(plan)
    one_of("inputs", inputs, get_args(Inputs), error=TrajectoryError)
    start = plan.start if start is None else real_number("start", start, unit="s")
    end = plan.end if end is None else real_number("end", end, unit="s")
    rate = real_number("rate", rate, unit="Hz")
    t = _instants(rate, start, end)
    values = plan(t[:-1], inside=t[:-1] + SIDE / rate)
    return SampledPlan(
        time=t[:-1],
        u_ff=values.u if inputs == "sample" else _held_input(plan, t, GAUSS_NODES[inputs]),
        x_ref=values.x,
        y_d=values.y_d,
        y=values.y,
        names=_labels(plan),
        notes=_notes(plan, rate, inputs, t[:-1]),
        origin=origin_of(plan, inputs=inputs, end=float(t[-1])),
    )


def _instants(rate: float, start: float, end: float) -> Array:
    """t_k, and behind the last one the end of its hold."""
    if not (np.isfinite(rate) and rate > 0):
        raise TrajectoryError(f"rate must be a positive number of samples per second [Hz], got {rate}")
    if not (np.isfinite(start) and np.isfinite(end) and end >= start):
        raise TrajectoryError(f"expected start <= end, both finite [s], got start {start} and end {end}")
    rows = np.floor((end - start) * rate + SIDE) + 1
    if rows > LARGEST_PLAN:
        raise TrajectoryError(
            f"{rate} Hz from {start} s to {end} s gives {rows:.3g} rows, expected at most {LARGEST_PLAN}; lower the rate [Hz] or "
            "choose start and end closer together"
        )
    t: Array = start + np.arange(rows + 1) / rate
    return t


def _held_input(plan: Plan, t: Array, nodes: int) -> Array:
    """Mean of u over each hold (m, p) by Gauss quadrature over the stretches between breakpoints; one node is the midpoint rule."""
    breakpoints = plan.breakpoints
    edges = np.union1d(t, breakpoints[(breakpoints > t[0]) & (breakpoints < t[-1])])
    length, middle = np.diff(edges), (edges[:-1] + edges[1:]) / 2
    places, weights = np.polynomial.legendre.leggauss(nodes)
    u = sum(weight / 2 * plan(middle + place * length / 2, inside=middle).u for place, weight in zip(places, weights, strict=True))
    first = np.searchsorted(edges, t)  # where each hold's first stretch begins
    share = length / np.repeat(np.diff(t), np.diff(first))
    mean: Array = np.add.reduceat(share[:, None] * u, first[:-1], axis=0)
    return mean


def _labels(plan: Plan) -> dict[str, tuple[str, ...]]:
    """Per array its channels' names, with [unit] where it is known."""
    model = plan.model
    channels = {"u_ff": model.inputs, "x_ref": model.states, "y_d": model.outputs, "y": model.outputs}
    return {array: group.labels for array, group in channels.items()}


def _notes(plan: Plan, rate: float, inputs: Inputs, t: Array) -> tuple[str, ...]:
    meaning = {
        "midpoint": "value in the middle of the hold from t_k to t_(k+1), time-weighted mean of the stretches between breakpoints",
        "average": "mean over the hold from t_k to t_(k+1)",
        "sample": "value at t_k, to be interpolated",
    }[inputs]
    certificate = plan.certificate
    return (
        f"method: {plan.method}",
        f"rate: {rate:.17g} Hz, {len(t)} rows from {t[0]:.17g} s to {t[-1]:.17g} s",
        f"u_ff: {inputs}: {meaning}",
        "x_ref, y_d, y: at t_k; x_ref is the deviation from the operating point before all jumps, the others are absolute; "
        "u = u_ff - K (x - x_ref)",
        f"manoeuvre: {plan.manoeuvre[0]:.17g} s to {plan.manoeuvre[1]:.17g} s",
        f"preactuation: {plan.preactuation:.6g} s, postactuation: {plan.postactuation:.6g} s, to rest within "
        f"{plan.tolerance:.3g} of each peak",
        f"certificate: dynamics residual {certificate.dynamics_residual:.3g}, output error {certificate.output_error:.3g}, "
        f"continuity {certificate.continuity:.3g}, rest residual {certificate.rest_residual:.3g}",
        *(f"remark: {' '.join(remark.split())}" for remark in plan.remarks),
    )
