"""The smooth model of a mechanism: what is left of it for a linear model, and what is left out."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from invtrack.plant.actuator_delays import actuator_delays
from invtrack.plant.elements import element_id, element_name
from invtrack.plant.units import joint_unit, tendon_unit, unit_of


@dataclass(frozen=True, eq=False)
class SmoothModel:
    """A model whose motion is smooth, and what distinguishes it from the whole mechanism.

    model: without dry friction, actuator delays and play. left_out: each of these, in words: "dry friction of joint x: 0.3 N".
    """

    model: mujoco.MjModel
    left_out: tuple[str, ...]


RIGID = 1e12
"""Armature of a joint that is to hold its place, in terms of the inertia that it moves."""


def smooth_model(model: mujoco.MjModel, *, backlash: Sequence[str] = ()) -> SmoothModel:
    """A copy without dry friction of joints and tendons, without actuator delays, and with the play of `backlash` joints closed.

    Equality constraints stay: MuJoCo makes stiff springs and dampers of them, so that accelerations remain functions of the state.
    They are solved to rounding (by Newton's method, which needs a single step where only equalities act), with the time constants
    that the file states, whatever the time step: MuJoCo stretches those below two time steps.
    """
    left_out = (*_friction(model), *_delays(model), *(_play(model, joint) for joint in backlash))
    smooth = copy.copy(model)
    smooth.dof_frictionloss[:] = 0
    smooth.tendon_frictionloss[:] = 0
    smooth.actuator_delay[:] = 0
    for name in backlash:
        joint = element_id(model, "joint", name)
        smooth.jnt_limited[joint] = False
        smooth.dof_armature[model.jnt_dofadr[joint]] += RIGID * model.dof_M0[model.jnt_dofadr[joint]]
    smooth.opt.solver, smooth.opt.tolerance = mujoco.mjtSolver.mjSOL_NEWTON, 0.0
    smooth.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_REFSAFE
    return SmoothModel(smooth, left_out)


def _friction(model: mujoco.MjModel) -> list[str]:
    if model.opt.disableflags & (mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT):
        return []
    named = []
    for joint in range(model.njnt):
        dofs = model.dof_jntid == joint
        losses = np.unique(model.dof_frictionloss[dofs])
        unit = "" if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE else joint_unit(model, joint)
        named.append(("joint", joint, losses, unit))
    for tendon in range(model.ntendon):
        named.append(("tendon", tendon, model.tendon_frictionloss[tendon : tendon + 1], tendon_unit(model, tendon)))
    return [
        f"dry friction of {kind} {element_name(model, kind, index)}: {', '.join(f'{loss:.6g}' for loss in losses)}"
        f" {unit_of('frictionloss', unit)}".rstrip()
        for kind, index, losses, unit in named
        if np.any(losses)
    ]


def _play(model: mujoco.MjModel, name: str) -> str:
    joint = element_id(model, "joint", name)
    low, high = model.jnt_range[joint]
    span = f": {low:.6g} to {high:.6g} {joint_unit(model, joint)}" if model.jnt_limited[joint] else " without a range"
    return f"play of joint {name}{span}"


def _delays(model: mujoco.MjModel) -> list[str]:
    return [f"delay of actuator {late.actuator}: {late.delay:.6g} s" for late in actuator_delays(model)]
