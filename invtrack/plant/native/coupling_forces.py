"""Velocity couplings as MuJoCo's passive callback, compiled."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from invtrack.plant.native.layout import data_pointer
from invtrack.plant.native.libmujoco import address_of
from invtrack.plant.native.pointers import (
    address_in,
    call,
    callback,
    compiled,
    floats,
    integers,
    matrix,
    records,
    registered,
    symbol,
    word,
)
from invtrack.plant.native.slots import PASSIVE

if TYPE_CHECKING:
    from invtrack.plant.couplings import VelocityCoupling

_table = symbol("invtrack_passive_slots", PASSIVE.address)

_BODY = np.int32(int(mujoco.mjtObj.mjOBJ_XBODY))
_LOCAL = np.int32(1)

_FORCES = np.dtype(
    [(name, np.int64) for name in ("nv", "couplings", "first", "qvel", "force", "xpos", "xmat", "velocity", "apply")]
)
"""What belongs to a model: nv, number and address of its couplings, offsets of pointers in mjData, addresses of functions."""

_COUPLING = np.dtype([(name, np.int64) for name in ("size", "K", "joints", "joint_rows", "dofs", "bodies", "body_rows", "ids")])
"""One coupling: the rows of K, how many joints and bodies, and where their rows and numbers stand."""

_forces_at, _couplings_at = records(_FORCES), records(_COUPLING)


@compiled
def _add_forces(forces: Any, coupling: Any, model: int, data: int) -> None:
    size, v, f = coupling.size, np.empty(coupling.size), np.zeros(coupling.size)
    qvel, force = floats(word(data + forces.qvel), forces.nv), floats(word(data + forces.force), forces.nv)
    K = matrix(coupling.K, size, size)
    rows, dofs = integers(coupling.joint_rows, coupling.joints), integers(coupling.dofs, coupling.joints)
    for i in range(coupling.joints):
        v[rows[i]] = qvel[dofs[i]]
    body_rows, ids = integers(coupling.body_rows, coupling.bodies), integers(coupling.ids, coupling.bodies)
    twist, wrench = np.empty(6), np.empty(6)
    for i in range(coupling.bodies):  # MuJoCo's twist has the rotation first
        call(forces.velocity, (model, data, _BODY, np.int32(ids[i]), address_in(twist), _LOCAL))
        for j in range(3):
            v[body_rows[i] + j], v[body_rows[i] + 3 + j] = twist[3 + j], twist[j]
    for i in range(size):
        for j in range(size):
            f[i] += K[i, j] * v[j]
    for i in range(coupling.joints):
        force[dofs[i]] += f[rows[i]]
    for i in range(coupling.bodies):
        origin, R = word(data + forces.xpos) + 24 * ids[i], matrix(word(data + forces.xmat) + 72 * ids[i], 3, 3)
        for part in range(2):
            for j in range(3):
                wrench[3 * part + j] = 0.0
                for k in range(3):
                    wrench[3 * part + j] += R[j, k] * f[body_rows[i] + 3 * part + k]
        address = address_in(wrench)
        call(forces.apply, (model, data, address, address + 24, origin, np.int32(ids[i]), word(data + forces.force)))


@callback("model", "data")
def _passive(model: int, data: int) -> None:
    found = registered(_table(), model)
    if found != 0:
        forces = _forces_at(found, 1)[0]
        couplings = _couplings_at(forces.first, forces.couplings)
        for i in range(forces.couplings):
            _add_forces(forces, couplings[i], model, data)


PASSIVE.serve(_passive)


@contextmanager
def coupling_forces(model: mujoco.MjModel, couplings: Sequence[VelocityCoupling]) -> Iterator[None]:
    """A block in which MuJoCo adds the couplings' forces whenever it evaluates `model`, in any thread, and for this model alone.

    Raises PlantError where MuJoCo's library or the layout of its data is not known.
    """
    kept: list[np.ndarray] = []

    def stored(array: object, dtype: type) -> int:
        kept.append(np.array(array, dtype=dtype))
        return int(kept[-1].ctypes.data)

    table = np.zeros(len(couplings), dtype=_COUPLING)
    for row, coupling in zip(table, couplings, strict=True):
        joints, bodies = np.array(coupling.joints).reshape(-1, 2), np.array(coupling.bodies).reshape(-1, 2)
        row["size"], row["K"] = len(coupling.K), stored(coupling.K, float)
        row["joints"], row["bodies"] = len(joints), len(bodies)
        row["joint_rows"], row["dofs"] = (stored(column, int) for column in joints.T)
        row["body_rows"], row["ids"] = (stored(column, int) for column in bodies.T)
    forces = np.zeros(1, dtype=_FORCES)
    forces["nv"], forces["couplings"], forces["first"] = model.nv, len(couplings), table.ctypes.data
    for field, name in (("qvel", "qvel"), ("force", "qfrc_passive"), ("xpos", "xpos"), ("xmat", "xmat")):
        forces[field] = data_pointer(name)
    forces["velocity"], forces["apply"] = address_of("mj_objectVelocity"), address_of("mj_applyFT")
    with PASSIVE.block(model._address, forces.ctypes.data):
        yield
