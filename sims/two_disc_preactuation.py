"""Zeros near the imaginary axis and on it: the two-disc rig where exact inversion starts too early or does not exist, in MuJoCo.

The second disc turns by one radian in 5 s. The identified rig has a zero pair near the axis: its exact inverse starts long before
the slew. Without damping and coupling the pair lies on the axis: exact inversion is refused, and the causal inverse, which starts
with the slew, leaves the discs ringing against each other for ever. Remedies: modified inversion, which moves the pair off the axis
for a little error, and the quadratic redesign of the output. All are driven closed-loop (feedforward and LQR state feedback).
Claim tested: Devasia, "Output tracking for systems with non-hyperbolic and near non-hyperbolic internal dynamics" (1996), on
plants that the paper does not have.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
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
from two_disc.rig import SLEW, R, peak, rig, run_settings, twist

import invtrack
from invtrack.errors import NonHyperbolicError
from invtrack.figures import comparison_figure, tracking_figure
from invtrack.linear import format_zeros
from invtrack.redesign import outcome
from invtrack.studies import Case, Column, Session, Setup, Study, StudyOptions, Table

DURATION = 5.0  # [s]
AT_THE_END = 5.0  # [s] of the run in which what is left is looked at
WINDOW = (-25.0, 30.0)  # [s] of the comparison

COLUMNS = (
    Column("preactuation time", "s"),
    Column("max error", "rad"),
    Column("predicted max error", "rad"),
    Column("final error", "rad"),
    Column("peak input", "1"),
    Column("input left", "1"),
    Column("twist left", "rad"),
    Column("start", "s"),
)


def build(options: StudyOptions) -> Setup:
    reference = invtrack.rest_to_rest(0.0, SLEW, DURATION)
    plants = {"identified": rig(), "passive": passive_rig()}
    models = {name: invtrack.linearize(plant) for name, plant in plants.items()}
    plans, q_y = _plans(models, reference)
    return Setup(
        [_refused(plants["passive"], models["passive"], reference)]
        + [_case(plants[_rig_of(name)], models[_rig_of(name)], name, plan) for name, plan in plans.items()],
        sections={
            "zeros": {name: _pairs(invtrack.linear.zeros(model)) for name, model in models.items()},
            "moved_to": MOVED_TO,
            "level": LEVEL,
            "redesign_with_the_same_error": {"r": R, "q_x": 0.0, "q_y": q_y},
            "trade_off": lambda done: both_remedies(models["passive"], reference),
        },
        figures={
            **{f"comparison_{family}": partial(_comparison, family) for family in plants},
            "trade_off": lambda done: draw_remedies(
                f"two_disc_passive: what preactuation buys, slew of {DURATION:g} s", done.section("trade_off")
            ),
        },
        report=[
            *(f"{name} rig: zeros {format_zeros(invtrack.linear.zeros(model))} [1/s]" for name, model in models.items()),
            Table(f"Slew by {SLEW:g} rad in {DURATION:g} s, in MuJoCo", COLUMNS),
            _explanation(q_y),
            _reason,
            f"passive_causal: {'; '.join(plans['passive_causal'].remarks)}\n",
            *report_remedies(),
        ],
    )


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


def _refused(plant: invtrack.Plant, model: invtrack.StateSpace, reference: invtrack.PiecewiseSignal) -> Case:
    """Exact inversion on the axis."""
    return Case(
        "passive_exact",
        plant,
        lambda: invtrack.TrackingController(invtrack.invert(model, reference)),
        refused_by=NonHyperbolicError,
    )


def _case(plant: invtrack.Plant, model: invtrack.StateSpace, name: str, plan: invtrack.Plan) -> Case:
    """In MuJoCo, the input evaluated at the stages of RK4."""
    return Case(
        name,
        plant,
        invtrack.TrackingController(plan, invtrack.lqr(model, Q=1.0, R=1.0)),
        settings={**run_settings(plan), "evaluate": "stages"},
        numbers=_numbers,
        figures={"tracking": partial(tracking_figure, window=(-5.0, 20.0))},
    )


def _numbers(result: invtrack.RunResult) -> dict[str, Any]:
    """Metrics of one case, what its plan predicts, and what is left of error, input and twist at the end of the run."""
    late = result.time >= result.time[-1] - AT_THE_END
    return {
        **invtrack.metrics(result),
        "predicted_max_error": peak(result.planned_output.values - result.reference.values),
        "final_error": peak(result.error[late]),
        "input_left": peak(result.applied.values[late[:-1]]),
        "twist_left": peak(twist(result.state.values[late])),
        "start": float(result.time[0]),
    }


def _pairs(values: np.ndarray) -> list[list[float]]:
    return [[float(value.real), float(value.imag)] for value in values]


def _explanation(q_y: float) -> str:
    return (
        f"preactuation time: since the input first exceeds {LEVEL:.0%} of its peak. final error, input left, twist left: the\n"
        f"largest of the run's last {AT_THE_END:g} s. modified: the pair of zeros gets the real part {MOVED_TO:g} 1/s.\n"
        f"redesigned: with the papers' weights r = 1, q_x = 5000, q_y = 1; redesigned_same_error: with q_x = 0 and q_y =\n"
        f"{q_y:.3g}, so that it gives up as much as modified does."
    )


def _reason(done: Session) -> str:
    refused = [(name, numbers["reason"]) for name, numbers in done.numbers.items() if numbers["status"] == "refused"]
    return "\n".join(f"{name} is refused: {reason}" for name, reason in refused)


def _comparison(family: str, done: Session) -> object:
    return comparison_figure(done.among(name for name in done.runs if _rig_of(name) == family), window=WINDOW)


STUDY = Study("two_disc_preactuation", build, description=__doc__, defaults=StudyOptions(timestep=5e-3))

if __name__ == "__main__":
    STUDY.main()
