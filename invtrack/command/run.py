"""`invtrack run`: plan a motion, drive it in MuJoCo, and keep table, figures and recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from invtrack.advice.trial import limits_exceeded
from invtrack.command.mechanism import assignment
from invtrack.command.motion import seconds
from invtrack.command.planning import Planned, Planning
from invtrack.control import KalmanFilter, OutputFeedbackController, TrackingController
from invtrack.control.protocol import Controller
from invtrack.figures import tracking_figure
from invtrack.plant import Change
from invtrack.results import RunResult, metrics
from invtrack.simulation import Sensor
from invtrack.studies import Case, Column, Session, Setup, Study, StudyOptions, Table

BEGINNING = -1e9
"""A time before every run [s]."""

INPUT_NOISE = 0.01
"""Share of the input that the motion takes which an observer takes for noise of the input."""


@dataclass(frozen=True, kw_only=True)
class Run(Planned, StudyOptions):
    """Move a mechanism along a trajectory: plan it, drive it in MuJoCo under feedback, and keep what happened."""

    surprise: Annotated[tuple[str, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="PATH=VALUE")] = ()
    """A parameter whose value the plan does not know, from the beginning on."""

    period: Annotated[str | None, tyro.conf.arg(metavar="TIME")] = None
    """Control period, such as 5ms; by default the controller acts in every physics step."""

    noise: Annotated[tuple[str, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="OUTPUT=SIGMA")] = ()
    """Standard deviation of the noise on an output's sensor. With it the controller sees nothing but the outputs, and estimates
    the rest by a Kalman filter."""

    def that_matter(self) -> dict[str, Any]:
        """As every study's, paths as texts."""
        return {name: str(value) if isinstance(value, Path) else value for name, value in super().that_matter().items()}

    def execute(self) -> int:
        """Run it as a study of one case; its status."""
        study = Study(f"run_{Path(self.mechanism).stem}", lambda options: options.setup(), defaults=self)
        summary = study.run(self)
        return 3 if summary["status"] == "diverged" else 0

    def setup(self) -> Setup:
        """The study's only case."""
        unknown = tuple(Change(BEGINNING, **dict([assignment("--surprise", text)])) for text in self.surprise)
        planning = self.planning(unknown)
        plant, settings = planning.plant, dict[str, Any]()
        if unknown:
            values = {name: value for change in unknown for name, value in change.parameters.items()}
            settings["schedule"] = [Change(BEGINNING, **values), *self.changes]
        if self.noise:
            settings["sensors"] = {name: Sensor(noise=size) for name, size in (assignment("--noise", text) for text in self.noise)}

        def numbers(run: RunResult) -> Mapping[str, Any]:
            beyond = limits_exceeded(planning.task, run) if self.limit else []
            return {**metrics(run), **({"limits_exceeded": beyond} if self.limit else {})}

        case = Case(
            self.chosen_method + ("_nonlinear" if self.nonlinear else ""),
            plant,
            lambda: self._controller(planning),
            settings=settings,
            numbers=numbers,
            figures={"tracking": tracking_figure},
        )
        columns = [
            Column("max error", plant.outputs.units[0] if len(set(plant.outputs.units)) == 1 else ""),
            Column("residual vibration"),
            Column("peak input", plant.inputs.units[0] if len(set(plant.inputs.units)) == 1 else ""),
            Column("preactuation time", "s"),
            Column("postactuation time", "s"),
        ]
        title = f"{plant.name}: {', '.join(plant.outputs.names)} by {', '.join(plant.inputs.names)}"
        return Setup([case], report=[Table(title, columns, row_header="method"), *([_limits_kept] if self.limit else [])])

    def _controller(self, planning: Planning) -> Controller:
        plan, gains = planning.plan, planning.gains
        period = None if self.period is None else seconds("--period", self.period)
        if not self.noise:
            return TrackingController(plan, gains, period=period)
        noise = dict(assignment("--noise", text) for text in self.noise)
        sizes = [noise.get(name, min(noise.values())) for name in plan.model.outputs.names]
        kalman = KalmanFilter(input_noise=INPUT_NOISE * float(np.max(planning.task.sizes[1])), measurement_noise=sizes)
        return OutputFeedbackController(plan, gains, kalman, period=self.timestep if period is None else period)


def _limits_kept(session: Session) -> str:
    beyond = [text for case in session.numbers.values() for text in case.get("limits_exceeded", [])]
    return f"limits: {'; '.join(beyond)}" if beyond else "limits: kept by the plan and by all that the controller asked for"
