"""Velocity couplings as MuJoCo's passive callback, compiled."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from invtrack.plant.native.layout import data_pointer
from invtrack.plant.native.pointers import (
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

_POINTERS = ("qvel", "qfrc_passive", "xpos", "xmat", "cvel", "cdof", "subtree_com")

_FORCES = np.dtype([(name, np.int64) for name in ("nv", "couplings", "first", *_POINTERS)])
"""What belongs to a model: nv, number and address of its couplings, and where mjData keeps pointers."""

_COUPLING = np.dtype(
    [
        (name, np.int64)
        for name in ("size", "K", "joints", "joint_rows", "dofs", "bodies", "body_rows", "ids", "roots", "chains", "chain_ends")
    ]
)
"""One coupling: the rows of K, how many joints and bodies, and where their rows and numbers stand.

roots: the first body of the tree of each. chains: the degrees of freedom that move each body, one body after the other; chain_ends:
where each ends.
"""

_forces_at, _couplings_at = records(_FORCES), records(_COUPLING)


@compiled
def _add_forces(forces: Any, coupling: Any, data: int) -> None:
    size = coupling.size
    qvel, force = floats(word(data + forces.qvel), forces.nv), floats(word(data + forces.qfrc_passive), forces.nv)
    K = matrix(coupling.K, size, size)
    rows, dofs = integers(coupling.joint_rows, coupling.joints), integers(coupling.dofs, coupling.joints)
    if coupling.bodies == 0:  # without room for twists, which takes time to find
        for i in range(size):
            for j in range(size):
                force[dofs[i]] += K[rows[i], rows[j]] * qvel[dofs[j]]
        return
    v, f = np.empty(size), np.zeros(size)
    for i in range(coupling.joints):
        v[rows[i]] = qvel[dofs[i]]
    for i in range(coupling.bodies):
        _twist(forces, coupling, data, i, v)
    for i in range(size):
        for j in range(size):
            f[i] += K[i, j] * v[j]
    for i in range(coupling.joints):
        force[dofs[i]] += f[rows[i]]
    for i in range(coupling.bodies):
        _wrench(forces, coupling, data, i, f)


@compiled
def _twist(forces: Any, coupling: Any, data: int, i: int, v: Any) -> None:
    """The twist of coupled body number i, in its own frame, into its rows of v.

    MuJoCo keeps (rotation, translation) along the world's axes, of the point of the body that is at the centre of mass of its tree.
    """
    body, row = integers(coupling.ids, i + 1)[i], integers(coupling.body_rows, i + 1)[i]
    c, R = floats(word(data + forces.cvel) + 48 * body, 6), matrix(word(data + forces.xmat) + 72 * body, 3, 3)
    x, y, z = _arm(forces, coupling, data, i)
    moved = c[3] + c[1] * z - c[2] * y, c[4] + c[2] * x - c[0] * z, c[5] + c[0] * y - c[1] * x
    for j in range(3):
        v[row + j] = R[0, j] * moved[0] + R[1, j] * moved[1] + R[2, j] * moved[2]
        v[row + 3 + j] = R[0, j] * c[0] + R[1, j] * c[1] + R[2, j] * c[2]


@compiled
def _wrench(forces: Any, coupling: Any, data: int, i: int, f: Any) -> None:
    """Add what the wrench on coupled body number i, its rows of f in its own frame, does along the degrees of freedom."""
    body, row = integers(coupling.ids, i + 1)[i], integers(coupling.body_rows, i + 1)[i]
    R, force = matrix(word(data + forces.xmat) + 72 * body, 3, 3), floats(word(data + forces.qfrc_passive), forces.nv)
    x, y, z = _arm(forces, coupling, data, i)
    a, b, c = _turned(R, f, row, 0), _turned(R, f, row, 1), _turned(R, f, row, 2)
    p, q, r = _turned(R, f, row + 3, 0), _turned(R, f, row + 3, 1), _turned(R, f, row + 3, 2)
    p, q, r = p + y * c - z * b, q + z * a - x * c, r + x * b - y * a  # the torque about the centre of mass of the tree
    ends = integers(coupling.chain_ends, i + 1)
    chain, axes = integers(coupling.chains, ends[i]), matrix(word(data + forces.cdof), forces.nv, 6)
    for k in range(ends[i - 1] if i > 0 else 0, ends[i]):
        j = chain[k]
        force[j] += axes[j, 0] * p + axes[j, 1] * q + axes[j, 2] * r + axes[j, 3] * a + axes[j, 4] * b + axes[j, 5] * c


@compiled
def _turned(R: Any, f: Any, row: int, i: int) -> float:
    """Entry i of R times three entries of f."""
    return R[i, 0] * f[row] + R[i, 1] * f[row + 1] + R[i, 2] * f[row + 2]  # type: ignore[no-any-return]


@compiled
def _arm(forces: Any, coupling: Any, data: int, i: int) -> tuple[float, float, float]:
    """From the centre of mass of the tree of coupled body number i to the origin of the body's frame, along the world's axes."""
    origin = floats(word(data + forces.xpos) + 24 * integers(coupling.ids, i + 1)[i], 3)
    centre = floats(word(data + forces.subtree_com) + 24 * integers(coupling.roots, i + 1)[i], 3)
    return origin[0] - centre[0], origin[1] - centre[1], origin[2] - centre[2]


@callback("model", "data")
def _passive(model: int, data: int) -> None:
    found = registered(_table(), model)
    if found != 0:
        forces = _forces_at(found, 1)[0]
        couplings = _couplings_at(forces.first, forces.couplings)
        for i in range(forces.couplings):
            _add_forces(forces, couplings[i], data)


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
        joints, bodies = (np.array(pairs, dtype=np.intp).reshape(-1, 2) for pairs in (coupling.joints, coupling.bodies))
        row["size"], row["K"] = len(coupling.K), stored(coupling.K, float)
        row["joints"], row["bodies"] = len(joints), len(bodies)
        row["joint_rows"], row["dofs"] = (stored(column, int) for column in joints.T)
        row["body_rows"], row["ids"] = (stored(column, int) for column in bodies.T)
        chains = [_moving(model, body) for body in bodies[:, 1].tolist()]
        row["roots"], row["chains"] = stored(model.body_rootid[bodies[:, 1]], int), stored(np.concatenate([[], *chains]), int)
        row["chain_ends"] = stored(np.cumsum([len(chain) for chain in chains]), int)
    forces = np.zeros(1, dtype=_FORCES)
    forces["nv"], forces["couplings"], forces["first"] = model.nv, len(couplings), table.ctypes.data
    for name in _POINTERS:
        forces[name] = data_pointer(name)
    with PASSIVE.block(model._address, forces.ctypes.data):
        yield


def _moving(model: mujoco.MjModel, body: int) -> list[int]:
    """The degrees of freedom that move a body."""
    found: list[int] = []
    while body:
        first = int(model.body_dofadr[body])
        found += range(first, first + int(model.body_dofnum[body]))
        body = int(model.body_parentid[body])
    return found
