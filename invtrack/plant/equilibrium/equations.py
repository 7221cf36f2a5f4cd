"""The equations of an equilibrium of a MuJoCo model, in units of their own, and their bounded least-squares solution."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import mujoco
import numpy as np
import scipy  # loads scipy.optimize at its first use
from numpy.typing import NDArray

from invtrack.arrays import Array, as_divisor
from invtrack.errors import PlantError
from invtrack.plant.elements import control_limits
from invtrack.plant.equilibrium.given import Given, position_limits
from invtrack.plant.linearize import tangent_units
from invtrack.plant.plant import Plant

Mask = NDArray[np.bool_]

STEP = 2.0**-17
"""Perturbation of each scaled unknown for central differences: they are good to 1e-10, and the steps are Newton's."""

STEP_IN_CONTACT = 2.0**-21
"""The same where contacts and limits act, whose forces come and go within less than a thousandth of the mechanism's size."""

YIELD = 0.01
"""A joint's limit is no bound of its own where it holds the mechanism: it may give way by this share of the range."""

ANCHORS = (1e-1, 1e-3, 1e-5)
"""Weights of the departure from the present positions, relative to the equations, one after the other: least departure."""

DAMPING = 1e-7
"""Weight of the departure from the last iterate, once the equilibrium is near: what does not matter does not move."""

CONTROL_SHARE = 1e-4
"""Weight of a control's or activation's departure in terms of a position's: posture first, then least control."""

NUDGE = 0.2
"""How far a start is moved aside, in units of the positions."""

GOLDEN_RATIO = (1 + math.sqrt(5)) / 2

INSIDE = 0.05
"""How far from its bounds a search begins, in units of the unknown or of its range."""

RESOLVED = 1e-6
"""How near to a bound an unknown counts as held by it, in its unit."""

TIDY = 1e-9
"""How near to its start an unknown is put there, in its unit, where that costs nothing."""

ROUNDING = 1e-13
"""A scaled residual that is nothing but rounding."""

HOPELESS = 1e-2
"""A scaled residual that corrections of the last iterate will not remove."""

ACTS = 1e-9
"""An unknown acts on an equation where a unit of it changes the equation by more than this, both scaled."""

ROUNDS = 12
"""Most corrections with the last iterate as anchor."""


@dataclass(frozen=True, eq=False)
class Scales:
    """What one unit of each scaled unknown (positions, activations, controls) and of each equation (accelerations, rates of the
    activations, outputs) is, in SI units."""

    unknowns: Array
    equations: Array


@dataclass(frozen=True, eq=False)
class Iterate:
    """Unknowns z (nv + na + nu,) as (displacement, act, ctrl), and what is left of the equations, scaled."""

    z: Array
    residual: Array
    evaluations: int

    @property
    def miss(self) -> float:
        """The largest of what is left."""
        return float(np.max(np.abs(self.residual), initial=0.0))


class EquilibriumEquations:
    """qacc = 0, act' = 0 and y = y_given at rest, as functions of z = (displacement in tangent space, act, ctrl).

    Dry friction is left out: what is in equilibrium without it is so with it. Controls are not clamped here, their ranges are
    bounds of the solution. All forces count that MuJoCo knows, velocity couplings do no work at rest; contacts and limits only
    where `constraints` says so.

    Equations and unknowns are scaled: positions by 1 rad or the mechanism's extent; the acceleration of each degree of freedom by
    what all single forces together, and each position's change by its unit, would make of it; each control and activation by what
    it takes to accelerate as much. So neither the units of the file nor the size of a mechanism matter.
    """

    def __init__(self, plant: Plant, model: mujoco.MjModel, given: Given, *, tolerance: float, constraints: bool) -> None:
        self.plant, self.given, self.tolerance, self.constraints = plant, given, tolerance, constraints
        self.model = copy.copy(model)
        self.model.dof_frictionloss[:] = 0
        self.model.tendon_frictionloss[:] = 0
        self.model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
        self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL)
        if not constraints:
            self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT)
        self.data = mujoco.MjData(self.model)
        plant.configuration.write(self.data)
        self.data.qvel[:] = 0
        self.start = np.concatenate([given.displacement, plant.configuration.act, given.ctrl])
        self.free: Mask = given.free
        muscles = np.flatnonzero(model.actuator_dyntype == mujoco.mjtDyn.mjDYN_MUSCLE)
        self.muscles, self.excitations = model.actuator_actadr[muscles], model.actuator_ctrladr[muscles]
        self.is_position = np.arange(len(self.start)) < model.nv
        self.bounds = self._bounds(model)
        self.step = STEP_IN_CONTACT if constraints else STEP
        with self.forces():
            self.scales = self._scales()

    @contextmanager
    def forces(self) -> Iterator[None]:
        """A block in which the plant's own forces act; everything below is called within one."""
        with self.plant.forces(self.model):
            yield

    def values(self, z: Array) -> Array:
        """(qacc, act', y - y_given) at z, in SI units."""
        model, data = self.model, self.data
        displacement, act, ctrl = np.split(z, [model.nv, model.nv + model.na])
        qpos = np.array(self.given.qpos)
        mujoco.mj_integratePos(model, qpos, displacement, 1.0)
        data.qpos[:], data.act[:], data.ctrl[:] = qpos, act, ctrl
        data.qacc_warmstart[:] = 0  # so that an evaluation does not depend on the one before it
        mujoco.mj_forward(model, data)
        rates = np.array(data.act_dot)
        # Whatever its time constants, which jump there, a muscle is at rest where its activation is its excitation.
        rates[self.muscles] = ctrl[self.excitations] - act[self.muscles]
        missed = data.sensordata[self.given.output_addresses] - self.given.output_values
        return np.concatenate([data.qacc, rates, missed])

    def plant_at(self, z: Array) -> Plant:
        """The plant at rest where the unknowns put it."""
        model = self.model
        displacement, act, ctrl = np.split(z, [model.nv, model.nv + model.na])
        qpos = np.array(self.given.qpos)
        mujoco.mj_integratePos(model, qpos, displacement, 1.0)
        return self.plant.at(qpos=qpos, qvel=np.zeros(model.nv), act=act, ctrl=ctrl)

    def residual(self, z: Array) -> Array:
        """The same, scaled."""
        return np.asarray(self.values(z) / self.scales.equations)

    def jacobian(self, z: Array, which: Mask) -> Array:
        """Its derivative with respect to those of the scaled unknowns that the mask picks."""
        return self._derivative(z, which, self.scales.unknowns) / self.scales.equations[:, None]

    def solve(
        self, start: Array, free: Mask, *, bounded: bool = True, rows: Mask | None = None, anchor: Array | None = None
    ) -> Iterate:
        """The equilibrium nearest to `start` in the unknowns that the mask picks, or the point that comes nearest to one.

        Tikhonov regularisation towards the start, weaker and weaker, then towards each iterate in turn, by a bounded trust region
        (`scipy.optimize.least_squares`); the last steps are Newton's.

        Args:
            start: unknowns (nv + na + nu,); moved within the bounds if they are beyond.
            free: which of them may change.
            bounded: whether they stay within their bounds.
            rows: which equations count; all unless given.
            anchor: from where the departure is to be least; from the start unless given.
        """
        limits = zip((-np.inf, np.inf), self.bounds.T, strict=True)
        low, high = (np.where(free & (not bounded), limit, bound) for limit, bound in limits)
        anchor = np.clip(start if anchor is None else anchor, low, high)
        start = np.clip(start, low, high)
        rows = np.ones(len(self.scales.equations), dtype=bool) if rows is None else rows
        best = Iterate(start, self.residual(start)[rows], 1)
        if not np.all(np.isfinite(best.residual)):
            raise PlantError(f"accelerations of plant {self.plant.name!r} are not finite at its configuration; check its masses")
        if not np.any(free):
            return best
        share = CONTROL_SHARE if np.any(free & self.is_position) else 1.0
        weights = np.where(self.is_position, 1.0, share)[free]
        evaluations = 1
        current = start
        for weight in (*ANCHORS, *[DAMPING] * ROUNDS):
            if weight == DAMPING and (best.miss == 0 or best.miss > HOPELESS):
                break
            if weight == DAMPING:
                found = self._regularised(current, current, free, rows, np.full(len(weights), DAMPING), (low, high))
            else:
                found = self._regularised(self._inside(current, low, high), anchor, free, rows, weight * weights, (low, high))
            evaluations += found.evaluations
            current = found.z
            if weight == DAMPING and found.miss > best.miss / 2:
                best = found if found.miss < best.miss else best
                break
            best = found
        return Iterate(best.z, best.residual, evaluations)

    def at_bounds(self, z: Array) -> Mask:
        """Which of the free unknowns are at one of their bounds, to within what a search resolves."""
        return np.asarray(self.free & np.any(np.abs(z[:, None] - self.bounds) <= RESOLVED * self.scales.unknowns[:, None], axis=1))

    def _inside(self, z: Array, low: Array, high: Array) -> Array:
        """The same a little off its bounds, where the steps of the trust region would be short."""
        room = INSIDE * np.minimum(high - low, self.scales.unknowns)
        if self.constraints:  # off its stops nothing holds the mechanism
            room[self.is_position] = 0
        return np.clip(z, low + room, high - room)

    def search(self, start: Array, free: Mask, *, bounded: bool = True, rows: Mask | None = None) -> Iterate:
        """What `solve` finds from the start, or from a little aside of it where the start is stationary for an equation.

        A stretched arm does not know which way to bend.
        """
        tries = [self.solve(start, free, bounded=bounded, rows=rows)]
        if tries[0].miss > self.tolerance and self._is_stationary(start, free, rows):
            for sign in (1, -1):
                tries.append(self.solve(start + sign * self.aside(free), free, bounded=bounded, rows=rows, anchor=start))
                if tries[-1].miss <= self.tolerance:
                    break
        best = min(tries, key=lambda found: found.miss)
        return replace(best, evaluations=sum(found.evaluations for found in tries))

    def aside(self, free: Mask) -> Array:
        """A displacement of the positions in no particular direction."""
        pattern = np.modf(GOLDEN_RATIO * np.arange(1, len(free) + 1))[0] - 0.5
        return np.asarray(NUDGE * pattern * self.scales.unknowns * (free & self.is_position))

    def _is_stationary(self, z: Array, free: Mask, rows: Mask | None) -> bool:
        """Whether an equation is not met at z, and nothing that is free acts on it there."""
        unmet = np.abs(self.residual(z)) > self.tolerance
        idle = np.max(np.abs(self.jacobian(z, free)), axis=1, initial=0.0) <= ACTS
        return bool(np.any(unmet & idle & (True if rows is None else rows)))

    def tidied(self, found: Iterate, free: Mask) -> Iterate:
        """The same without the rounding in unknowns that need not differ from their start or are at a bound.

        free: which of the unknowns were solved.
        """
        z = np.array(found.z)
        for target, near in ((self.start, TIDY), *((bound, RESOLVED) for bound in self.bounds.T)):
            z = np.where(free & (np.abs(z - target) <= near * self.scales.unknowns), target, z)
        rest = free & (z == found.z)
        allowed = max(2 * found.miss, ROUNDING)
        tidy = Iterate(z, self.residual(z), 1)
        if tidy.miss > allowed and np.any(rest):
            low, high = self.bounds.T
            rows = np.ones(len(self.scales.equations), dtype=bool)
            tidy = self._regularised(z, z, rest, rows, np.full(np.sum(rest), DAMPING), (low, high))
        kept = tidy if tidy.miss <= allowed else found
        return Iterate(kept.z, kept.residual, found.evaluations + tidy.evaluations)

    def _regularised(
        self, start: Array, anchor: Array, free: Mask, rows: Mask, weights: Array, bounds: tuple[Array, Array]
    ) -> Iterate:
        """Least squares of the equations and of weights * (unknowns - anchor), scaled.

        Args:
            start, anchor: from where, and towards where (nv + na + nu,).
            free, rows: which unknowns may change, and which equations count.
            weights: of the departure of each free unknown.
            bounds: lowest and highest values of all unknowns.
        """
        units = self.scales.unknowns[free]

        def full(scaled: Array) -> Array:
            z = np.array(start)
            z[free] = np.clip(scaled * units, *(bound[free] for bound in bounds))
            return z

        def extended(scaled: Array) -> Array:
            return np.concatenate([self.residual(full(scaled))[rows], weights * (scaled - anchor[free] / units)])

        def derivative(scaled: Array) -> Array:
            return np.vstack([self.jacobian(full(scaled), free)[rows], np.diag(weights)])

        found = scipy.optimize.least_squares(
            extended,
            start[free] / units,
            jac=derivative,
            bounds=tuple(bound[free] / units for bound in bounds),
            method="trf",
            ftol=1e-8,
            xtol=1e-14,
            gtol=1e-15,
            max_nfev=50,
        )
        z = full(found.x)
        return Iterate(z, self.residual(z)[rows], int(found.nfev))

    def _derivative(self, z: Array, which: Mask, units: Array) -> Array:
        """Columns of the derivative of `values` with respect to those unknowns, each measured in its unit."""
        columns = np.flatnonzero(which)
        derivative = np.empty((len(self.values(z)), len(columns)))
        for i, column in enumerate(columns):
            ahead, behind = np.array(z), np.array(z)
            ahead[column] += self.step * units[column]
            behind[column] -= self.step * units[column]
            derivative[:, i] = (self.values(ahead) - self.values(behind)) / (2 * self.step)
        return derivative

    def _scales(self) -> Scales:
        model = self.model
        nv, na = model.nv, model.na
        lengths = np.array([model.stat.extent if unit == "m" else 1.0 for unit in tangent_units(model)])
        limits = self.bounds[nv:]
        spans = np.where(np.all(np.isfinite(limits), axis=1), (limits[:, 1] - limits[:, 0]) / 2, 1.0)
        units = np.concatenate([lengths, as_divisor(np.nan_to_num(spans, posinf=1.0))])
        self.values(self.start)
        single = self._single_accelerations()
        by_unit = np.abs(self._derivative(self.start, np.ones(len(units), dtype=bool), units))
        positions, activations, controls = np.split(by_unit, [nv, nv + na], axis=1)
        inputs = np.hstack([activations, controls])
        accelerations = single + np.sum(positions[:nv], axis=1)
        accelerations = np.where(accelerations > 0, accelerations, np.max(inputs[:nv], axis=1, initial=0.0))
        accelerations = as_divisor(accelerations)
        # A control that accelerates nothing by itself acts through its activation, whose unit follows from the force it makes.
        strength = np.max(inputs[:nv] / accelerations[:, None], axis=0, initial=0.0)
        units[nv:] /= as_divisor(strength)
        rates = as_divisor(np.max(inputs[nv : nv + na] / as_divisor(strength), axis=1, initial=0.0))
        indirect = np.max(inputs[nv : nv + na, na:] / rates[:, None], axis=0, initial=0.0)
        units[nv + na :] /= np.where(strength[na:] > 0, 1.0, as_divisor(indirect))
        outputs = as_divisor(np.sum(by_unit[nv + na :, :nv], axis=1))
        return Scales(units, np.concatenate([accelerations, rates, outputs]))

    def _single_accelerations(self) -> Array:
        """What the single forces at the start would make of each acceleration, added up without their signs, (nv,)."""
        model, data = self.model, self.data
        kinds = (data.qfrc_bias, data.qfrc_spring, data.qfrc_gravcomp, data.qfrc_actuator, data.qfrc_applied, data.qfrc_constraint)
        forces = np.array(kinds)
        accelerations = np.zeros_like(forces)
        mujoco.mj_solveM(model, data, accelerations, forces)
        return np.asarray(np.sum(np.abs(accelerations), axis=0))

    def _bounds(self, model: mujoco.MjModel) -> Array:
        """Lowest and highest value of each unknown (nv + na + nu, 2): ranges of slides and hinges, of activations and controls."""
        positions = position_limits(model)
        if self.constraints:
            room = YIELD * (positions[:, 1] - positions[:, 0])
            positions = positions + np.where(np.isfinite(room), room, 0.0)[:, None] * [-1, 1]
        present = np.zeros(model.nv)
        for joint in range(model.njnt):
            if mujoco.mjtJoint(model.jnt_type[joint]) in (mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE):
                present[model.jnt_dofadr[joint]] = self.given.qpos[model.jnt_qposadr[joint]]
        activations = np.tile([-np.inf, np.inf], (model.na, 1))
        for i in np.flatnonzero(model.actuator_actlimited):
            where = slice(model.actuator_actadr[i], model.actuator_actadr[i] + model.actuator_actnum[i])
            activations[where] = model.actuator_actrange[i]
        controls = control_limits(model, np.arange(model.nu))
        controls[self.excitations] = np.clip(controls[self.excitations], 0.0, 1.0)  # beyond, MuJoCo clamps them
        return np.vstack([positions - present[:, None], activations, controls])
