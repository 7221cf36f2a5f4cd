"""The equations of an equilibrium of a MuJoCo model, in units of their own."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import mujoco
import numpy as np

from invtrack.arrays import Array, as_divisor
from invtrack.plant.configuration import tangent_units
from invtrack.plant.equilibrium.given import Given, Mask
from invtrack.plant.plant import Plant
from invtrack.plant.smooth_model import smooth_model

STEP = 2.0**-17
"""Perturbation of each scaled unknown for central differences: they are good to 1e-10, enough for Newton's steps."""

STEP_IN_CONTACT = 2.0**-21
"""The same where contacts and limits act, whose forces come and go within less than a thousandth of the mechanism's size."""

YIELD = 0.01
"""A joint's limit that may hold the mechanism gives way, by no more than this share of the range."""

SLOWEST = 1e-9
"""A force that makes an acceleration below this share of the fastest, in units of the positions, is rounding."""

RESOLVED = 1e-6
"""How near to a bound an unknown counts as held by it, in its unit."""


class EquilibriumEquations:
    """All forces cancel, act' = 0 and y = y_given at rest, as functions of z = (displacement in tangent space, act, ctrl).

    Forces along the degrees of freedom, not the accelerations that they make: of a long chain of links a torque at one joint
    accelerates all of them, some many thousand times as much as others, and what balances each joint is hard to tell from those.
    All forces count that MuJoCo knows. Dry friction is left out: what is in equilibrium without it is so with it. Contacts and
    limits count where `constraints` says so. Controls are not clamped here: their ranges are bounds.

    Equations and unknowns are scaled, so that neither the units of a file nor the size of a mechanism matter: positions by 1 rad
    or the mechanism's extent; forces by what all single ones, and what each position's change by its unit makes of them, add up
    to; controls and activations by what it takes to push as much; outputs by what the positions' units would make of them.

    Args:
        plant: whose couplings act, and whose operating point is where the search starts.
        model: the plant's, with parameter values.
        given: what has to be met.
        constraints: whether contacts and limits act.
        force_limits: whether forcerange and actuatorfrcrange act, beyond which a control moves nothing.

    Attributes:
        start: z at the start (nv + na + nu,).
        free: which of these are unknown.
        is_position: which of these are positions.
        bounds: their ranges (nv + na + nu, 2).
        units: one scaled unit of each, in SI units (nv + na + nu,).
        scales: one scaled unit of each equation, in SI units.
        evaluations: how often the residual was evaluated.
    """

    def __init__(self, plant: Plant, model: mujoco.MjModel, given: Given, *, constraints: bool, force_limits: bool = True) -> None:
        self.plant, self.given, self.constraints = plant, given, constraints
        self.model = _for_search(plant, model, constraints=constraints, force_limits=force_limits)
        self.data = mujoco.MjData(self.model)
        plant.configuration.write(self.data)
        self.data.qvel[:] = 0
        self.evaluations = 0
        self.start = np.concatenate([given.displacement, plant.configuration.act, given.ctrl])
        self.free: Mask = given.free
        self.is_position: Mask = np.arange(len(self.start)) < model.nv
        self._step = STEP_IN_CONTACT if constraints else STEP
        muscles = np.flatnonzero(model.actuator_dyntype == mujoco.mjtDyn.mjDYN_MUSCLE)
        self._muscles, self._excitations = model.actuator_actadr[muscles], model.actuator_ctrladr[muscles]
        self.bounds = self._bounds()
        with self.forces():
            self.units, self.scales = self._scaling()

    @contextmanager
    def forces(self) -> Iterator[None]:
        """A block in which the plant's velocity couplings act; what evaluates the equations is called within one."""
        with self.plant.forces(self.model):
            yield

    def qpos(self, z: Array) -> Array:
        """The positions (nq,) at z."""
        qpos = np.array(self.given.qpos)
        mujoco.mj_integratePos(self.model, qpos, z[: self.model.nv], 1.0)
        return qpos

    def plant_at(self, z: Array) -> Plant:
        """The plant at rest where the unknowns put it."""
        nv, na = self.model.nv, self.model.na
        return self.plant.at(qpos=self.qpos(z), qvel=np.zeros(nv), act=z[nv : nv + na], ctrl=z[nv + na :])

    def rates(self, z: Array) -> Array:
        """(qacc, act') at z, in SI units: what a plant that is no equilibrium does there."""
        activations = self.values(z)[self.model.nv : self.model.nv + self.model.na]
        return np.concatenate([self.data.qacc, activations])

    def values(self, z: Array) -> Array:
        """(forces, act', y - y_given) at z, in SI units."""
        data = self.data
        _, act, ctrl = np.split(z, [self.model.nv, self.model.nv + self.model.na])
        data.qpos[:], data.act[:], data.ctrl[:] = self.qpos(z), act, ctrl
        data.qacc_warmstart[:] = 0  # so that an evaluation does not depend on the one before it
        mujoco.mj_forward(self.model, data)
        rates = np.array(data.act_dot)
        # Whatever its time constants, which jump there, a muscle is at rest where its activation is its excitation.
        rates[self._muscles] = ctrl[self._excitations] - act[self._muscles]
        missed = self.given.output_readings.values(data) - self.given.output_values
        return np.concatenate([data.qfrc_smooth + data.qfrc_constraint, rates, missed])

    def residual(self, z: Array) -> Array:
        """The same, scaled."""
        self.evaluations += 1
        return np.asarray(self.values(z) / self.scales)

    def jacobian(self, z: Array, which: Mask) -> Array:
        """Its derivative with respect to those of the scaled unknowns that the mask picks."""
        return self._derivative(z, which, self.units) / self.scales[:, None]

    def at_bounds(self, z: Array) -> Mask:
        """Which of the unknowns are at one of their bounds, to within what a search resolves."""
        near = np.abs(z[:, None] - self.bounds) <= RESOLVED * self.units[:, None]
        return np.asarray(self.free & np.any(near, axis=1))

    def _derivative(self, z: Array, which: Mask, units: Array) -> Array:
        """Columns of the derivative of `values` with respect to those unknowns, each measured in its unit."""
        columns = np.flatnonzero(which)
        derivative = np.empty((len(self.values(z)), len(columns)))
        for i, column in enumerate(columns):
            ahead, behind = np.array(z), np.array(z)
            ahead[column] += self._step * units[column]
            behind[column] -= self._step * units[column]
            derivative[:, i] = (self.values(ahead) - self.values(behind)) / (2 * self._step)
        return derivative

    def _scaling(self) -> tuple[Array, Array]:
        """Units of the unknowns and scales of the equations, in SI units."""
        nv, na = self.model.nv, self.model.na
        lengths = np.array([self.model.stat.extent if unit == "m" else 1.0 for unit in tangent_units(self.model)])
        spans = (self.bounds[nv:, 1] - self.bounds[nv:, 0]) / 2
        spans = np.where(np.isfinite(spans), as_divisor(spans), 1.0)
        self.values(self.start)
        single, inertia = self._single_forces(), self._inertia()
        changes = np.abs(self._derivative(self.start, np.ones(len(self.start), dtype=bool), np.concatenate([lengths, spans])))
        by_position, by_input = changes[:, :nv], changes[:, nv:]
        forces = single + np.sum(by_position[:nv], axis=1)
        fastest = inertia * lengths * np.max(forces / inertia / lengths, initial=0.0)
        driven = np.max(by_input[:nv], axis=1, initial=0.0)
        for idle in (driven, fastest):  # what nothing pushes by itself is scaled by what inputs make of it, or as the rest
            forces = np.where(forces > SLOWEST * fastest, forces, idle)
        forces = as_divisor(forces)
        # A control that pushes nothing by itself acts through its activation, whose unit follows from the force it makes.
        strength = np.max(by_input[:nv] / forces[:, None], axis=0, initial=0.0)
        inputs = spans / as_divisor(strength)
        rates = as_divisor(np.max(by_input[nv : nv + na] / as_divisor(strength), axis=1, initial=0.0))
        indirect = np.max(by_input[nv : nv + na, na:] / rates[:, None], axis=0, initial=0.0)
        inputs[na:] /= np.where(strength[na:] > 0, 1.0, as_divisor(indirect))
        outputs = as_divisor(np.sum(by_position[nv + na :], axis=1))
        return np.concatenate([lengths, inputs]), np.concatenate([forces, rates, outputs])

    def _single_forces(self) -> Array:
        """The single forces along each degree of freedom, added up without their signs, (nv,)."""
        data = self.data
        kinds = (data.qfrc_bias, data.qfrc_spring, data.qfrc_gravcomp, data.qfrc_actuator, data.qfrc_constraint)
        return np.asarray(np.sum(np.abs(kinds), axis=0))

    def _inertia(self) -> Array:
        """Of each degree of freedom with all that it carries, (nv,)."""
        found = np.empty(self.model.nv)
        for dof, unit in enumerate(np.eye(self.model.nv)):
            column = np.empty_like(unit)
            mujoco.mj_mulM(self.model, self.data, column, unit)
            found[dof] = column[dof]
        return found

    def _bounds(self) -> Array:
        """Ranges of the positions of slides and hinges, as displacements, of activations and of controls."""
        model, positions = self.model, self.given.position_limits
        if self.constraints:
            room = YIELD * (positions[:, 1] - positions[:, 0])
            positions = positions + np.where(np.isfinite(room), room, 0.0)[:, None] * [-1, 1]
        present = np.zeros(model.nv)
        for dof in np.flatnonzero(np.any(np.isfinite(positions), axis=1)):
            present[dof] = self.given.qpos[model.jnt_qposadr[model.dof_jntid[dof]]]
        activations = np.tile([-np.inf, np.inf], (model.na, 1))
        for i in np.flatnonzero(model.actuator_actlimited):
            where = slice(model.actuator_actadr[i], model.actuator_actadr[i] + model.actuator_actnum[i])
            activations[where] = model.actuator_actrange[i]
        controls = self.given.control_limits.copy()
        controls[self._excitations] = np.clip(controls[self._excitations], 0.0, 1.0)  # beyond, MuJoCo clamps them
        return np.vstack([positions - present[:, None], activations, controls])


def _for_search(plant: Plant, model: mujoco.MjModel, *, constraints: bool, force_limits: bool) -> mujoco.MjModel:
    """The smooth model without sleep, clamped controls and those limits that are not to act."""
    model = smooth_model(model, backlash=plant.backlash).model
    model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL)
    if not constraints:
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT)
    if not force_limits:
        for limited in (model.actuator_forcelimited, model.jnt_actfrclimited, model.tendon_actfrclimited):
            limited[:] = 0
    return model
