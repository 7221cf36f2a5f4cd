"""MuJoCo's smooth dynamics at many states at once: compiled loops around mj_forwardSkip.

States are rows (qpos, qvel, act); inputs are those of the plant. Positions are perturbed and integrated in the tangent space of
qpos. Each thread needs a `Machine` of its own. The entries take addresses of contiguous float64 arrays, so that each is compiled
once, whatever arrays it is given.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from invtrack.arrays import Array, Indices
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

_COUNTS = ("nq", "nv", "na", "m", "turns", "outputs", "sensors")
_ADDRESSES = ("forward", "integrate", "model", "data", "inputs", "rotations", "readings", "scratch")
_ARRAYS = ("qpos", "qvel", "act", "ctrl", "qacc", "act_dot", "qacc_warmstart")
_MACHINE = np.dtype([(name, np.int64) for name in (*_COUNTS, *_ADDRESSES, *_ARRAYS)])
"""One model and its data: sizes (inputs m, rotations, outputs, whether some are sensors), and addresses of functions, arrays
and memory to work in."""

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
        scratch = np.zeros(3 * (2 * self.model.nv + self.model.na) + len(inputs))
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

    def integrate(self, points: Array, coefficients: Array, basis: Array, lengths: Array, nodes: Array) -> None:
        """Classical RK4 over elements in even steps, the input a polynomial over each element.

        Args:
            points: states at the elements' starts (k, nq + nv + na).
            coefficients: of the input's polynomials (k, s, m).
            basis: their values at the starts, middles and ends of the steps (2 S + 1, s).
            lengths: of the elements (k,) [s].
            nodes: result, the states at the ends of the steps, the start first (k, S + 1, nq + nv + na); beyond one that is not
                usable they stay as they are.
        """
        count, order = (len(basis) - 1) // 2, basis.shape[1]
        _integrate(self._record, len(points), count, order, *_addresses(points, coefficients, basis, lengths, nodes))


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
    """From w to theta' of the rotation vectors theta from where a step began: w + theta x w / 2 + theta x (theta x w) / 12."""
    rotations = integers(machine.rotations, machine.turns)
    for i in range(machine.turns):
        first = rotations[i]
        a, b, c = theta[first], theta[first + 1], theta[first + 2]
        p, q, r = rate[first], rate[first + 1], rate[first + 2]
        x, y, z = b * r - c * q, c * p - a * r, a * q - b * p
        rate[first] += x / 2 + (b * z - c * y) / 12
        rate[first + 1] += y / 2 + (c * x - a * z) / 12
        rate[first + 2] += z / 2 + (a * y - b * x) / 12


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
def _step(machine: Any, h: float, inputs: int, order: int, coefficients: int, point: Any, after: Any) -> bool:
    """One step of length h; inputs: the address of the polynomials' values at its start, middle and end; whether it is usable."""
    nq, nv, na, m = machine.nq, machine.nv, machine.na, machine.m
    n = 2 * nv + na
    at, rate, total = floats(machine.scratch, n), floats(machine.scratch + 8 * n, n), floats(machine.scratch + 16 * n, n)
    control, c = floats(machine.scratch + 24 * n, m), floats(coefficients, order * m)
    for i in range(n):
        rate[i], total[i] = 0.0, 0.0
    for stage in range(4):
        share = 0.0 if stage == 0 else h if stage == 3 else h / 2
        weight = h / 6 if stage == 0 or stage == 3 else h / 3
        for i in range(n):
            at[i] = share * rate[i]
        values = floats(inputs + 8 * order * ((stage + 1) // 2), order)
        for j in range(m):
            control[j] = 0.0
            for i in range(order):
                control[j] += values[i] * c[m * i + j]
        if not (_usable(at) and _usable(control)):
            return False
        _slope(machine, point, at, control, rate)
        for i in range(n):
            total[i] += weight * rate[i]
    _moved(machine, point, total)
    qpos = floats(machine.qpos, nq)
    for i in range(nq):
        after[i] = qpos[i]
    for i in range(nv + na):
        after[nq + i] = point[nq + i] + total[nv + i]
    return True


@entry
def _integrate(
    machines: Any, count: int, steps: int, order: int, points: int, coefficients: int, basis: int, lengths: int, nodes: int
) -> None:
    machine = machines[0]
    width, m, length = machine.nq + machine.nv + machine.na, machine.m, floats(lengths, count)
    for k in range(count):
        first, row = floats(points + 8 * width * k, width), nodes + 8 * width * (steps + 1) * k
        point = floats(row, width)
        for i in range(width):
            point[i] = first[i]
        for step in range(steps):
            after = floats(row + 8 * width * (step + 1), width)
            values, c = basis + 16 * order * step, coefficients + 8 * order * m * k
            if not (_usable(point) and _step(machine, length[k] / steps, values, order, c, point, after)):
                break
            point = after
