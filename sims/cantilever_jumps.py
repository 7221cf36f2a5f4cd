"""Exact tracking through tip-mass jumps, in MuJoCo.

The tip of a flexible cantilever moves 2 units and back while its tip mass jumps 0 -> 100 -> 10 in mid-motion. One case drives it
with the inverse that knows the jumps; the others show what each ingredient is worth. Claim tested: Devasia, Paden, Rossi,
"Exact-output tracking theory for systems with parameter jumps" (1996), section 5, here from rest instead of from the paper's
initial state.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np

import invtrack
from invtrack.figures import comparison_figure, preactuation_figure, save_figure, tracking_figure
from invtrack.studies.folder import RunFolder
from invtrack.studies.options import SimOptions, run_sim
from invtrack.studies.progress import progress
from invtrack.studies.table import Column, print_table

MASSES = (0.0, 100.0, 10.0)  # [kg]
JUMPS = (np.pi / 2, 3 * np.pi / 2)  # [s]
FLEXIBLE = ("deflection", "rotation")

COLUMNS = (
    Column("max error", "m"),
    Column("start", "s"),
    Column("preactuation time", "s"),
    Column("residual vibration", "m"),
    Column("peak input", "N"),
    Column("rms error", "m"),
    Column("deflection vibration", "m"),
    Column("rotation vibration", "rad"),
)


@dataclass(frozen=True)
class Case:
    """A controller, and the changes of the tip mass that really happen; None: those that its plan knows."""

    name: str
    controller: invtrack.TrackingController
    schedule: Sequence[invtrack.Change] | None = None
    evaluate: Literal["held", "stages"] = "held"


def main(options: SimOptions) -> None:
    folder = RunFolder(options.out)
    plant = invtrack.Plant.from_xml(
        invtrack.model_path("cantilever"),
        inputs=["base_force"],
        outputs=["tip_position"],
        parameters={"tip_mass": invtrack.BodyMass("tip", inertia="fixed")},
    )
    model = invtrack.SwitchedSystem([invtrack.linearize(plant, tip_mass=mass) for mass in MASSES], JUMPS)
    reference = invtrack.raised_cosine(2.0)
    plan = invtrack.invert(model, reference, tolerance=1e-11)
    runs = [_run(plant, case, options.timestep) for case in _cases(model, reference, plan)]
    slope_runs = [
        _run(plant, _cases(model, reference, plan)[0], factor * options.timestep, f"error slope, step x {factor}")
        for factor in (2, 4)
    ]
    cases = {run.name: _numbers(run) for run in runs}
    _report(plan, cases, [runs[0], *slope_runs])
    for run in runs:
        invtrack.save_recording(run.thinned(options.record_every), folder.file(f"{run.name}.rrd"))
    if options.figures:
        _draw(runs, folder)
    folder.write_summary(
        sim="cantilever_jumps",
        model=plant.name,
        timestep=options.timestep,
        cases=cases,
        plan=_plan_numbers(plan),
        error_slope=[{"timestep": run.timestep, "max_error": invtrack.max_error(run)} for run in (runs[0], *slope_runs)],
    )
    print(
        f"written to {folder.path}: summary.json, a recording (.rrd) of each case" + (", figures (.png)" if options.figures else "")
    )


def _cases(model: invtrack.SwitchedSystem, reference: invtrack.PiecewiseSignal, plan: invtrack.Plan) -> list[Case]:
    gains = invtrack.lqr(model, Q=100.0, R=0.01)
    exact = invtrack.TrackingController(plan, gains)
    frozen = invtrack.TrackingController(invtrack.invert(model.systems[0], reference, tolerance=plan.tolerance), gains)
    static = invtrack.TrackingController(invtrack.inversion.steady_state_feedforward(model, reference), gains)
    return [
        Case("inversion", exact),
        Case("inversion_continuous", exact, evaluate="stages"),
        Case("feedforward_only", invtrack.TrackingController(plan)),
        Case("feedback_only", static),
        Case("frozen_inversion", frozen, _schedule()),
        Case("payload_error", exact, _schedule(factor=1.05)),
        Case("late_switch", exact, _schedule(delay=0.05)),
    ]


def _schedule(*, factor: float = 1.0, delay: float = 0.0) -> list[invtrack.Change]:
    return [invtrack.Change(t + delay, tip_mass=factor * mass) for t, mass in zip(JUMPS, MASSES[1:], strict=True)]


def _run(plant: invtrack.Plant, case: Case, timestep: float, description: str | None = None) -> invtrack.RunResult:
    with progress(description or case.name) as report:
        return invtrack.simulate(
            plant,
            case.controller,
            schedule=case.schedule,
            timestep=timestep,
            evaluate=case.evaluate,
            name=case.name,
            progress=report,
        )


def _numbers(run: invtrack.RunResult) -> dict[str, Any]:
    """Metrics of one case; vibrations of the flexible coordinates are measured against their planned motion."""
    numbers: dict[str, Any] = {**invtrack.metrics(run), "start": float(run.time[0]), "status": run.status}
    completed = run.status == "completed"
    vibration = invtrack.results.state_vibration(run, FLEXIBLE) if completed else dict.fromkeys(FLEXIBLE)
    numbers.update({f"{name}_vibration": value for name, value in vibration.items()})
    return numbers


def _plan_numbers(plan: invtrack.Plan) -> dict[str, Any]:
    certificate = plan.certificate
    return {
        "zeros": [[zero.real, zero.imag] for zero in invtrack.linear.zeros(plan.model.systems[0])],
        "preactuation": plan.preactuation,
        "postactuation": plan.postactuation,
        "tolerance": plan.tolerance,
        "dynamics_residual": certificate.dynamics_residual,
        "output_error": certificate.output_error,
        "continuity": certificate.continuity,
        "rest_residual": certificate.rest_residual,
        "state_at_start_of_manoeuvre": plan(plan.manoeuvre[0]).x[0],
    }


def _report(plan: invtrack.Plan, cases: dict[str, dict[str, Any]], slope_runs: Sequence[invtrack.RunResult]) -> None:
    print_table("Cantilever with tip-mass jumps, tracking from rest in MuJoCo", columns=COLUMNS, rows=cases)
    certificate = plan.certificate
    print(
        f"start: the run begins at rest this long before the manoeuvre; the plan is then within {plan.tolerance:.0e} of each\n"
        "peak of rest. preactuation time: how long |u| stays above 1 % of its peak before the manoeuvre. Vibrations: peak to\n"
        "peak over 5 periods of the slowest flexible mode after the manoeuvre; deflection and rotation against their plan.\n"
        f"plan: dynamics residual {certificate.dynamics_residual:.1e}, output error {certificate.output_error:.1e} (relative)."
    )
    steps, errors = zip(*((run.timestep, invtrack.max_error(run)) for run in slope_runs), strict=True)
    slopes = [np.log(b[1] / a[1]) / np.log(b[0] / a[0]) for a, b in pairwise(zip(steps, errors, strict=True))]
    print(
        "error of the inversion case over the step: "
        + ", ".join(f"{error:.2e} m at {1e3 * step:g} ms" for step, error in zip(steps, errors, strict=True))
        + f" (slope {', '.join(f'{slope:.2f}' for slope in slopes)})"
    )


def _draw(runs: Sequence[invtrack.RunResult], folder: RunFolder) -> None:
    for run in runs:
        save_figure(tracking_figure(run), folder.file(f"tracking_{run.name}.png"))
    save_figure(preactuation_figure(runs[0]), folder.file("preactuation.png"))
    save_figure(comparison_figure(runs, window=(-10.0, 20.0)), folder.file("comparison.png"))


if __name__ == "__main__":
    run_sim(main, defaults=SimOptions(out=Path("runs/cantilever_jumps"), timestep=1e-3), description=__doc__ or "")
