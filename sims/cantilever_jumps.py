"""Exact tracking through tip-mass jumps, in MuJoCo.

The tip of a flexible cantilever moves 2 units and back while its tip mass jumps 0 -> 100 -> 10 in mid-motion. One case drives it
with the inverse that knows the jumps; the others show what each ingredient is worth. Claim tested: Devasia, Paden, Rossi,
"Exact-output tracking theory for systems with parameter jumps" (1996), section 5, here from rest instead of from the paper's
initial state.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

import invtrack
from invtrack.figures import comparison_figure, preactuation_figure, tracking_figure
from invtrack.studies import Case, Column, Session, Setup, Study, StudyOptions, Table

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


def build(options: StudyOptions) -> Setup:
    plant = invtrack.Plant.from_xml(
        invtrack.model_path("cantilever"),
        inputs=["base_force"],
        outputs=["tip_position"],
        parameters={"tip_mass": "body:tip:mass"},
    )
    model = invtrack.SwitchedSystem([invtrack.linearize(plant, tip_mass=mass) for mass in MASSES], JUMPS)
    plan = invtrack.invert(model, invtrack.raised_cosine(2.0), tolerance=1e-11)
    cases = _cases(plant, model, plan, options.timestep)
    return Setup(
        cases,
        sections={"plan": _plan_numbers(plan), "error_slope": partial(_error_slope, cases[0], options.timestep)},
        figures={
            "preactuation": lambda done: preactuation_figure(done["inversion"]),
            "comparison": lambda done: comparison_figure(done.among(), window=(-10.0, 20.0)),
        },
        report=[
            Table("Cantilever with tip-mass jumps, tracking from rest in MuJoCo", COLUMNS),
            _explanation(plan),
            lambda done: _slope_text(done.section("error_slope")),
        ],
    )


def _cases(plant: invtrack.Plant, model: invtrack.SwitchedSystem, plan: invtrack.Plan, timestep: float) -> list[Case]:
    gains = invtrack.lqr(model, Q=100.0, R=0.01)
    exact = invtrack.TrackingController(plan, gains)
    for_the_hold = invtrack.invert(model, plan.reference, hold=timestep, tolerance=plan.tolerance)
    frozen = invtrack.TrackingController(invtrack.invert(model.systems[0], plan.reference, tolerance=plan.tolerance), gains)
    static = invtrack.TrackingController(invtrack.inversion.steady_state_feedforward(model, plan.reference), gains)

    def case(name: str, controller: invtrack.TrackingController, **settings: Any) -> Case:
        return Case(name, plant, controller, settings=settings, numbers=_numbers, figures={"tracking": tracking_figure})

    return [
        case("inversion", exact),
        case("inversion_for_the_hold", invtrack.TrackingController(for_the_hold, gains)),
        case("inversion_continuous", exact, evaluate="stages"),
        case("feedforward_only", invtrack.TrackingController(plan)),
        case("feedback_only", static),
        case("frozen_inversion", frozen, schedule=_schedule(), vibration_period=_vibration_period(plant, MASSES[-1])),
        case("payload_error", exact, schedule=_schedule(factor=1.05), vibration_period=_vibration_period(plant, 1.05 * MASSES[-1])),
        case("late_switch", exact, schedule=_schedule(delay=0.05)),
    ]


def _schedule(*, factor: float = 1.0, delay: float = 0.0) -> list[invtrack.Change]:
    return [invtrack.Change(t + delay, tip_mass=factor * mass) for t, mass in zip(JUMPS, MASSES[1:], strict=True)]


def _vibration_period(plant: invtrack.Plant, mass: float) -> float:
    """That of the plant as it really is at the end, where the plan's model is another one."""
    return invtrack.linear.slowest_flexible_period(invtrack.linearize(plant, tip_mass=mass))


def _numbers(run: invtrack.RunResult) -> dict[str, Any]:
    """Metrics of one case; vibrations of the flexible coordinates are measured against their planned motion."""
    vibration = invtrack.results.state_vibration(run, FLEXIBLE)
    return {
        **invtrack.metrics(run),
        "start": float(run.time[0]),
        **{f"{name}_vibration": value for name, value in vibration.items()},
    }


def _error_slope(case: Case, timestep: float, done: Session) -> list[dict[str, float]]:
    """Largest error of a case with its own step and with two larger ones."""
    runs = [done[case.name]]
    for factor in (2, 4):
        settings = {**case.settings, "timestep": factor * timestep}
        runs.append(done.simulate(case.plant, case.controller, name=f"step x {factor}", **settings))
    return [{"timestep": run.timestep, "max_error": invtrack.max_error(run)} for run in runs]


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


def _explanation(plan: invtrack.Plan) -> str:
    certificate = plan.certificate
    return (
        f"start: the run begins at rest this long before the manoeuvre; the plan is then within {plan.tolerance:.0e} of each\n"
        "peak of rest. preactuation time: how long before the manoeuvre |u| gets above 1 % of its peak. Vibrations: peak to\n"
        "peak over 5 periods of the slowest flexible mode after the manoeuvre; deflection and rotation against their plan.\n"
        f"plan: dynamics residual {certificate.dynamics_residual:.1e}, output error {certificate.output_error:.1e} (relative)."
    )


def _slope_text(points: Sequence[dict[str, float]]) -> str:
    steps, errors = [point["timestep"] for point in points], [point["max_error"] for point in points]
    slopes = [np.log(b / a) / np.log(h_b / h_a) for (h_a, a), (h_b, b) in pairwise(zip(steps, errors, strict=True))]
    return (
        "error of the inversion case over the step: "
        + ", ".join(f"{error:.2e} m at {1e3 * step:g} ms" for step, error in zip(steps, errors, strict=True))
        + f" (slope {', '.join(f'{slope:.2f}' for slope in slopes)})"
    )


STUDY = Study("cantilever_jumps", build, description=__doc__, defaults=StudyOptions(timestep=1e-3))

if __name__ == "__main__":
    STUDY.main()
