"""The equilibrium of a plant for given outputs, joint positions and controls."""

from __future__ import annotations

from collections.abc import Sequence
from types import MappingProxyType

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from invtrack.arguments import instance
from invtrack.arrays import require_share
from invtrack.errors import PlantError
from invtrack.plant.equilibrium.equations import EquilibriumEquations
from invtrack.plant.equilibrium.given import Given, Positions, Values, given_of
from invtrack.plant.equilibrium.refusals import overloads, why_not
from invtrack.plant.equilibrium.search import EquilibriumSearch, Iterate
from invtrack.plant.equilibrium.trim_point import TrimmedQuantity, TrimPoint
from invtrack.plant.linearizable import constraint_name
from invtrack.plant.plant import A_PLANT, Plant
from invtrack.plant.smooth_model import smooth_model

_OPTIONS = {"plant", "outputs", "positions", "controls", "free", "tolerance"}

_LOADS = [
    int(kind)
    for kind in (
        mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT,
        mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON,
        mujoco.mjtConstraint.mjCNSTR_CONTACT_FRICTIONLESS,
        mujoco.mjtConstraint.mjCNSTR_CONTACT_PYRAMIDAL,
        mujoco.mjtConstraint.mjCNSTR_CONTACT_ELLIPTIC,
    )
]
"""Constraints that hold a mechanism only while they touch it."""

RANK_TOLERANCE = 1e-8
"""A direction counts as left open where the scaled equations change by less than this share of the largest change."""


def trim(
    plant: Plant,
    *,
    outputs: Values | ArrayLike | None = None,
    positions: Positions | None = None,
    controls: Values | ArrayLike | None = None,
    free: Sequence[str] = (),
    tolerance: float = 1e-8,
    **parameter_values: float,
) -> TrimPoint:
    """The equilibrium of a plant in which what is given holds; everything that is not given is solved.

        qacc(q, act, u) = 0,  act'(q, act, u) = 0,  y(q, act, u) = y_given,  qvel = 0

    Unknown are the positions (in tangent space, so quaternions stay of length 1), all activations, and the controls of the plant's
    inputs and of the actuators named in `free`; others keep theirs. Gravity, springs, tendons, servos, gravity compensation,
    equality constraints and the ranges of controls, activations and joints count. Dry friction does not: it may hold the mechanism
    elsewhere, too; nor does backlash: play stays as it is, and bears any load. Contacts and limits count where there is no
    equilibrium without them, and the result names them.

    The search is local and starts from the plant's operating point (`plant.at`): where what is given leaves several equilibria it
    finds one near it. If the present posture will do it is kept, else the departure from it is the least; then the controls depart
    least from the present ones, which are 0 unless a keyframe or `plant.at` says otherwise.

        held = invtrack.trim(plant, outputs={"joint:elbow": 0.5})
        model = invtrack.linearize(held.plant)

    Args:
        plant: at the configuration to start from; its velocity does not matter.
        outputs: what outputs or measurements are to be, in sensor units, by name; or of all outputs (p,).
        positions: joint positions by name, in qpos's units: of slides and hinges a number, of ball joints a quaternion, of free
            joints (x, y, z) and a quaternion; also "NAME.x", "NAME.y", "NAME.z" alone [m], and "NAME.rx", "NAME.ry", "NAME.rz" as
            parts of the rotation vector [rad] from the present orientation.
        controls: controls of inputs or of other actuators, by name; or of all inputs (p,).
        free: names of actuators besides the plant's inputs whose controls are solved, too.
        tolerance: the largest scaled residual that counts as equilibrium; what is attained is usually near rounding.
        parameter_values: named parameters that differ from the file, as in `linearize`.

    Raises PlantError for unknown names, values beyond their range, and where no equilibrium is found, with its reason: outputs that
    contradict each other or what is given, outputs out of reach, the controls that would be needed beyond their ctrlrange, or the
    accelerations that nothing free acts on.
    """
    instance("plant", plant, Plant, expected=A_PLANT, error=PlantError)
    require_share("tolerance", tolerance, error=PlantError)
    reserved = sorted(_OPTIONS & set(plant.parameters))
    if reserved:
        raise PlantError(f"parameters cannot be called {', '.join(reserved)}, which are options of trim; rename them")
    model = plant.model_with(parameter_values)
    given = given_of(
        plant,
        model,
        outputs={} if outputs is None else outputs,
        positions={} if positions is None else positions,
        controls={} if controls is None else controls,
        free=free,
    )
    equations, found = _searched(plant, model, given, tolerance)
    return _point(equations, found, model, {**plant.parameter_values, **parameter_values})


def _searched(plant: Plant, model: mujoco.MjModel, given: Given, tolerance: float) -> tuple[EquilibriumEquations, Iterate]:
    """The equilibrium without contacts and limits; with them, where that does not exist or touches one."""
    smooth = EquilibriumEquations(plant, model, given, constraints=False)
    search = EquilibriumSearch(smooth, tolerance)
    with smooth.forces():
        found = search.nearest(smooth.start)
    overloaded: tuple[str, ...] = ()
    if not search.found(found):
        found, overloaded = _within_force_limits(plant, model, given, search, found)
    touching = _bearing(smooth.plant_at(found.z), model)
    if search.found(found) and not touching:
        return smooth, found
    touched = EquilibriumEquations(plant, model, given, constraints=True)
    starts = [touched.start] if _bearing(touched.plant_at(touched.start), model) else []
    if touching or np.any(smooth.at_bounds(found.z) & smooth.is_position):
        starts.append(found.z)
    with touched.forces():
        for start in starts:
            held = EquilibriumSearch(touched, tolerance).nearest(start)
            if held.miss <= tolerance:
                return touched, held
    with smooth.forces():
        raise PlantError(f"plant {plant.name!r} {why_not(search, found, touching, overloaded)}")


def _within_force_limits(
    plant: Plant, model: mujoco.MjModel, given: Given, search: EquilibriumSearch, found: Iterate
) -> tuple[Iterate, tuple[str, ...]]:
    """The search once more, from where the equilibrium would be if no actuator's force were limited.

    A stiff servo far from what it is to hold pushes with all its force, whatever its control: there no search sees where to go.
    Returned are what comes nearest to an equilibrium, and the forces that would have to leave their ranges.
    """
    if not any(np.any(limited) for limited in (model.actuator_forcelimited, model.jnt_actfrclimited, model.tendon_actfrclimited)):
        return found, ()
    unlimited = EquilibriumEquations(plant, model, given, constraints=False, force_limits=False)
    relaxed = EquilibriumSearch(unlimited, search.tolerance)
    with unlimited.forces():
        start = relaxed.nearest(unlimited.start)
        if not relaxed.found(start):
            return found, ()
        overloaded = overloads(unlimited, start.z, model)
    with search.equations.forces():
        again = search.nearest(start.z)
    return (again if again.miss < found.miss else found), overloaded


def _bearing(plant: Plant, model: mujoco.MjModel) -> tuple[str, ...]:
    """Contacts and limits that bear load at the plant's operating point."""
    data = plant.new_data(model)
    rows = np.flatnonzero(np.isin(data.efc_type, _LOADS) & (data.efc_force != 0)).tolist()
    return tuple(sorted({constraint_name(model, data, row) for row in rows}))


def _point(equations: EquilibriumEquations, found: Iterate, model: mujoco.MjModel, parameters: dict[str, float]) -> TrimPoint:
    plant = equations.plant_at(found.z)
    data = plant.new_data(smooth_model(model, backlash=plant.backlash).model)
    with equations.forces():
        jacobian = equations.jacobian(found.z, equations.free)
    singular = np.linalg.svd(jacobian, compute_uv=False) if jacobian.size else np.zeros(0)
    rank = int(np.sum(singular > RANK_TOLERANCE * np.max(singular, initial=0.0)))
    rates = np.concatenate([data.qacc, data.act_dot])
    quantities = _quantities(equations, plant, data)
    names = [quantity.name for quantity in quantities if quantity.kind != "output"]
    at_limits = equations.at_bounds(found.z) & ~equations.is_position
    return TrimPoint(
        plant=plant,
        parameters=MappingProxyType(parameters),
        quantities=tuple(quantities),
        residual=MappingProxyType(dict(zip(plant.coordinates.names[model.nv :], rates.tolist(), strict=True))),
        scaled_residual=found.miss,
        evaluations=equations.evaluations,
        open_directions=int(np.sum(equations.free)) - rank,
        held_by=_bearing(plant, model),
        at_limits=tuple(names[i] for i in np.flatnonzero(at_limits)),
    )


def _quantities(equations: EquilibriumEquations, plant: Plant, data: mujoco.MjData) -> list[TrimmedQuantity]:
    """The outputs, and all unknowns in their order."""
    given = equations.given
    outputs = dict(zip(plant.outputs.names, zip(plant.outputs.units, plant.output_readings.readings, strict=True), strict=True))
    outputs |= dict(zip(given.outputs.names, zip(given.outputs.units, given.output_readings.readings, strict=True), strict=True))
    quantities = [
        TrimmedQuantity("output", name, unit, reading.value(data), "given" if name in given.outputs else "follows")
        for name, (unit, reading) in outputs.items()
    ]
    origins = np.where(equations.free, "solved", np.where(given.held, "held", "given")).tolist()
    values = given.readings(equations.plant, plant).tolist()
    quantities += [TrimmedQuantity(*unknown, *rest) for unknown, *rest in zip(given.unknowns, values, origins, strict=True)]
    return quantities
