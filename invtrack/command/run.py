"""`invtrack run`: plan a motion, drive it in MuJoCo, and keep table, figures and recording."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tyro

from invtrack.arrays import Array
from invtrack.command.mechanism import assignment
from invtrack.command.motion import Motion, seconds
from invtrack.control import KalmanFilter, OutputFeedbackController, TrackingController, bryson, lqr
from invtrack.control.protocol import Controller
from invtrack.figures import tracking_figure
from invtrack.inversion import invert, modified_inversion, steady_state_feedforward
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.plan import Plan
from invtrack.plant import Change, Plant, linearize
from invtrack.redesign import Limits, constrained_redesign, quadratic_redesign
from invtrack.references import PiecewiseSignal, load_reference, rest_to_rest, stack
from invtrack.simulation import Sensor
from invtrack.studies import Case, Column, Setup, Study, Table

Method = Literal["exact", "nonlinear", "modified", "redesign", "limited", "feedback"]

BEGINNING = -1e9
"""A time before every run [s]."""

SHARE = 0.01
"""Share of the motion that feedback is to take for as large a deviation as the plan's largest input, and the largest state."""


@dataclass(frozen=True, kw_only=True)
class Run(Motion):
    """Move a mechanism along a trajectory: plan it, drive it in MuJoCo under feedback, and keep what happened."""

    smoothness: int | None = None
    """How many derivatives of the motion vanish at its ends; by default two more than exact tracking needs."""

    method: Method = "exact"
    """exact: the inverse of the linear model; nonlinear: that of the mechanism's own motion; modified: zeros near the axis moved,
    for less preactuation; redesign: less input for a little of the motion; limited: within the actuators' ranges; feedback: none
    of these, feedback alone."""

    change: Annotated[tuple[tuple[float, str], ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="SECONDS PATH=VALUE")] = ()
    """A parameter that changes on the way, known to the plan, as in --change 1.5 body:tip:mass=3; may be given several times."""

    surprise: Annotated[tuple[str, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="PATH=VALUE")] = ()
    """A parameter whose value the plan does not know, from the beginning on."""

    period: Annotated[str | None, tyro.conf.arg(metavar="TIME")] = None
    """Control period, such as 5ms; by default the controller acts in every physics step."""

    noise: Annotated[tuple[str, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="OUTPUT=SIGMA")] = ()
    """Standard deviation of the noise on an output's sensor. With it the controller sees nothing but the outputs, and estimates
    the rest by a Kalman filter."""

    def execute(self) -> int:
        """Run it as a study of one case; its status."""
        study = Study(f"run_{Path(self.mechanism).stem}", lambda options: options.setup(), defaults=self)
        summary = study.run(self)
        return 3 if summary["status"] == "diverged" else 0

    def setup(self) -> Setup:
        """The study's only case."""
        changes = [Change(time, **dict([assignment("--change", text)])) for time, text in self.change]
        unknown = [Change(BEGINNING + i, **dict([assignment("--surprise", text)])) for i, text in enumerate(self.surprise, start=1)]
        plant = self.plant([*changes, *unknown])
        model = self._model(plant, changes)
        reference = self._reference(plant, model)
        settings: dict[str, Any] = {}
        if unknown:
            settings["schedule"] = [*([Change(BEGINNING, **self.values)] if self.values else []), *unknown, *changes]
        if self.noise:
            settings["sensors"] = {name: Sensor(noise=size) for name, size in (assignment("--noise", text) for text in self.noise)}
        case = Case(
            self.method,
            plant,
            lambda: self._controller(self._plan(plant, model, reference, changes), model),
            settings=settings,
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
        return Setup([case], report=[Table(title, columns, row_header="method")])

    def _model(self, plant: Plant, changes: list[Change]) -> SwitchedSystem:
        values, models = self.values, []
        models.append(linearize(plant, **values))
        for change in sorted(changes, key=lambda change: change.time):
            values = {**values, **change.parameters}
            models.append(linearize(plant, **values))
        return SwitchedSystem(models, sorted(change.time for change in changes))

    def _reference(self, plant: Plant, model: SwitchedSystem) -> PiecewiseSignal:
        if self.reference is not None:
            return load_reference(self.reference, channels=plant.outputs)
        distances = self.distances(plant)
        smoothness = self._smoothness(model)
        starts = plant.operating_point.y0
        return stack(
            [
                rest_to_rest(y, y + distance, duration=self.duration, smoothness=smoothness)
                for y, distance in zip(starts.tolist(), distances, strict=True)
            ]
        )

    def _smoothness(self, model: SwitchedSystem) -> int:
        if self.smoothness is not None:
            return self.smoothness
        from invtrack.linear.zeros import zero_report

        return 2 + max(max(zero_report(system).derivatives, default=1) for system in model.distinct)

    def _plan(self, plant: Plant, model: SwitchedSystem, reference: PiecewiseSignal, changes: list[Change]) -> Plan:
        methods: dict[Method, Callable[[], Plan]] = {
            "exact": lambda: invert(model, reference),
            "nonlinear": lambda: invert(plant, reference, schedule=changes),
            "modified": lambda: modified_inversion(
                model, reference, axis_distance=1.0 / self.duration, real_part=5.0 / self.duration
            ),
            "redesign": lambda: quadratic_redesign(model, reference, R=self._dearness(model, reference), Q_y=1.0),
            "limited": lambda: constrained_redesign(
                model, reference, R=self._dearness(model, reference), Q_y=1.0, limits=Limits(input=tuple(plant.input_limits.T))
            ),
            "feedback": lambda: steady_state_feedforward(model, reference),
        }
        return methods[self.method]()

    def _dearness(self, model: SwitchedSystem, reference: PiecewiseSignal) -> Array:
        """R (m, m) with which the exact inverse's input costs a hundredth of what standing still would."""
        return np.diag(SHARE * (_motion(reference) / _largest_inputs(invert(model, reference))) ** 2)

    def _controller(self, plan: Plan, model: SwitchedSystem) -> Controller:
        deviations = dict(
            zip(model.outputs.names, np.full(len(model.outputs), SHARE * _motion(plan.reference)).tolist(), strict=True)
        )
        inputs = dict(zip(model.inputs.names, _largest_inputs(plan).tolist(), strict=True))
        peaks = dict(zip(model.states.names, plan.trajectory.peaks[: model.n_states].tolist(), strict=True))
        states = {name: peak for name, peak in peaks.items() if peak > 0}  # so that modes which no output shows are seen, too
        Q, R = bryson(model, outputs=deviations, states=states, inputs=inputs)
        gains = lqr(plan if plan.linearizations is not None else model, Q=Q, R=R)
        period = None if self.period is None else seconds("--period", self.period)
        if not self.noise:
            return TrackingController(plan, gains, period=period)
        noise = dict(assignment("--noise", text) for text in self.noise)
        sizes = [noise.get(name, min(noise.values())) for name in model.outputs.names]
        kalman = KalmanFilter(input_noise=SHARE * float(np.max(_largest_inputs(plan))), measurement_noise=sizes)
        return OutputFeedbackController(plan, gains, kalman, period=self.timestep if period is None else period)


def _motion(reference: PiecewiseSignal) -> float:
    times = np.linspace(*reference.manoeuvre, 500)
    return float(np.max(np.ptp(reference(times), axis=0))) or 1.0


def _largest_inputs(plan: Plan) -> Array:
    """How far each input goes from where it rests at the start (m,), 1 where it does not move."""
    low, high = plan.input_range
    rest = np.nan_to_num(plan.rest_inputs[0])
    size = np.maximum(high - rest, rest - low)
    return np.where(size > 1e-9 * np.max(size, initial=0.0), size, np.max(size, initial=0.0) or 1.0)
