"""Plans that look only a little ahead: what the error of a loop around them is over how far they look, in MuJoCo.

The exact inverse acts ahead of the motion, for as long as the slowest unstable zero asks. Here the reference becomes known only a
while ahead: each plan is made of updates that see no further, the feedback takes in what they bring. The cantilever's tip moves
through jumps of its mass, the tip of an elastic beam aside, the helicopter steps aside and descends, the two-disc rig turns under
the quadratic redesign, whose error is counted from the redesign that knows everything. Beside each error stands its bound, worked
out from the model and the gains alone, for all references with derivatives as large: its rate is that of the slowest zero ahead, of
a redesign its slowest closed-loop pole. Claim tested: Q. Zou, S. Devasia, "Preview-based stable-inversion for output tracking of
linear systems" (1999), carried over to jumps of the plant and to the redesign.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Annotated, Any

import numpy as np
import tyro
from hover.aircraft import helicopter, sidestep_and_descent
from two_disc.rig import WEIGHTS, rig, slew

import invtrack
from invtrack import preview
from invtrack.figures import sweep_figure, tracking_figure
from invtrack.mechanisms import Beam
from invtrack.studies import Case, Column, Rows, Session, Setup, Study, StudyOptions, Table

MASSES = (0.0, 100.0, 10.0)  # [kg]
JUMPS = (np.pi / 2, 3 * np.pi / 2)  # [s]
TOLERANCE = 1e-8
SWEEP = "_over_preview"

COLUMNS = (
    Column("measured", "of motion"),
    Column("bound", "of motion"),
    Column("share of bound", "1"),
    Column("rate", "1/s"),
    Column("constant", "of motion"),
    Column("peak input", "of complete"),
)


@dataclass(frozen=True, eq=False)
class Machine:
    """A mechanism, its motion, and plans for it that look a stated time ahead.

    Args:
        plant, model, gains: in MuJoCo, linear, and of the loop.
        reference: the wanted motion.
        output: the one whose error is shown.
        previews: how far ahead [s].
        period: between updates [s].
        planner, plan: made for a preview and a period; of the inverse unless stated.
        completely: makes the plan that knows everything.
        bound: of a planner.
        exact: whether the plan's output is to be the wanted one, and not that of the complete plan.
        settings: of its runs, in place of the study's.
    """

    plant: invtrack.Plant
    model: Any
    gains: invtrack.GainSchedule
    reference: invtrack.PiecewiseSignal
    output: int
    previews: tuple[float, ...]
    period: float
    planner: Callable[..., preview.PreviewPlanner] = preview.inversion_planner
    plan: Callable[..., invtrack.Plan] = preview.preview_inversion
    completely: Callable[..., invtrack.Plan] = invtrack.invert
    exact: bool = True
    settings: Mapping[str, Any] = field(default_factory=dict)

    @cached_property
    def complete(self) -> invtrack.Plan:
        """The plan that knows everything."""
        return self.completely(self.model, self.reference, tolerance=TOLERANCE)

    def controller(self, ahead: float) -> invtrack.TrackingController:
        """Around the plan that looks `ahead` [s]."""
        plan = self.plan(self.model, self.reference, preview=ahead, period=self.period, tolerance=TOLERANCE)
        return invtrack.TrackingController(plan, self.gains)

    def row(self, ahead: float, done: Session) -> dict[str, float]:
        """Measured in MuJoCo, and the bound, as shares of the motion."""
        name = f"{self.plant.name} {ahead:g} s ahead"
        run = done.simulate(self.plant, self.controller(ahead), name=name, evaluate="stages", **self.settings)
        planner = self.planner(self.model, preview=ahead, period=self.period)
        bound = preview.preview_bound(planner, self.gains if self.exact else None)
        motion, i = float(np.ptp(run.reference.values[:, self.output])), self.output
        wanted = run.reference.values if self.exact else self.complete(run.time).y
        measured, most = float(np.max(np.abs(run.output.values - wanted)[:, i])), float(bound.of(self.reference)[i])
        inputs = run.applied.values - self.complete.rest_inputs[0]
        low, high = self.complete.input_range
        complete = np.max(np.abs(np.array([low, high]) - self.complete.rest_inputs[0]), axis=0)
        return {
            "preview": ahead,
            "measured": measured / motion,
            "bound": most / motion,
            "share_of_bound": measured / most,
            "rate": bound.alpha,
            "constant": most / motion * float(np.exp(bound.alpha * ahead)),
            "peak_input": float(np.max(np.abs(inputs) / complete)),
        }


@dataclass(frozen=True, kw_only=True)
class PreviewOptions(StudyOptions):
    """Options of the study."""

    ahead: Annotated[tuple[float, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="S")] = ()
    """Look so many seconds ahead; may be given several times. Times of each machine's own unless given."""


def build(options: PreviewOptions) -> Setup:
    machines = {"cantilever": cantilever(), "beam": beam(), "helicopter": hovering(), "two_disc_redesign": two_disc()}
    return Setup(
        [
            Case(
                name,
                machine.plant,
                partial(machine.controller, machine.previews[1]),
                settings={"evaluate": "stages", **machine.settings},
                figures={"tracking": tracking_figure},
            )
            for name, machine in machines.items()
        ],
        sweeps={
            f"{name}{SWEEP}": {f"{ahead:g} s": partial(machine.row, ahead) for ahead in options.ahead or machine.previews}
            for name, machine in machines.items()
        },
        figures={f"{name}{SWEEP}": partial(_figure, name) for name in machines},
        report=[
            *(
                Table(f"{name}: largest error over preview, in MuJoCo", COLUMNS, partial(_rows, name), "preview")
                for name in machines
            ),
            "bound: for every reference whose derivatives are as large as this one's; it falls as constant exp(-rate preview).\n"
            "two_disc_redesign: against the redesign that knows the whole reference. peak input: of the plan that knows it.",
        ],
    )


def cantilever() -> Machine:
    """The tip moves 2 units and back while its mass jumps; the slowest unstable zero is 0.2345 rad/s."""
    plant = invtrack.Plant.from_xml(
        invtrack.model_path("cantilever"),
        inputs=["base_force"],
        outputs=["tip_position"],
        parameters={"tip_mass": "body:tip:mass"},
    )
    model = invtrack.SwitchedSystem([invtrack.linearize(plant, tip_mass=mass) for mass in MASSES], JUMPS)
    reference = invtrack.raised_cosine(2.0)
    return Machine(
        plant=plant,
        model=model,
        gains=invtrack.lqr(model, Q=100.0, R=0.01),
        reference=reference,
        output=0,
        previews=(2.0, 8.0, 16.0, 32.0, 48.0),
        period=0.25,
    )


def beam() -> Machine:
    """The tip of a beam of three segments moves 0.3 m aside; the slowest unstable zero is 26.7 rad/s."""
    mechanism = Beam(segments=3)
    plant = invtrack.Plant.from_xml(mechanism.mjcf(), inputs=["force"], outputs=[mechanism.tip_output])
    model = invtrack.linearize(plant)
    return Machine(
        plant=plant,
        model=model,
        gains=invtrack.lqr(model, Q=100.0, R=0.01),
        reference=invtrack.rest_to_rest(0.0, 0.3, duration=1.0),
        output=0,
        previews=(0.05, 0.1, 0.2, 0.3, 0.4),
        period=0.01,
        settings={"timestep": 1e-3},  # its fastest zero is 640 rad/s
    )


def hovering() -> Machine:
    """A sidestep and descent of the helicopter HE3; unstable zeros 0.0465 +- 4.37j; shown is the sideways speed."""
    plant, reference = helicopter(), sidestep_and_descent()
    model = invtrack.linearize(plant)
    return Machine(
        plant=plant,
        model=model,
        gains=invtrack.lqr(model, Q=1.0, R=1.0),
        reference=reference,
        output=2,
        previews=(2.0, 10.0, 20.0, 40.0, 80.0),
        period=0.25,
    )


def two_disc() -> Machine:
    """A slew of the rig with the papers' weights; the slowest pole of the optimal loop is 0.22 rad/s from the axis."""
    plant, reference = rig(), slew(5.0, "quintic")
    model = invtrack.linearize(plant)
    return Machine(
        plant=plant,
        model=model,
        gains=invtrack.lqr(model, Q=1.0, R=1.0),
        reference=reference,
        output=0,
        previews=(2.0, 5.0, 10.0, 20.0, 40.0),
        period=0.25,
        planner=partial(preview.redesign_planner, **WEIGHTS),
        plan=partial(preview.preview_redesign, **WEIGHTS),
        completely=partial(invtrack.quadratic_redesign, **WEIGHTS),
        exact=False,
    )


def _rows(name: str, done: Session) -> Rows:
    return {f"{row['preview']:g} s": row for row in done.section(f"{name}{SWEEP}")}


def _figure(name: str, done: Session) -> Any:
    rows = done.section(f"{name}{SWEEP}")
    return sweep_figure(
        f"{name}: largest error over preview",
        label="preview [s]",
        values=[row["preview"] for row in rows],
        predicted={"bound for all references": [row["bound"] for row in rows]},
        measured={"this motion": [row["measured"] for row in rows]},
        quantity="largest error [share of the motion]",
        logarithmic=True,
    )


STUDY = Study("preview", build, description=__doc__, defaults=PreviewOptions(timestep=5e-3))

if __name__ == "__main__":
    STUDY.main()
