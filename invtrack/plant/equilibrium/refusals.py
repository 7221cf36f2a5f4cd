"""Why there is no equilibrium: each reason is found by solving again without what may stand in the way."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from invtrack.arrays import Array
from invtrack.errors import PlantError
from invtrack.plant.elements import listed
from invtrack.plant.equilibrium.equations import ACTS, EquilibriumEquations, Iterate, Mask

SHOWN = 6
"""How many quantities a message names at most."""


def no_equilibrium(equations: EquilibriumEquations, found: Iterate, touching: Sequence[str]) -> PlantError:
    """The error that says why the search failed.

    Args:
        equations: without contacts and limits.
        found: what they were solved to, an equilibrium or the point nearest to one.
        touching: contacts and limits that bear load at `found`.
    """
    name = equations.plant.name
    if found.miss <= equations.tolerance:
        return PlantError(
            f"plant {name!r} has an equilibrium only where {listed(touching)} pushes it away; start from a configuration clear of"
            " that (plant.at), or give other outputs or positions"
        )
    with equations.forces():
        reason = (
            _outputs_out_of_reach(equations)
            or _held_controls(equations, found)
            or _beyond_range(equations, found)
            or _what_is_left(equations, found)
        )
    return PlantError(f"plant {name!r} has no such equilibrium: {reason}")


def _outputs_out_of_reach(equations: EquilibriumEquations) -> str:
    """Outputs that cannot be had at all, whatever the forces; "" where they can."""
    outputs, values = equations.given.outputs, equations.given.output_values
    rows = np.arange(len(equations.scales.equations)) >= len(equations.scales.equations) - len(outputs)
    together = equations.search(equations.start, equations.free, rows=rows)
    if together.miss <= equations.tolerance:
        return ""
    wanted = _phrases(outputs.names, outputs.units, values)
    if np.any(np.isfinite(equations.bounds[equations.free])):
        unbounded = equations.search(equations.start, equations.free, rows=rows, bounded=False)
        if unbounded.miss <= equations.tolerance:
            return f"{listed(wanted)} would take {_beyond(equations, unbounded.z)}. Give outputs within reach, or widen the range"
    reasons = []
    for i, row in enumerate(np.flatnonzero(rows)):
        only = np.arange(len(rows)) == row
        alone = equations.search(equations.start, equations.free, rows=only) if len(wanted) > 1 else together
        if alone.miss > equations.tolerance:
            (closest,) = _phrases([outputs.names[i]], [outputs.units[i]], values[[i]] + equations.values(alone.z)[only])
            points = (equations.start, alone.z, equations.start + equations.aside(equations.free))  # it may be stationary at some
            if any(np.any(np.abs(equations.jacobian(z, equations.free)[row]) > ACTS) for z in points):
                reasons.append(f"{wanted[i]} is out of reach, the nearest is {closest}")
            else:
                reasons.append(f"nothing that is free acts on {closest} at rest, and {values[i]:g} is asked for")
    if reasons:
        return f"{'; '.join(reasons)}. Give outputs within reach"
    nearest = _phrases(outputs.names, outputs.units, values + equations.values(together.z)[rows])
    return f"the outputs {listed(wanted)} cannot hold together, the nearest are {listed(nearest)}. Give fewer of them"


def _held_controls(equations: EquilibriumEquations, found: Iterate) -> str:
    """Actuators that are no inputs and would have to change their control; "" where that does not help."""
    held = equations.given.held
    if not np.any(held):
        return ""
    free = equations.free | held
    solved = equations.search(equations.start, free & ~equations.is_position)
    if solved.miss > equations.tolerance:
        solved = equations.search(found.z, free)
    if solved.miss > equations.tolerance:
        return ""
    units = equations.scales.unknowns
    changed = held & (np.abs(solved.z - equations.start) > equations.tolerance * units)
    names = [unknown.name for unknown, moved in zip(equations.given.unknowns, changed, strict=True) if moved]
    return (
        f"actuators that are no inputs hold their controls, and it would take {_named(equations, changed, solved.z)}. Add"
        f" free={names} to solve for them, too, or set them by plant.at(ctrl=...)"
    )


def _beyond_range(equations: EquilibriumEquations, found: Iterate) -> str:
    """Controls, activations and joints that would have to leave their range; "" where that does not help either."""
    for start, free in (
        (equations.start, equations.free & ~equations.is_position),
        (found.z, equations.free & ~equations.is_position),
        (found.z, equations.free),
    ):
        solved = equations.search(start, free, bounded=False)
        beyond = _beyond(equations, solved.z)
        if solved.miss <= equations.tolerance and beyond:
            return f"it would take {beyond}. Widen the range, or give other outputs or positions"
    return ""


def _what_is_left(equations: EquilibriumEquations, found: Iterate) -> str:
    """The accelerations and rates that remain, and whether anything could act on them."""
    names = [*equations.plant.coordinates.names[equations.model.nv :], *equations.given.outputs.names]
    units = [*(f"{unit} per s" for unit in equations.plant.coordinates.units[equations.model.nv :]), *equations.given.outputs.units]
    values, jacobian = equations.values(found.z), equations.jacobian(found.z, equations.free)
    largest = [i for i in np.argsort(-np.abs(found.residual))[:SHOWN] if abs(found.residual[i]) > 1e-3 * found.miss]
    left = listed(f"{names[i]}: {values[i]:.6g} {units[i]}" for i in largest)
    idle = [names[i] for i in largest if np.max(np.abs(jacobian[i]), initial=0.0) <= ACTS]
    text = f"the nearest point to one leaves the rates {left}"
    if idle:
        return f"{text}, and no control or position that is free acts on {listed(idle)}. Give less, or an actuator for it"
    friction = np.any(equations.plant.model.dof_frictionloss) or np.any(equations.plant.model.tendon_frictionloss)
    stuck = ", which dry friction alone may hold (it is left out here)" if friction else ""
    return f"{text}{stuck}. Start the search elsewhere (plant.at(qpos=...)), or give less"


def _beyond(equations: EquilibriumEquations, z: Array) -> str:
    """The unknowns that leave their bounds at z, with their ranges; "" where none does."""
    low, high = equations.bounds.T
    slack = 1e-9 * equations.scales.unknowns
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
