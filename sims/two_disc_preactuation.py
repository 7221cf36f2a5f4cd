"""Zeros near the imaginary axis and on it: the two-disc rig where exact inversion starts too early or does not exist, in MuJoCo.

The second disc turns by one radian in 5 s. The identified rig has a zero pair near the axis: its exact inverse starts long before
the slew. Without damping and coupling the pair lies on the axis: exact inversion is refused, and the causal inverse, which starts
with the slew, leaves the discs ringing against each other for ever. Remedies: modified inversion, which moves the pair off the axis
for a little error, and the quadratic redesign of the output. All are driven closed-loop (feedforward and LQR state feedback).
Claim tested: Devasia, "Output tracking for systems with non-hyperbolic and near non-hyperbolic internal dynamics" (1996), on
plants that the paper does not have.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from two_disc.remedies import (
    LEVEL,
    MOVED_TO,
    TOLERANCE,
    both_remedies,
    draw_remedies,
    modified,
    papers_redesign,
    redesign_with_error,
    report_remedies,
)
from two_disc.rig import SLEW, R, peak, rig, run, twist

import invtrack
from invtrack.errors import NonHyperbolicError
from invtrack.figures import comparison_figure, save_figure, tracking_figure
from invtrack.linear import format_zeros
from invtrack.redesign import outcome
from invtrack.studies.folder import RunFolder
from invtrack.studies.options import SimOptions, run_sim
from invtrack.studies.progress import progress
from invtrack.studies.table import Column, print_table

DURATION = 5.0  # [s]
AT_THE_END = 5.0  # [s] of the run in which what is left is looked at
WINDOW = (-25.0, 30.0)  # [s] of the comparison

COLUMNS = (
    Column("preactuation", "s", "first_above_1_percent"),
    Column("max error", "rad"),
    Column("predicted max error", "rad"),
    Column("final error", "rad"),
    Column("peak input", "1"),
    Column("input left", "1"),
    Column("twist left", "rad"),
    Column("start", "s"),
)


def main(options: SimOptions) -> None:
    folder = RunFolder(options.out)
    reference = invtrack.rest_to_rest(0.0, SLEW, DURATION)
    plants = {"identified": rig(), "passive": passive_rig()}
    models = {name: invtrack.linearize(plant) for name, plant in plants.items()}
    plans, q_y = _plans(models, reference)
    runs = [_run(plants[_rig_of(name)], models[_rig_of(name)], plan, name, options.timestep) for name, plan in plans.items()]
    cases = {"passive_exact": _refused(models["passive"], reference)}
    cases |= {result.name: _numbers(result, plans[result.name]) for result in runs}
    remedies = both_remedies(models["passive"], reference)
    _report(models, cases, plans["passive_causal"].remarks, q_y)
    report_remedies(remedies)
    for result in runs:
        invtrack.save_recording(result.thinned(options.record_every), folder.file(f"{result.name}.rrd"))
    if options.figures:
        _draw(runs, remedies, folder)
    folder.write_summary(
        sim="two_disc_preactuation",
        model=", ".join(plant.name for plant in plants.values()),
        timestep=options.timestep,
        cases=cases,
        zeros={name: _pairs(invtrack.linear.zeros(model)) for name, model in models.items()},
        moved_to=MOVED_TO,
        level=LEVEL,
        redesign_with_the_same_error={"r": R, "q_x": 0.0, "q_y": q_y},
        trade_off=remedies,
    )
    print(f"written to {folder.path}: summary.json, recordings (.rrd)" + (", figures (.png)" if options.figures else ""))


def _plans(
    models: Mapping[str, invtrack.StateSpace], reference: invtrack.PiecewiseSignal
) -> tuple[dict[str, invtrack.Plan], float]:
    """By case, and the q_y of the redesign that gives up as much as modified inversion does."""
    identified, passive = models["identified"], models["passive"]
    mild = modified(passive, reference, MOVED_TO)
    same_error, q_y = redesign_with_error(passive, reference, outcome(mild).max_error)
    plans = {
        "identified_exact": invtrack.invert(identified, reference, tolerance=TOLERANCE),
        "identified_modified": modified(identified, reference, MOVED_TO),
        "passive_modified": mild,
        "passive_causal": invtrack.causal_inverse(passive, reference, tolerance=TOLERANCE),
        "passive_redesigned": papers_redesign(passive, reference),
        "passive_redesigned_same_error": same_error,
    }
    return plans, q_y


def _rig_of(case: str) -> str:
    return case.partition("_")[0]


def passive_rig() -> invtrack.Plant:
    """The rig without damping and velocity coupling."""
    path = invtrack.model_path("two_disc_passive")
    return invtrack.Plant.from_xml(path, inputs=["motor"], outputs=["disc2_angle"], units={"motor": "1"})


def _refused(model: invtrack.StateSpace, reference: invtrack.PiecewiseSignal) -> dict[str, Any]:
    """The case of exact inversion on the axis: no numbers, and the reason why."""
    try:
        invtrack.invert(model, reference)
    except NonHyperbolicError as error:
        return {**dict.fromkeys(column.key for column in COLUMNS), "status": "refused", "reason": str(error)}
    raise invtrack.InvtrackError(
        f"expected exact inversion of the passive rig to be refused, its zeros are {format_zeros(invtrack.linear.zeros(model))}"
    )


def _run(plant: invtrack.Plant, model: invtrack.StateSpace, plan: invtrack.Plan, name: str, timestep: float) -> invtrack.RunResult:
    """In MuJoCo, the input evaluated at the stages of RK4."""
    controller = invtrack.TrackingController(plan, invtrack.lqr(model, Q=1.0, R=1.0))
    with progress(name) as report:
        return run(plant, controller, name, timestep, evaluate="stages", progress=report)


def _numbers(result: invtrack.RunResult, plan: invtrack.Plan) -> dict[str, Any]:
    """Metrics of one case, what its plan predicts, and what is left of error, input and twist at the end of the run."""
    late = result.time >= result.time[-1] - AT_THE_END
    return {
        **invtrack.metrics(result),
        "first_above_1_percent": invtrack.results.preactuation_time(plan, level=LEVEL),
        "predicted_max_error": peak(result.planned_output.values - result.reference.values),
        "final_error": peak(result.error[late]),
        "input_left": peak(result.applied.values[late[:-1]]),
        "twist_left": peak(twist(result.state.values[late])),
        "start": float(result.time[0]),
        "status": result.status,
    }


def _pairs(values: np.ndarray) -> list[list[float]]:
    return [[float(value.real), float(value.imag)] for value in values]


def _report(
    models: Mapping[str, invtrack.StateSpace], cases: Mapping[str, Mapping[str, Any]], remarks: Sequence[str], q_y: float
) -> None:
    for name, model in models.items():
        print(f"{name} rig: zeros {format_zeros(invtrack.linear.zeros(model))} [1/s]")
    print_table(f"Slew by {SLEW:g} rad in {DURATION:g} s, in MuJoCo", columns=COLUMNS, rows=cases)
    print(
        f"preactuation: since the input first exceeds {LEVEL:.0%} of its peak. final error, input left, twist left: the largest\n"
        f"of the run's last {AT_THE_END:g} s. modified: the pair of zeros gets the real part {MOVED_TO:g} 1/s. redesigned: with\n"
        f"the papers' weights r = 1, q_x = 5000, q_y = 1; redesigned_same_error: with q_x = 0 and q_y = {q_y:.3g}, so that it\n"
        "gives up as much as modified does."
    )
    print(f"passive_exact is refused: {cases['passive_exact']['reason']}")
    print(f"passive_causal: {'; '.join(remarks)}\n")


def _draw(runs: Sequence[invtrack.RunResult], remedies: list[dict[str, Any]], folder: RunFolder) -> None:
    figures = {f"tracking_{result.name}": tracking_figure(result, window=(-5.0, 20.0)) for result in runs}
    for family in ("identified", "passive"):
        compared = [result for result in runs if _rig_of(result.name) == family]
        figures[f"comparison_{family}"] = comparison_figure(compared, window=WINDOW)
    title = f"two_disc_passive: what preactuation buys, slew of {DURATION:g} s"
    figures["trade_off"] = draw_remedies(title, remedies)
    for name, figure in figures.items():
        save_figure(figure, folder.file(f"{name}.png"))


if __name__ == "__main__":
    run_sim(main, defaults=SimOptions(out=Path("runs/two_disc_preactuation"), timestep=5e-3), description=__doc__ or "")
