"""What the hover simulation prints."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from hover.aircraft import LINEAR, NONLINEAR
from hover.comparison import inverse_poles

from invtrack.linear import format_zeros
from invtrack.plans import PreactuationBound
from invtrack.studies import Column, Session, Table

COLUMNS = (
    Column("max error", "SI"),
    Column("predicted max error", "SI"),
    Column("rms error", "SI"),
    Column("residual vibration", "SI"),
    Column("peak input", "1"),
    Column("preactuation time", "s"),
    Column("fitted decay rate", "1/s"),
    Column("start", "s"),
)
ALIKE = 0.9  # correlation from which two curves are called alike

LIKENESS_COLUMNS = (
    Column("peak, exact", key="exact_peak"),
    Column("peak, modified", key="modified_peak"),
    Column("largest difference / peak", key="largest_difference"),
    Column("correlation"),
)


def report(
    plans: Mapping[str, Any], bounds: Mapping[str, PreactuationBound], alike: dict[str, dict[str, float]]
) -> list[Table | str | Callable[[Session], str]]:
    """Both tables and what they mean."""
    return [
        _plants(plans),
        Table("A metre to the right and a metre down in 5 s, U, W, V [m/s] and R [rad/s]", COLUMNS),
        Table("How alike the two plans are in the manoeuvre", LIKENESS_COLUMNS, lambda _: alike, row_header="control, attitude"),
        _similar(alike),
        lambda done: _errors(done, alike),
        _meanings(bounds),
        *(partial(_way, name + planned) for name in plans for planned in ("", NONLINEAR)),
    ]


def _plants(plans: Mapping[str, Any]) -> str:
    tried = ", ".join(f"{entry.name} {entry.integral_square_error:.3g}" for entry in plans["modified"].candidates)
    return (
        "The helicopter is HE3 of COMPleib: the paper's aircraft, states and inputs, not its matrix, which is lost.\n"
        f"zeros: {format_zeros(inverse_poles(plans['exact']))}\n"
        f"poles of the modified inverse: {format_zeros(inverse_poles(plans['modified']))} [1/s]\n"
        f"ways of using the freedom in the modified law, by the integral of their squared error:\n  {tried};\n"
        f"  taken: {plans['modified'].design}\n"
    )


def _similar(alike: dict[str, dict[str, float]]) -> str:
    groups: dict[bool, list[str]] = {True: [], False: []}
    for label, row in alike.items():
        groups[row["correlation"] >= ALIKE].append(label.replace("_", " "))
    return (
        "The paper finds its inputs and attitudes similar. Here these are (correlation of"
        f" {ALIKE:g} or more): {', '.join(groups[True])};\n"
        f"these are not, since the exact plan still swings at its zeros' frequency: {', '.join(groups[False])}.\n"
    )


def _errors(done: Session, alike: dict[str, dict[str, float]]) -> str:
    linear, physics, bent, exact, moving = (
        done.numbers_of(name) for name in ("modified" + LINEAR, "modified", "modified" + NONLINEAR, "exact", "exact" + NONLINEAR)
    )
    return (
        f"largest error of modified: {linear['predicted_max_error']:.6f} predicted, {linear['max_error']:.6f} on the linear model,"
        f" {physics['max_error']:.4f} in MuJoCo\n"
        f"(on the linear model output and prediction differ by at most {linear['difference_from_prediction']:.0e}).\n"
        "The error of exact in MuJoCo comes of the tilt: U, V, W are measured along the body's own axes, which roll by\n"
        f"up to {alike['roll phi']['exact_peak']:.3f} rad, while those of the linear model stay level; planned for the body itself"
        f" (exact{NONLINEAR}) it falls from {exact['max_error']:.1e} to {moving['max_error']:.1e}.\n"
        f"modified{NONLINEAR} is planned for the body, too: from {-bent['bent_from']:.2f} s before the manoeuvre on it bends the"
        f" outputs,\nby {bent['predicted_max_error']:.4f} at most, as little as leaves the moved pair at rest until then, and is"
        f" followed to {bent['difference_from_prediction']:.0e}."
    )


def _meanings(bounds: Mapping[str, PreactuationBound]) -> str:
    bounding = ", ".join(f"{bound.M:.3g} exp({bound.alpha:.5g} t) ({name})" for name, bound in bounds.items())
    return (
        "start: the run begins at rest this long before the manoeuvre. preactuation time: since |u| first exceeded 1 % of\n"
        "its peak. residual vibration: peak to peak over 5 periods of the slowest flexible mode after the manoeuvre. fitted\n"
        "decay rate: of |u| before the manoeuvre, where the plans keep\n"
        f"|u| below {bounding}."
    )


def _way(name: str, done: Session) -> str:
    displacement = done.numbers_of(name)["displacement"]
    went = ", ".join(f"{distance:.3f} m {where}" for where, distance in displacement.items())
    return f"way of the body in MuJoCo, {name}: {went}"
