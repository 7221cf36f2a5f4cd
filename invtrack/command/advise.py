"""`invtrack advise`: which method to take for a motion, and the lines that make it."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
import tyro

from invtrack.advice import Advice, Move, advise
from invtrack.advice.program import Line, Name
from invtrack.command.motion import Motion, seconds, share
from invtrack.errors import InvtrackError
from invtrack.files import replaced_when_complete
from invtrack.plant import Plant
from invtrack.redesign import Limits
from invtrack.references import PiecewiseSignal, load_reference
from invtrack.report import write_report
from invtrack.studies.session import progress

PROGRAM, ADVICE, PAGE = "program.py", "advice.json", "report.html"
"""What is kept in the folder of --out."""


@dataclass(frozen=True, kw_only=True)
class Advise(Motion):
    """Try every method that applies to a motion of a mechanism, in MuJoCo, and recommend one."""

    error: Annotated[str, tyro.conf.arg(metavar="SHARE")] = "1%"
    """Largest error that is acceptable, as a share of the motion."""

    limit: Annotated[tuple[str, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="NAME=VALUE")] = ()
    """What an input, or an output, must never exceed: a number for both signs, or LOW:HIGH; may be given several times. Without it
    the actuators' ranges are the limits."""

    parameter_error: Annotated[tuple[str, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="[PATH=]SHARE")] = ()
    """By how much a parameter may be off, as in body:load:mass=10%; may be given several times. A share alone is that of the masses
    of all moving bodies, and of stiffnesses."""

    max_preactuation: Annotated[str | None, tyro.conf.arg(metavar="TIME")] = None
    """For how long before the motion the input may act, such as 500ms."""

    fastest: tyro.conf.FlagCreatePairsOff[bool] = False
    """Recommend the shortest motion that does what is asked, in place of the one with the least input."""

    def execute(self) -> int:
        """Print the advice; 0, or 1 where there is no recommendation."""
        if self.set:
            raise InvtrackError("--set: advise takes a mechanism as its file has it; change it there, or say --parameter-error")
        plant = self.plant()
        options: dict[str, Any] = {
            "error": share("--error", self.error),
            "limits": self._limits(plant),
            "parameter_errors": self._parameter_errors(),
            "max_preactuation": None if self.max_preactuation is None else seconds("--max-preactuation", self.max_preactuation),
            "fastest": self.fastest,
            "timestep": self.timestep,
        }
        given: Move | PiecewiseSignal
        if self.reference is None:
            given = Move(self.distances(plant), self.duration)
        else:
            given = load_reference(self.reference, channels=plant.outputs)
        if self.quiet or self.json:
            found = advise(plant, given, **options)
        else:
            with progress(f"methods for {plant.name}") as report:
                found = advise(plant, given, **options, progress=report)
        self._show(replace(found, source=self._source(plant)))
        return 0 if found.recommended is not None else 1

    def _show(self, advice: Advice) -> None:
        if self.json:
            print(json.dumps(advice.as_dict(), indent=2, allow_nan=False))
        elif not self.quiet:
            advice.show()
        if self.out is not None:
            self.out.mkdir(parents=True, exist_ok=True)
            write_report(advice, self.out / PAGE)
            for name, text in ((ADVICE, json.dumps(advice.as_dict(), indent=2, allow_nan=False)), (PROGRAM, advice.program)):
                with replaced_when_complete(self.out / name) as draft:
                    draft.write_text(text + "\n", encoding="utf-8")

    def _limits(self, plant: Plant) -> Limits | None:
        if not self.limit:
            return None
        sides = {"input": plant.input_limits.T.copy(), "output": np.array([[-np.inf], [np.inf]]) * np.ones(len(plant.outputs))}
        channels = {"input": plant.inputs, "output": plant.outputs}
        for text in self.limit:
            name, _, value = text.rpartition("=")
            kind = next((kind for kind, known in channels.items() if name in known.names), None)
            if kind is None:
                names = ", ".join([*plant.inputs.names, *plant.outputs.names])
                raise InvtrackError(f"--limit: expected NAME=VALUE with one of {names}, got {text!r}")
            sides[kind][:, channels[kind].index(name)] = _range(value)
        return Limits(**{kind: (low, high) for kind, (low, high) in sides.items()})

    def _parameter_errors(self) -> float | dict[str, float]:
        alone = [text for text in self.parameter_error if "=" not in text]
        if alone and len(self.parameter_error) > 1:
            raise InvtrackError("--parameter-error: expected one share for all, or PATH=SHARE for each, got both")
        if alone:
            return share("--parameter-error", alone[0])
        pairs = (text.rpartition("=") for text in self.parameter_error)
        return {path.strip(): share("--parameter-error", value) for path, _, value in pairs}

    def _source(self, plant: Plant) -> tuple[str, ...]:
        """Lines of Python that make the plant, and a reference from a file."""
        options: dict[str, Any] = {"inputs": list(plant.inputs.names), "outputs": list(self.output)}
        options |= {} if self.keyframe is None else {"keyframe": self.keyframe}
        options |= {"drop_states": list(self.drop)} if self.drop else {}
        lines = [Line("plant", "invtrack.Plant.from_xml", [str(self.source)], options)]
        if self.trim:
            lines.append(Line("plant", "invtrack.trim", [Name("plant")], {"outputs": self.trimmed}))
        if self.reference is not None:
            lines.append(Line("reference", "invtrack.load_reference", [str(self.reference)], {"channels": Name("plant.outputs")}))
        return tuple(line.text + (".plant" if line.call == "invtrack.trim" else "") for line in lines)


def _range(text: str) -> tuple[float, float]:
    """(-5, 5) from "5", (-1, 2) from "-1:2". Raises InvtrackError for anything else."""
    low, colon, high = text.partition(":")
    try:
        sides = (float(low), float(high)) if colon else (-float(low), float(low))
    except ValueError:
        sides = (0.0, 0.0)
    if not sides[0] < sides[1]:
        raise InvtrackError(f"--limit: expected a positive number, or LOW:HIGH, got {text!r}")
    return sides
