"""MuJoCo's smooth dynamics at many states at once: loops that numba compiles and that call libmujoco by address.

States are rows (qpos, qvel, act); controls are those of the plant's inputs. `Machine` holds what a loop needs of one MjModel and
one MjData, which must outlive it; each thread needs one of its own. Positions are perturbed and integrated in the tangent space of
qpos.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

from invtrack.arrays import Array, Indices

NOTHING_SKIPPED, POSITIONS_SKIPPED, VELOCITIES_SKIPPED = 0, 1, 2
"""What mj_forwardSkip takes for granted: nothing; all that depends on positions; all that depends on positions and velocities."""


HUGE = 1e9
"""What is larger, or is no number, is not given to MuJoCo, which would print a warning: what comes of it is no number either."""


class Machine(NamedTuple):
    """What a compiled loop needs of one model and its data.

    Args:
        forward, integrate: addresses of mj_forwardSkip and mj_integratePos.
        model, data: addresses of the MjModel and the MjData.
        qpos, qvel, act, ctrl, qacc, act_dot, warmstart: the data's own arrays.
        inputs: where the plant's inputs stand in ctrl (m,).
        rotations: the first of the three degrees of freedom of each rotation of a ball or free joint.
        readings: addresses of the numbers that the outputs are made of (r,).
        sensors: whether some of these are sensors.
    """

    forward: int
    integrate: int
    model: int
    data: int
    qpos: Array
    qvel: Array
    act: Array
    ctrl: Array
    qacc: Array
    act_dot: Array
    warmstart: Array
    inputs: Indices
    rotations: Indices
    readings: Indices
    sensors: bool


def machine(
    model: mujoco.MjModel, data: mujoco.MjData, *, inputs: Indices, rotations: Sequence[int], readings: Sequence[int], sensors: bool
) -> Machine:
    """A machine for this model and these data, which it does not keep alive; see `Machine`."""
    return Machine(
        forward=_address("mj_forwardSkip"),
        integrate=_address("mj_integratePos"),
        model=model._address,
        data=data._address,
        qpos=data.qpos,
        qvel=data.qvel,
        act=data.act if model.na else np.zeros(0),
        ctrl=data.ctrl,
        qacc=data.qacc,
        act_dot=data.act_dot if model.na else np.zeros(0),
        warmstart=data.qacc_warmstart,
        inputs=np.asarray(inputs, dtype=np.int64),
        rotations=np.asarray(rotations, dtype=np.int64),
        readings=np.asarray(readings, dtype=np.int64),
        sensors=sensors,
    )


_LIBRARIES: list[ctypes.CDLL] = []


def _address(function: str) -> int:
    """Of a function of libmujoco."""
    if not _LIBRARIES:
        folder = Path(mujoco.__file__).parent
        (found, *_) = [path for pattern in ("libmujoco*.so*", "libmujoco*.dylib", "mujoco.dll") for path in folder.glob(pattern)]
        _LIBRARIES.append(ctypes.CDLL(str(found)))
    address = ctypes.cast(getattr(_LIBRARIES[0], function), ctypes.c_void_p).value
    assert address is not None
    return address


@intrinsic
def _call_forward(context: Any, function: Any, model: Any, data: Any, stage: Any, skip_sensors: Any) -> Any:
    """mj_forwardSkip(model, data, stage, skip_sensors) by its address."""
    signature = types.void(types.int64, types.int64, types.int64, types.int32, types.int32)

    def code(target: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer, word = ir.IntType(8).as_pointer(), ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [pointer, pointer, word, word]).as_pointer()
        m, d = (builder.inttoptr(argument, pointer) for argument in arguments[1:3])
        builder.call(builder.inttoptr(arguments[0], kind), [m, d, arguments[3], arguments[4]])
        return target.get_dummy_value()

    return signature, code


@intrinsic
def _call_integrate(context: Any, function: Any, model: Any, qpos: Any, velocity: Any, time: Any) -> Any:
    """mj_integratePos(model, qpos, velocity, time) by its address, the arrays by theirs."""
    signature = types.void(types.int64, types.int64, types.int64, types.int64, types.float64)

    def code(target: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer, real = ir.IntType(8).as_pointer(), ir.DoubleType()
        kind = ir.FunctionType(ir.VoidType(), [pointer, pointer, pointer, real]).as_pointer()
        pointers = [builder.inttoptr(argument, pointer) for argument in arguments[1:4]]
        builder.call(builder.inttoptr(arguments[0], kind), [*pointers, arguments[4]])
        return target.get_dummy_value()

    return signature, code


@intrinsic
def _number_at(context: Any, address: Any) -> Any:
    """The double at an address."""
    signature = types.float64(types.int64)

    def code(target: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.load(builder.inttoptr(arguments[0], ir.DoubleType().as_pointer()))

    return signature, code


@njit(cache=True, nogil=True)
def _forward(machine, stage, outputs):  # type: ignore[no-untyped-def]
    """mj_forward from what stands in the data; outputs: whether sensors are needed."""
    machine.warmstart[:] = 0.0  # so that an evaluation does not depend on the one before it
    skip = np.int32(0 if outputs and machine.sensors else 1)
    _call_forward(machine.forward, machine.model, machine.data, np.int32(stage), skip)


@njit(cache=True, nogil=True)
def _usable(values):  # type: ignore[no-untyped-def]
    for value in values:  # noqa: SIM110 - numba knows no all() of a generator
        if not abs(value) < HUGE:
            return False
    return True


@njit(cache=True, nogil=True)
def _moved(machine, qpos, tangent):  # type: ignore[no-untyped-def]
    """Put qpos, moved by a tangent (nv,), into the data."""
    if len(machine.rotations):
        machine.qpos[:] = qpos
        _call_integrate(machine.integrate, machine.model, machine.qpos.ctypes.data, tangent.ctypes.data, 1.0)
    else:
        for i in range(len(qpos)):
            machine.qpos[i] = qpos[i] + tangent[i]


@njit(cache=True, nogil=True)
def _read(machine, values):  # type: ignore[no-untyped-def]
    for i in range(len(machine.readings)):
        values[i] = _number_at(machine.readings[i])


@njit(cache=True, nogil=True)
def evaluate(machine, points, controls, accelerations, readings):  # type: ignore[no-untyped-def]
    """qacc and act_dot, and what the outputs are made of, at given states.

    Args:
        machine: the model and its data.
        points, controls: states (k, nq + nv + na) and inputs (k, m).
        accelerations, readings: results (k, nv + na) and (k, r).
    """
    nq, nv = len(machine.qpos), len(machine.qvel)
    for k in range(len(points)):
        if not (_usable(points[k]) and _usable(controls[k])):
            accelerations[k] = np.nan
            readings[k] = np.nan
            continue
        machine.qpos[:] = points[k, :nq]
        machine.qvel[:] = points[k, nq : nq + nv]
        machine.act[:] = points[k, nq + nv :]
        for j in range(len(machine.inputs)):
            machine.ctrl[machine.inputs[j]] = controls[k, j]
        _forward(machine, NOTHING_SKIPPED, True)
        accelerations[k, :nv] = machine.qacc
        accelerations[k, nv:] = machine.act_dot
        _read(machine, readings[k])


@njit(cache=True, nogil=True)
def perturbed(machine, points, controls, steps, accelerations, readings):  # type: ignore[no-untyped-def]
    """The same with each state and input moved ahead and back by its step.

    Positions come last, so that what depends on them alone is computed once for all that leaves them where they are.

    Args:
        machine: the model and its data.
        points, controls: states (k, nq + nv + na) and inputs (k, m).
        steps: of positions in tangent space, velocities, activations and inputs (2 nv + na + m,).
        accelerations, readings: results (k, 2 nv + na + m, 2, nv + na) and (k, 2 nv + na + m, 2, r).
    """
    nq, nv, na = len(machine.qpos), len(machine.qvel), len(machine.act)
    tangent = np.zeros(nv)
    for k in range(len(points)):
        if not (_usable(points[k]) and _usable(controls[k])):
            accelerations[k] = np.nan
            readings[k] = np.nan
            continue
        qpos = points[k, :nq].copy()
        machine.qpos[:] = qpos
        machine.qvel[:] = points[k, nq : nq + nv]
        machine.act[:] = points[k, nq + nv :]
        for j in range(len(machine.inputs)):
            machine.ctrl[machine.inputs[j]] = controls[k, j]
        _forward(machine, NOTHING_SKIPPED, True)
        for i in range(len(steps) - 1, -1, -1):
            for side in range(2):
                step = steps[i] if side == 0 else -steps[i]
                if i >= 2 * nv + na:
                    address = machine.inputs[i - 2 * nv - na]
                    machine.ctrl[address] = controls[k, i - 2 * nv - na] + step
                    _forward(machine, VELOCITIES_SKIPPED, True)
                    if side == 1:
                        machine.ctrl[address] = controls[k, i - 2 * nv - na]
                elif i >= 2 * nv:
                    machine.act[i - 2 * nv] = points[k, nq + i - nv] + step
                    _forward(machine, VELOCITIES_SKIPPED, True)
                    if side == 1:
                        machine.act[i - 2 * nv] = points[k, nq + i - nv]
                elif i >= nv:
                    machine.qvel[i - nv] = points[k, nq + i - nv] + step
                    _forward(machine, POSITIONS_SKIPPED, True)
                    if side == 1:
                        machine.qvel[i - nv] = points[k, nq + i - nv]
                else:
                    tangent[i] = step
                    _moved(machine, qpos, tangent)
                    tangent[i] = 0.0
                    _forward(machine, NOTHING_SKIPPED, True)
                accelerations[k, i, side, :nv] = machine.qacc
                accelerations[k, i, side, nv:] = machine.act_dot
                _read(machine, readings[k, i, side])


@njit(cache=True, nogil=True)
def _turning(rotations, theta, velocity, rate):  # type: ignore[no-untyped-def]
    """rate = theta' of the rotation vectors theta from where a step began: w + theta x w / 2 + theta x (theta x w) / 12."""
    rate[:] = velocity
    for first in rotations:
        a, b, c = theta[first], theta[first + 1], theta[first + 2]
        w = velocity[first : first + 3]
        x, y, z = b * w[2] - c * w[1], c * w[0] - a * w[2], a * w[1] - b * w[0]
        rate[first] += x / 2 + (b * z - c * y) / 12
        rate[first + 1] += y / 2 + (c * x - a * z) / 12
        rate[first + 2] += z / 2 + (a * y - b * x) / 12


@njit(cache=True, nogil=True)
def integrate(machine, points, coefficients, basis, lengths, nodes):  # type: ignore[no-untyped-def]
    """Classical RK4 over elements in even steps, the input a polynomial over each element.

    Args:
        machine: the model and its data.
        points: states at the elements' starts (k, nq + nv + na).
        coefficients: of the input's polynomials (k, s, m).
        basis: their values at the starts, middles and ends of the steps (2 S + 1, s).
        lengths: of the elements (k,) [s].
        nodes: result, the states at the ends of the steps, the start first (k, S + 1, nq + nv + na).
    """
    nq, nv, na = len(machine.qpos), len(machine.qvel), len(machine.act)
    n, count, m = 2 * nv + na, (len(basis) - 1) // 2, len(machine.inputs)
    rates, at, total = np.zeros((4, n)), np.zeros(n), np.zeros(n)
    for k in range(len(points)):
        h = lengths[k] / count
        point = points[k].copy()
        nodes[k] = np.nan
        nodes[k, 0] = point
        usable = _usable(point)
        for i in range(basis.shape[1]):
            usable = usable and _usable(coefficients[k, i])
        for step in range(count):
            if not usable:
                break
            for stage in range(4):
                if stage == 0:
                    at[:] = 0.0
                else:
                    at[:] = rates[stage - 1] * (h if stage == 3 else h / 2)
                usable = usable and _usable(at)
                if not usable:
                    break
                velocity = point[nq : nq + nv] + at[nv : 2 * nv]
                _moved(machine, point[:nq], at[:nv])
                machine.qvel[:] = velocity
                machine.act[:] = point[nq + nv :] + at[2 * nv :]
                instant = 2 * step + (0 if stage == 0 else 2 if stage == 3 else 1)
                for j in range(m):
                    value = 0.0
                    for i in range(basis.shape[1]):
                        value += basis[instant, i] * coefficients[k, i, j]
                    machine.ctrl[machine.inputs[j]] = value
                _forward(machine, NOTHING_SKIPPED, False)
                _turning(machine.rotations, at[:nv], velocity, rates[stage, :nv])
                rates[stage, nv : 2 * nv] = machine.qacc
                rates[stage, 2 * nv :] = machine.act_dot
            if not usable:
                break
            total[:] = h / 6 * (rates[0] + 2 * rates[1] + 2 * rates[2] + rates[3])
            _moved(machine, point[:nq], total[:nv])
            point[:nq] = machine.qpos
            point[nq:] += total[nv:]
            nodes[k, step + 1] = point
            usable = _usable(point)
