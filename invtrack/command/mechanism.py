"""The options that name a mechanism, and the plant that they make."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import tyro

from invtrack.errors import InvtrackError
from invtrack.plant import Plant, model_path, trim, with_parameter_values


@dataclass(frozen=True, kw_only=True)
class Mechanism:
    """A mechanism and the channels that matter."""

    mechanism: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="MODEL.xml")]
    """An MJCF file, or the name of a model that comes with invtrack, such as cantilever."""

    input: Annotated[tuple[str, ...], tyro.conf.UseAppendAction, tyro.conf.arg(aliases=["-u"], metavar="ACTUATOR")] = ()
    """An actuator that is to be driven; may be given several times. All actuators unless given."""

    output: Annotated[tuple[str, ...], tyro.conf.UseAppendAction, tyro.conf.arg(aliases=["-y"], metavar="OUTPUT")] = ()
    """What is to follow: a sensor, or an expression such as joint:NAME, site:NAME:x, body:NAME:z; may be given several times."""

    keyframe: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """The operating point; without it qpos0 at rest."""

    trim: Annotated[tuple[str, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="OUTPUT=VALUE")] = ()
    """Find the equilibrium near the operating point in which this output has this value; may be given several times. The word
    `here` finds the one with the least departure."""

    set: Annotated[tuple[str, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="PATH=VALUE")] = ()
    """Another value of a parameter than the file's, such as body:tip:mass=3; may be given several times."""

    drop: Annotated[tuple[str, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="STATE")] = ()
    """A coordinate that acts on nothing, such as where a vehicle stands; may be given several times."""

    @property
    def values(self) -> dict[str, Any]:
        """Values of --set by path."""
        return dict(assignment("--set", text) for text in self.set)

    def plant(self, parameters: Sequence[str] = ()) -> Plant:
        """The plant at its operating point, with what is set; parameters: paths of those that may change on the way."""
        if not self.output:
            raise InvtrackError("--output (-y): say what is to follow, such as a sensor or joint:NAME or site:NAME:x")
        source = self.source
        plant = Plant.from_xml(
            source,
            inputs=self.input or _actuators(source),
            outputs=self.output,
            parameters=list(dict.fromkeys([*self.values, *parameters])),
            keyframe=self.keyframe,
            drop_states=self.drop,
        )
        if self.values:
            plant = with_parameter_values(plant, self.values)
        kept = {name: parameter for name, parameter in plant.parameters.items() if name in parameters}
        plant = replace(plant, parameters=kept, parameter_channels=plant.parameter_channels.subset(list(kept)))
        return trim(plant, outputs=self.trimmed).plant if self.trim else plant

    @property
    def trimmed(self) -> dict[str, float]:
        """Values of --trim by output."""
        return dict(assignment("--trim", text) for text in self.trim if text != "here")

    @property
    def source(self) -> Path:
        """The MJCF file."""
        path = Path(self.mechanism)
        if path.exists():
            return path
        if path.suffix or path.parent != Path():
            raise InvtrackError(f"there is no file {path}")
        return model_path(self.mechanism)


def assignment(option: str, text: str) -> tuple[str, float]:
    """("body:tip:mass", 3.0) from "body:tip:mass=3". Raises InvtrackError, with the option's name, for anything else."""
    name, equals, value = text.rpartition("=")
    try:
        number = float(value)
    except ValueError:
        equals = ""
        number = 0.0
    if not equals or not name:
        raise InvtrackError(f"{option}: expected NAME=NUMBER, such as body:tip:mass=3, got {text!r}")
    return name.strip(), number


def _actuators(source: Path) -> list[str]:
    import mujoco

    try:
        model = mujoco.MjModel.from_xml_path(str(source))
    except (ValueError, OSError) as error:
        raise InvtrackError(f"{source}: {error}") from error
    names = [model.actuator(i).name or f"actuator {i}" for i in range(model.nu)]
    if not names:
        raise InvtrackError(f"{source} has no actuators; expected some in its <actuator> section")
    return names
