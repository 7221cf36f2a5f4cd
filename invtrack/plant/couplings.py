"""Velocity couplings: forces linear in velocity that no damper, spring or tendon of MJCF makes, carried by the MJCF file itself.

    <custom>
      <tuple name="velocity_coupling">
        <element objtype="joint" objname="th1"/>
        <element objtype="joint" objname="th2"/>
      </tuple>
      <numeric name="velocity_coupling" data="-0.2 0.1  0.3 -0.4"/>
    </custom>

The tuple names what is coupled, the numeric of the same name holds the square matrix K, row by row; every tuple whose name contains
"velocity_coupling" is one coupling. A slide or hinge stands for one velocity and the force that does work on it. A body stands for
six: its twist (v_x, v_y, v_z, w_x, w_y, w_z), the velocity [m/s] of the origin of the body's frame (not of its centre of mass) and
its angular velocity [rad/s], along the axes of that frame, and the wrench (force, torque) at that origin along the same axes. So
physics that moves with a body, such as the stability derivatives of an aircraft, is the same in every orientation.

MuJoCo treats these forces explicitly, whatever the integrator; RK4 evaluates them at each stage.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import accumulate

import mujoco
import numpy as np

from invtrack.arrays import Array
from invtrack.errors import PlantError
from invtrack.plant.elements import element_name, listed

MARK = "velocity_coupling"
"""What the names of a coupling's tuple and numeric contain; prefixes and suffixes (of <attach>, say) do not hide it."""

TWIST = 6

_SIZES = {mujoco.mjtObj.mjOBJ_JOINT: 1, mujoco.mjtObj.mjOBJ_BODY: TWIST}

_SCALAR_JOINTS = (mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE)


@dataclass(frozen=True, eq=False)
class VelocityCoupling:
    """Generalized forces J' K J qvel (nv,), where J qvel (k,) are the velocities of the coupled joints and bodies.

    `invtrack.plant.native.coupling_forces` computes them.

    name: as in the file. K (k, k): forces per velocity, in SI units. joints: the rows of J that pick a degree of freedom, as
    (row, dof). bodies: the rows of J at which the six of a body's twist start, as (row, body).
    """

    name: str
    K: Array
    joints: tuple[tuple[int, int], ...]
    bodies: tuple[tuple[int, int], ...] = ()

    def __post_init__(self) -> None:
        self.K.setflags(write=False)


def require_known_elements(spec: mujoco.MjSpec) -> None:
    """Refuse, before MuJoCo's compiler does so without the names there are, couplings of joints or bodies that do not exist."""
    known = {
        mujoco.mjtObj.mjOBJ_JOINT: ("joint", [joint.name for joint in spec.joints if joint.name]),
        mujoco.mjtObj.mjOBJ_BODY: ("body", [body.name for body in spec.bodies if body.name and body.name != "world"]),
    }
    for coupling in spec.tuples:
        if MARK not in coupling.name:
            continue
        for objtype, name in zip(coupling.objtype, coupling.objname, strict=True):
            kind, names = known.get(mujoco.mjtObj(objtype), ("", [name]))
            if name not in names:
                raise PlantError(f"coupling {coupling.name!r}: the model has no {kind} named {name!r}; there are: {listed(names)}")


def velocity_couplings(model: mujoco.MjModel) -> tuple[VelocityCoupling, ...]:
    """The couplings that a model carries.

    Raises PlantError for a matrix without joints or bodies and the reverse, a matrix that does not fit them, entries that are not
    finite, elements named twice, ball and free joints, bodies that do not move, and models that disable passive forces.
    """
    tuples, numerics = _marked(model, "tuple"), _marked(model, "numeric")
    if tuples.keys() != numerics.keys():
        raise PlantError(
            "a velocity coupling is a <tuple> of joints or bodies and a <numeric> with its matrix, both of the same name; there are"
            f" the tuples {listed(tuples)} and the numerics {listed(numerics)}"
        )
    disabled = mujoco.mjtDisableBit.mjDSBL_SPRING | mujoco.mjtDisableBit.mjDSBL_DAMPER
    if tuples and model.opt.disableflags & disabled == disabled:
        raise PlantError(
            "the model disables springs and dampers, and with both of them MuJoCo leaves out the velocity coupling"
            f" {listed(tuples)}; remove one of the two flags"
        )
    return tuple(_coupling(model, name, index, numerics[name]) for name, index in tuples.items())


def _coupling(model: mujoco.MjModel, name: str, tuple_id: int, numeric_id: int) -> VelocityCoupling:
    where = slice(model.tuple_adr[tuple_id], model.tuple_adr[tuple_id] + model.tuple_size[tuple_id])
    elements = [(mujoco.mjtObj(kind), int(i)) for kind, i in zip(model.tuple_objtype[where], model.tuple_objid[where], strict=True)]
    labels = [_checked_label(model, name, kind, index) for kind, index in elements]
    if len(set(labels)) != len(labels):
        raise PlantError(f"coupling {name!r} names an element twice: {listed(labels)}; name each once")
    rows = list(accumulate((_SIZES[kind] for kind, _ in elements), initial=0))
    size, start = rows[-1], model.numeric_adr[numeric_id]
    entries = np.array(model.numeric_data[start : start + model.numeric_size[numeric_id]])
    if entries.size != size**2:
        raise PlantError(
            f"coupling {name!r} of {listed(labels)} expects a matrix of {size} x {size} = {size**2} entries (one row and column for"
            f" a joint, {TWIST} for a body), got {entries.size}"
        )
    if not np.all(np.isfinite(entries)):
        raise PlantError(f"coupling {name!r} has entries that are not finite: {entries.tolist()}")
    placed = [(row, kind, index) for row, (kind, index) in zip(rows, elements, strict=False)]
    return VelocityCoupling(
        name=name,
        K=entries.reshape(size, size),
        joints=tuple((row, int(model.jnt_dofadr[i])) for row, kind, i in placed if kind == mujoco.mjtObj.mjOBJ_JOINT),
        bodies=tuple((row, i) for row, kind, i in placed if kind == mujoco.mjtObj.mjOBJ_BODY),
    )


def _checked_label(model: mujoco.MjModel, coupling: str, kind: mujoco.mjtObj, index: int) -> str:
    """What messages call an element, after making sure that it can be coupled."""
    if kind == mujoco.mjtObj.mjOBJ_JOINT:
        label = element_name(model, "joint", index)
        if mujoco.mjtJoint(model.jnt_type[index]) not in _SCALAR_JOINTS:
            raise PlantError(
                f"coupling {coupling!r} needs slides, hinges or bodies; joint {label!r} is a ball or free joint: name its body"
            )
        return f"joint {label}"
    if kind == mujoco.mjtObj.mjOBJ_BODY:
        label = element_name(model, "body", index)
        if model.body_weldid[index] == 0:
            moving = (element_name(model, "body", i) for i in range(model.nbody) if model.body_weldid[i] != 0)
            raise PlantError(f"coupling {coupling!r}: body {label!r} does not move; those that do are: {listed(moving)}")
        return f"body {label}"
    raise PlantError(
        f'coupling {coupling!r} expects elements of objtype "joint" or "body", got "{mujoco.mju_type2Str(kind)}"; name the joint or'
        " the body that it belongs to"
    )


def _marked(model: mujoco.MjModel, kind: str) -> dict[str, int]:
    """The tuples or numerics that belong to a coupling, by name."""
    objtype, count = {
        "tuple": (mujoco.mjtObj.mjOBJ_TUPLE, model.ntuple),
        "numeric": (mujoco.mjtObj.mjOBJ_NUMERIC, model.nnumeric),
    }[kind]
    names: Iterable[str] = (mujoco.mj_id2name(model, objtype, i) or "" for i in range(count))
    return {name: i for i, name in enumerate(names) if MARK in name}
