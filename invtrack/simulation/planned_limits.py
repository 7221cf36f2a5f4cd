"""Which limits of a MuJoCo plant a plan goes beyond: its states and inputs put into the model, without simulating anything."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from weakref import WeakKeyDictionary

import mujoco
import numpy as np

from invtrack.arrays import Array
from invtrack.plans.plan import Plan
from invtrack.plant.configuration import configuration_of
from invtrack.plant.plant import Plant
from invtrack.simulation.acting_limits import ActingLimit, first_and_most
from invtrack.simulation.active_constraints import ActiveConstraints
from invtrack.simulation.actuation import Actuation

SAMPLES = 501
"""Evenly spaced over the whole plan, and as many over its manoeuvre."""


def limits_along(plant: Plant, plan: Plan) -> list[tuple[ActingLimit, float, float]]:
    """Limits of forces, activations, joints and tendons that the plan goes beyond, and contacts that it would make.

    Each with the time [s] at which it first does, and by how much at most, in the order of these times. The limits of the inputs
    themselves (`Plant.input_limits`) are not among them. Between the samples nothing is looked at.
    """
    known = _known.setdefault(plan, WeakKeyDictionary())
    if plant not in known:  # a plan that is driven a thousand times is looked through once
        known[plant] = _limits_along(plant, plan)
    return known[plant]


_known: WeakKeyDictionary[Plan, WeakKeyDictionary[Plant, list[tuple[ActingLimit, float, float]]]] = WeakKeyDictionary()


def _limits_along(plant: Plant, plan: Plan) -> list[tuple[ActingLimit, float, float]]:
    found: dict[ActingLimit, tuple[float, float]] = {}
    for model, times in _stretches(plant, plan):
        constraints, actuation = ActiveConstraints(model), Actuation(plant, model)
        inputs = len(plant.inputs)
        if not constraints.possible and len(actuation.limits) == inputs:
            continue
        samples = plan(times)
        raw = _raw_states(plant, model, plan, samples.x)
        _, excess = actuation.passed_on(raw, samples.u)
        for limit, beyond in zip(actuation.limits[inputs:], excess.T[inputs:], strict=True):
            _keep(found, limit, samples.time, beyond)
        if constraints.possible:
            _constrained(found, plant, constraints, model, raw, samples.time)
    return sorted(((limit, first, most) for limit, (first, most) in found.items()), key=lambda each: each[1])


def _stretches(plant: Plant, plan: Plan) -> Iterator[tuple[mujoco.MjModel, Array]]:
    """Between the changes that the plan knows of: the model with the parameters in force, and times at which to look."""
    times = np.unique(np.concatenate([np.linspace(*span, SAMPLES) for span in ((plan.start, plan.end), plan.manoeuvre)]))
    times = times[(times >= plan.start) & (times <= plan.end)]
    values = dict(plan.model.parameters)
    edges = [-np.inf, *(time for time, _ in plan.schedule), np.inf]
    for (begins, ends), new in zip(pairwise(edges), [{}, *(new for _, new in plan.schedule)], strict=True):
        values.update(new)
        inside = times[(times >= begins) & (times < ends)]
        if len(inside):
            model = plant.model_with({name: value for name, value in values.items() if name in plant.parameters})
            yield model, inside


def _raw_states(plant: Plant, model: mujoco.MjModel, plan: Plan, x: Array) -> Array:
    """(qpos, qvel, act), (k, nq + nv + na), of states x (k, n)."""
    x0 = plan.model.operating_point.x0
    return np.array([np.concatenate(configuration_of(model, x0, plant.coordinates_of(row))) for row in x])


def _constrained(
    found: dict[ActingLimit, tuple[float, float]],
    plant: Plant,
    constraints: ActiveConstraints,
    model: mujoco.MjModel,
    raw: Array,
    time: Array,
) -> None:
    """Add the constraints that act at raw states (k, .) at times (k,)."""
    data = mujoco.MjData(model)
    plant.configuration.write(data)
    depths: dict[ActingLimit, Array] = {}
    for i, row in enumerate(raw):
        data.qpos[:] = row[: model.nq]
        mujoco.mj_fwdPosition(model, data)
        for key, depth in constraints.excess(data).items():
            depths.setdefault(constraints.limit(key), np.zeros(len(raw)))[i] = depth
    for limit, beyond in depths.items():
        _keep(found, limit, time, beyond)


def _keep(found: dict[ActingLimit, tuple[float, float]], limit: ActingLimit, time: Array, beyond: Array) -> None:
    seen = first_and_most(beyond, time)
    if seen is not None:
        first, most = found.get(limit, seen)
        found[limit] = (min(first, seen[0]), max(most, seen[1]))
