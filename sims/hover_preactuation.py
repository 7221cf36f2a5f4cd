"""A minute of preactuation traded for a little tracking error: a helicopter in hover steps aside and down, in MuJoCo.

Exact inversion of a plant with zeros just right of the imaginary axis acts long before the manoeuvre. Moving these zeros away from
the axis shortens that and gives up exactness. Both plans, one metre to the right and one down in 5 s while forward speed and yaw
rate stay zero, are driven closed-loop (feedforward and LQR state feedback), on the linear model and as a free rigid body in MuJoCo.
Claim tested: Devasia, "Output tracking for systems with non-hyperbolic and near non-hyperbolic internal dynamics: helicopter hover
control" (1996): about 30 s of preactuation become 1 s, with similar inputs and attitudes. The helicopter here is HE3 of COMPleib,
the same aircraft in the same states and inputs, not the paper's plant, whose matrix A is lost: the paper's zero pair is
0.0425 +- 4.3055j, HE3's is 0.0465 +- 4.3692j, and HE3 has a stable pair beside it, -0.0543 +- 2.2753j, that rings for a minute
after the manoeuvre.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from hover.aircraft import LINEAR, OUTPUTS, displacement, helicopter, sidestep_and_descent
from hover.comparison import decay_pair, fitted_decay_rate, inverse_poles, likeness
from hover.figures import papers_figures
from hover.report import report_results

import invtrack
from invtrack.figures import preactuation_figure, save_figure
from invtrack.studies.folder import RunFolder
from invtrack.studies.options import SimOptions, run_sim
from invtrack.studies.progress import progress

MOVED_TO = 2.0  # [1/s], the paper's
ERROR_POLES = (-1.0, -2.0, -3.0, -4.0)  # [1/s], the paper's, one for the error of each output
TOLERANCE = 1e-6  # of the plans: at rest to within this share of each peak when they start
AFTER = 120.0  # [s] simulated after the manoeuvre, while the stable pair of zeros rings down


def main(options: SimOptions) -> None:
    folder = RunFolder(options.out)
    plant = helicopter()
    model = invtrack.linearize(plant)
    plans = _plans(model)
    runs = _runs(plant, model, plans, options.timestep)
    cases = {run.name: _numbers(run, plans[run.name.removesuffix(LINEAR)]) for run in runs}
    bounds = {name: invtrack.plans.preactuation_bound(plan) for name, plan in plans.items()}
    alike = likeness(plans["exact"], plans["modified"])
    report_results(plans, bounds, cases, alike)
    for run in runs:
        invtrack.save_recording(run.thinned(options.record_every), folder.file(f"{run.name}.rrd"))
    if options.figures:
        _draw(plans, runs, folder)
    folder.write_summary(
        sim="hover_preactuation",
        model=plant.name,
        timestep=options.timestep,
        cases=cases,
        helicopter="HE3 of COMPleib, not the paper's plant",
        zeros=_pairs(inverse_poles(plans["exact"])),
        zeros_modified=_pairs(inverse_poles(plans["modified"])),
        bound={name: {"alpha": bound.alpha, "M": bound.M, "t_0": bound.t_0} for name, bound in bounds.items()},
        likeness=alike,
        modification={
            "design": plans["modified"].design,
            "integral_square_error": {entry.name: entry.integral_square_error for entry in plans["modified"].candidates},
        },
    )
    print(f"written to {folder.path}: summary.json, recordings (.rrd)" + (", figures (.png)" if options.figures else ""))


def _plans(model: invtrack.StateSpace) -> dict[str, Any]:
    reference = sidestep_and_descent()
    exact = invtrack.invert(model, reference, tolerance=TOLERANCE)
    pair = decay_pair(exact)
    modified = invtrack.modified_inversion(
        model, reference, move={pair: complex(MOVED_TO, pair.imag)}, error_poles=ERROR_POLES, tolerance=TOLERANCE
    )
    return {"exact": exact, "modified": modified}


def _runs(
    plant: invtrack.Plant, model: invtrack.StateSpace, plans: Mapping[str, invtrack.Plan], timestep: float
) -> list[invtrack.RunResult]:
    """Every plan in MuJoCo and on the linear model, the input evaluated at the stages of RK4: what is left is physics."""
    gains = invtrack.lqr(model, Q=1.0, R=1.0)
    runs = []
    for name, plan in plans.items():
        controller = invtrack.TrackingController(plan, gains)
        for suffix, mechanism in (("", plant), (LINEAR, invtrack.LinearPlant(model, input_limits=plant.input_limits))):
            with progress(name + suffix) as report:
                run = invtrack.simulate(
                    mechanism,
                    controller,
                    timestep=timestep,
                    end=plan.manoeuvre[1] + AFTER,
                    evaluate="stages",
                    name=name + suffix,
                    progress=report,
                )
            if run.status == "diverged":
                raise invtrack.InvtrackError(f"case {run.name!r} diverged ({run.message}); take a smaller --timestep")
            runs.append(run)
    return runs


def _numbers(run: invtrack.RunResult, plan: invtrack.Plan) -> dict[str, Any]:
    """Metrics of one case, with what the plan predicts of it."""
    predicted = run.planned_output.values - run.reference.values
    numbers: dict[str, Any] = {
        **invtrack.metrics(run),
        "predicted_max_error": float(np.max(np.abs(predicted))),
        "difference_from_prediction": invtrack.max_error(run, wanted="planned_output"),
        "first_above_1_percent": invtrack.results.preactuation_time(plan, level=0.01),
        "alpha": decay_pair(plan).real,
        "fitted_decay_rate": fitted_decay_rate(run, decay_pair(plan)),
        "start": float(run.time[0]),
        "status": run.status,
        "max_errors": dict(zip(OUTPUTS, np.max(np.abs(run.error), axis=0).tolist(), strict=True)),
    }
    return numbers | ({"displacement": displacement(run)} if run.qpos.size else {})


def _pairs(values: np.ndarray) -> list[list[float]]:
    return [[float(value.real), float(value.imag)] for value in values]


def _draw(plans: Mapping[str, invtrack.Plan], runs: Sequence[invtrack.RunResult], folder: RunFolder) -> None:
    in_mujoco = {run.name: run for run in runs if not run.name.endswith(LINEAR)}
    figures = papers_figures(plans, in_mujoco)
    for name, run in in_mujoco.items():
        figures[f"preactuation_{name}"] = preactuation_figure(run)
    for name, figure in figures.items():
        save_figure(figure, folder.file(f"{name}.png"))


if __name__ == "__main__":
    run_sim(main, defaults=SimOptions(out=Path("runs/hover_preactuation"), timestep=1e-2), description=__doc__ or "")
