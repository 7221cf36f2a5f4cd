"""The linear model of a plant about its operating point, by central differences with Richardson extrapolation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from invtrack.arguments import flag, instance
from invtrack.arrays import Array, real_number, require_not_negative
from invtrack.errors import PlantError
from invtrack.linear.state_space import Measurement, OperatingPoint, StateSpace
from invtrack.plant.closed_loops import refuse_branching
from invtrack.plant.configuration import configuration_of, tangent_units
from invtrack.plant.linearizable import (
    refuse_acting,
    refuse_constraints,
    refuse_kinks,
    refuse_moving_quaternions,
    refuse_nonequilibrium,
    refuse_saturation,
    refuse_step_maps,
)
from invtrack.plant.moved_rest import Kept, equilibrium_of, measured_from
from invtrack.plant.plant import A_PLANT, Plant
from invtrack.plant.smooth_model import smooth_model

IMPEDANCE_STEPS = 64
"""Perturbations of positions fit this often into the violation over which an equality constraint changes its softness."""

_OPTIONS = {"plant", "equilibrium", "step", "equilibrium_tolerance", "allow_nonequilibrium"}


@dataclass(frozen=True, eq=False)
class Derivative:
    """A Jacobian (m, k) with an estimate (m, k) of each entry's error, and the jump (m, k) of each one-sided derivative.

    `jump` is the size of the right-hand minus the left-hand derivative: more than noise where the function has a kink.
    """

    jacobian: Array
    error: Array
    jump: Array


def differentiate(function: Callable[[Array], Array], steps: Array) -> Derivative:
    """The derivative at 0 of `function` (from (k,) to (m,)), with a step for each argument.

    With D(h) = (f(h) - f(-h)) / 2h the result is R(h) = (4 D(h) - D(2h)) / 3, good to order h^4. The error estimate is
    |R(h) - R(2h)| (some fifteen times the truncation error where that prevails) plus the jump and the rounding of f over h. With
    s(h) = f(h) - 2 f(0) + f(-h) and j(h) = (4 s(h) - s(2h)) / 2h the jump is (8 j(h) - j(2h)) / 7, of order h^5 where f is smooth;
    there it is a sample of the noise in f.
    """
    centre = function(np.zeros(len(steps)))
    columns = [_column(function, centre, i, steps) for i in range(len(steps))]
    jacobian, error, jump = (np.column_stack(parts) for parts in zip(*columns, strict=True))
    return Derivative(jacobian, error, jump)


def _column(function: Callable[[Array], Array], centre: Array, i: int, steps: Array) -> tuple[Array, Array, Array]:
    h = steps[i]
    direction = np.eye(len(steps))[i]
    ahead, behind = ([function(sign * factor * h * direction) for factor in (1, 2, 4)] for sign in (1, -1))
    D = [(f - b) / (2 * factor * h) for f, b, factor in zip(ahead, behind, (1, 2, 4), strict=True)]
    fine, coarse = ((4 * D[j] - D[j + 1]) / 3 for j in (0, 1))
    rounding = np.finfo(float).eps * np.max(np.abs([centre, *ahead, *behind]), axis=0) / h
    bend = [f - 2 * centre + b for f, b in zip(ahead, behind, strict=True)]
    jump_fine, jump_coarse = ((4 * bend[j] - bend[j + 1]) / (2 * (j + 1) * h) for j in (0, 1))
    jump = np.abs(8 * jump_fine - jump_coarse) / 7
    return fine, np.abs(fine - coarse) + jump + rounding, jump


def linearize(
    plant: Plant,
    *,
    equilibrium: Kept | Plant | None = None,
    step: float = 1e-4,
    equilibrium_tolerance: float = 1e-6,
    allow_nonequilibrium: bool = False,
    **parameter_values: float,
) -> StateSpace:
    """The linear model x' = A (x - rest) + B (u - u0), y = y0 + C (x - rest) + D (u - u0) of a plant about an equilibrium.

    That is the plant's operating point unless `equilibrium` says otherwise: where other parameters move it, it is u0, y0 and the
    state `rest`, so that the models before and after a change have one frame and make a SwitchedSystem:

        light = invtrack.linearize(plant)
        laden = invtrack.linearize(plant, load=3.0, equilibrium="same outputs")
        model = invtrack.SwitchedSystem([light, laden], switch_times=[1.0])

    x (n = 2 nv + na,) is the deviation from the plant's operating point in tangent space, less the coordinates that the plant
    drops; continuous time, whatever integrator the file names. The rows of A that say "position' = velocity" are exact; the others,
    B, C and D are central differences of mj_forward with Richardson extrapolation, with an estimate of the error of each entry in
    `error_estimates`. The model carries the plant's names and units, and in `parameters` the values of all named parameters for
    which it holds.

    Args:
        plant: at the operating point from which states are measured.
        equilibrium: where to linearize. None: at the plant's operating point. "same outputs": at the equilibrium with the outputs
            of that point, whatever inputs it takes (an actuator that holds a load). "same controls": at that with its controls
            (a servo that sags). Both are the nearest one, by `trim`. Or the plant at another equilibrium, `trim(plant, ...).plant`.
        step: the smallest perturbation of each state and input: in radians; in metres (for mechanisms smaller than a metre in units
            of their extent); the same per second for velocities; in the unit of each control (times its size at the operating point
            where that exceeds 1). It is rounded to a power of two, and reduced within narrow ctrlrange and actrange, and for
            positions to a share of the violation over which an equality constraint changes its softness (solimp's width).
        equilibrium_tolerance: largest rate x' that still counts as equilibrium, in SI units.
        allow_nonequilibrium: whether the point need not be an equilibrium; its rate is then left out.
        parameter_values: named parameters that differ from the file.

    Dry friction, actuator delays and the plant's backlash are left out, and named in the model's `left_out`; simulations have them.
    Equality constraints stay: MuJoCo makes springs and dampers of them (solref, solimp), so each adds fast, well damped modes of
    its own, and the mechanism's slow ones differ from those of a rigid coupling the less the faster these are.

    Raises PlantError for an operating point that is no equilibrium (unless allow_nonequilibrium; `trim` finds one), active contacts
    and limits, equality constraints that depend on each other just there, saturated controls, spinning ball or free joints, kinks,
    dropped states that act on what is kept, and models in which qacc depends on the time step (integrator="discrete").
    """
    instance("plant", plant, Plant, expected=A_PLANT, error=PlantError)
    flag("allow_nonequilibrium", allow_nonequilibrium, error=PlantError)
    require_not_negative("equilibrium_tolerance", equilibrium_tolerance, error=PlantError)
    reserved = sorted(_OPTIONS & set(plant.parameters))
    if reserved:
        raise PlantError(f"parameters cannot be called {', '.join(reserved)}, which are options of linearize; rename them")
    if not 0 < real_number("step", step, error=PlantError) < 1:
        raise PlantError(f"step must lie between 0 and 1 (1e-4 suits most mechanisms), got {step}")
    smooth, origin = smooth_model(plant.model_with(parameter_values), backlash=plant.backlash), plant
    model = smooth.model
    plant = equilibrium_of(origin, equilibrium, parameter_values)
    refuse_step_maps(model)
    refuse_moving_quaternions(plant)
    refuse_saturation(plant, model)
    data = plant.new_data(model)
    refuse_constraints(model, data)
    refuse_branching(plant, model, data)
    if not allow_nonequilibrium:
        refuse_nonequilibrium(plant, data, equilibrium_tolerance, parameter_values, smooth.left_out)
    point, measured = plant.operating_point_in(model), plant.measurement_readings.values(data)
    for readings in (plant.output_readings, plant.measurement_readings):
        readings.require_smooth(model, data)
    with plant.forces(model):
        derivative = differentiate(_Dynamics(plant, model, data), _steps(plant, model, step))
    _check(plant, derivative)
    parameters = {**plant.parameter_values, **parameter_values}
    linear = _assemble(plant, point, measured, parameters, derivative, smooth.left_out)
    return linear if plant is origin else measured_from(origin, linear, plant)


class _Dynamics:
    """(x, u - u0) -> (qacc, act_dot, y, y_m) at one instant."""

    def __init__(self, plant: Plant, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self.plant, self.model, self.data = plant, model, data

    def __call__(self, deviation: Array) -> Array:
        plant, model, data = self.plant, self.model, self.data
        x, u = np.split(deviation, [len(plant.coordinates)])
        data.qpos[:], data.qvel[:], data.act[:] = configuration_of(model, plant.configuration.x0, x)
        data.ctrl[:] = plant.configuration.ctrl
        data.ctrl[plant.input_addresses] += u
        data.qacc_warmstart[:] = 0  # so that an evaluation does not depend on the one before it
        mujoco.mj_forward(model, data)
        refuse_constraints(model, data)
        outputs, measurements = plant.output_readings.values(data), plant.measurement_readings.values(data)
        result = np.concatenate([data.qacc, data.act_dot, outputs, measurements])
        if not np.all(np.isfinite(result)):
            raise PlantError(f"accelerations of plant {plant.name!r} are not finite near the operating point; check its masses")
        return result


def _steps(plant: Plant, model: mujoco.MjModel, step: float) -> Array:
    """The smallest perturbation of each state and input, (n + m,): powers of two, so that sums and differences lose no digits."""
    length = min(1.0, float(model.stat.extent))
    translation = np.array([unit == "m" for unit in tangent_units(model)])
    lengths = np.where(translation, length, 1.0)
    positions = lengths * min(1.0, _impedance_width(model) / (IMPEDANCE_STEPS * step))
    act, ctrl = plant.configuration.act, plant.configuration.ctrl
    room = np.full(model.na, np.inf)
    for i in np.flatnonzero(model.actuator_actlimited):
        where = slice(model.actuator_actadr[i], model.actuator_actadr[i] + model.actuator_actnum[i])
        room[where] = _room(act[where], model.actuator_actrange[i])
    activations = np.minimum(step * np.maximum(1.0, np.abs(act)), room)
    controls = []
    for address in plant.input_addresses:
        u0, limited = ctrl[address], model.actuator_ctrllimited[address]
        u_room = _room(u0, model.actuator_ctrlrange[address]) if limited else np.inf
        controls.append(np.minimum(step * max(1.0, abs(u0)), u_room))
    steps = np.concatenate([step * positions, step * lengths, activations, controls])
    return np.asarray(2.0 ** np.floor(np.log2(steps)))


def _impedance_width(model: mujoco.MjModel) -> float:
    """The least violation (in m or rad) over which the softness of an equality constraint changes; infinite where none does."""
    low, high, width = model.eq_solimp[:, :3].T
    return float(np.min(width, initial=np.inf, where=(low != high) & (width > 0)))


def _room(value: Array, limits: Array) -> Array:
    """The largest step of which four fit between the value and its nearer limit."""
    return np.asarray(np.minimum(value - limits[0], limits[1] - value) / 4)


def _check(plant: Plant, derivative: Derivative) -> None:
    nv = plant.model.nv
    rows = [f"the rate of {name!r}" for name in plant.coordinates.names[nv:]] + [f"output {name!r}" for name in plant.outputs.names]
    rows += [f"measurement {name!r}" for name in plant.measurements.names]
    columns = [repr(name) for name in (*plant.coordinates.names, *plant.inputs.names)]
    refuse_kinks(plant, derivative.jacobian, derivative.jump, rows, columns)


def _assemble(
    plant: Plant,
    point: OperatingPoint,
    measured: Array,
    parameters: Mapping[str, float],
    derivative: Derivative,
    left_out: tuple[str, ...],
) -> StateSpace:
    nv, n, m, p = plant.model.nv, len(plant.coordinates), len(plant.inputs), len(plant.outputs)
    velocity_rows = np.zeros((nv, n + m))
    velocity_rows[:, nv : 2 * nv] = np.eye(nv)
    jacobian, error = np.vstack([velocity_rows, derivative.jacobian]), np.vstack([np.zeros((nv, n + m)), derivative.error])
    kept_rows = np.concatenate([plant.state_addresses, np.arange(n, len(jacobian))])
    jacobian, error = jacobian[kept_rows], error[kept_rows]
    rows = [repr(name) for name in (*plant.states.names, *plant.outputs.names, *plant.measurements.names)]
    refuse_acting(plant, jacobian[:, :n], error[:, :n], rows)
    kept_columns, n = np.concatenate([plant.state_addresses, np.arange(n, n + m)]), plant.n_states
    value, errors = _blocks(jacobian[:, kept_columns], n, p), _blocks(error[:, kept_columns], n, p)
    C_m, D_m = np.split(jacobian[n + p :, kept_columns], [n], axis=1)
    return StateSpace(
        **value,
        states=plant.states,
        inputs=plant.inputs,
        outputs=plant.outputs,
        operating_point=point,
        input_limits=plant.input_limits,
        measurement=Measurement(C_m, D_m, plant.measurements, measured),
        parameters=parameters,
        error_estimates=errors,
        left_out=left_out,
    )


def _blocks(rows: Array, n: int, p: int) -> dict[str, Array]:
    """A, B, C and D out of [A B; C D; ...]."""
    return {"A": rows[:n, :n], "B": rows[:n, n:], "C": rows[n : n + p, :n], "D": rows[n : n + p, n:]}
