"""MuJoCo's smooth dynamics at many states at once: compiled loops around mj_forwardSkip.

States are rows (qpos, qvel, act); inputs are those of the plant. Positions are perturbed and integrated in the tangent space of
qpos. Each thread needs a `Machine` of its own. The entries take addresses of contiguous float64 arrays, so that each is compiled
once, whatever arrays it is given.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from invtrack.arrays import Array, Indices
from invtrack.plans.runge_kutta import Steps
from invtrack.plant.native.libmujoco import address_of
from invtrack.plant.native.pointers import address_in, call, compiled, entry, floats, integers, records
from invtrack.plant.native.readings import READING, readings_of, value_of
from invtrack.plant.readings import Entry, Reading

_NOTHING, _POSITIONS, _VELOCITIES = (
    np.int32(int(stage)) for stage in (mujoco.mjtStage.mjSTAGE_NONE, mujoco.mjtStage.mjSTAGE_POS, mujoco.mjtStage.mjSTAGE_VEL)
)
"""What mj_forwardSkip takes for granted: nothing; all that depends on positions; all that depends on positions and velocities."""

_HUGE = 1e9
"""What is larger, or is no number, is not given to MuJoCo, which would print a warning: what comes of it is no number either."""

_SMALL_ANGLE = 1e-4
"""Below it 1/12 is c of `_turn` to rounding."""

_COUNTS = ("nq", "nv", "na", "m", "turns", "outputs", "sensors")
_ADDRESSES = ("forward", "integrate", "model", "data", "inputs", "rotations", "readings", "scratch")
_ARRAYS = ("qpos", "qvel", "act", "ctrl", "qacc", "act_dot", "qacc_warmstart")
_MACHINE = np.dtype([(name, np.int64) for name in (*_COUNTS, *_ADDRESSES, *_ARRAYS)])
"""One model and its data: sizes (inputs m, rotations, outputs, whether some are sensors), and addresses of functions, arrays
and memory to work in."""

_METHOD = np.dtype([(name, np.int64) for name in ("stages", "count", "a", "b", "basis", "slopes")])
"""A Runge-Kutta method and the polynomials of the inputs: how many, and addresses of its coefficients, of the polynomials at the
stages of all steps, and of memory for the slopes of a step."""

_readings_at = records(READING)


@dataclass(frozen=True, eq=False)
class Machine:
    """A model and data that the compiled loops work on, kept alive with all that they refer to.

    Args:
        model, data: on which nobody else works meanwhile.
        inputs: where the plant's inputs stand in ctrl (m,).
        rotations: the first of the three degrees of freedom of each rotation of a ball or free joint.
        outputs: what the plant's outputs read.
    """

    model: mujoco.MjModel
    data: mujoco.MjData
    inputs: Indices
    rotations: Sequence[int]
    outputs: Sequence[Reading]
    _record: NDArray[np.void] = field(init=False, repr=False)
    _kept: tuple[object, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Write the record."""
        inputs, rotations = (np.array(numbers, dtype=np.int64) for numbers in (self.inputs, self.rotations))
        readings, references = readings_of(self.data, self.outputs, range(len(self.outputs)))
        record = np.zeros(1, dtype=_MACHINE)
        for name in ("nq", "nv", "na"):
            record[name] = getattr(self.model, name)
        record["m"], record["turns"], record["outputs"] = len(inputs), len(rotations), len(readings)
        record["sensors"] = any(isinstance(reading, Entry) and reading.array == "sensordata" for reading in self.outputs)
        record["forward"], record["integrate"] = address_of("mj_forwardSkip"), address_of("mj_integratePos")
        record["model"], record["data"] = self.model._address, self.data._address
        record["inputs"], record["rotations"], record["readings"] = (a.ctypes.data for a in (inputs, rotations, readings))
        for name in _ARRAYS:
            record[name] = getattr(self.data, name).ctypes.data
        object.__setattr__(self, "_record", record)
        scratch = np.zeros(2 * self.model.nv + self.model.na + len(inputs))
        record["scratch"] = scratch.ctypes.data
        object.__setattr__(self, "_kept", (inputs, rotations, readings, references, scratch))

    def evaluate(self, points: Array, controls: Array, accelerations: Array, outputs: Array) -> None:
        """qacc and act_dot, and the outputs, at given states; results that are not usable stay as they are.

        Args:
            points, controls: states (k, nq + nv + na) and inputs (k, m).
            accelerations, outputs: results (k, nv + na) and (k, p).
        """
        _evaluate(self._record, len(points), *_addresses(points, controls, accelerations, outputs))

    def perturbed(self, points: Array, controls: Array, steps: Array, accelerations: Array, outputs: Array) -> None:
        """The same with each state and input moved by steps of its own; results that are not usable stay as they are.

        Args:
            points, controls: states (k, nq + nv + na) and inputs (k, m).
            steps: of positions in tangent space, velocities, activations and inputs (2 nv + na + m, sides).
            accelerations, outputs: results (k, 2 nv + na + m, sides, nv + na) and (k, 2 nv + na + m, sides, p).
        """
        _perturbed(self._record, len(points), steps.shape[1], *_addresses(points, controls, steps, accelerations, outputs))

    def integrate(self, points: Array, coefficients: Array, steps: Steps, lengths: Array, nodes: Array) -> None:
        """Steps by a Runge-Kutta method over elements, the input a polynomial over each element.

        Args:
            points: states at the elements' starts (k, nq + nv + na).
            coefficients: of the input's polynomials (k, s, m).
            steps: the method and the steps.
            lengths: of the elements (k,) [s].
            nodes: result, the states at the ends of the steps, the start first (k, S + 1, nq + nv + na); beyond one that is not
                usable they stay as they are.
        """
        method = np.zeros(1, dtype=_METHOD)
        slopes = np.empty((len(steps.method.b), 2 * self.model.nv + self.model.na))
        arrays = steps.method.a, steps.method.b, steps.basis, slopes  # kept as long as the loop runs
        method["stages"], method["count"] = arrays[2].shape[1:]
        method["a"], method["b"], method["basis"], method["slopes"] = _addresses(*arrays)
        _integrate(self._record, method, len(points), steps.number, *_addresses(points, coefficients, lengths, nodes))


def _addresses(*arrays: Array) -> list[int]:
    assert all(array.flags.c_contiguous and array.dtype == np.float64 for array in arrays)
    return [array.ctypes.data for array in arrays]


@compiled
def _forward(machine: Any, stage: Any, outputs: bool) -> None:
    """mj_forward from what stands in the data; outputs: whether sensors are needed."""
    warmstart = floats(machine.qacc_warmstart, machine.nv)
    for i in range(machine.nv):
        warmstart[i] = 0.0  # so that an evaluation does not depend on the one before it
    skip = np.int32(not (outputs and machine.sensors != 0))
    call(machine.forward, (machine.model, machine.data, stage, skip))


@compiled
def _usable(values: Any) -> bool:
    for i in range(values.shape[0]):  # noqa: SIM110 - numba compiles no all() of a generator
        if not abs(values[i]) < _HUGE:
            return False
    return True


@compiled
def _moved(machine: Any, point: Any, tangent: Any) -> None:
    """Put the positions of a point, moved by the first nv entries of a tangent, into the data."""
    qpos = floats(machine.qpos, machine.nq)
    if machine.turns != 0:
        for i in range(machine.nq):
            qpos[i] = point[i]
        call(machine.integrate, (machine.model, machine.qpos, address_in(tangent), 1.0))
    else:
        for i in range(machine.nq):
            qpos[i] = point[i] + tangent[i]


@compiled
def _written(machine: Any, point: Any, control: Any) -> None:
    """Put a state and inputs into the data."""
    nq, nv, na, m = machine.nq, machine.nv, machine.na, machine.m
    qpos, qvel, act = floats(machine.qpos, nq), floats(machine.qvel, nv), floats(machine.act, na)
    for i in range(nq):
        qpos[i] = point[i]
    for i in range(nv):
        qvel[i] = point[nq + i]
    for i in range(na):
        act[i] = point[nq + nv + i]
    ctrl, inputs = floats(machine.ctrl, 1 << 62), integers(machine.inputs, m)
    for j in range(m):
        ctrl[inputs[j]] = control[j]


@compiled
def _read(machine: Any, accelerations: int, outputs: int) -> None:
    """Get accelerations, rates of activations and outputs from the data, to these addresses."""
    nv, na, p = machine.nv, machine.na, machine.outputs
    rates, values = floats(accelerations, nv + na), floats(outputs, p)
    qacc, act_dot = floats(machine.qacc, nv), floats(machine.act_dot, na)
    for i in range(nv):
        rates[i] = qacc[i]
    for i in range(na):
        rates[nv + i] = act_dot[i]
    readings = _readings_at(machine.readings, p)
    for i in range(p):
        values[i] = value_of(readings[i])


@entry
def _evaluate(machines: Any, count: int, points: int, controls: int, accelerations: int, outputs: int) -> None:
    machine = machines[0]
    width, n, m, p = machine.nq + machine.nv + machine.na, machine.nv + machine.na, machine.m, machine.outputs
    for k in range(count):
        point, control = floats(points + 8 * width * k, width), floats(controls + 8 * m * k, m)
        if _usable(point) and _usable(control):
            _written(machine, point, control)
            _forward(machine, _NOTHING, True)
            _read(machine, accelerations + 8 * n * k, outputs + 8 * p * k)


@entry
def _perturbed(
    machines: Any, count: int, sides: int, points: int, controls: int, steps: int, accelerations: int, outputs: int
) -> None:
    """Positions come last, so that what depends on them alone is computed once for all that leaves them where they are."""
    machine = machines[0]
    nv, na, m, p = machine.nv, machine.na, machine.m, machine.outputs
    width, total, inputs = machine.nq + nv + na, 2 * nv + na + m, integers(machine.inputs, m)
    step, tangent = floats(steps, total * sides), floats(machine.scratch, nv)
    for i in range(nv):
        tangent[i] = 0.0
    for k in range(count):
        point, control = floats(points + 8 * width * k, width), floats(controls + 8 * m * k, m)
        if not (_usable(point) and _usable(control)):
            continue
        _written(machine, point, control)
        _forward(machine, _NOTHING, True)
        for i in range(total - 1, -1, -1):
            stage = _NOTHING
            if i < nv:
                address = machine.scratch + 8 * i
            elif i < 2 * nv:
                address, stage = machine.qvel + 8 * (i - nv), _POSITIONS
            elif i < 2 * nv + na:
                address, stage = machine.act + 8 * (i - 2 * nv), _VELOCITIES
            else:
                address, stage = machine.ctrl + 8 * inputs[i - 2 * nv - na], _VELOCITIES
            entry_at = floats(address, 1)
            value = entry_at[0]
            for side in range(sides):
                entry_at[0] = value + step[sides * i + side]
                if i < nv:
                    _moved(machine, point, tangent)
                _forward(machine, stage, True)
                row = sides * (total * k + i) + side
                _read(machine, accelerations + 8 * (nv + na) * row, outputs + 8 * p * row)
            entry_at[0] = value


@compiled
def _turn(machine: Any, theta: Any, rate: Any) -> None:
    """From w to theta' of the rotation vectors theta from where a step began: w + theta x w / 2 + c theta x (theta x w), where
    c = (1 - h cot h) / (2 h)^2 of the half angle h."""
    rotations = integers(machine.rotations, machine.turns)
    for i in range(machine.turns):
        first = rotations[i]
        a, b, c = theta[first], theta[first + 1], theta[first + 2]
        p, q, r = rate[first], rate[first + 1], rate[first + 2]
        x, y, z = b * r - c * q, c * p - a * r, a * q - b * p
        square = a * a + b * b + c * c
        half = math.sqrt(square) / 2
        share = (1 - half / math.tan(half)) / square if half > _SMALL_ANGLE else 1 / 12
        rate[first] += x / 2 + share * (b * z - c * y)
        rate[first + 1] += y / 2 + share * (c * x - a * z)
        rate[first + 2] += z / 2 + share * (a * y - b * x)


@compiled
def _slope(machine: Any, point: Any, at: Any, control: Any, rate: Any) -> None:
    """The rate of the tangent `at` from a point."""
    nv, na = machine.nv, machine.na
    qvel, act, qacc, act_dot = (
        floats(machine.qvel, nv),
        floats(machine.act, na),
        floats(machine.qacc, nv),
        floats(machine.act_dot, na),
    )
    _written(machine, point, control)
    _moved(machine, point, at)
    for i in range(nv):
        qvel[i] += at[nv + i]
        rate[i] = qvel[i]
    for i in range(na):
        act[i] += at[2 * nv + i]
    _forward(machine, _NOTHING, False)
    _turn(machine, at, rate)
    for i in range(nv):
        rate[nv + i] = qacc[i]
    for i in range(na):
        rate[2 * nv + i] = act_dot[i]


@compiled
def _sum(at: Any, h: float, weights: Any, stages: int, slopes: int) -> None:
    """The tangent of h times the weighted slopes of the first stages."""
    n = at.shape[0]
    for i in range(n):
        at[i] = 0.0
    for j in range(stages):
        weight = h * weights[j]
        if weight != 0.0:
            slope = floats(slopes + 8 * n * j, n)
            for i in range(n):
                at[i] += weight * slope[i]


@compiled
def _step(machine: Any, method: Any, h: float, inputs: int, coefficients: int, point: Any, after: Any) -> bool:
    """One step of length h; inputs: the address of the polynomials' values at its stages; whether it is usable."""
    nq, nv, na, m, count = machine.nq, machine.nv, machine.na, machine.m, method.count
    n = 2 * nv + na
    at, control = floats(machine.scratch, n), floats(machine.scratch + 8 * n, m)
    c = floats(coefficients, count * m)
    for stage in range(method.stages):
        _sum(at, h, floats(method.a + 8 * method.stages * stage, method.stages), stage, method.slopes)
        values = floats(inputs + 8 * count * stage, count)
        for j in range(m):
            control[j] = 0.0
            for i in range(count):
                control[j] += values[i] * c[m * i + j]
        if not (_usable(at) and _usable(control)):
            return False
        _slope(machine, point, at, control, floats(method.slopes + 8 * n * stage, n))
    _sum(at, h, floats(method.b, method.stages), method.stages, method.slopes)
    _moved(machine, point, at)
    qpos = floats(machine.qpos, nq)
    for i in range(nq):
        after[i] = qpos[i]
    for i in range(nv + na):
        after[nq + i] = point[nq + i] + at[nv + i]
    return True


@entry
def _integrate(
    machines: Any, methods: Any, count: int, steps: int, points: int, coefficients: int, lengths: int, nodes: int
) -> None:
    machine, method = machines[0], methods[0]
    width, length = machine.nq + machine.nv + machine.na, floats(lengths, count)
    for k in range(count):
        first, row = floats(points + 8 * width * k, width), nodes + 8 * width * (steps + 1) * k
        point = floats(row, width)
        for i in range(width):
            point[i] = first[i]
        for step in range(steps):
            after = floats(row + 8 * width * (step + 1), width)
            values = method.basis + 8 * method.stages * method.count * step
            c = coefficients + 8 * method.count * machine.m * k
            if not (_usable(point) and _step(machine, method, length[k] / steps, values, c, point, after)):
                break
            point = after
