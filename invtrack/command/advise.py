"""`invtrack advise`: which method to take for a motion, and the lines that make it."""

from __future__ import annotations

import json
import shlex
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import tyro

from invtrack.advice import Advice, Move, Trial, advise
from invtrack.advice.program import Line, Name
from invtrack.command.motion import Motion, seconds, share
from invtrack.command.planning import Method
from invtrack.command.printed import Printed
from invtrack.errors import InvtrackError
from invtrack.files import replaced_when_complete
from invtrack.plant import Plant
from invtrack.references import PiecewiseSignal, load_reference
from invtrack.report import write_report
from invtrack.studies.session import progress

PROGRAM, ADVICE, PAGE, RECORDING = "program.py", "advice.json", "report.html", "recommended.rrd"
"""What is kept in the folder of --out."""


METHODS: dict[str, tuple[Method, bool]] = {
    "stable inversion": ("exact", False),
    "stable inversion of the motion": ("exact", True),
    "modified inversion": ("modified", False),
    "modified inversion of the motion": ("modified", True),
    "quadratic redesign": ("redesign", False),
    "quadratic redesign of the motion": ("redesign", True),
    "constrained redesign": ("limited", False),
    "constrained redesign of the motion": ("limited", True),
    "feedback and postures": ("feedback", True),
}
"""The methods of `invtrack run`, and whether on the nonlinear motion, by what advice calls them."""


@dataclass(frozen=True, kw_only=True)
class Advise(Motion, Printed):
    """Try every method that applies to a motion of a mechanism, in MuJoCo, and recommend one."""

    parameter_error: Annotated[tuple[str, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="[PATH=]SHARE")] = ()
    """By how much a parameter may be off, as in body:load:mass=10%; may be given several times. A share alone is that of the masses
    of all moving bodies, and of stiffnesses."""

    max_preactuation: Annotated[str | None, tyro.conf.arg(metavar="TIME")] = None
    """For how long before the motion the input may act, such as 500ms."""

    fastest: tyro.conf.FlagCreatePairsOff[bool] = False
    """Recommend the shortest motion that does what is asked, in place of the one with the least input."""

    timestep: Annotated[float, tyro.conf.arg(metavar="SECONDS")] = 1e-3
    """Largest physics step."""

    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder for the page, the program, the numbers and the recording of what is recommended."""

    def execute(self) -> int:
        """Print the advice; 0, or 1 where there is no recommendation."""
        plant = self.plant()
        options: dict[str, Any] = {
            "error": share("--error", self.error),
            "limits": self.limits(plant),
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
        if self.quiet:
            found = advise(plant, given, **options)
        else:
            with progress(f"methods for {plant.name}") as report:
                found = advise(plant, given, **options, progress=report)
        self._show(replace(found, source=self._source(plant), command=self._command(found.recommended)))
        return 0 if found.recommended is not None else 1

    def _show(self, advice: Advice) -> None:
        if self.json:
            print(json.dumps(advice.as_dict(), indent=2, allow_nan=False))
        elif not self.quiet:
            advice.show()
        if self.out is not None:
            self.out.mkdir(parents=True, exist_ok=True)
            write_report(advice, self.out / PAGE)
            if advice.recommended is not None:
                from invtrack.recording import save_recording  # loads Rerun

                save_recording(advice.recommended.run, self.out / RECORDING, application="invtrack advise")
            for name, text in ((ADVICE, json.dumps(advice.as_dict(), indent=2, allow_nan=False)), (PROGRAM, advice.program)):
                with replaced_when_complete(self.out / name) as draft:
                    draft.write_text(text + "\n", encoding="utf-8")

    def _parameter_errors(self) -> float | dict[str, float]:
        alone = [text for text in self.parameter_error if "=" not in text]
        if alone and len(self.parameter_error) > 1:
            raise InvtrackError("--parameter-error: expected one share for all, or PATH=SHARE for each, got both")
        if alone:
            return share("--parameter-error", alone[0])
        pairs = (text.rpartition("=") for text in self.parameter_error)
        return {path.strip(): share("--parameter-error", value) for path, _, value in pairs}

    def _command(self, trial: Trial | None) -> str:
        """The `invtrack run` of a trial; "" where it has no such method."""
        if trial is None or trial.method not in METHODS:
            return ""
        method, nonlinear = METHODS[trial.method]
        repeated = {"-u": self.input, "-y": self.output, "--trim": self.trim, "--set": self.set, "--drop": self.drop}
        words = [
            "invtrack",
            "run",
            self.mechanism,
            *(word for option, values in repeated.items() for v in values for word in (option, v)),
        ]
        words += [] if self.keyframe is None else ["--keyframe", self.keyframe]
        if self.reference is None:
            words += [*(word for distance in self.move for word in ("--move", f"{distance!r}")), "--in", f"{trial.duration!r}"]
            words += ["--smoothness", str(trial.smoothness)]
        else:
            words += ["--reference", str(self.reference)]
        words += ["--method", method, *(["--nonlinear"] if nonlinear else []), "--error", self.error]
        if trial.gives_up is not None:
            words += ["--give-up", f"{trial.gives_up * share('--error', self.error):.6g}"]
        words += [word for limit in self.limit for word in ("--limit", limit)]
        return shlex.join([*words, "--timestep", f"{self.timestep!r}"])

    def _source(self, plant: Plant) -> tuple[str, ...]:
        """Lines of Python that make the plant, and a reference from a file."""
        options: dict[str, Any] = {"inputs": list(plant.inputs.names), "outputs": list(self.output)}
        options |= {} if self.keyframe is None else {"keyframe": self.keyframe}
        options |= {"drop_states": list(self.drop)} if self.drop else {}
        options |= {"parameters": list(self.values)} if self.set else {}
        lines = [Line("plant", "invtrack.Plant.from_xml", [str(self.source)], options)]
        if self.set:
            lines.append(Line("plant", "invtrack.plant.with_parameter_values", [Name("plant"), self.values]))
        if self.trim:
            lines.append(Line("plant", "invtrack.trim", [Name("plant")], {"outputs": self.trimmed}))
        if self.reference is not None:
            lines.append(Line("reference", "invtrack.load_reference", [str(self.reference)], {"channels": Name("plant.outputs")}))
        return tuple(line.text + (".plant" if line.call == "invtrack.trim" else "") for line in lines)
