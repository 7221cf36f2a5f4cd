"""What a MuJoCo model's actuators make of their controls, within the limits on controls, forces and activations."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence

import mujoco
import numpy as np

from invtrack.arrays import Array
from invtrack.plant.elements import element_name
from invtrack.plant.limits import actuator_of, control_limit, control_limits, limit_text, scalar_joint
from invtrack.plant.plant import Plant
from invtrack.plant.units import activation_unit, constant_gain
from invtrack.simulation.acting_limits import ActingLimit, clipped, noticeable, size_of

Stage = Callable[[mujoco.MjModel, mujoco.MjData], None]

_LINEAR_DYNAMICS = tuple(
    map(
        int, (mujoco.mjtDyn.mjDYN_NONE, mujoco.mjtDyn.mjDYN_INTEGRATOR, mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT)
    )
)
_FILTERS = tuple(map(int, (mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT)))

ONE_STEP = 1e-3
"""What a single step would add to a clamped activation is noticed from this share of what else is noticed on."""


class Actuation:
    """The actuators of one model, asked what they do at recorded states.

    Limits that are the same in every state (`invtrack.plant.limits`) only clip the inputs. What depends on the state (the force of
    a servo or a muscle, the total at a tendon or a joint, activations) is asked of MuJoCo: the forces that act without limits, from
    which those that the limits leave follow, in MuJoCo's order: total at the tendon, forcerange, total at the joint. A model
    without such limits costs nothing beyond the clipping; forces that are affine in state and control, as those of servos on
    slides and hinges, cost one product of matrices, whose coefficients MuJoCo is asked for once.

    limits: the limits that may act, in the order of the columns of `excess`; the first p are those of the inputs.
    """

    def __init__(self, plant: Plant, model: mujoco.MjModel) -> None:
        self._addresses = plant.input_addresses
        self._input_limits = control_limits(model, self._addresses)
        self._forces = _Forces(model, [actuator_of(model, int(address)) for address in self._addresses])
        names = zip(plant.inputs.names, plant.inputs.units, self._addresses, strict=True)
        self.limits = [ActingLimit(limit_text(model, name, int(address)), unit) for name, unit, address in names]
        self.limits += self._forces.limits
        if self._forces.limits:
            self._data = mujoco.MjData(model)
            plant.configuration.write(self._data)
            self._held = np.clip(self._data.ctrl, *control_limits(model, np.arange(model.nu)).T)  # of those that are no inputs

    def passed_on(self, raw: Array, u: Array, after: Array | None = None) -> tuple[Array, Array]:
        """What is applied of inputs u (k, p) at raw states (k, nq + nv + na), and the excess over each limit (k, L).

        An input that is clamped on its way is what would give the force that acts: of an actuator without activation
        u + (force that acts - force without limits) / (force per control). The cut of a total at a joint is shared by the inputs
        that act on that joint, as they contribute to it. Of an actuator with an activation, whose force does not follow its control
        at once, and of what acts on a clamped joint through a tendon or a site, it is the input within its own limits.

        after (k, nq + nv + na): the raw states at the ends of the steps, which show where an activation was clamped; without them,
        as along a plan, activations are compared with their range as they are.
        """
        applied, excess = clipped(u, self._input_limits)
        if not self._forces.limits:
            return applied, excess
        controls = np.tile(self._held, (len(u), 1))
        controls[:, self._addresses] = applied
        change, beyond = self._forces.clamped(self._data, raw, controls, after)
        return applied + change[:, self._addresses], np.hstack([excess, beyond])


class _Forces:
    """Limits that depend on the state: forceranges, totals at tendons and joints, ranges of activations."""

    def __init__(self, model: mujoco.MjModel, inputs: Sequence[int]) -> None:
        found = [control_limit(model, address) for address in range(model.nu)]
        handled = {actuator_of(model, address) for address, limit in enumerate(found) if limit.forcerange}
        alone = {limit.joint for limit in found if limit.joint is not None}
        every = range(model.nactuator)
        self._forced: list[int] = [i for i in every if model.actuator_forcelimited[i] and i not in handled]
        self._tendons: list[int] = np.flatnonzero(model.tendon_actfrclimited).tolist()
        self._joints: list[int] = [j for j in np.flatnonzero(model.jnt_actfrclimited).tolist() if j not in alone]
        self._active: list[int] = [i for i in every if model.actuator_actlimited[i] and model.actuator_actnum[i]]
        self.limits: list[ActingLimit] = []
        for kind, text, elements in (
            ("tendon", "actuatorfrcrange", self._tendons),
            ("actuator", "forcerange", self._forced),
            ("joint", "actuatorfrcrange", self._joints),
            ("actuator", "actrange", self._active),
        ):
            named = kind if kind != "actuator" else ""
            for i in elements:
                unit = activation_unit(model, i) if text == "actrange" else ""
                self.limits.append(ActingLimit(f"{text} of {f'{named} {element_name(model, kind, i)}'.strip()}", unit))
        self._model = model
        if not self.limits:
            return
        self._free = copy.copy(model)
        self._free.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL
        self._free.actuator_forcelimited[:] = False
        self._free.tendon_actfrclimited[:] = False
        self._free.jnt_actfrclimited[:] = False
        self._without_joints = copy.copy(model)
        self._without_joints.jnt_actfrclimited[:] = False
        self._prepare = _preparation(self._free)
        self._affine = self._affine_map() if _is_affine(model) else None
        self._outputs = [slice(int(a), int(a + n)) for a, n in zip(model.actuator_outadr, model.actuator_outnum, strict=True)]
        self._direct = [i for i in inputs if model.actuator_actnum[i] == 0 and model.actuator_ctrlnum[i] == 1]

    def clamped(self, data: mujoco.MjData, raw: Array, controls: Array, after: Array | None) -> tuple[Array, Array]:
        """By how much limits change the controls (k, nu), and the excess over each of them (k, L)."""
        model = self._model
        force, total, rate = self._without_limits(data, raw, controls)
        acting = force.copy()
        excess = [self._at_tendon(tendon, acting) for tendon in self._tendons]
        for i in self._forced:
            columns, limits = self._outputs[i], model.actuator_forcerange[i]
            asked = acting[:, columns].copy()
            acting[:, columns] = np.clip(asked, *limits)
            excess.append(noticeable(np.max(np.abs(acting[:, columns] - asked), axis=1), size_of(limits)))
        change = acting - force
        if self._joints:
            rows = np.flatnonzero(np.any(change, axis=1))
            total[rows] = self._act(self._without_joints, data, raw[rows], controls[rows])[1]
            excess += [self._at_joint(joint, total, acting, change) for joint in self._joints]
        first = model.nq + model.nv
        for i in self._active:
            at, reached = raw[:, first:], None if after is None else after[:, first:]
            excess.append(self._of_activation(i, at, rate, reached))
        return self._as_controls(data, raw, controls, force, change), np.column_stack(excess)

    def _at_tendon(self, tendon: int, acting: Array) -> Array:
        """Excess of the total at a tendon; MuJoCo scales all its actuators alike, and so does this, in place."""
        model = self._model
        pulls = [
            self._outputs[i].start
            for i in range(model.nactuator)
            if model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_TENDON and model.actuator_trnid[i, 0] == tendon
        ]
        limits, total = model.tendon_actfrcrange[tendon], acting[:, pulls].sum(axis=1)
        within = np.clip(total, *limits)
        share = np.divide(within, total, out=np.ones_like(total), where=total != 0)
        acting[:, pulls] *= share[:, None]
        return noticeable(np.abs(total - within), size_of(limits))

    def _at_joint(self, joint: int, total: Array, acting: Array, change: Array) -> Array:
        """Excess of the total at a joint; the cut is shared by the inputs on it, added to `change` in place."""
        model = self._model
        limits, dof = model.jnt_actfrcrange[joint], int(model.jnt_dofadr[joint])
        cut = np.clip(total[:, dof], *limits) - total[:, dof]
        movers = [i for i in self._direct if scalar_joint(model, i) == joint]
        columns = [self._outputs[i].start for i in movers]
        if columns:
            gears = model.actuator_gear[columns, 0]
            parts = np.abs(gears * acting[:, columns])
            whole = parts.sum(axis=1, keepdims=True)
            share = np.divide(parts, whole, out=np.full_like(parts, 1 / len(columns)), where=whole > 0)
            change[:, columns] += cut[:, None] * share / gears
        return noticeable(np.abs(cut), size_of(limits))

    def _of_activation(self, actuator: int, act: Array, rate: Array, reached: Array | None) -> Array:
        """Excess of an actuator's activations `act` (k, na), which change at `rate` [1/s] and are `reached` a step later.

        A clamped one is exactly at the end of its range after the step, and would have gone on: a filter to the control that it
        follows, anything else by what its rate adds in one step.
        """
        model, first = self._model, int(self._model.actuator_actadr[actuator])
        columns = slice(first, first + int(model.actuator_actnum[actuator]))
        limits = model.actuator_actrange[actuator]
        if reached is None:
            excess = act[:, columns] - np.clip(act[:, columns], *limits)
            return noticeable(np.max(np.abs(excess), axis=1), size_of(limits))
        filtered = model.actuator_dyntype[actuator] in _FILTERS
        onwards = float(model.actuator_dynprm[actuator, 0]) if filtered else model.opt.timestep
        wanted = act[:, columns] + onwards * rate[:, columns]
        excess = wanted - np.clip(wanted, *limits)
        excess[~np.isin(reached[:, columns], limits)] = 0.0
        excess = np.max(np.abs(excess), axis=1)
        return noticeable(excess, size_of(limits) * (1.0 if filtered else ONE_STEP))

    def _as_controls(self, data: mujoco.MjData, raw: Array, controls: Array, force: Array, change: Array) -> Array:
        """The changes of control (k, nu) that make the changes of force, of actuators whose force follows their control."""
        result = np.zeros_like(controls)
        rows = np.flatnonzero(np.any(change, axis=1))
        if len(rows) and self._direct:
            addresses = self._model.actuator_ctrladr[self._direct]
            outputs = [self._outputs[i].start for i in self._direct]
            at = controls[rows][:, addresses]
            moved = controls[rows].copy()
            moved[:, addresses] += (step := np.where(at != 0, at, 1.0))
            gain = (self._without_limits(data, raw[rows], moved)[0][:, outputs] - force[rows][:, outputs]) / step
            part = change[rows][:, outputs]
            result[np.ix_(rows, addresses)] = np.divide(part, gain, out=np.zeros_like(part), where=gain != 0)
        return result

    def _without_limits(self, data: mujoco.MjData, raw: Array, controls: Array) -> tuple[Array, Array, Array]:
        """As `_act`, without limits."""
        if self._affine is None:
            return self._act(self._free, data, raw, controls)
        at_zero, rates = self._affine
        every = at_zero + np.hstack([raw, controls]) @ rates
        model = self._model
        force, total, rate = np.split(every, [every.shape[1] - model.nv - model.na, every.shape[1] - model.na], axis=1)
        return force, total, rate

    def _affine_map(self) -> tuple[Array, Array]:
        """What `_act` is at zero, and its derivatives, where it is affine in state and control: differences over steps of 1."""
        model, data = self._free, mujoco.MjData(self._free)
        points = np.eye(1 + model.nq + model.nv + model.na + model.nu)[:, 1:]
        controls = points[:, model.nq + model.nv + model.na :]
        values = np.hstack(self._act(model, data, points[:, : model.nq + model.nv + model.na], controls))
        return values[0], values[1:] - values[0]

    def _act(self, model: mujoco.MjModel, data: mujoco.MjData, raw: Array, controls: Array) -> tuple[Array, Array, Array]:
        """Forces (k, nout), their totals at the degrees of freedom (k, nv), and rates of activations (k, na)."""
        force = np.empty((len(raw), data.actuator_force.size))
        total, rate = np.empty((len(raw), model.nv)), np.empty((len(raw), model.na))
        ends = [model.nq, model.nq + model.nv]
        written = list(zip(np.split(raw, ends, axis=1), (data.qpos, data.qvel, data.act), strict=True))
        written = [(values, live) for values, live in [*written, (controls, data.ctrl)] if live.size]
        read = [(force, data.actuator_force), (total, data.qfrc_actuator), (rate, data.act_dot)]
        read = [(target, live) for target, live in read if live.size]
        stages = [*self._prepare, mujoco.mj_fwdActuation]
        for i in range(len(raw)):
            for values, live in written:
                live[:] = values[i]
            for stage in stages:
                stage(model, data)
            for target, live in read:
                target[i] = live
        return force, total, rate


def _is_affine(model: mujoco.MjModel) -> bool:
    """Whether forces and rates of activations are affine in state and control: motors, servos, filters on slides and hinges."""
    on_tendon = model.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON
    on_joint = [scalar_joint(model, i) is not None for i in range(model.nactuator)]
    return bool(
        np.all(on_tendon | on_joint)
        and np.all(model.wrap_type == mujoco.mjtWrap.mjWRAP_JOINT)
        and all(constant_gain(model, i) is not None for i in range(model.nactuator))
        and np.all(np.isin(model.actuator_biastype, (mujoco.mjtBias.mjBIAS_NONE, mujoco.mjtBias.mjBIAS_AFFINE)))
        and np.all(np.isin(model.actuator_dyntype, _LINEAR_DYNAMICS))
        and not np.any(model.jnt_actgravcomp)
        and not np.any(model.actuator_dampingpoly)
    )


def _preparation(model: mujoco.MjModel) -> list[Stage]:
    """The stages of MuJoCo's pipeline that the forces of this model's actuators depend on."""
    fixed = (mujoco.mjtGain.mjGAIN_FIXED,), (mujoco.mjtBias.mjBIAS_NONE,)
    needs_velocity = bool(
        not np.all(np.isin(model.actuator_gaintype, fixed[0]))
        or not np.all(np.isin(model.actuator_biastype, fixed[1]))
        or np.any(model.jnt_actgravcomp)
    )
    needs_places = needs_velocity and model.nv > 0
    needs_places |= not np.all(np.isin(model.actuator_trntype, (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_TENDON)))
    needs_places |= not np.all(model.wrap_type == mujoco.mjtWrap.mjWRAP_JOINT)
    return [
        *([mujoco.mj_kinematics, mujoco.mj_comPos] if needs_places else []),
        *([mujoco.mj_tendon] if model.ntendon else []),
        mujoco.mj_transmission,
        *([mujoco.mj_fwdVelocity] if needs_velocity else []),
    ]
