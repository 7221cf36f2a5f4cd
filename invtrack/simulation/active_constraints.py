"""Which limits of joints and tendons, and which contacts, act in a MuJoCo model, live while it steps and along a motion."""

from __future__ import annotations

from functools import cache

import mujoco
import numpy as np

from invtrack.arrays import Array
from invtrack.plant.elements import element_name
from invtrack.plant.units import joint_unit, tendon_unit
from invtrack.simulation.acting_limits import NOTICEABLE, ActingLimit, Stretches, size_of

Key = tuple[str, int, int]  # kind; joint or tendon and 0, or two geoms

_LIMITS = {int(mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT): "joint", int(mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON): "tendon"}


class ActiveConstraints:
    """The limits and contacts of one model that data are beyond by more than rounding, as MuJoCo itself finds them.

    possible: whether the model has any; without them nothing need be asked.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        self.possible = _possible(model)
        self.limit = cache(self._limit)
        self._rounding = {
            "joint": (NOTICEABLE * size_of(model.jnt_range)).tolist(),
            "tendon": (NOTICEABLE * size_of(model.tendon_range)).tolist(),
        }
        self._geom_rounding = cache(self._contact_rounding)

    def excess(self, data: mujoco.MjData) -> dict[Key, float]:
        """How far data, after mj_step, mj_forward or mj_fwdPosition, are beyond each limit, and how deep contacts are."""
        found: dict[Key, float] = {}
        if data.nl:
            first = data.ne + data.nf
            rows = slice(first, first + data.nl)
            depths = (data.efc_margin[rows] - data.efc_pos[rows]).tolist()
            for kind, index, depth in zip(data.efc_type[rows].tolist(), data.efc_id[rows].tolist(), depths, strict=True):
                element = _LIMITS[kind]
                if depth > self._rounding[element][index]:
                    found[element, index, 0] = max(depth, found.get((element, index, 0), 0.0))
        if data.ncon:
            contact = data.contact
            depths = (contact.includemargin - contact.dist).tolist()
            for (one, other), excluded, depth in zip(contact.geom.tolist(), contact.exclude.tolist(), depths, strict=True):
                if not excluded and depth > self._geom_rounding(one, other):
                    key = ("contact", min(one, other), max(one, other))
                    found[key] = max(depth, found.get(key, 0.0))
        return found

    def _limit(self, key: Key) -> ActingLimit:
        """What messages call it."""
        kind, index, other = key
        if kind == "contact":
            one, two = (element_name(self._model, "geom", geom) if geom >= 0 else "a flex" for geom in (index, other))
            return ActingLimit(f"contact of {one} and {two}", "m", "contact")
        unit = joint_unit(self._model, index) if kind == "joint" else tendon_unit(self._model, index)
        return ActingLimit(f"range of {kind} {element_name(self._model, kind, index)}", unit)

    def _contact_rounding(self, *geoms: int) -> float:
        """How deep a contact is only by rounding: a small share of the smaller geom's radius; planes have none."""
        radii = [float(self._model.geom_rbound[geom]) for geom in geoms if geom >= 0 and self._model.geom_rbound[geom] > 0]
        return NOTICEABLE * min(radii, default=float(self._model.stat.extent))


class ConstraintWatch:
    """Notes which constraints act, asked after each step in which MuJoCo has any, and after the first without."""

    def __init__(self, constraints: ActiveConstraints, data: mujoco.MjData) -> None:
        self._constraints, self._data = constraints, data
        self._since: dict[Key, tuple[int, float]] = {}
        self._over: dict[Key, list[tuple[int, int, float]]] = {}

    @property
    def acting(self) -> bool:
        """Whether any acted in the step that was noted last."""
        return bool(self._since)

    def stretches(self, steps: int) -> dict[ActingLimit, Stretches]:
        """When each of those that acted did, in a run of so many steps."""
        found = {key: [*spans] for key, spans in self._over.items()}
        for key, (since, most) in self._since.items():
            found.setdefault(key, []).append((since, steps, most))
        return {
            self._constraints.limit(key): Stretches(*(np.array(column) for column in zip(*spans, strict=True)))
            for key, spans in found.items()
        }

    def note(self, step: int) -> None:
        """Look at the data after a step, by its number."""
        acting = self._constraints.excess(self._data)
        for key in [key for key in self._since if key not in acting]:
            since, most = self._since.pop(key)
            self._over.setdefault(key, []).append((since, step, most))
        for key, depth in acting.items():
            since, most = self._since.get(key, (step, 0.0))
            self._since[key] = since, max(most, depth)


def _possible(model: mujoco.MjModel) -> bool:
    def disabled(flag: mujoco.mjtDisableBit) -> bool:
        return bool(model.opt.disableflags & flag)

    if disabled(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT):
        return False
    limited = bool(np.any(model.jnt_limited) or np.any(model.tendon_limited))
    pairs: Array = model.geom_contype[:, None] & model.geom_conaffinity[None, :]
    bodies = model.body_weldid[model.geom_bodyid]
    colliding = bool(np.any(pairs[bodies[:, None] != bodies[None, :]])) or model.npair > 0 or model.nflex > 0
    return (limited and not disabled(mujoco.mjtDisableBit.mjDSBL_LIMIT)) or (
        colliding and not disabled(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    )
