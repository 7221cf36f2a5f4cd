"""A mechanism in MJCF with named inputs, outputs, states and parameters."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from invtrack.arguments import by_name, texts
from invtrack.arrays import Array, real_number, real_numbers
from invtrack.channels import Channels
from invtrack.errors import PlantError
from invtrack.linear.state_space import OperatingPoint
from invtrack.plant.actuator_delays import fill_histories
from invtrack.plant.configuration import Configuration, state_of
from invtrack.plant.couplings import VelocityCoupling, velocity_couplings
from invtrack.plant.elements import (
    Addresses,
    coordinate_channels,
    dropped_states,
    input_channels,
    listed,
    scalar_joints,
)
from invtrack.plant.limits import control_limits
from invtrack.plant.loading import Source, compile_spec, load_model, model_name
from invtrack.plant.outputs import output_readings
from invtrack.plant.parameters import Parameter, named_parameters
from invtrack.plant.readings import Readings

A_PLANT = "an invtrack.Plant, such as Plant.from_xml(path, inputs=[...], outputs=[...])"
"""What messages say is expected where something else is given for a plant."""


@dataclass(frozen=True, eq=False)
class Plant:
    """A MuJoCo model seen as a system with inputs u = data.ctrl, outputs y read from its data, and named physical parameters.

    The state is x = (tangent of qpos, qvel, act), each as deviation from the operating point; n = 2 nv + na (see
    `invtrack.plant.configuration`), or less where coordinates are dropped. Actuators that are not inputs hold their control of the
    operating point.

    Args:
        source: where the mechanism comes from, as messages say it: the path of its file, "the MJCF text", "the MjModel".
        model: compiled with the file's parameter values; make a copy with `model_with` before changing anything in it.
        spec: what the model was compiled from; None where it came as a compiled model.
        configuration: the operating point in MuJoCo's coordinates.
        inputs, outputs, measurements: their `Channels`.
        coordinates: all 2 nv + na of the tangent space, positions before velocities before activations.
        input_addresses: where the inputs stand in data.ctrl (p,).
        output_readings, measurement_readings: what these read from MuJoCo's data.
        dropped: names of the coordinates that are not among the states.
        backlash: names of the joints that are the play of a transmission, whose coordinates are dropped, too.
        parameters: what each named parameter changes.
        parameter_channels: names and units of the parameters.
        couplings: forces linear in velocity that the file carries (see `invtrack.plant.couplings`). MuJoCo applies them only within
            `forces`, in which everything that invtrack computes from the plant takes place.
    """

    source: str
    model: mujoco.MjModel
    spec: mujoco.MjSpec | None = field(repr=False)
    configuration: Configuration = field(repr=False)
    inputs: Channels
    outputs: Channels
    measurements: Channels
    coordinates: Channels = field(repr=False)
    input_addresses: Addresses = field(repr=False)
    output_readings: Readings = field(repr=False)
    measurement_readings: Readings = field(repr=False)
    dropped: tuple[str, ...]
    parameters: Mapping[str, Parameter]
    parameter_channels: Channels = field(repr=False)
    couplings: tuple[VelocityCoupling, ...] = ()
    backlash: tuple[str, ...] = ()

    @classmethod
    def from_xml(
        cls,
        source: Source,
        *,
        inputs: Sequence[str],
        outputs: Sequence[str],
        measurements: Sequence[str] | None = None,
        drop_states: Sequence[str] = (),
        backlash: Sequence[str] = (),
        parameters: Mapping[str, str | Parameter] | Sequence[str] = (),
        units: Mapping[str, str] | None = None,
        keyframe: str | None = None,
    ) -> Plant:
        """A plant from MJCF.

        Elements without a name are called as messages call them, by kind and index: "joint 0", "actuator 2".

        Args:
            source: the path of an MJCF file, MJCF text (whose includes are looked for in the working directory), a mujoco.MjSpec
                or a mujoco.MjModel. What is given is copied.
            inputs: actuators ("NAME", or "NAME[1]" where one has several controls).
            outputs: sensors ("NAME", "NAME[1]"), states by their names ("NAME velocity"), or expressions: "joint:NAME",
                "joint:NAME:velocity" (of a free or ball joint "joint:NAME:x", "joint:NAME:rx:velocity"), "activation:ACTUATOR",
                "body:NAME:x", "site:NAME:x" (y, z: world coordinates; yaw, pitch, roll: from the orientation in the keyframe, see
                `invtrack.plant.readings`), "distance:SITE:SITE", "tendon:NAME".
            measurements: what controllers that do not know the state may measure, named like outputs; the outputs unless stated.
            drop_states: coordinates that act on nothing (where a vehicle stands, its heading), which models and controllers are not
                to see; the simulation still moves them, and `linearize` refuses where they do act.
            backlash: slide and hinge joints that are the play of a transmission (a small range, nothing else that holds them).
                Models and controllers see the play closed: the joint keeps its place, and is no state; the simulation moves it.
            parameters: names of your own for what may change, with its path, as {"tip_mass": "body:tip:mass"}; or the paths
                alone, which then are the names.
            units: SI units that replace those inferred, by the name of an input, output, state or parameter.
            keyframe: the operating point; without it qpos0 at rest with zero controls. Angles count from it, also after `at`.

        Raises PlantError for what does not compile, unknown names (with those there are), velocity couplings that do not fit the
        model, and models whose state is more than (qpos, qvel, act): plugins with state, plasticity, sensors with delays (delays of
        actuators are simulated, and left out of linear models).
        """
        units = dict(by_name("units", {} if units is None else units, expected="units by the names of channels", error=PlantError))
        inputs, outputs, drop_states = _names("inputs", inputs), _names("outputs", outputs), _names("drop_states", drop_states)
        measurements = outputs if measurements is None else _names("measurements", measurements)
        loaded = load_model(source)
        model = loaded.model
        named = named_parameters(model, parameters)
        configuration = Configuration.of_model(model, keyframe)
        u, input_addresses = input_channels(model, inputs)
        y, y_m = (output_readings(model, names, configuration) for names in (outputs, measurements))
        coordinates = coordinate_channels(model)
        backlash = scalar_joints(model, "backlash", _names("backlash", backlash))
        play = [name for joint in backlash for name in (joint, f"{joint} velocity")]
        channels = Channels(tuple(named), [parameter.unit(model) for parameter in named.values()])
        _require_known(units, (u, y.channels, y_m.channels, coordinates, channels))
        return cls(
            source=loaded.description,
            model=model,
            spec=loaded.spec,
            configuration=configuration,
            inputs=u.with_units(units),
            outputs=y.channels.with_units(units),
            measurements=y_m.channels.with_units(units),
            coordinates=coordinates.with_units(units),
            input_addresses=input_addresses,
            output_readings=y,
            measurement_readings=y_m,
            dropped=dropped_states(coordinates, drop_states, play=play),
            parameters=MappingProxyType(named),
            parameter_channels=channels.with_units(units),
            couplings=velocity_couplings(model),
            backlash=backlash,
        )

    def at(
        self,
        *,
        qpos: ArrayLike | Mapping[str, ArrayLike] | None = None,
        qvel: ArrayLike | Mapping[str, ArrayLike] | None = None,
        act: ArrayLike | Mapping[str, ArrayLike] | None = None,
        ctrl: ArrayLike | Mapping[str, ArrayLike] | None = None,
        keyframe: str | None = None,
    ) -> Plant:
        """The same plant at another operating point, which need not be an equilibrium: `trim` finds those.

        Args:
            qpos, qvel: positions (nq,) and velocities (nv,), or those of some joints by name, as {"elbow": 0.3} or, of a ball
                joint, {"wrist": [1, 0, 0, 0]}; None: as they are.
            act, ctrl: activations (na,) and controls (nu,) of all actuators, or those of some by name; None: as they are.
            keyframe: name of the keyframe to start from; this plant's operating point unless given.

        Raises PlantError for wrong sizes and unknown names.
        """
        start = self.configuration if keyframe is None else Configuration.of_model(self.model, keyframe)
        return replace(self, configuration=start.replaced(self.model, qpos=qpos, qvel=qvel, act=act, ctrl=ctrl))

    @property
    def name(self) -> str:
        """The model's name in its file."""
        return model_name(self.model)

    @cached_property
    def states(self) -> Channels:
        """The coordinates that are kept."""
        return self.coordinates.subset([name for name in self.coordinates.names if name not in self.dropped])

    @cached_property
    def state_addresses(self) -> Addresses:
        """Where the states stand among all coordinates, (n,)."""
        return np.array([self.coordinates.index(name) for name in self.states.names], dtype=np.intp)

    @property
    def n_states(self) -> int:
        """Number of states n: 2 nv + na, less those that are dropped."""
        return len(self.states)

    @property
    def input_limits(self) -> Array:
        """Lowest and highest value of each input that its actuator passes on, (m, 2); infinite where it is not limited.

        The tightest of ctrlrange and, where the force does not depend on the state, forcerange and actuatorfrcrange; see
        `invtrack.plant.limits`.
        """
        return control_limits(self.model, self.input_addresses)

    @property
    def parameter_values(self) -> dict[str, float]:
        """The parameters' values in the file."""
        return {name: parameter.read(self.model) for name, parameter in self.parameters.items()}

    @property
    def parameter_bodies(self) -> dict[str, str]:
        """The bodies of those parameters that belong to one."""
        return {name: parameter.body for name, parameter in self.parameters.items() if parameter.body is not None}

    @cached_property
    def operating_point(self) -> OperatingPoint:
        """x0 = (qpos, qvel, act) (nq + nv + na,), u0 (m,) and y0 (p,), with the file's parameter values."""
        return self.operating_point_in(self.model)

    def operating_point_in(self, model: mujoco.MjModel) -> OperatingPoint:
        """The operating point with the parameter values of `model` (from `model_with`)."""
        data = self.new_data(model)
        return OperatingPoint(x0=self.configuration.x0, u0=data.ctrl[self.input_addresses], y0=self.measure(data))

    def new_data(self, model: mujoco.MjModel | None = None) -> mujoco.MjData:
        """Fresh MuJoCo data at the operating point, after mj_forward; for `model` from `model_with`, or the plant's own."""
        model = self.model if model is None else model
        data = mujoco.MjData(model)
        self.configuration.write(data)
        fill_histories(model, data, data.time)
        with self.forces(model):
            mujoco.mj_forward(model, data)
        return data

    def forces(self, model: mujoco.MjModel | None = None) -> AbstractContextManager[None]:
        """A block in which MuJoCo applies the velocity couplings to `model` (from `model_with`), or to the plant's own model.

        Whoever calls mj_forward, mj_step, mj_inverse or mujoco.rollout on a plant's model does so within it:

            model = plant.model_with()
            data = plant.new_data(model)
            with plant.forces(model):
                mujoco.mj_step(model, data)

        The block holds for this model object alone, not for copies of it; blocks for several models and plants may be nested, and
        entered in several threads. It works through MuJoCo's passive callback (see `invtrack.plant.native.slots`), compiled, so
        that MuJoCo keeps its speed. A plant without couplings installs none.

        Raises PlantError for a model that did not come from this plant.
        """
        if not self.couplings:
            return nullcontext()
        model = self.model if model is None else model
        self._require_own(model)
        from invtrack.plant.native.coupling_forces import coupling_forces  # compiles; plants without couplings do without it

        return coupling_forces(model, self.couplings)

    def measure(self, data: mujoco.MjData) -> Array:
        """The outputs (p,) of data that are up to date, as after mj_forward (after mj_step part of them lag by one step)."""
        return self.output_readings.values(data)

    def state(self, data: mujoco.MjData) -> Array:
        """The state x (n,) of the data, as deviation from the operating point."""
        return state_of(self.model, self.configuration.x0, data.qpos, data.qvel, data.act)[self.state_addresses]

    def coordinates_of(self, x: ArrayLike) -> Array:
        """All coordinates (2 nv + na,) of the state x (n,); what is dropped is at the operating point. Raises PlantError."""
        x = real_numbers("x", x, error=PlantError)
        if x.shape != (self.n_states,):
            raise PlantError(f"x has shape {x.shape}, expected ({self.n_states},): {listed(self.states.names)}")
        coordinates = np.zeros(len(self.coordinates))
        coordinates[self.state_addresses] = x
        return coordinates

    def model_with(self, values: Mapping[str, float] | None = None) -> mujoco.MjModel:
        """A fresh copy of the model with named parameters set; the others as in the file. Raises PlantError like `apply`."""
        model, values = copy.copy(self.model), values or {}
        self._check(values)
        if values:
            self._write(model, values)
            self._derive(model)
        return model

    def apply(self, model: mujoco.MjModel, values: Mapping[str, float]) -> None:
        """Set named parameters in a model that came from this plant, in place, also while a simulation is running.

        Live data keep qpos, qvel and act; call mj_forward before reading accelerations or sensors from them. Everything that MuJoCo
        derives from masses is computed anew. Raises PlantError, leaving the model as it was, for unknown parameters and for values
        that are not finite, negative where that makes no sense, or leave a moving body without mass or with an inertia that no body
        has.
        """
        self._check(values)
        self._require_own(model)
        if values:
            self._write(copy.copy(model), values)  # the copy takes any refusal, so that the model itself stays whole
            self._write(model, values)
            self._derive(model)

    def _write(self, model: mujoco.MjModel, values: Mapping[str, float]) -> None:
        """Write the parameters as they are. Raises PlantError, the model half written, for values that leave no mechanism."""
        for name, value in values.items():
            self.parameters[name].write(model, float(value), reference=self.model)
        for name in values:
            self.parameters[name].check(model)

    def _derive(self, model: mujoco.MjModel) -> None:
        """Have MuJoCo work out anew what it derives from masses."""
        # The scratch data are thrown away: mj_setConst puts qpos0 into the data it is given.
        mujoco.mj_setConst(model, mujoco.MjData(model))

    def compiled_with(self, values: Mapping[str, float]) -> mujoco.MjModel:
        """A model compiled afresh with named parameters set in its specification: an independent check on `model_with`.

        Raises PlantError like `apply`, where the file's compiler options overwrite a parameter, and for a plant that came as a
        compiled model, which MuJoCo does not turn back into a specification.
        """
        self._check(values)
        if self.spec is None:
            raise PlantError(
                f"plant {self.name!r} came as an MjModel, which MuJoCo cannot compile again; give Plant.from_xml its MJCF or its"
                " MjSpec (model_with and changes in mid-run need neither)"
            )
        spec = self.spec.copy()
        for name, value in values.items():
            self.parameters[name].write_spec(spec, float(value), reference=self.model)
        return compile_spec(spec, f"{self.source} with {dict(values)}")

    def _require_own(self, model: mujoco.MjModel) -> None:
        if model.signature != self.model.signature:
            raise PlantError(f"expected a model that came from plant {self.name!r} (plant.model_with()), got another one")

    def _check(self, values: Mapping[str, float]) -> None:
        for name, value in values.items():
            if name not in self.parameters:
                raise PlantError(
                    f"plant {self.name!r} has no parameter {name!r}; there are: {listed(self.parameters)}. They are stated with the"
                    ' plant, as Plant.from_xml(..., parameters=["body:tip:mass"])'
                )
            lowest, number = self.parameters[name].lowest, real_number(f"parameter {name!r}", value, error=PlantError)
            if not math.isfinite(number) or number < lowest:
                unit = self.parameter_channels.units[self.parameter_channels.index(name)]
                below = "" if math.isinf(lowest) else " and not negative" if lowest == 0 else f" and at least {lowest}"
                raise PlantError(f"parameter {name!r} must be finite{below}{f' [{unit}]' if unit else ''}, got {value}")


def _require_known(units: Iterable[str], groups: Iterable[Channels]) -> None:
    """Refuse, with the names there are, units given for what is no channel and no parameter."""
    known = {name for channels in groups for name in channels.names}
    unknown = sorted(set(units) - known)
    if unknown:
        raise PlantError(f"units are given for {listed(unknown)}; the channels and parameters are: {listed(sorted(known))}")


def _names(what: str, given: Sequence[str]) -> Sequence[str]:
    """The names in a list; a single text is left to where names are looked up, which knows what to suggest."""
    return given if isinstance(given, str) else texts(what, given, expected="a list of names", error=PlantError)
