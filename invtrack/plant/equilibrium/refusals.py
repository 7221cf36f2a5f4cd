"""Why there is no equilibrium: each reason is found by solving again without what may stand in the way."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import mujoco
import numpy as np

from invtrack.arrays import Array
from invtrack.plant.elements import element_name, listed
from invtrack.plant.equilibrium.equations import EquilibriumEquations
from invtrack.plant.equilibrium.given import Mask
from invtrack.plant.equilibrium.search import ACTS, EquilibriumSearch, Iterate

SHOWN = 6
"""How many quantities a message names at most."""


def why_not(search: EquilibriumSearch, found: Iterate, touching: Sequence[str], overloaded: Sequence[str]) -> str:
    """The predicate of a sentence about the plant: why it has no equilibrium, and what would help.

    Args:
        search: of the equations without contacts and limits, within their `forces`.
        found: what they were solved to, an equilibrium or the point nearest to one.
        touching: contacts and limits that bear load at `found`.
        overloaded: forces beyond their ranges with which there would be an equilibrium.
    """
    if search.found(found):
        return (
            f"has an equilibrium only where {listed(touching)} pushes it away; start from a configuration clear of that"
            " (plant.at), or give other outputs or positions"
        )
    if overloaded:
        return (
            f"has no such equilibrium: it would take {listed(overloaded)}. Widen the range (or gear the actuator differently), or"
            " give other outputs or positions"
        )
    reason = (
        _outputs_out_of_reach(search)
        or _held_controls(search, found)
        or _beyond_range(search, found)
        or _what_is_left(search, found)
    )
    return f"has no such equilibrium: {reason}"


def overloads(equations: EquilibriumEquations, z: Array, model: mujoco.MjModel) -> tuple[str, ...]:
    """The forces of actuators, and those of actuators on joints and tendons, that leave their ranges in `model` at z."""
    equations.values(z)
    data = equations.data
    on_joints = data.qfrc_actuator[model.jnt_dofadr]
    on_tendons = np.array([data.actuator_force[_pulls(model, tendon)].sum() for tendon in range(model.ntendon)])
    texts = []
    for kind, forces, limited, ranges, name in (
        ("actuator", data.actuator_force, model.actuator_forcelimited, model.actuator_forcerange, "forcerange"),
        ("joint", on_joints, model.jnt_actfrclimited, model.jnt_actfrcrange, "actuatorfrcrange"),
        ("tendon", on_tendons, model.tendon_actfrclimited, model.tendon_actfrcrange, "actuatorfrcrange"),
    ):
        for i in np.flatnonzero(limited):
            low, high = ranges[i]
            if not low <= forces[i] <= high:
                element = element_name(model, kind, int(i))
                texts.append(f"{forces[i]:.6g} of {kind} {element}, beyond its {name} [{low:g}, {high:g}]")
    return tuple(texts)


def _pulls(model: mujoco.MjModel, tendon: int) -> Mask:
    """The actuators that pull a tendon."""
    pulls = (model.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON) & (model.actuator_trnid[:, 0] == tendon)
    return np.asarray(pulls)


def _outputs_out_of_reach(search: EquilibriumSearch) -> str:
    """Outputs that cannot be had at all, whatever the forces; "" where they can."""
    equations = search.equations
    outputs, values = equations.given.outputs, equations.given.output_values
    rows = np.arange(len(equations.scales)) >= len(equations.scales) - len(outputs)
    together = search.solve(equations.start, equations.free, rows=rows)
    if search.found(together):
        return ""
    wanted = _phrases(outputs.names, outputs.units, values)
    if np.any(np.isfinite(equations.bounds[equations.free])):
        unbounded = search.solve(equations.start, equations.free, rows=rows, bounded=False)
        if search.found(unbounded):
            return f"{listed(wanted)} would take {_beyond(equations, unbounded.z)}. Give outputs within reach, or widen the range"
    reasons = []
    for i, row in enumerate(np.flatnonzero(rows)):
        only = np.arange(len(rows)) == row
        alone = search.solve(equations.start, equations.free, rows=only) if len(wanted) > 1 else together
        if not search.found(alone):
            (closest,) = _phrases([outputs.names[i]], [outputs.units[i]], values[[i]] + equations.values(alone.z)[only])
            points = (equations.start, alone.z, equations.start + search.aside(equations.free))  # it may be stationary at some
            if any(np.any(np.abs(equations.jacobian(z, equations.free)[row]) > ACTS) for z in points):
                reasons.append(f"{wanted[i]} is out of reach, the nearest found is {closest}")
            else:
                reasons.append(f"nothing that is free acts on {closest} at rest, and {values[i]:g} is asked for")
    if reasons:
        return f"{'; '.join(reasons)}. Give outputs within reach"
    nearest = _phrases(outputs.names, outputs.units, values + equations.values(together.z)[rows])
    return (
        f"no posture is found in which {listed(wanted)} hold together, the nearest has {listed(nearest)}. Give fewer of them,"
        " or start nearer to such a posture (plant.at(qpos=...))"
    )


def _held_controls(search: EquilibriumSearch, found: Iterate) -> str:
    """Actuators that are no inputs and would have to change their control; "" where that does not help."""
    equations = search.equations
    held = equations.given.held
    if not np.any(held):
        return ""
    free = equations.free | held
    solved = search.solve(equations.start, free & ~equations.is_position)
    if not search.found(solved):
        solved = search.solve(found.z, free)
    if not search.found(solved):
        return ""
    units = equations.units
    changed = held & (np.abs(solved.z - equations.start) > search.tolerance * units)
    names = [unknown.name for unknown, moved in zip(equations.given.unknowns, changed, strict=True) if moved]
    return (
        f"actuators that are no inputs hold their controls, and it would take {_named(equations, changed, solved.z)}. Add"
        f" free={names} to solve for them, too, or set them by plant.at(ctrl=...)"
    )


def _beyond_range(search: EquilibriumSearch, found: Iterate) -> str:
    """Controls, activations and joints that would have to leave their range; "" where that does not help either."""
    equations = search.equations
    for start, free in (
        (equations.start, equations.free & ~equations.is_position),
        (found.z, equations.free & ~equations.is_position),
        (found.z, equations.free),
    ):
        solved = search.solve(start, free, bounded=False)
        beyond = _beyond(equations, solved.z)
        if search.found(solved) and beyond:
            return f"it would take {beyond}. Widen the range, or give other outputs or positions"
    return ""


def _what_is_left(search: EquilibriumSearch, found: Iterate) -> str:
    """The accelerations and rates that remain, and whether anything could act on them."""
    equations = search.equations
    names = [*equations.plant.coordinates.names[equations.model.nv :], *equations.given.outputs.names]
    units = [*(f"{unit} per s" for unit in equations.plant.coordinates.units[equations.model.nv :]), *equations.given.outputs.units]
    nv, na = equations.model.nv, equations.model.na
    values = np.concatenate([equations.rates(found.z), equations.values(found.z)[nv + na :]])
    jacobian = equations.jacobian(found.z, equations.free)
    largest = [i for i in np.argsort(-np.abs(found.residual))[:SHOWN] if abs(found.residual[i]) > 1e-3 * found.miss]
    left = listed(f"{names[i]}: {values[i]:.6g} {units[i]}" for i in largest)
    idle = [names[i] for i in largest if np.max(np.abs(jacobian[i]), initial=0.0) <= ACTS]
    text = f"the nearest point to one leaves the rates {left}"
    if idle:
        touch = "; or start where it touches what is to carry it (plant.at(qpos=...)): only from there contacts count"
        return (
            f"{text}, and no control or position that is free acts on {listed(idle)}. Give less, or an actuator for it"
            f"{touch if _may_touch(equations.plant.model) else ''}"
        )
    friction = np.any(equations.plant.model.dof_frictionloss) or np.any(equations.plant.model.tendon_frictionloss)
    stuck = ", which dry friction alone may hold (it is left out here)" if friction else ""
    return f"{text}{stuck}. Start the search elsewhere (plant.at(qpos=...)), or give less"


def _may_touch(model: mujoco.MjModel) -> bool:
    """Whether there are geoms of two bodies that may collide."""
    if model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_CONTACT):
        return False
    meets = (model.geom_contype[:, None] & model.geom_conaffinity) != 0
    bodies = model.body_weldid[model.geom_bodyid]
    return bool(np.any((meets | meets.T) & (bodies[:, None] != bodies)))


def _beyond(equations: EquilibriumEquations, z: Array) -> str:
    """The unknowns that leave their bounds at z, with their ranges; "" where none does."""
    low, high = equations.bounds.T
    slack = 1e-9 * equations.units
    return _named(equations, (z < low - slack) | (z > high + slack), z)


def _named(equations: EquilibriumEquations, which: Mask, z: Array) -> str:
    """The unknowns that the mask picks: kind, name, value, unit and range; "" for none."""
    unknowns = equations.given.unknowns
    readings = equations.given.readings(equations.plant, equations.plant_at(z))
    offset = readings - z
    texts = []
    for i in np.flatnonzero(which)[:SHOWN]:
        low, high = equations.bounds[i] + offset[i]
        span = f" (range [{low:g}, {high:g}])" if np.isfinite(low) or np.isfinite(high) else ""
        texts.append(f"{unknowns[i].kind} {unknowns[i].name} = {readings[i]:.6g}{_suffix(unknowns[i].unit)}{span}")
    return ", ".join(texts)


def _phrases(names: Iterable[str], units: Iterable[str], values: Array) -> list[str]:
    return [f"{name} = {value:.6g}{_suffix(unit)}" for name, unit, value in zip(names, units, values.tolist(), strict=True)]


def _suffix(unit: str) -> str:
    return "" if unit in ("", "1") else f" {unit}"
