"""Refusals: where a linear model about an operating point would be wrong, or would not exist."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from invtrack.arrays import Array
from invtrack.errors import PlantError
from invtrack.plant.elements import element_name, listed
from invtrack.plant.plant import Plant

_CONTACTS = (
    mujoco.mjtConstraint.mjCNSTR_CONTACT_FRICTIONLESS,
    mujoco.mjtConstraint.mjCNSTR_CONTACT_PYRAMIDAL,
    mujoco.mjtConstraint.mjCNSTR_CONTACT_ELLIPTIC,
)
_EQUALITY = mujoco.mjtConstraint.mjCNSTR_EQUALITY
_ELEMENTS = {
    _EQUALITY: ("equality", "{}"),
    mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT: ("joint", "limit of {}"),
    mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON: ("tendon", "limit of {}"),
    mujoco.mjtConstraint.mjCNSTR_FRICTION_TENDON: ("tendon", "friction of {}"),
}

LARGEST_ACTION = 1e-8
"""Below this, relative to the largest derivative in the same row (at least 1), a coordinate does not act on that row."""


def refuse_step_maps(model: mujoco.MjModel) -> None:
    """Refuse what makes qacc depend on the time step: then it is no derivative of the state."""
    if model.opt.integrator == mujoco.mjtIntegrator.mjINT_DISCRETE:
        raise PlantError(
            'with integrator="discrete" qacc is a step map, not an acceleration, so there is no continuous-time linear model;'
            ' set integrator="RK4" (or "implicitfast") in the file\'s <option>'
        )
    early = [element_name(model, "actuator", i) for i in range(model.nactuator) if model.actuator_actearly[i]]
    if early:
        raise PlantError(f"actuators {listed(early)} use the activation of the next step (actearly); set actearly to false")
    if model.opt.enableflags & mujoco.mjtEnableBit.mjENBL_SLEEP:
        raise PlantError("sleeping bodies ignore small perturbations; remove <flag sleep='enable'/>")


def refuse_moving_quaternions(plant: Plant) -> None:
    """Refuse a spinning ball or free joint: its tangent coordinates are not the integral of its velocity."""
    model, qvel = plant.model, plant.configuration.qvel
    quaternion = np.isin(model.jnt_type, (mujoco.mjtJoint.mjJNT_BALL, mujoco.mjtJoint.mjJNT_FREE))
    moving = np.unique(model.dof_jntid[quaternion[model.dof_jntid] & (qvel != 0)])
    if len(moving):
        names = listed(element_name(model, "joint", int(joint)) for joint in moving)
        raise PlantError(f"{names}: a ball or free joint must be at rest at the operating point; set its qvel to 0")


def refuse_saturation(plant: Plant, model: mujoco.MjModel) -> None:
    """Refuse controls and activations at or beyond their limits, where MuJoCo clamps them and derivatives vanish."""
    ctrl, act = plant.configuration.ctrl, plant.configuration.act
    clamped = not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL
    for name, address in zip(plant.inputs.names, plant.input_addresses, strict=True):
        low, high = model.actuator_ctrlrange[address]
        if clamped and model.actuator_ctrllimited[address] and not low < ctrl[address] < high:
            raise PlantError(
                f"input {name!r} is {ctrl[address]} at the operating point, at or beyond its ctrlrange"
                f" [{low}, {high}], where it is clamped; widen the range or choose another operating point"
            )
    for i in np.flatnonzero(model.actuator_actlimited):
        low, high = model.actuator_actrange[i]
        values = act[model.actuator_actadr[i] :][: model.actuator_actnum[i]]
        if not np.all((low < values) & (values < high)):
            raise PlantError(
                f"the activation of actuator {element_name(model, 'actuator', int(i))!r} is {values} at the operating point, at or"
                f" beyond its actrange [{low}, {high}], where it is clamped; choose another operating point"
            )


def refuse_nonequilibrium(
    plant: Plant, data: mujoco.MjData, tolerance: float, parameter_values: Mapping[str, float], left_out: Sequence[str]
) -> None:
    """Refuse an operating point whose x' = (qvel, qacc, act_dot) exceeds the tolerance, naming the largest entries.

    Args:
        plant: at the point in question.
        data: of its smooth model there.
        tolerance: the largest rate that counts as equilibrium, in SI units.
        parameter_values: those that differ from the file, for the call that the message offers.
        left_out: what the smooth model does without, which may be what holds the mechanism.
    """
    residual, states = np.concatenate([data.qvel, data.qacc, data.act_dot]), plant.coordinates
    offending = [i for i in np.argsort(-np.abs(residual)) if not abs(residual[i]) <= tolerance]
    if offending:
        rates = ", ".join(f"{states.names[i]}: {residual[i]:.6g} {states.units[i]} per s" for i in offending[:5])
        values = "".join(f", {name}={float(value)!r}" for name, value in parameter_values.items())
        moved = f' After a change in mid-run: invtrack.linearize(plant{values}, equilibrium="same outputs"), or "same controls".'
        without = f" without what a linear model leaves out ({'; '.join(left_out)})" if left_out else ""
        raise PlantError(
            f"the operating point is no equilibrium{without}: its state changes at the rate {rates}"
            f"{' and more' if len(offending) > 5 else ''} (equilibrium_tolerance={tolerance:g}). The plant"
            f" invtrack.trim(plant{values}).plant is at the equilibrium nearest to it; outputs=, positions= and controls= say what"
            f" holds there.{moved if values else ''} Or pass a larger equilibrium_tolerance, or allow_nonequilibrium=True for a"
            " linear model that omits this rate"
        )


def refuse_constraints(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Refuse contacts and limits that are active, naming the geoms, joints or tendons.

    Equality constraints are not refused: they act on both sides of where they hold.
    """
    active = sorted({constraint_name(model, data, row) for row in np.flatnonzero(data.efc_type != _EQUALITY).tolist()})
    if active:
        raise PlantError(
            f"contacts or limits are active at or near the operating point: {listed(active)}. They push one way only, so there is"
            " no linear model: choose an operating point clear of them, or disable them in the file"
        )


def refuse_kinks(plant: Plant, jacobian: Array, jump: Array, rows: list[str], columns: list[str]) -> None:
    """Refuse one-sided derivatives that differ: a dead band, a clamp, or a switch right at the operating point.

    Args:
        plant: whose name the message states.
        jacobian, jump: derivatives, and how far the one-sided ones lie apart (m, k).
        rows, columns: names of what is derived (m,), and of what it is derived with respect to (k,).
    """
    scale = np.maximum(1.0, np.max(np.abs(jacobian), axis=1, keepdims=True))
    row, column = np.unravel_index(np.argmax(jump / scale), jump.shape)
    if jump[row, column] > 1e-6 * scale[row, 0]:
        raise PlantError(
            f"plant {plant.name!r} is not differentiable at the operating point: the derivative of {rows[row]} with respect"
            f" to {columns[column]} jumps by {jump[row, column]:.3g} (a clamp, dead band or switch there, or a nonlinearity finer"
            " than the step). Choose another operating point or a smaller step"
        )


def refuse_acting(plant: Plant, jacobian: Array, error: Array, rows: list[str]) -> None:
    """Refuse dropped coordinates that act on what is kept; the play of a transmission is held still, and does not count.

    jacobian (k, 2 nv + na): derivatives of the rates of the kept states, outputs and measurements, which `rows` names, with respect
    to all coordinates; error: an estimate of the error of each entry.
    """
    scale = np.maximum(1.0, np.max(np.abs(jacobian), axis=1, keepdims=True))
    acts = np.abs(jacobian) > np.maximum(LARGEST_ACTION * scale, error)
    found, play = [], {name for joint in plant.backlash for name in (joint, f"{joint} velocity")}
    for i, name in enumerate(plant.coordinates.names):
        if name in plant.dropped and name not in play and np.any(acts[:, i]):
            targets = dict.fromkeys(rows[row] for row in np.flatnonzero(acts[:, i]))  # an output may be measured too
            found.append(f"{name!r} acts on {listed(targets)}")
    if found:
        raise PlantError(
            f"plant {plant.name!r} drops states that act on what is kept: {'; '.join(found)}. Take them out of drop_states, or drop"
            " what they act on as well"
        )


def constraint_name(model: mujoco.MjModel, data: mujoco.MjData, row: int) -> str:
    """What messages call the constraint in a row of data.efc_type: "contact of floor and foot", "limit of joint knee"."""
    kind, index = mujoco.mjtConstraint(data.efc_type[row]), int(data.efc_id[row])
    if kind in _CONTACTS:
        first, second = (element_name(model, "geom", int(geom)) for geom in data.contact[index].geom)
        return f"contact of {first} and {second}"
    if kind == mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF:
        return f"friction of {element_name(model, 'joint', int(model.dof_jntid[index]))}"
    element, text = _ELEMENTS[kind]
    return text.format(f"{element} {element_name(model, element, index)}")
