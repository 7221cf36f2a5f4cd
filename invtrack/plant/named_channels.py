"""What a plant's inputs, outputs, measurements and states are called, in what units, and where they stand in MuJoCo's arrays."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invtrack.errors import PlantError
from invtrack.plant.elements import Channel, listed

Array = NDArray[np.float64]
Addresses = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class NamedChannels:
    """The channels of a plant.

    inputs, outputs, measurements: with addresses in data.ctrl and data.sensordata. coordinates: all 2 nv + na of the tangent
    space, positions before velocities before activations. dropped: names of those that are not among the states.
    """

    inputs: tuple[Channel, ...]
    outputs: tuple[Channel, ...]
    measurements: tuple[Channel, ...]
    coordinates: tuple[Channel, ...] = field(repr=False)
    dropped: tuple[str, ...]

    @property
    def states(self) -> tuple[Channel, ...]:
        """The coordinates that are kept, with their addresses among all coordinates."""
        return tuple(channel for channel in self.coordinates if channel.name not in self.dropped)

    @property
    def n_states(self) -> int:
        """Number of states n: 2 nv + na, less those that are dropped."""
        return len(self.states)

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return _names(self.inputs)

    @property
    def output_names(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return _names(self.outputs)

    @property
    def measurement_names(self) -> tuple[str, ...]:
        """Names of the measurements."""
        return _names(self.measurements)

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the states."""
        return _names(self.states)

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """Names of all coordinates, those that are dropped too."""
        return _names(self.coordinates)

    @property
    def input_units(self) -> tuple[str, ...]:
        """Units of the inputs."""
        return _units(self.inputs)

    @property
    def output_units(self) -> tuple[str, ...]:
        """Units of the outputs."""
        return _units(self.outputs)

    @property
    def measurement_units(self) -> tuple[str, ...]:
        """Units of the measurements."""
        return _units(self.measurements)

    @property
    def state_units(self) -> tuple[str, ...]:
        """Units of the states."""
        return _units(self.states)

    @property
    def input_addresses(self) -> Addresses:
        """Where the inputs stand in data.ctrl, (p,)."""
        return _addresses(self.inputs)

    @property
    def output_addresses(self) -> Addresses:
        """Where the outputs stand in data.sensordata, (p,)."""
        return _addresses(self.outputs)

    @property
    def measurement_addresses(self) -> Addresses:
        """Where the measurements stand in data.sensordata, (m,)."""
        return _addresses(self.measurements)

    @property
    def state_addresses(self) -> Addresses:
        """Where the states stand among all coordinates, (n,)."""
        return _addresses(self.states)

    def coordinates_of(self, x: ArrayLike) -> Array:
        """All coordinates (2 nv + na,) of the state x (n,); what is dropped is at the operating point. Raises PlantError."""
        x = np.array(x, dtype=float)
        if x.shape != (self.n_states,):
            raise PlantError(f"x has shape {x.shape}, expected ({self.n_states},): {listed(self.state_names)}")
        coordinates = np.zeros(len(self.coordinates))
        coordinates[self.state_addresses] = x
        return coordinates

    def require_known(self, units: Iterable[str], *, besides: Iterable[str]) -> None:
        """Refuse, with the names there are, units given for what is neither a channel nor one of the parameters `besides`."""
        known = {*self.input_names, *self.output_names, *self.measurement_names, *self.coordinate_names, *besides}
        unknown = sorted(set(units) - known)
        if unknown:
            raise PlantError(f"units are given for {listed(unknown)}; the channels and parameters are: {listed(sorted(known))}")


def with_units(channels: Iterable[Channel], units: Mapping[str, str]) -> tuple[Channel, ...]:
    """The channels, with the units that are given for some of them by name."""
    return tuple(replace(channel, unit=units.get(channel.name, channel.unit)) for channel in channels)


def dropped_states(coordinates: Sequence[Channel], names: Sequence[str]) -> tuple[str, ...]:
    """The names to drop, in the order of the coordinates. Raises PlantError for unknown names, or where none would be left."""
    if isinstance(names, str):
        raise PlantError(f'expected a list of states to drop such as ["name"], got {names!r}')
    known = _names(coordinates)
    unknown = [name for name in names if name not in known]
    if unknown:
        raise PlantError(f"there is no state {listed(map(repr, unknown))} to drop; the states are: {listed(known)}")
    if set(names) == set(known):
        raise PlantError(f"all states are dropped: {listed(known)}; keep those that the outputs depend on")
    return tuple(name for name in known if name in names)


def _names(channels: Iterable[Channel]) -> tuple[str, ...]:
    return tuple(channel.name for channel in channels)


def _units(channels: Iterable[Channel]) -> tuple[str, ...]:
    return tuple(channel.unit for channel in channels)


def _addresses(channels: Iterable[Channel]) -> Addresses:
    return np.array([channel.address for channel in channels], dtype=np.intp)
