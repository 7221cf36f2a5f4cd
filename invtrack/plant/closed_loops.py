"""Equality constraints of a mechanism at its operating point: whether the motion that they leave is one and the same around it."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
import scipy  # loads scipy.linalg at its first use

from invtrack.arrays import Array, as_divisor
from invtrack.errors import PlantError
from invtrack.plant.elements import element_name, listed
from invtrack.plant.plant import Plant

AWAY = 0.1
"""How far from the operating point constraints are compared: in radians, or in the mechanism's extent."""

LOST = 1e-2
"""Constraints depend on each other where a singular value of their Jacobian is below this share of what it is that far away."""

CONSTANT = 1e-6
"""A singular value below this share of the largest is zero wherever the mechanism stands: a constraint that repeats others."""

ITERATIONS = 30
"""Steps of Gauss and Newton back onto the constraints."""

CLOSED = 1e-8
"""Constraints are met to this share of the mechanism's extent (or in radians)."""


def refuse_branching(plant: Plant, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Refuse an operating point at which equality constraints depend on each other that do not elsewhere.

    There a mechanism can go on in more than one way (a parallelogram that lies flat folds or turns over), and its free motions are
    no linear space. Constraints that repeat each other wherever it stands, such as those of a planar loop out of its plane, pass.

    data: of the plant's smooth `model` (with a dense Jacobian) at the operating point.
    """
    if not np.any(data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY):
        return
    here = _Constraints.of(model, data)
    values, free = here.singular_values(), here.free_motions()
    lengths = np.where(_is_translation(model), max(float(model.stat.extent), np.finfo(float).tiny), 1.0)
    for motion in free.T:
        there = _moved(plant, model, motion * AWAY / np.max(np.abs(motion) / lengths))
        if there is None:
            continue
        elsewhere = there.singular_values()
        lost = (values < LOST * elsewhere) & (elsewhere > CONSTANT * np.max(elsewhere))
        if np.any(lost):
            names = dict.fromkeys(element_name(model, "equality", int(i)) for i in here.owners)
            raise PlantError(
                f"the equality constraints {listed(names)} depend on each other at the operating point, but not {AWAY} rad away"
                f" (a singular value of their Jacobian is {np.min(values[lost] / elsewhere[lost]):.1e} of what it is there): the"
                " mechanism can branch or lock here, and has no linear model. Choose an operating point further from this one"
            )


@dataclass(frozen=True, eq=False)
class _Constraints:
    """The rows of the equality constraints: violations r (k,), Jacobian J (k, nv), number of the equality (k,); mass M (nv, nv)."""

    r: Array
    J: Array
    M: Array
    owners: Array

    @classmethod
    def of(cls, model: mujoco.MjModel, data: mujoco.MjData) -> _Constraints:
        rows = np.flatnonzero(data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY)
        M = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, M)
        J = np.array(data.efc_J).reshape(data.nefc, model.nv)[rows]
        return cls(np.array(data.efc_pos[rows]), J, M, np.array(data.efc_id[rows]))

    def _weighted(self) -> tuple[Array, Array, Array]:
        """J L^-T (k, nv) with the rows of each equality in terms of its longest, that length of each row (k,), and L: M = L L'.

        Free of the units of coordinates and constraints; the directions of one equality keep their proportions.
        """
        L = np.linalg.cholesky(self.M)
        weighted = scipy.linalg.solve_triangular(L, self.J.T, lower=True).T
        lengths = np.linalg.norm(weighted, axis=1)
        longest = as_divisor(np.array([np.max(lengths[self.owners == owner]) for owner in self.owners]))
        return np.asarray(weighted / longest[:, np.newaxis]), longest, np.asarray(L, dtype=float)

    def singular_values(self) -> Array:
        """Those of the weighted Jacobian, the largest first (min(k, nv),)."""
        return np.asarray(np.linalg.svd(self._weighted()[0], compute_uv=False))

    def free_motions(self) -> Array:
        """A basis (nv, f) of the velocities that violate no constraint, counting as free what is hardly constrained here."""
        weighted, _, L = self._weighted()
        _, values, right = np.linalg.svd(weighted)
        rank = int(np.sum(values > LOST * AWAY * np.max(values, initial=0.0)))
        return np.asarray(scipy.linalg.solve_triangular(L.T, right[rank:].T))

    def correction(self) -> Array:
        """The least displacement (nv,), by kinetic energy, that undoes the violation to first order."""
        weighted, lengths, L = self._weighted()
        least = np.linalg.lstsq(weighted, -self.r / lengths, rcond=CONSTANT)[0]
        return np.asarray(scipy.linalg.solve_triangular(L.T, least))


def _moved(plant: Plant, model: mujoco.MjModel, displacement: Array) -> _Constraints | None:
    """The constraints where they are met again after a displacement (nv,) from the operating point; None where they are not."""
    data = plant.new_data(model)
    data.qvel[:] = 0
    qpos, step = np.array(data.qpos), displacement
    for _ in range(ITERATIONS):
        mujoco.mj_integratePos(model, qpos, step, 1.0)
        data.qpos[:] = qpos
        mujoco.mj_fwdPosition(model, data)
        constraints = _Constraints.of(model, data)
        if np.max(np.abs(constraints.r)) <= CLOSED * max(1.0, float(model.stat.extent)):
            return constraints
        step = constraints.correction()
    return None


def _is_translation(model: mujoco.MjModel) -> Array:
    """Which of the nv degrees of freedom are translations."""
    slide = model.jnt_type[model.dof_jntid] == mujoco.mjtJoint.mjJNT_SLIDE
    first = np.arange(model.nv) - model.jnt_dofadr[model.dof_jntid]
    return np.asarray(slide | ((model.jnt_type[model.dof_jntid] == mujoco.mjtJoint.mjJNT_FREE) & (first < 3)))
