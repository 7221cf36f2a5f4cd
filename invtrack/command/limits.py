"""Limits as a user states them by the names of channels, and whether plans keep to them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from invtrack.arrays import Array
from invtrack.errors import InvtrackError
from invtrack.plans.plan import Plan, dense_times
from invtrack.plant import Plant
from invtrack.redesign import Limits
from invtrack.redesign.limited.limit_check import tail_excess
from invtrack.redesign.limits import Bound

RATE = ":rate"
"""Follows the name of an input whose rate is meant."""

KEPT = 1e-9
"""A limit counts as kept where it is exceeded by no more than this share of its size."""


def stated_limits(texts: Sequence[str], plant: Plant) -> Limits | None:
    """The limits in "drive=12", "drive:rate=50", "site:tip:x=-1:2", within what the actuators pass on; None where none is stated.

    Raises InvtrackError for names that the plant does not have, and what is no range.
    """
    if not texts:
        return None
    inputs, outputs = len(plant.inputs), len(plant.outputs)
    sides = {"input": plant.input_limits.T.copy(), "input_rate": _free(inputs), "output": _free(outputs)}
    for text in texts:
        name, _, value = text.rpartition("=")
        kind, index = _channel(name.strip(), text, plant)
        low, high = _range(value)
        sides[kind][:, index] = max(low, sides[kind][0, index]), min(high, sides[kind][1, index])
    return Limits(**{kind: (low, high) for kind, (low, high) in sides.items()})


def exceeded(plan: Plan, bounds: Sequence[Bound]) -> list[str]:
    """Which limits the plan goes beyond, with by how much, over all of time."""
    times, inside = dense_times(plan.breakpoints)
    at, point = plan(times, inside=inside), plan.model.operating_point
    values = np.hstack([at.x, at.u - point.u0, at.y - point.y0])
    between = np.diff(times) > 0
    rates = np.diff(values, axis=0)[between] / np.diff(times)[between, np.newaxis]
    jumps = np.diff(values, axis=0)[~between]
    tails = np.array([tail_excess(tail, bounds) for tail in (plan.trajectory.before, plan.trajectory.after)])
    found = []
    for bound, excess in zip(bounds, np.max(tails, axis=0, initial=-np.inf), strict=True):
        if bound.kind == "input rate" and np.any(
            np.abs(jumps @ bound.row) > KEPT * np.max(np.abs(values @ bound.row), initial=0.0)
        ):
            found.append(f"{bound} is not kept by an input that jumps")
            continue
        most = max(float(excess), float(np.max(bound.excess((rates if bound.kind == "input rate" else values) @ bound.row))))
        if most > KEPT:
            found.append(f"{bound} is exceeded by {100 * most:.3g} % of it")
    return found


def _free(count: int) -> Array:
    return np.array([[-np.inf], [np.inf]]) * np.ones(count)


def _channel(name: str, text: str, plant: Plant) -> tuple[str, int]:
    for kind, channels in (("input", plant.inputs), ("output", plant.outputs)):
        if name in channels.names:
            return kind, channels.index(name)
    if name.removesuffix(RATE) in plant.inputs.names:
        return "input_rate", plant.inputs.index(name.removesuffix(RATE))
    names = ", ".join([*plant.inputs.names, *(f"{each}{RATE}" for each in plant.inputs.names), *plant.outputs.names])
    raise InvtrackError(f"--limit: expected NAME=VALUE with one of {names}, got {text!r}")


def _range(text: str) -> tuple[float, float]:
    """(-5, 5) from "5", (-1, 2) from "-1:2". Raises InvtrackError for anything else."""
    low, colon, high = text.partition(":")
    try:
        sides = (float(low), float(high)) if colon else (-float(low), float(low))
    except ValueError:
        sides = (0.0, 0.0)
    if not sides[0] < sides[1]:
        raise InvtrackError(f"--limit: expected a positive number, or LOW:HIGH, got {text!r}")
    return sides
