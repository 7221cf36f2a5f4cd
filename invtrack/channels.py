"""Names and units of scalar signals: one type for states, inputs, outputs, measurements and parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from invtrack.arguments import by_name, texts
from invtrack.arrays import shown
from invtrack.errors import ChannelError


@dataclass(frozen=True, init=False)
class Channels:
    """Scalar signals in their order, each with a name and a unit.

    names: distinct. units: one for each name, such as "m" or "N m"; "1" for a plain number, "" where the unit is not known, as it
    is for all of them unless stated.

    Raises ChannelError for names that are not distinct, and for another number of units than names.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]

    def __init__(self, names: Sequence[str] = (), units: Sequence[str] | None = None) -> None:
        for what, given in (("names", names), ("units", units)):
            if isinstance(given, str):
                raise ChannelError(f"expected a list of {what} such as [{given!r}], got the text {given!r}")
        names = texts("names", names, expected="a list of names of channels", error=ChannelError)
        if units is None:
            units = ("",) * len(names)
        units = texts("units", units, expected="a list of units of channels", error=ChannelError)
        if len(set(names)) != len(names):
            raise ChannelError(f"expected distinct names of channels, got {list(names)}")
        if len(units) != len(names):
            raise ChannelError(f"expected one unit for each of the channels {list(names)}, got {list(units)}")
        object.__setattr__(self, "names", names)
        object.__setattr__(self, "units", units)

    @classmethod
    def of(cls, given: Channels | Sequence[str]) -> Channels:
        """Channels from themselves, or from names without units."""
        return given if isinstance(given, Channels) else cls(given)

    @classmethod
    def numbered(cls, letter: str, count: int) -> Channels:
        """Channels that nobody has named: x1, x2, ... for the letter x."""
        return cls([f"{letter}{i}" for i in range(1, count + 1)])

    def __len__(self) -> int:
        """Number of channels."""
        return len(self.names)

    def __contains__(self, name: object) -> bool:
        """Whether one of the channels has this name."""
        return name in self.names

    def __str__(self) -> str:
        """The labels in one line, "none" where there are no channels."""
        return ", ".join(self.labels) or "none"

    @property
    def labels(self) -> tuple[str, ...]:
        """Each name with its unit, "tip [m]"; the name alone where the unit is not known."""
        return tuple(f"{name} [{unit}]" if unit else name for name, unit in zip(self.names, self.units, strict=True))

    def index(self, name: str) -> int:
        """Position of the channel with this name. Raises ChannelError, with the names there are, where there is none."""
        if not isinstance(name, str) or name not in self.names:
            raise ChannelError(f"no channel is named {shown(name)}; there are: {', '.join(self.names) or 'none'}")
        return self.names.index(name)

    def subset(self, names: Sequence[str]) -> Channels:
        """The channels of these names, in the order of the names. Raises ChannelError as `index` does."""
        chosen = texts("names", names, expected="a list of names of channels", error=ChannelError)
        return Channels(chosen, [self.units[self.index(name)] for name in chosen])

    def with_units(self, units: Mapping[str, str]) -> Channels:
        """The same channels with other units for those of them that `units` names; other names in it are left alone."""
        units = by_name("units", units, expected="units by the names of channels", error=ChannelError)
        return Channels(self.names, [units.get(name, unit) for name, unit in zip(self.names, self.units, strict=True)])

    def fits(self, other: Channels) -> bool:
        """Whether both have the same names in the same order, and no channel two different units; an unknown one fits any."""
        return self.names == other.names and all(
            mine == theirs or not (mine and theirs) for mine, theirs in zip(self.units, other.units, strict=True)
        )
