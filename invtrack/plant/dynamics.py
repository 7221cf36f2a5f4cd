"""A plant's nonlinear dynamics as planning sees them (`invtrack.plans.dynamics`): from MuJoCo, at many states at once."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from invtrack.arrays import Array, Indices
from invtrack.channels import Channels
from invtrack.linear.state_space import StateSpace
from invtrack.plans.dynamics import Derivatives, Mechanism, mechanism
from invtrack.plans.runge_kutta import Steps
from invtrack.plant.configuration import configuration_of, state_of, tangent_units
from invtrack.plant.linearizable import refuse_constraints, refuse_step_maps
from invtrack.plant.linearize import linearize
from invtrack.plant.plant import Plant
from invtrack.plant.smooth_model import smooth_model

if TYPE_CHECKING:
    from invtrack.plant.native.motions import Machine

STEP = 2.0**-17
"""Perturbation of states and inputs in central differences, in radians, metres (of small mechanisms: extents) and their rates."""

SMALL_STEP = 2.0**-25
"""The same in one-sided differences."""

FEWEST = 32
"""States that a thread is worth starting for."""

IN_MEMORY = 2**23
"""Numbers that differences are made of, held in memory at once."""


@dataclass(frozen=True, eq=False)
class PlantDynamics:
    """The smooth dynamics of a plant with these values of its parameters: no dry friction, no delays, no limits, no contacts.

    Points are rows (qpos, qvel, act); see `invtrack.plans.dynamics.Dynamics` for what can be asked of them.
    """

    plant: Plant
    values: Mapping[str, float]

    @cached_property
    def _smooth(self) -> mujoco.MjModel:
        """With what MuJoCo's limits do to the motion."""
        return smooth_model(self.plant.model_with(self.values), backlash=self.plant.backlash).model

    @cached_property
    def _model(self) -> mujoco.MjModel:
        """Without limits and contacts, so that iterations may pass through states that the plan does not."""
        model = smooth_model(self.plant.model_with(self.values), backlash=self.plant.backlash).model
        refuse_step_maps(model)
        flags = mujoco.mjtDisableBit
        model.opt.disableflags |= flags.mjDSBL_CONTACT | flags.mjDSBL_LIMIT | flags.mjDSBL_CLAMPCTRL
        model.actuator_forcelimited[:] = False
        model.actuator_actlimited[:] = False
        model.jnt_actfrclimited[:] = False
        model.tendon_actfrclimited[:] = False
        return model

    @cached_property
    def size(self) -> int:
        """Number of tangent coordinates, 2 nv + na."""
        return 2 * int(self._model.nv) + int(self._model.na)

    @property
    def state_coordinates(self) -> Indices:
        """The tangent coordinates that are the plant's states (n,)."""
        return self.plant.state_addresses

    @cached_property
    def _rotations(self) -> list[int]:
        return rotations(self._model)

    @cached_property
    def _data(self) -> tuple[mujoco.MjData, ...]:
        return tuple(self.plant.new_data(self._model) for _ in range(os.cpu_count() or 1))

    @cached_property
    def _periods(self) -> Array:
        """Of outputs that are angles known up to whole turns, 0 for others (p,)."""
        return np.array([reading.period for reading in self.plant.output_readings.readings])

    @cached_property
    def _machines(self) -> tuple[Machine, ...]:
        from invtrack.plant.native.motions import Machine  # compiles

        addresses, outputs = self.plant.input_addresses, self.plant.output_readings.readings
        return tuple(Machine(self._model, data, addresses, self._rotations, outputs) for data in self._data)

    @cached_property
    def _pool(self) -> ThreadPoolExecutor:
        """Threads that live as long as the dynamics: starting them costs as much as hundreds of states."""
        return ThreadPoolExecutor(len(self._machines))

    @cached_property
    def _sizes(self) -> Array:
        """Of states and inputs, by which they are perturbed (n + m,)."""
        length = min(1.0, float(self._model.stat.extent))
        places = np.where(np.array([unit == "m" for unit in tangent_units(self._model)]), length, 1.0)
        configuration = self.plant.configuration
        act = np.maximum(1.0, np.abs(configuration.act))
        controls = np.maximum(1.0, np.abs(configuration.ctrl[self.plant.input_addresses]))
        return np.concatenate([places, places, act, controls])

    def _shared(self, work: Callable[[Machine, slice], None], count: int) -> None:
        """Do the work on all of `count` states, on as many threads as are worth it."""
        threads = max(1, min(len(self._machines), count // FEWEST))
        edges = np.linspace(0, count, threads + 1).astype(int).tolist()
        with self.plant.forces(self._model):
            if threads == 1:
                work(self._machines[0], slice(0, count))
                return
            jobs = [self._pool.submit(work, self._machines[i], slice(a, b)) for i, (a, b) in enumerate(pairwise(edges))]
            for job in jobs:
                job.result()

    def motion(self, points: Array, coefficients: Array, steps: Steps, lengths: Array) -> Array:
        """The points (k, S + 1, .) on k motions; see `Dynamics.motion`.

        Args:
            points, coefficients, steps, lengths: see `Dynamics.motion`.
        """
        nodes = np.full((len(points), steps.number + 1, points.shape[1]), np.nan)
        given = [np.ascontiguousarray(array, dtype=float) for array in (points, coefficients, lengths)]

        def work(own: Machine, part: slice) -> None:
            own.integrate(given[0][part], given[1][part], steps, given[2][part], nodes[part])

        self._shared(work, len(points))
        return nodes

    def evaluate(self, points: Array, inputs: Array) -> tuple[Array, Array]:
        """Rates (k, n) and outputs (k, p); see `Dynamics.evaluate`."""
        points, inputs = np.ascontiguousarray(points, dtype=float), np.ascontiguousarray(inputs, dtype=float)
        nq, nv, p = self._model.nq, self._model.nv, len(self.plant.outputs)
        accelerations, outputs = np.full((len(points), self.size - nv), np.nan), np.full((len(points), p), np.nan)

        def work(own: Machine, part: slice) -> None:
            own.evaluate(points[part], inputs[part], accelerations[part], outputs[part])

        self._shared(work, len(points))
        return np.hstack([points[:, nq : nq + nv], accelerations]), outputs

    def derivatives(self, points: Array, inputs: Array, *, rough: bool = False) -> Derivatives:
        """Rates, outputs and their derivatives, by central differences, or by one-sided ones; see `Dynamics.derivatives`."""
        rates, outputs = self.evaluate(points, inputs)
        k, n, m, nv, p = len(points), self.size, len(self.plant.inputs), self._model.nv, len(self.plant.outputs)
        A, B, C, D = (np.zeros((k, rows, columns)) for rows in (n, p) for columns in (n, m))
        A[:, :nv, nv : 2 * nv] = np.eye(nv)
        for first in self._rotations:
            w = rates[:, first : first + 3]
            for i, j, axis, sign in ((0, 1, 2, 1), (0, 2, 1, -1), (1, 0, 2, -1), (1, 2, 0, 1), (2, 0, 1, 1), (2, 1, 0, -1)):
                A[:, first + i, first + j] = sign * w[:, axis]  # -w x d
        block = max(1, IN_MEMORY // (2 * (n + m) * (n - nv + p)))
        for start in range(0, k, block):
            part = slice(start, min(start + block, k))
            if rough:
                acceleration, output = self._one_sided(points[part], inputs[part], rates[part, nv:], outputs[part])
            else:
                acceleration, output = self._central(points[part], inputs[part])
            A[part, nv:], B[part, nv:] = acceleration[:, :, :n], acceleration[:, :, n:]
            C[part], D[part] = output[:, :, :n], output[:, :, n:]
        return Derivatives(rates, outputs, A, B, C, D)

    def _central(self, points: Array, inputs: Array) -> tuple[Array, Array]:
        """Derivatives (k, nv + na, n + m) of accelerations and (k, p, n + m) of outputs."""
        steps = STEP * self._sizes
        accelerations, outputs = self._perturbed(points, inputs, np.column_stack([steps, -steps]))
        change = self.output_difference(outputs[:, :, 0], outputs[:, :, 1])
        slopes = (accelerations[:, :, 0] - accelerations[:, :, 1]) / (2 * steps[:, None]), change / (2 * steps[:, None])
        return slopes[0].transpose(0, 2, 1), slopes[1].transpose(0, 2, 1)

    def _one_sided(self, points: Array, inputs: Array, at: Array, outputs_at: Array) -> tuple[Array, Array]:
        """The same from accelerations (k, nv + na) and outputs (k, p) at the points themselves."""
        steps = SMALL_STEP * self._sizes
        accelerations, outputs = self._perturbed(points, inputs, steps[:, None])
        change = self.output_difference(outputs[:, :, 0], outputs_at[:, None])
        slopes = (accelerations[:, :, 0] - at[:, None]) / steps[:, None], change / steps[:, None]
        return slopes[0].transpose(0, 2, 1), slopes[1].transpose(0, 2, 1)

    def _perturbed(self, points: Array, inputs: Array, steps: Array) -> tuple[Array, Array]:
        """Accelerations (k, n + m, sides, nv + na) and outputs, states and inputs moved by steps (n + m, sides) one at a time."""
        points, inputs, steps = (np.ascontiguousarray(array, dtype=float) for array in (points, inputs, steps))
        counts = self.size - self._model.nv, len(self.plant.outputs)
        accelerations, outputs = (np.full((len(points), *steps.shape, count), np.nan) for count in counts)

        def work(own: Machine, part: slice) -> None:
            own.perturbed(points[part], inputs[part], steps, accelerations[part], outputs[part])

        self._shared(work, len(points))
        return accelerations, outputs

    def retract(self, points: Array, tangents: Array) -> Array:
        """The points at tangents (k, n) from points (k, .)."""
        nq, nv = self._model.nq, self._model.nv
        result = np.hstack([points[:, :nq], points[:, nq:] + tangents[:, nv:]])
        if not self._rotations:
            result[:, :nq] += tangents[:, :nv]
            return result
        for row, tangent in zip(result, tangents, strict=True):
            mujoco.mj_integratePos(self._model, row[:nq], tangent[:nv].copy(), 1.0)
        return result

    def difference(self, points: Array, origins: Array) -> Array:
        """The tangents (k, n) from the origins (k, .) to the points (k, .)."""
        nq, nv = self._model.nq, self._model.nv
        if not self._rotations:
            return np.asarray(points - origins)
        result = np.hstack([np.empty((len(points), nv)), points[:, nq:] - origins[:, nq:]])
        for row, point, origin in zip(result, points, origins, strict=True):
            mujoco.mj_differentiatePos(self._model, row[:nv], 1.0, origin[:nq].copy(), point[:nq].copy())
        return result

    def output_difference(self, outputs: Array, wanted: Array) -> Array:
        """outputs - wanted (..., p), angles that are known up to whole turns by the shorter way round."""
        away, period = np.asarray(outputs - wanted), self._periods
        turning = period > 0
        away[..., turning] -= period[turning] * np.round(away[..., turning] / period[turning])
        return away

    def states(self, points: Array) -> Array:
        """The plant's states (k, n) at points (k, .), as deviations from its operating point."""
        x0, addresses = self.plant.configuration.x0, self.plant.state_addresses
        origins = np.broadcast_to(x0, points.shape)
        return self.difference(points, origins)[:, addresses]

    def state_rates(self, points: Array, rates: Array) -> Array:
        """The time derivatives (k, n) of the plant's states, for points that move at rates (k, .)."""
        if not self._rotations:
            return np.asarray(rates[:, self.plant.state_addresses])
        step = STEP / np.maximum(np.max(np.abs(rates), axis=1, keepdims=True), 1.0)
        ahead, back = (self.states(self.retract(points, sign * step * rates)) for sign in (1, -1))
        return np.asarray((ahead - back) / (2 * step))

    def linear_model(self, point: Array, inputs: Array) -> StateSpace:
        """The linear model about an equilibrium, by `linearize`, its states measured from the plant's operating point."""
        values: dict[str, Any] = dict(self.values)
        return linearize(self.plant, equilibrium=self._at(point, inputs), **values)

    def _at(self, point: Array, inputs: Array) -> Plant:
        nq, nv = self._model.nq, self._model.nv
        ctrl = np.array(self.plant.configuration.ctrl)
        ctrl[self.plant.input_addresses] = inputs
        at_rest = np.zeros(nv)  # of an equilibrium velocities are rounding
        return self.plant.at(qpos=point[:nq], qvel=at_rest, act=point[nq + nv :], ctrl=ctrl)

    def require_free(self, points: Array, inputs: Array) -> None:
        """Raises PlantError where a contact or a limit acts on the plant."""
        model = self._smooth
        data, nq, nv = self.plant.new_data(model), model.nq, model.nv
        with self.plant.forces(model):
            for point, u in zip(points, inputs, strict=True):
                data.qpos[:], data.qvel[:], data.act[:] = point[:nq], point[nq : nq + nv], point[nq + nv :]
                data.ctrl[self.plant.input_addresses] = u
                mujoco.mj_forward(model, data)
                refuse_constraints(model, data)

    def replay(self, points: Array, coefficients: Array, lengths: Array, steps: int) -> tuple[Array, Array]:
        """Points (k, steps, .) and outputs (k, steps, p) by mj_step with RK4, the polynomials evaluated at each of its stages.

        Args:
            points, coefficients, lengths, steps: see `Dynamics.replay`.
        """
        from invtrack.plant.native.polynomial_inputs import PolynomialInputs  # compiles

        model = self._smooth
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
        data, nq, nv = self.plant.new_data(model), model.nq, model.nv
        powers, inputs = _powers(coefficients), PolynomialInputs(data, self.plant.input_addresses, coefficients.shape[1])
        reached = np.empty((len(points), steps, points.shape[1]))
        outputs = np.empty((len(points), steps, len(self.plant.outputs)))
        with self.plant.forces(model), inputs.acting():
            for k, point in enumerate(points):
                inputs.begin(powers[k], lengths[k])
                data.qpos[:], data.qvel[:], data.act[:] = point[:nq], point[nq : nq + nv], point[nq + nv :]
                model.opt.timestep = lengths[k] / steps
                for step in range(steps):
                    data.qacc_warmstart[:] = 0
                    mujoco.mj_step(model, data)
                    reached[k, step] = np.concatenate([data.qpos, data.qvel, data.act])
                    mujoco.mj_forward(model, data)
                    outputs[k, step] = self.plant.measure(data)
        return reached, outputs


@dataclass(frozen=True, eq=False)
class PlantMechanism:
    """A plant as a mechanism to plan for; see `invtrack.plans.dynamics.Mechanism`."""

    plant: Plant

    @property
    def name(self) -> str:
        """The model's name."""
        return self.plant.name

    @property
    def inputs(self) -> Channels:
        """The plant's inputs."""
        return self.plant.inputs

    @property
    def outputs(self) -> Channels:
        """The plant's outputs."""
        return self.plant.outputs

    @property
    def states(self) -> Channels:
        """The plant's states."""
        return self.plant.states

    @property
    def parameter_values(self) -> Mapping[str, float]:
        """The parameters' values in the file."""
        return self.plant.parameter_values

    @property
    def operating_point(self) -> tuple[Array, Array]:
        """(qpos, qvel, act) of the plant's operating point, and its inputs there."""
        configuration = self.plant.configuration
        return configuration.x0, np.array(configuration.ctrl[self.plant.input_addresses])

    def dynamics(self, values: Mapping[str, float]) -> PlantDynamics:
        """The plant's dynamics with these parameters, the others as in the file."""
        return PlantDynamics(self.plant, dict(values))

    @property
    def turns(self) -> bool:
        """Whether the plant has ball or free joints."""
        return bool(rotations(self.plant.model))

    def state_difference(self, x: Array, x_ref: Array) -> Array:
        """x minus x_ref, both (n,), rotations as the rotation vector in the body's frame at x_ref."""
        plant, model = self.plant, self.plant.model
        x0 = plant.configuration.x0
        at, reference = (configuration_of(model, x0, plant.coordinates_of(each)) for each in (x, x_ref))
        return state_of(model, np.concatenate(reference), *at)[plant.state_addresses]


@mechanism.register
def _(model: Plant) -> Mechanism:
    return PlantMechanism(model)


def rotations(model: mujoco.MjModel) -> list[int]:
    """The first of the three degrees of freedom of each rotation: of ball joints, and of free joints behind their place."""
    places = {int(mujoco.mjtJoint.mjJNT_BALL): 0, int(mujoco.mjtJoint.mjJNT_FREE): 3}
    joints = zip(model.jnt_type.tolist(), model.jnt_dofadr.tolist(), strict=True)
    return [first + places[kind] for kind, first in joints if kind in places]


@lru_cache
def _legendre_powers(count: int) -> Array:
    """Row i: the coefficients of the Legendre polynomial i on [0, 1], lowest power first (count, count)."""
    rows = np.zeros((count, count))
    for i in range(count):
        shifted = np.polynomial.Polynomial(np.polynomial.legendre.leg2poly(np.eye(count)[i]))(np.polynomial.Polynomial([-1.0, 2.0]))
        rows[i, : len(shifted.coef)] = shifted.coef
    return rows


def _powers(coefficients: Array) -> Array:
    """The same polynomials by powers of the share of the element that has passed (k, s, m)."""
    return np.asarray(np.einsum("kim,ij->kjm", coefficients, _legendre_powers(coefficients.shape[1])))
