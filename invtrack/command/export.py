"""`invtrack export`: a plan as a table for hardware that plays it at its own rate, and the gains of the feedback around it."""

from __future__ import annotations

import json
import math
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from invtrack.command.motion import seconds
from invtrack.command.planning import Planned, Planning
from invtrack.command.printed import Printed
from invtrack.control import GainSchedule
from invtrack.errors import FileError, InvtrackError
from invtrack.files import write_table
from invtrack.plans import export_plan
from invtrack.plans.export import Inputs
from invtrack.plans.plan import Plan
from invtrack.studies.folder import SUMMARY
from invtrack.studies.origin import plan_in_words

SAME = 1e-6
"""A plan that is made again is that of a run where its inputs' ranges agree to this share of the largest input."""


@dataclass(frozen=True, kw_only=True)
class Export(Planned, Printed):
    """Write a plan for hardware: time, input, state, wanted and planned output at a period, as a CSV file.

    MODEL.xml with the options of `invtrack run`, or in its place the folder of a run, whose options are taken.
    """

    period: Annotated[str, tyro.conf.arg(metavar="TIME")] = "1ms"
    """Time from one row to the next, such as 5ms."""

    inputs: Inputs = "midpoint"
    """What the input of a row is, for hardware that holds it until the next: midpoint of the hold, or average over it. sample: its
    value at the row's time, for hardware that interpolates."""

    out: Annotated[Path, tyro.conf.arg(metavar="FILE.csv")] = Path("plan.csv")
    """The file."""

    gains: Annotated[Path | None, tyro.conf.arg(metavar="FILE.csv")] = None
    """Where to write the gains K of u = u_ff - K (x - x_ref), too: a row for each stretch of time over which they hold."""

    def execute(self) -> int:
        """Plan, write, and say what was written; 0."""
        rate = 1.0 / seconds("--period", self.period)
        folder = Path(self.mechanism)
        planning = self._of_run(folder) if folder.is_dir() else self.planning()
        plan = planning.plan
        start = math.floor(plan.start * rate) / rate  # so that rows stand at multiples of the period
        files = [export_plan(plan, self.out, rate=rate, inputs=self.inputs, start=start)]
        if self.gains is not None:
            files.append(write_gains(planning.gains, plan, self.gains, start=start))
        if self.json:
            said = {"method": plan.method, "start": start, "end": plan.end, "rate": rate}
            print(json.dumps({**said, "files": [str(path) for path in files]}, indent=2))
        elif not self.quiet:
            print(f"{plan.method} from {start:.6g} s to {plan.end:.6g} s at {rate:.6g} Hz: {', '.join(map(str, files))}")
        return 0

    def _of_run(self, folder: Path) -> Planning:
        """The plan of a run, made again from its options, and compared with what the run recorded."""
        stated = [each.name for each in fields(Planned) if each.default is not MISSING and getattr(self, each.name) != each.default]
        if stated:
            words = ", ".join("--in" if name == "duration" else f"--{name.replace('_', '-')}" for name in stated)
            raise InvtrackError(
                f"{words}: the folder of a run says how its plan was made; leave these options out, or give MODEL.xml"
            )
        options, summary = _options_of(folder)
        planning = options.planning()
        again, *before = (
            np.array(list(plan["input_range"].values()), dtype=float)  # NaN where it is not finite
            for plan in (plan_in_words(planning.plan), *summary["plans"].values())
        )
        size = np.max(np.abs(again), initial=0.0, where=np.isfinite(again))
        if not all(np.allclose(again, known, rtol=0.0, atol=SAME * size, equal_nan=True) for known in before):
            raise InvtrackError(
                f"{folder}: {options.mechanism} no longer makes the plan of that run, so it has changed since; run it again, or "
                "export from the file as it is"
            )
        return planning


def write_gains(gains: GainSchedule, plan: Plan, path: Path, *, start: float) -> Path:
    """Write K (m, n), from a start [s] on: the time from which on it holds, its entries "K.<input>.<state>"; returns the path.

    Raises FileError for another suffix than .csv, and where the file cannot be written.
    """
    if path.suffix.lower() != ".csv":
        raise FileError(f"--gains: expected a file that ends in .csv, got {path.name!r}")
    model = plan.model
    columns = [f"K.{driven}.{state}" for driven in model.inputs.names for state in model.states.names]
    first = int(gains.interval(start))
    times = np.append(start, gains.switch_times[first:])
    comments = ("u = u_ff - K (x - x_ref); each row holds from its time on until the next",)
    write_table(path, ["time [s]", *columns], np.column_stack([times, [K.ravel() for K in gains.gains[first:]]]), comments)
    return path


def _options_of(folder: Path) -> tuple[Planned, dict[str, Any]]:
    """The options with which `invtrack run` made the plan of its run in this folder, and the run's summary."""
    try:
        summary = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
    except (OSError, ValueError) as reason:
        raise FileError(f"{folder}: expected the folder of a run that has ended, with its {SUMMARY}: {reason}") from reason
    names = [each.name for each in fields(Planned)]
    if not isinstance(summary, dict) or not set(names) <= summary.keys():
        raise FileError(
            f"{folder}: expected the folder of `invtrack run`; what other studies plan is known to their own programs alone: take "
            "invtrack.export_plan there"
        )
    options: dict[str, Any] = {name: _as_option(summary[name]) for name in names}
    if options["reference"] is not None:
        options["reference"] = Path(options["reference"])
    return Planned(**options), summary


def _as_option(value: Any) -> Any:
    return tuple(map(_as_option, value)) if isinstance(value, list) else value
