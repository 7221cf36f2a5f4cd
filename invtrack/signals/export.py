"""A planned trajectory sampled for hardware: what a real-time target plays, at its own rate."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from invtrack.errors import TrajectoryError
from invtrack.signals.nominal import NominalTrajectory
from invtrack.signals.plan_file import Plan, write_plan

Array = NDArray[np.float64]

Hold = Literal["midpoint", "average", "sample"]

GAUSS_NODES = {"midpoint": 1, "average": 5}

LARGEST_PLAN = 20_000_000
"""Rows that fit into memory with room for a dozen columns; a plan beyond that is a mistyped rate."""

SIDE = 1e-6
"""Share of a period by which an instant may miss a breakpoint through rounding and still count as the breakpoint."""


def export_plan(
    nominal: NominalTrajectory,
    path: str | Path,
    *,
    rate: float,
    hold: Hold = "midpoint",
    start: float | None = None,
    stop: float | None = None,
    units: Mapping[str, str] | None = None,
) -> Path:
    """Write `sampled_plan` to a file, .csv or .npz by its suffix, in one piece; returns the path.

    Raises TrajectoryError as `sampled_plan` does, for another suffix, and where the file cannot be written.
    """
    return write_plan(sampled_plan(nominal, rate=rate, hold=hold, start=start, stop=stop, units=units), path)


def sampled_plan(
    nominal: NominalTrajectory,
    *,
    rate: float,
    hold: Hold = "midpoint",
    start: float | None = None,
    stop: float | None = None,
    units: Mapping[str, str] | None = None,
) -> Plan:
    """The plan at t_k = start + k / rate up to `stop`: x_ref, y_d and planned y at t_k, u_ff for the time until t_(k+1).

    rate [Hz]. start, stop [s]: by default where the plan leaves rest and where it has come to rest again. hold: what u_ff[k] is.
    "midpoint" (default): its value in the middle of the hold, so that a zero-order hold follows the plan with an error of order
    rate^-2. "average": its mean over the hold, of the same order; it keeps the impulse where the input is fast against the rate.
    "sample": its value at t_k, for targets that interpolate; with a zero-order hold the error is of order 1 / rate. In the first
    two cases a hold across breakpoints, where u may jump, gets the mean of the stretches between them, weighted by their durations,
    so that the order stays. At a breakpoint itself y_d, y and u are taken from its right.

    units: from a channel's name to its unit, for the headers. x_ref is the deviation from the operating point that `nominal` was
    planned about; u_ff, y_d and y are absolute.

    Raises TrajectoryError for a rate that is not positive, stop before start, an unknown hold or channel, or too many rows.
    """
    if hold not in get_args(Hold):
        raise TrajectoryError(f"hold must be one of {list(get_args(Hold))}, got {hold!r}")
    start, stop = nominal.start if start is None else start, nominal.end if stop is None else stop
    t = _instants(rate, start, stop)
    values = nominal(t[:-1], inside=t[:-1] + SIDE / rate)
    return Plan(
        time=t[:-1],
        u_ff=values.u if hold == "sample" else _held_input(nominal, t, GAUSS_NODES[hold]),
        x_ref=values.x,
        y_d=values.y_d,
        y=values.y,
        names=_labels(nominal, units or {}),
        notes=_notes(nominal, rate, hold, t[:-1]),
    )


def _instants(rate: float, start: float, stop: float) -> Array:
    """t_k, and behind the last one the end of its hold."""
    if not (np.isfinite(rate) and rate > 0):
        raise TrajectoryError(f"rate must be a positive number of samples per second [Hz], got {rate}")
    if not (np.isfinite(start) and np.isfinite(stop) and stop >= start):
        raise TrajectoryError(f"expected start <= stop, both finite [s], got start {start} and stop {stop}")
    rows = np.floor((stop - start) * rate + SIDE) + 1
    if rows > LARGEST_PLAN:
        raise TrajectoryError(
            f"{rate} Hz from {start} s to {stop} s gives {rows:.3g} rows, expected at most {LARGEST_PLAN}; lower the rate [Hz] or "
            "choose start and stop closer together"
        )
    t: Array = start + np.arange(rows + 1) / rate
    return t


def _held_input(nominal: NominalTrajectory, t: Array, nodes: int) -> Array:
    """Mean of u over each hold (m, p) by Gauss quadrature over the stretches between breakpoints; one node is the midpoint rule."""
    breakpoints = nominal.breakpoints
    edges = np.union1d(t, breakpoints[(breakpoints > t[0]) & (breakpoints < t[-1])])
    length, middle = np.diff(edges), (edges[:-1] + edges[1:]) / 2
    places, weights = np.polynomial.legendre.leggauss(nodes)
    u = sum(
        weight / 2 * nominal(middle + place * length / 2, inside=middle).u for place, weight in zip(places, weights, strict=True)
    )
    first = np.searchsorted(edges, t)  # where each hold's first stretch begins
    share = length / np.repeat(np.diff(t), np.diff(first))
    mean: Array = np.add.reduceat(share[:, None] * u, first[:-1], axis=0)
    return mean


def _labels(nominal: NominalTrajectory, units: Mapping[str, str]) -> dict[str, tuple[str, ...]]:
    """Per array its channels' names, with [unit] where one is given."""
    system = nominal.model.systems[0]
    names = {"u_ff": system.input_names, "x_ref": system.state_names, "y_d": system.output_names, "y": system.output_names}
    known = {name for group in names.values() for name in group}
    if unknown := set(units) - known:
        raise TrajectoryError(f"units name no channel: {', '.join(sorted(unknown))}; the channels are: {', '.join(sorted(known))}")
    return {array: tuple(f"{name} [{units[name]}]" if name in units else name for name in group) for array, group in names.items()}


def _notes(nominal: NominalTrajectory, rate: float, hold: Hold, t: Array) -> tuple[str, ...]:
    meaning = {
        "midpoint": "value in the middle of the hold from t_k to t_(k+1), time-weighted mean of the stretches between breakpoints",
        "average": "mean over the hold from t_k to t_(k+1)",
        "sample": "value at t_k, to be interpolated",
    }[hold]
    certificate = nominal.certificate
    return (
        f"method: {nominal.method}",
        f"rate: {rate:.17g} Hz, {len(t)} rows from {t[0]:.17g} s to {t[-1]:.17g} s",
        f"u_ff: {hold}: {meaning}",
        "x_ref, y_d, y: at t_k; x_ref is the deviation from the operating point, the others are absolute; u = u_ff - K (x - x_ref)",
        f"support of the manoeuvre: {nominal.support[0]:.17g} s to {nominal.support[1]:.17g} s",
        f"preactuation: {nominal.preactuation:.6g} s, postactuation: {nominal.postactuation:.6g} s, to rest within "
        f"{nominal.tolerance:.3g} of each peak",
        f"certificate: dynamics residual {certificate.dynamics_residual:.3g}, output error {certificate.output_error:.3g}, "
        f"continuity {certificate.continuity:.3g}, rest residual {certificate.rest_residual:.3g}",
        *(f"remark: {' '.join(remark.split())}" for remark in nominal.remarks),
    )
