"""What is given of an equilibrium, by name: outputs, joint positions and controls; everything else is unknown."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from invtrack.arguments import by_name, texts
from invtrack.arrays import Array, Indices, finite_number, real_numbers, real_vector, shown
from invtrack.channels import Channels
from invtrack.errors import PlantError
from invtrack.plant.elements import element_name, listed
from invtrack.plant.limits import control_limits
from invtrack.plant.plant import Plant
from invtrack.plant.readings import Readings
from invtrack.plant.units import control_unit

Values = Mapping[str, float]
Positions = Mapping[str, ArrayLike]

Mask = NDArray[np.bool_]

_QUATERNIONS = {mujoco.mjtJoint.mjJNT_BALL: 4, mujoco.mjtJoint.mjJNT_FREE: 7}
"""How many numbers of qpos a joint with a quaternion has."""

_TRANSLATIONS = {mujoco.mjtJoint.mjJNT_BALL: 0, mujoco.mjtJoint.mjJNT_FREE: 3}
"""How many of its coordinates stand in qpos as they are; all of a slide or hinge."""


class Unknown(NamedTuple):
    """One unknown of an equilibrium; a joint and its actuator may share a name."""

    kind: Literal["position", "activation", "control"]
    name: str
    unit: str


@dataclass(frozen=True, eq=False)
class Given:
    """What an equilibrium has to meet, and from where the rest is solved.

    Unknowns are the nv positions (as displacements in tangent space), na activations and nu controls, in this order.

    Args:
        unknowns: what each is called.
        free: which of them are solved.
        held: what is neither given nor solved: controls of actuators that are no inputs, and the play of transmissions.
        qpos: the present positions with those that are given (nq,), from where displacements are measured.
        displacement: rotations that are given as a displacement, 0 elsewhere (nv,).
        ctrl: the present controls with those that are given (nu,).
        position_limits: range of the position of each degree of freedom (nv, 2).
        control_limits: range of each control that its actuator passes on (nu, 2).
        outputs: the outputs that are given.
        output_readings, output_values: what these read from MuJoCo's data, and what they are to be.
    """

    unknowns: tuple[Unknown, ...]
    free: Mask
    held: Mask
    qpos: Array
    displacement: Array
    ctrl: Array
    position_limits: Array
    control_limits: Array
    outputs: Channels
    output_readings: Readings
    output_values: Array

    def readings(self, before: Plant, after: Plant) -> Array:
        """The unknowns as a user reads them (nv + na + nu,), of the plant moved from `before` to `after`.

        The positions of slides, of hinges and of the place of free joints are those in qpos, rotations of ball and free joints the
        vectors from their orientation before.
        """
        model, qpos = after.model, after.configuration.qpos
        positions = np.zeros(model.nv)
        mujoco.mj_differentiatePos(model, positions, 1.0, before.configuration.qpos, qpos)
        for joint, kind in enumerate(model.jnt_type):
            count = _TRANSLATIONS.get(mujoco.mjtJoint(kind), 1)
            dof, address = int(model.jnt_dofadr[joint]), int(model.jnt_qposadr[joint])
            positions[dof : dof + count] = qpos[address : address + count]
        return np.concatenate([positions, after.configuration.act, after.configuration.ctrl])


def given_of(
    plant: Plant,
    model: mujoco.MjModel,
    *,
    outputs: Values | ArrayLike,
    positions: Positions,
    controls: Values | ArrayLike,
    free: Sequence[str],
) -> Given:
    """What is given, looked up in the plant.

    Args:
        plant: whose names are used, and whose operating point gives what is not named.
        model: the plant's, with parameter values; its joint and control ranges count.
        outputs: values of outputs or measurements by name, or of all outputs (p,).
        positions: values by the names of joints or of single coordinates.
        controls: values by the names of inputs or actuators, or of all inputs (p,).
        free: names of actuators besides the inputs whose controls are unknown.

    Raises PlantError for unknown names, values that are no finite numbers, positions and controls beyond their range, and what is
    given twice.
    """
    readings, values = _outputs(plant, outputs)
    qpos, displacement, fixed = _positions(plant, model, positions)
    ctrl, given, solved = _controls(plant, model, controls, free)
    coordinates, nv = plant.coordinates, model.nv
    still = np.isin(coordinates.names[:nv], plant.backlash) & ~fixed
    named = list(zip(coordinates.names, coordinates.units, strict=True))
    unknowns = [
        *(Unknown("position", *each) for each in named[:nv]),
        *(Unknown("activation", *each) for each in named[2 * nv :]),
        *(Unknown("control", *each) for each in _controls_named(model)),
    ]
    return Given(
        unknowns=tuple(unknowns),
        free=np.concatenate([~fixed & ~still, np.ones(model.na, dtype=bool), solved]),
        held=np.concatenate([still, np.zeros(model.na, dtype=bool), ~given & ~solved]),
        qpos=qpos,
        displacement=displacement,
        ctrl=ctrl,
        position_limits=_position_limits(model),
        control_limits=control_limits(model, np.arange(model.nu)),
        outputs=readings.channels,
        output_readings=readings,
        output_values=values,
    )


def _controls_named(model: mujoco.MjModel) -> list[tuple[str, str]]:
    """Name and unit of all nu controls in the order of data.ctrl: "NAME" of the actuator, "NAME[1]" where it has several."""
    named = {}
    for actuator in range(model.nactuator):
        name, unit = element_name(model, "actuator", actuator), control_unit(model, actuator)
        first, count = int(model.actuator_ctrladr[actuator]), int(model.actuator_ctrlnum[actuator])
        for i in range(count):
            named[first + i] = (name if count == 1 else f"{name}[{i}]", unit)
    return [named[i] for i in range(model.nu)]


def _outputs(plant: Plant, outputs: Values | ArrayLike) -> tuple[Readings, Array]:
    values = _by_name("outputs", outputs, plant.outputs)
    found = {
        name: (unit, reading)
        for channels, readings in ((plant.outputs, plant.output_readings), (plant.measurements, plant.measurement_readings))
        for name, unit, reading in zip(channels.names, channels.units, readings.readings, strict=True)
    }
    _require_known("outputs", values, found)
    numbers = [finite_number(f"output {name!r}", value, error=PlantError) for name, value in values.items()]
    channels = Channels(list(values), [found[name][0] for name in values])
    return Readings(channels, tuple(found[name][1] for name in values)), np.array(numbers)


def _positions(plant: Plant, model: mujoco.MjModel, positions: Positions) -> tuple[Array, Array, Mask]:
    values = by_name("positions", positions, expected="joint positions by the names of joints", error=PlantError)
    names = plant.coordinates.names[: model.nv]
    joints = {name: i for i, name in enumerate(_joint_names(model))}
    _require_known("positions", values, dict.fromkeys([*joints, *names]))
    qpos, displacement = np.array(plant.configuration.qpos), np.zeros(model.nv)
    fixed = np.zeros(model.nv, dtype=bool)
    for name, value in values.items():
        if name in joints and mujoco.mjtJoint(model.jnt_type[joints[name]]) in _QUATERNIONS:
            dofs = _whole_joint(model, joints[name], name, value, qpos)
        else:
            dofs = np.array([names.index(name)])
            _single(model, int(dofs[0]), name, finite_number(f"position {name!r}", value, error=PlantError), qpos, displacement)
        if np.any(fixed[dofs]):
            raise PlantError(f"position {name!r} is given twice, as a joint and by its coordinates; give it once")
        fixed[dofs] = True
    mujoco.mj_normalizeQuat(model, qpos)
    return qpos, displacement, fixed


def _whole_joint(model: mujoco.MjModel, joint: int, name: str, value: ArrayLike, qpos: Array) -> Indices:
    """Put the position of a ball or free joint into qpos; its degrees of freedom."""
    size = _QUATERNIONS[mujoco.mjtJoint(model.jnt_type[joint])]
    numbers = real_numbers(f"position {name!r}", value, error=PlantError)
    expected = "a quaternion (w, x, y, z)" if size == 4 else "(x, y, z) [m] and a quaternion (w, x, y, z)"
    if numbers.shape != (size,) or not np.all(np.isfinite(numbers)) or not np.any(numbers[-4:]):
        raise PlantError(f"position {name!r} must be {expected}, {size} finite numbers, got {shown(value)}")
    first = int(model.jnt_qposadr[joint])
    qpos[first : first + size] = numbers
    return np.flatnonzero(model.dof_jntid == joint)


def _single(model: mujoco.MjModel, dof: int, name: str, value: float, qpos: Array, displacement: Array) -> None:
    """Put the position of a slide or hinge, or one coordinate of a ball or free joint, where it belongs."""
    joint = int(model.dof_jntid[dof])
    within = dof - int(model.jnt_dofadr[joint])
    if within >= _TRANSLATIONS.get(mujoco.mjtJoint(model.jnt_type[joint]), 1):  # a rotation has no coordinate of its own in qpos
        displacement[dof] = value
        return
    low, high = _position_limits(model)[dof]
    if not low <= value <= high:
        raise PlantError(
            f"position {name!r} is given as {value:g}, beyond the joint's range [{low:g}, {high:g}]; give one within it"
        )
    qpos[int(model.jnt_qposadr[joint]) + within] = value


def _position_limits(model: mujoco.MjModel) -> Array:
    """Range of the position of each degree of freedom, (nv, 2); infinite where it has none, and for ball and free joints."""
    limits = np.tile([-np.inf, np.inf], (model.nv, 1))
    if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_LIMIT:
        return limits
    for joint in np.flatnonzero(model.jnt_limited):
        if mujoco.mjtJoint(model.jnt_type[joint]) not in _QUATERNIONS:
            limits[model.jnt_dofadr[joint]] = model.jnt_range[joint]
    return limits


def _controls(plant: Plant, model: mujoco.MjModel, controls: Values | ArrayLike, free: Sequence[str]) -> tuple[Array, Mask, Mask]:
    """The controls (nu,), which of them are given, and which are solved."""
    values = _by_name("controls", controls, plant.inputs)
    free = texts("free", free, expected="a list of names of actuators", error=PlantError)
    found = {name: i for i, (name, _) in enumerate(_controls_named(model))}
    found |= dict(zip(plant.inputs.names, plant.input_addresses.tolist(), strict=True))
    _require_known("controls", values, found)
    _require_known("free", free, found)
    ctrl, given, solved = np.array(plant.configuration.ctrl), np.zeros(model.nu, dtype=bool), np.zeros(model.nu, dtype=bool)
    solved[[*plant.input_addresses, *(found[name] for name in free)]] = True
    for name, value in values.items():
        address = found[name]
        number = finite_number(f"control {name!r}", value, error=PlantError)
        ((low, high),) = control_limits(model, np.array([address]))
        if not low <= number <= high:
            raise PlantError(
                f"control {name!r} is given as {number:g}; its actuator passes on {low:g} to {high:g}: give one within that"
            )
        if name in free or given[address]:
            raise PlantError(f"control {name!r} is given twice, or both given and free; name it once")
        ctrl[address], given[address], solved[address] = number, True, False
    return ctrl, given, solved


def _by_name(what: str, values: Values | ArrayLike, channels: Channels) -> Values:
    """Values by name, from those or from one number for each channel."""
    if isinstance(values, Mapping):
        return by_name(what, values, expected=f"values by the names of {what}", error=PlantError)
    return dict(zip(channels.names, real_vector(what, values, channels.names, error=PlantError).tolist(), strict=True))


def _require_known(what: str, names: Iterable[str], known: Collection[str]) -> None:
    unknown = [name for name in names if name not in known]
    if unknown:
        raise PlantError(f"{what}: there is no {listed(map(repr, unknown))}; there are: {listed(known)}")


def _joint_names(model: mujoco.MjModel) -> list[str]:
    return [element_name(model, "joint", joint) for joint in range(model.njnt)]
