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
    for i in range(len(machine.warmstart)):
        machine.warmstart[i] = 0.0  # so that an evaluation does not depend on the one before it
    skip = np.int32(0 if outputs and machine.sensors else 1)
    _call_forward(machine.forward, machine.model, machine.data, np.int32(stage), skip)


@njit(cache=True, nogil=True)
def _usable(values):  # type: ignore[no-untyped-def]
    for i in range(len(values)):  # noqa: SIM110 - numba compiles no all() of a generator
        if not abs(values[i]) < HUGE:
            return False
    return True


@njit(cache=True, nogil=True)
def _moved(machine, point, tangent):  # type: ignore[no-untyped-def]
    """Put the positions of a point, moved by the first nv entries of a tangent, into the data."""
    if len(machine.rotations):
        for i in range(len(machine.qpos)):
            machine.qpos[i] = point[i]
        _call_integrate(machine.integrate, machine.model, machine.qpos.ctypes.data, tangent.ctypes.data, 1.0)
    else:
        for i in range(len(machine.qpos)):
            machine.qpos[i] = point[i] + tangent[i]


@njit(cache=True, nogil=True)
def _written(machine, point, control):  # type: ignore[no-untyped-def]
    """Put a state and inputs into the data."""
    nq, nv = len(machine.qpos), len(machine.qvel)
    for i in range(nq):
        machine.qpos[i] = point[i]
    for i in range(nv):
        machine.qvel[i] = point[nq + i]
    for i in range(len(machine.act)):
        machine.act[i] = point[nq + nv + i]
    for j in range(len(machine.inputs)):
        machine.ctrl[machine.inputs[j]] = control[j]


@njit(cache=True, nogil=True)
def _read(machine, accelerations, readings):  # type: ignore[no-untyped-def]
    """Get accelerations, rates of activations and readings from the data."""
    nv = len(machine.qvel)
    for i in range(nv):
        accelerations[i] = machine.qacc[i]
    for i in range(len(machine.act)):
        accelerations[nv + i] = machine.act_dot[i]
    for i in range(len(machine.readings)):
        readings[i] = _number_at(machine.readings[i])


@njit(cache=True, nogil=True)
def evaluate(machine, points, controls, accelerations, readings):  # type: ignore[no-untyped-def]
    """qacc and act_dot, and what the outputs are made of, at given states; results that are not usable stay as they are.

    Args:
        machine: the model and its data.
        points, controls: states (k, nq + nv + na) and inputs (k, m).
        accelerations, readings: results (k, nv + na) and (k, r).
    """
    for k in range(len(points)):
        if _usable(points[k]) and _usable(controls[k]):
            _written(machine, points[k], controls[k])
            _forward(machine, NOTHING_SKIPPED, True)
            _read(machine, accelerations[k], readings[k])


@njit(cache=True, nogil=True)
def perturbed(machine, points, controls, steps, accelerations, readings):  # type: ignore[no-untyped-def]
    """The same with each state and input moved ahead and back by its step; results that are not usable stay as they are.

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
            continue
        _written(machine, points[k], controls[k])
        _forward(machine, NOTHING_SKIPPED, True)
        for i in range(len(steps) - 1, -1, -1):
            for side in range(2):
                step = steps[i] if side == 0 else -steps[i]
                stage = VELOCITIES_SKIPPED
                if i >= 2 * nv + na:
                    j = i - 2 * nv - na
                    machine.ctrl[machine.inputs[j]] = controls[k, j] + step
                elif i >= 2 * nv:
                    machine.act[i - 2 * nv] = points[k, nq + i - nv] + step
                elif i >= nv:
                    machine.qvel[i - nv] = points[k, nq + i - nv] + step
                    stage = POSITIONS_SKIPPED
                else:
                    tangent[i] = step
                    _moved(machine, points[k], tangent)
                    tangent[i] = 0.0
                    stage = NOTHING_SKIPPED
                _forward(machine, stage, True)
                _read(machine, accelerations[k, i, side], readings[k, i, side])
            if i >= 2 * nv + na:
                machine.ctrl[machine.inputs[i - 2 * nv - na]] = controls[k, i - 2 * nv - na]
            elif i >= 2 * nv:
                machine.act[i - 2 * nv] = points[k, nq + i - nv]
            elif i >= nv:
                machine.qvel[i - nv] = points[k, nq + i - nv]


@njit(cache=True, nogil=True)
def _turn(rotations, theta, rate):  # type: ignore[no-untyped-def]
    """From w to theta' of the rotation vectors theta from where a step began: w + theta x w / 2 + theta x (theta x w) / 12."""
    for first in rotations:
        a, b, c = theta[first], theta[first + 1], theta[first + 2]
        p, q, r = rate[first], rate[first + 1], rate[first + 2]
        x, y, z = b * r - c * q, c * p - a * r, a * q - b * p
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
        nodes: result, the states at the ends of the steps, the start first (k, S + 1, nq + nv + na); beyond one that is not
            usable they stay as they are.
    """
    nq, nv, na = len(machine.qpos), len(machine.qvel), len(machine.act)
    n, count = 2 * nv + na, (len(basis) - 1) // 2
    rates, at, total, control = np.zeros((4, n)), np.zeros(n), np.zeros(n), np.zeros(len(machine.inputs))
    for k in range(len(points)):
        h = lengths[k] / count
        for i in range(nq + nv + na):
            nodes[k, 0, i] = points[k, i]
        for step in range(count):
            point = nodes[k, step]
            usable = _usable(point)
            for stage in range(4):
                share = 0.0 if stage == 0 else h if stage == 3 else h / 2
                for i in range(n):
                    at[i] = share * rates[stage - 1, i] if stage else 0.0
                instant = 2 * step + (0 if stage == 0 else 2 if stage == 3 else 1)
                for j in range(len(control)):
                    control[j] = 0.0
                    for i in range(basis.shape[1]):
                        control[j] += basis[instant, i] * coefficients[k, i, j]
                usable = usable and _usable(at) and _usable(control)
                if not usable:
                    break
                _written(machine, point, control)
                _moved(machine, point, at)
                for i in range(nv):
                    machine.qvel[i] += at[nv + i]
                    rates[stage, i] = machine.qvel[i]
                for i in range(na):
                    machine.act[i] += at[2 * nv + i]
                _forward(machine, NOTHING_SKIPPED, False)
                _turn(machine.rotations, at, rates[stage])
                for i in range(nv):
                    rates[stage, nv + i] = machine.qacc[i]
                for i in range(na):
                    rates[stage, 2 * nv + i] = machine.act_dot[i]
            if not usable:
                break
            for i in range(n):
                total[i] = h / 6 * (rates[0, i] + 2 * rates[1, i] + 2 * rates[2, i] + rates[3, i])
            _moved(machine, point, total)
            for i in range(nq):
                nodes[k, step + 1, i] = machine.qpos[i]
            for i in range(nv + na):
                nodes[k, step + 1, nq + i] = point[nq + i] + total[nv + i]
