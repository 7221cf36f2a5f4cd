"""Named physical parameters, what each changes in MuJoCo, and changes of them in mid-run."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import mujoco
import numpy as np

from invtrack.arguments import items, one_of, require_text
from invtrack.arrays import finite_number, shown
from invtrack.errors import PlantError, SimulationError
from invtrack.plant.elements import element_id


class Parameter(Protocol):
    """A physical quantity that may change between runs or in mid-run.

    `body` is the body it belongs to, if it belongs to one. `write` changes fields of a compiled model (the constants that MuJoCo
    derives from them are Plant's business), `write_spec` changes the specification that a model is compiled from; `reference` is
    the model as the file has it.
    """

    @property
    def body(self) -> str | None: ...

    def unit(self, model: mujoco.MjModel) -> str: ...

    def read(self, model: mujoco.MjModel) -> float: ...

    def write(self, model: mujoco.MjModel, value: float, *, reference: mujoco.MjModel) -> None: ...

    def write_spec(self, spec: mujoco.MjSpec, value: float, *, reference: mujoco.MjModel) -> None: ...


@dataclass(frozen=True)
class BodyMass:
    """The mass [kg] of one body (of that body alone, not of its subtree).

    inertia="fixed" leaves the body's rotational inertia as it is in the file: what is added is a point mass at its centre of mass.
    inertia="scaled" changes it in proportion to the mass: the body keeps its shape and changes its density.
    """

    body: str
    inertia: Literal["fixed", "scaled"] = "fixed"

    def __post_init__(self) -> None:
        require_text("the body of BodyMass", self.body, error=PlantError)
        one_of("inertia of BodyMass", self.inertia, ("fixed", "scaled"), error=PlantError)

    def unit(self, model: mujoco.MjModel) -> str:
        return "kg"

    def read(self, model: mujoco.MjModel) -> float:
        return float(model.body_mass[element_id(model, "body", self.body)])

    def write(self, model: mujoco.MjModel, value: float, *, reference: mujoco.MjModel) -> None:
        body = element_id(model, "body", self.body)
        inertia = self._inertia(reference, body, value)
        rigid = model.body_weldid == model.body_weldid[body]
        rest = float(np.sum(model.body_mass[rigid]) - model.body_mass[body])
        if model.body_weldid[body] != 0 and rest + value <= mujoco.mjMINVAL:
            raise PlantError(
                f"a mass of {value} kg for body {self.body!r} leaves a moving body without mass, so its acceleration is undefined;"
                " give a positive mass, or weld the body to one that has mass"
            )
        model.body_mass[body] = value
        model.body_inertia[body] = inertia

    def write_spec(self, spec: mujoco.MjSpec, value: float, *, reference: mujoco.MjModel) -> None:
        if spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE or spec.compiler.settotalmass > 0:
            raise PlantError(
                f"cannot compile a mass for body {self.body!r}: the compiler options inertiafromgeom or settotalmass overwrite it;"
                " remove them from the file"
            )
        index = element_id(reference, "body", self.body)
        body = spec.body(self.body)
        body.explicitinertial = True
        body.mass = value
        body.ipos, body.iquat = reference.body_ipos[index], reference.body_iquat[index]
        body.fullinertia = np.r_[np.nan, np.zeros(5)]  # NaN: not given, so that the diagonal one below counts
        body.inertia = self._inertia(reference, index, value)

    def _inertia(self, reference: mujoco.MjModel, body: int, value: float) -> np.ndarray:
        if self.inertia == "fixed":
            return np.array(reference.body_inertia[body])
        mass = float(reference.body_mass[body])
        if mass <= mujoco.mjMINVAL:
            raise PlantError(
                f"the inertia of body {self.body!r} cannot scale with its mass because its mass in the file is {mass} kg;"
                ' give it a mass and an inertia in the file, or use BodyMass(..., inertia="fixed")'
            )
        return np.array(reference.body_inertia[body] * (value / mass))


@dataclass(frozen=True)
class JointStiffness:
    """The linear stiffness of a joint's spring, in N/m (slide) or N m/rad (hinge, ball); its rest position stays."""

    joint: str
    body = None

    def __post_init__(self) -> None:
        require_text("the joint of JointStiffness", self.joint, error=PlantError)

    def unit(self, model: mujoco.MjModel) -> str:
        return "N/m" if _slides(model, self.joint) else "N m/rad"

    def read(self, model: mujoco.MjModel) -> float:
        return float(model.jnt_stiffness[element_id(model, "joint", self.joint)])

    def write(self, model: mujoco.MjModel, value: float, *, reference: mujoco.MjModel) -> None:
        model.jnt_stiffness[element_id(model, "joint", self.joint)] = value

    def write_spec(self, spec: mujoco.MjSpec, value: float, *, reference: mujoco.MjModel) -> None:
        _refuse_springdamper(spec, self.joint)
        spec.joint(self.joint).stiffness[0] = value


@dataclass(frozen=True)
class JointDamping:
    """The linear damping of a joint, in N s/m (slide) or N m s/rad (hinge, ball), the same for all its degrees of freedom."""

    joint: str
    body = None

    def __post_init__(self) -> None:
        require_text("the joint of JointDamping", self.joint, error=PlantError)

    def unit(self, model: mujoco.MjModel) -> str:
        return "N s/m" if _slides(model, self.joint) else "N m s/rad"

    def read(self, model: mujoco.MjModel) -> float:
        return float(model.dof_damping[self._dofs(model)][0])

    def write(self, model: mujoco.MjModel, value: float, *, reference: mujoco.MjModel) -> None:
        model.dof_damping[self._dofs(model)] = value

    def write_spec(self, spec: mujoco.MjSpec, value: float, *, reference: mujoco.MjModel) -> None:
        _refuse_springdamper(spec, self.joint)
        spec.joint(self.joint).damping[0] = value

    def _dofs(self, model: mujoco.MjModel) -> np.ndarray:
        return np.flatnonzero(model.dof_jntid == element_id(model, "joint", self.joint))


@dataclass(frozen=True)
class TendonStiffness:
    """The linear stiffness [N/m] of a tendon (of a fixed tendon: per squared unit of its length); its rest length stays."""

    tendon: str
    body = None

    def __post_init__(self) -> None:
        require_text("the tendon of TendonStiffness", self.tendon, error=PlantError)

    def unit(self, model: mujoco.MjModel) -> str:
        return "N/m"

    def read(self, model: mujoco.MjModel) -> float:
        return float(model.tendon_stiffness[element_id(model, "tendon", self.tendon)])

    def write(self, model: mujoco.MjModel, value: float, *, reference: mujoco.MjModel) -> None:
        model.tendon_stiffness[element_id(model, "tendon", self.tendon)] = value

    def write_spec(self, spec: mujoco.MjSpec, value: float, *, reference: mujoco.MjModel) -> None:
        spec.tendon(self.tendon).stiffness[0] = value


@dataclass(frozen=True)
class TendonDamping:
    """The linear damping [N s/m] of a tendon (of a fixed tendon: per squared unit of its length)."""

    tendon: str
    body = None

    def __post_init__(self) -> None:
        require_text("the tendon of TendonDamping", self.tendon, error=PlantError)

    def unit(self, model: mujoco.MjModel) -> str:
        return "N s/m"

    def read(self, model: mujoco.MjModel) -> float:
        return float(model.tendon_damping[element_id(model, "tendon", self.tendon)])

    def write(self, model: mujoco.MjModel, value: float, *, reference: mujoco.MjModel) -> None:
        model.tendon_damping[element_id(model, "tendon", self.tendon)] = value

    def write_spec(self, spec: mujoco.MjSpec, value: float, *, reference: mujoco.MjModel) -> None:
        spec.tendon(self.tendon).damping[0] = value


def _slides(model: mujoco.MjModel, joint: str) -> bool:
    return bool(model.jnt_type[element_id(model, "joint", joint)] == mujoco.mjtJoint.mjJNT_SLIDE)


def _refuse_springdamper(spec: mujoco.MjSpec, joint: str) -> None:
    if np.any(spec.joint(joint).springdamper):
        raise PlantError(f"joint {joint!r} has its spring and damper from `springdamper`; give stiffness and damping in the file")


class Change:
    """At `time` [s] the named parameters take new values, as in Change(3.0, tip_mass=100.0); the state is continuous."""

    def __init__(self, time: float, **parameters: float) -> None:
        self.time = finite_number("the time of a change", time, unit="s", error=SimulationError)
        if not parameters:
            raise SimulationError(
                f"the change at t = {time} s names no parameter; write for instance Change({time}, tip_mass=100.0)"
            )
        self.parameters = {name: finite_number(name, value, error=SimulationError) for name, value in parameters.items()}

    def __repr__(self) -> str:
        return f"Change({self.time}, {', '.join(f'{k}={v}' for k, v in self.parameters.items())})"


def ordered(schedule: Sequence[Change]) -> list[Change]:
    """The changes in the order of their times. Raises SimulationError where two happen at once."""
    schedule = items("schedule", schedule, expected="a list of changes", error=SimulationError)
    strange = [change for change in schedule if not isinstance(change, Change)]
    if strange:
        raise SimulationError(
            f"the schedule holds {shown(strange[0])}; expected changes such as invtrack.Change(3.0, tip_mass=100.0)"
        )
    result = sorted(schedule, key=lambda change: change.time)
    for first, second in itertools.pairwise(result):
        if first.time == second.time:
            raise SimulationError(f"two changes at t = {first.time} s; name all parameters in one Change")
    return result
