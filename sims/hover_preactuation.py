"""A minute of preactuation traded for a little tracking error: a helicopter in hover steps aside and down, in MuJoCo.

Exact inversion of a plant with zeros just right of the imaginary axis acts long before the manoeuvre. Moving these zeros away from
the axis shortens that and gives up exactness. Both plans, one metre to the right and one down in 5 s while forward speed and yaw
rate stay zero, are driven closed-loop (feedforward and LQR state feedback), on the linear model and as a free rigid body in MuJoCo;
beside them both planned for that body itself, whose axes tilt with it: the exact inverse, and the one whose outputs are bent as
little as leaves the unstable pair at rest until shortly before the manoeuvre.
Claim tested: Devasia, "Output tracking for systems with non-hyperbolic and near non-hyperbolic internal dynamics: helicopter hover
control" (1996): about 30 s of preactuation become 1 s, with similar inputs and attitudes. The helicopter here is HE3 of COMPleib,
the same aircraft in the same states and inputs, not the paper's plant, whose matrix A is lost: the paper's zero pair is
0.0425 +- 4.3055j, HE3's is 0.0465 +- 4.3692j, and HE3 has a stable pair beside it, -0.0543 +- 2.2753j, that rings for a minute
after the manoeuvre.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from hover.aircraft import LINEAR, NONLINEAR, OUTPUTS, displacement, helicopter, sidestep_and_descent
from hover.comparison import decay_pair, fitted_decay_rate, inverse_poles, likeness
from hover.figures import errors_in_mujoco, papers_figures
from hover.report import report

import invtrack
from invtrack.figures import preactuation_figure
from invtrack.inversion import ModifiedMotion
from invtrack.studies import Case, Setup, Study, StudyOptions

MOVED_TO = 2.0  # [1/s], the paper's
ERROR_POLES = (-1.0, -2.0, -3.0, -4.0)  # [1/s], the paper's, one for the error of each output
TOLERANCE = 1e-6  # of the plans: at rest to within this share of each peak when they start
ACCURACY = 1e-6  # of the plan for the rigid body: output error as a share of the motion
AFTER = 120.0  # [s] simulated after the manoeuvre, while the stable pair of zeros rings down


def build(options: StudyOptions) -> Setup:
    plant = helicopter()
    model = invtrack.linearize(plant)
    plans = _plans(model)
    moving = _plans_for_the_body(plant, decay_pair(plans["exact"]))
    bounds = {name: invtrack.plans.preactuation_bound(plan) for name, plan in plans.items()}
    alike = likeness(plans["exact"], plans["modified"])
    return Setup(
        _cases(plant, model, plans, moving),
        sections={
            "helicopter": "HE3 of COMPleib, not the paper's plant",
            "zeros": _pairs(inverse_poles(plans["exact"])),
            "zeros_modified": _pairs(inverse_poles(plans["modified"])),
            "bound": {name: {"alpha": bound.alpha, "M": bound.M, "t_0": bound.t_0} for name, bound in bounds.items()},
            "likeness": alike,
            "modification": {
                "design": plans["modified"].design,
                "integral_square_error": {entry.name: entry.integral_square_error for entry in plans["modified"].candidates},
            },
        },
        figures={**papers_figures(plans), "errors_in_mujoco": errors_in_mujoco},
        report=report(plans, bounds, alike),
    )


def _plans(model: invtrack.StateSpace) -> dict[str, Any]:
    reference = sidestep_and_descent()
    exact = invtrack.invert(model, reference, tolerance=TOLERANCE)
    modified = invtrack.modified_inversion(
        model, reference, move=_moved(decay_pair(exact)), error_poles=ERROR_POLES, tolerance=TOLERANCE
    )
    return {"exact": exact, "modified": modified}


def _plans_for_the_body(plant: invtrack.Plant, pair: complex) -> dict[str, invtrack.Plan]:
    """The same for the rigid body as it moves; outputs are bent for as long as the moved pair takes to fade to 1 %."""
    reference, options = sidestep_and_descent(), {"tolerance": TOLERANCE, "accuracy": ACCURACY}
    return {
        "exact" + NONLINEAR: invtrack.invert(plant, reference, **options),
        "modified" + NONLINEAR: invtrack.modified_inversion(plant, reference, move=_moved(pair), **options),
    }


def _moved(pair: complex) -> dict[complex, complex]:
    return {pair: complex(MOVED_TO, pair.imag)}


def _cases(
    plant: invtrack.Plant, model: invtrack.StateSpace, plans: Mapping[str, invtrack.Plan], moving: Mapping[str, invtrack.Plan]
) -> list[Case]:
    """Every plan in MuJoCo, the linear model's on it, too; the input evaluated at the stages of RK4: what is left is physics."""
    gains = invtrack.lqr(model, Q=1.0, R=1.0)
    linear = invtrack.LinearPlant(model, input_limits=plant.input_limits)
    chosen = [(name + suffix, on, plan) for name, plan in plans.items() for suffix, on in (("", plant), (LINEAR, linear))]
    return [
        Case(
            name,
            mechanism,
            invtrack.TrackingController(plan, gains),
            settings={"end": plan.manoeuvre[1] + AFTER, "evaluate": "stages"},
            numbers=partial(_numbers, plan),
            figures={} if mechanism is linear else {"preactuation": preactuation_figure},
        )
        for name, mechanism, plan in [*chosen, *((name, plant, plan) for name, plan in moving.items())]
    ]


def _numbers(plan: invtrack.Plan, run: invtrack.RunResult) -> dict[str, Any]:
    """Metrics of one case, with what the plan predicts of it."""
    predicted, pair = run.planned_output.values - run.reference.values, decay_pair(plan)
    numbers: dict[str, Any] = {
        **invtrack.metrics(run),
        "predicted_max_error": float(np.max(np.abs(predicted))),
        "difference_from_prediction": invtrack.max_error(run, wanted="planned_output"),
        "alpha": None if pair is None else pair.real,
        "fitted_decay_rate": None if pair is None else fitted_decay_rate(run, pair),
        "bent_from": plan.window[0] if isinstance(plan, ModifiedMotion) else None,
        "start": float(run.time[0]),
        "max_errors": dict(zip(OUTPUTS, np.max(np.abs(run.error), axis=0).tolist(), strict=True)),
    }
    return numbers | ({"displacement": displacement(run)} if run.qpos.size else {})


def _pairs(values: np.ndarray) -> list[list[float]]:
    return [[float(value.real), float(value.imag)] for value in values]


STUDY = Study("hover_preactuation", build, description=__doc__, defaults=StudyOptions(timestep=1e-2))

if __name__ == "__main__":
    STUDY.main()
