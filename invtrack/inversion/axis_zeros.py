"""Zeros on the imaginary axis: exact inversion goes through them where the manoeuvre, from rest, leaves their motion at rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from invtrack.arrays import Array, ComplexArray
from invtrack.errors import NonHyperbolicError
from invtrack.linear.hidden_modes import zero_kinds
from invtrack.linear.internal_dynamics import (
    SplitDynamics,
    axis_message,
    format_zeros,
    internal_dynamics,
    on_axis,
    split_by,
)
from invtrack.linear.invariant_parts import invariant_parts
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.problem import PlanningProblem
from invtrack.plans.two_sided_problem import TwoSidedSolution

REST_TOLERANCE = 1e-9
"""The motion that zeros on the axis stand for is at rest where no more than this share of its peak is left of it."""

HELD_TOLERANCE = 1e-9
"""A held output lets it rest where its drive is below this share of its terms."""


def split_through_axis(plant: SwitchedSystem) -> tuple[SplitDynamics, ...]:
    """Split internal dynamics of each interval; in the first and the last one zeros on the axis stand apart, as neutral states.

    A neutral state z_c' = A_c z_c + G_c [zeta; y^(r)] starts at rest, runs forward, and is at rest after the manoeuvre if the drive
    leaves nothing in it: for a simple zero j w and outputs that return to where they were if the integral of exp(-j w t) times the
    drive vanishes. In the intervals between, which end, zeros on the axis do no harm. Raises RelativeDegreeError.
    """
    return plant.map(lambda system: split_interval(system, endless=plant.is_endless(system)))


def split_interval(system: StateSpace, *, endless: bool) -> SplitDynamics:
    """The same for one interval; endless: whether it is the first or the last one."""
    internal = internal_dynamics(system)
    zeros, axis = internal.zeros, on_axis(internal)
    forward = axis | (zeros.real <= 0)
    # By the nearest zero: reordering the Schur form puts one on the axis to either side of it.
    split = split_by(internal, lambda zero: bool(forward[np.argmin(np.abs(zeros - zero))]))
    if not endless or not np.any(axis):
        return split
    quick, slow = split.quick[0], slice(split.quick[0].start)
    parts = invariant_parts(split.A_s[slow, slow], lambda zero: not axis[np.argmin(np.abs(zeros - zero))])
    # What dies out, quick ones after the others, and what does not.
    A_s = scipy.linalg.block_diag(parts.A_1, split.A_s[quick, quick], parts.A_2)
    G_s, L_s = (np.vstack([parts.L_1 @ M[slow], M[quick], parts.L_2 @ M[slow]]) for M in (split.G_s, split.L_s))
    return replace(
        split,
        A_s=A_s,
        G_s=G_s,
        W_s=np.hstack([split.W_s[:, slow] @ parts.W_1, split.W_s[:, quick], split.W_s[:, slow] @ parts.W_2]),
        L_s=L_s,
        neutral=resolved_inverse(parts.A_2, internal.uncertainty),
        quick=(slice(len(parts.A_1), len(A_s) - len(parts.A_2)), split.quick[1]),
    )


def resolved_inverse(A: Array, uncertainty: float) -> Array:
    """The pseudoinverse of A (k, k), singular values within its uncertainty taken for zero."""
    U, sizes, Vh = np.linalg.svd(A)
    kept = sizes > uncertainty
    return np.asarray(Vh[kept].T @ (U[:, kept] / sizes[kept]).T)


def require_rest_held(problem: PlanningProblem, splits: Sequence[SplitDynamics]) -> None:
    """Raises NonHyperbolicError where the output held before or after the manoeuvre drives a zero at the origin, which drifts."""
    reference = problem.deviation
    for k, t, when in ((0, reference.breakpoints[0] - 1.0, "before"), (-1, reference.breakpoints[-1] + 1.0, "after")):
        split, n = splits[k], len(splits[k].A_s) - len(splits[k].neutral)
        if n == len(split.A_s) or np.any(reference(t, derivative=1)):
            continue
        A_c, drive = split.A_s[n:, n:], split.G_s[n:] @ _held_derivatives(split, reference(t))
        left = drive - A_c @ (split.neutral @ drive)
        terms = np.linalg.norm(split.G_s[n:]) * float(np.max(reference.size(0)))
        if np.linalg.norm(left) > HELD_TOLERANCE * terms:
            internal = split.internal
            origin = on_axis(internal) & (np.abs(internal.zeros) <= np.min(np.abs(internal.zeros)) + _near(split))
            raise NonHyperbolicError(
                axis_message(
                    internal,
                    origin,
                    zero_kinds(problem.plant.systems[k], internal.zeros),
                    f"and outputs held at {reference(t).tolist()} {when} the manoeuvre (as deviations from the operating point) "
                    "drive what belongs to them, which never comes to rest: let the reference start and end at the operating point",
                )
            )


def _held_derivatives(split: SplitDynamics, held: Array) -> Array:
    """[zeta; chi] of outputs that stand still at `held` (p,)."""
    form = split.internal.form
    return np.concatenate([form.zeta.coefficients[0], form.chi.coefficients[0]]) @ held


def require_rest_left(problem: PlanningProblem, splits: Sequence[SplitDynamics], equations: TwoSidedSolution) -> tuple[str, ...]:
    """What a user should know about zeros on the axis that the plan goes through.

    Raises NonHyperbolicError where the manoeuvre leaves their motion moving: which of them, and how much of its peak.
    """
    if not len(splits[-1].neutral):
        return ()
    internal = splits[-1].internal
    left, size = equations.unrest
    share = float(np.linalg.norm(left)) / size if size > 0 else 0.0
    axis = on_axis(internal)
    if share > REST_TOLERANCE:
        moving = axis & _moving(splits[-1], left, REST_TOLERANCE * size)
        raise NonHyperbolicError(
            axis_message(
                internal,
                moving,
                zero_kinds(problem.plant.systems[-1], internal.zeros),
                f"and of the motion that belongs to them, started at rest, the manoeuvre leaves {share:.1e} of its peak, which "
                f"would go on for ever{_causal(splits[-1])}; a reference without content there is served"
                + _without_content(internal.zeros[moving]),
            )
        )
    if size == 0:
        return ()
    if not np.any(equations.problem.systems[-1].moves_neutral):
        return ("a zero at the origin: the plant comes to rest where the manoeuvre leaves it, not always where the outputs say",)
    listed = format_zeros(internal.zeros[axis], float(np.max(np.abs(internal.zeros))))
    return (
        f"the zeros at {listed} lie on the imaginary axis: this reference leaves nothing in them ({share:.1e} of their motion's "
        "peak), but no damping takes away what anything else, such as an error of the model, leaves there",
    )


def _moving(split: SplitDynamics, left: Array, tolerance: float) -> NDArray[np.bool_]:
    """Which of the zeros (n_z,) have a part in what is left of the neutral states; with repeated ones all."""
    n, zeros = len(split.A_s) - len(split.neutral), split.internal.zeros
    values, vectors = np.linalg.eig(split.A_s[n:, n:])
    try:
        parts = np.abs(np.linalg.solve(vectors, left.astype(complex)))
    except np.linalg.LinAlgError:
        parts = np.full(len(values), np.inf)
    moving = values[parts > tolerance]
    if not moving.size:
        moving = values
    return np.asarray(np.min(np.abs(zeros[:, None] - moving), axis=1) <= _near(split))


def _causal(split: SplitDynamics) -> str:
    """Where `causal_inverse` would serve, the pointer to it."""
    values = np.linalg.eigvals(split.A_s[len(split.A_s) - len(split.neutral) :, len(split.A_s) - len(split.neutral) :])
    apart = np.abs(values[:, None] - values) + np.diag(np.full(len(values), np.inf))
    served = not len(split.A_u) and np.min(np.abs(values)) > _near(split) and np.min(apart, initial=np.inf) > _near(split)
    return " (invtrack.causal_inverse gives the plan that does)" if served else ""


def _near(split: SplitDynamics) -> float:
    """Zeros closer than this are taken for one, which rounding has split [rad/s]."""
    return 1e-6 * float(np.max(np.abs(split.internal.zeros)))


def _without_content(zeros: ComplexArray) -> str:
    """A reference without content at these zeros: halves that lie half a period apart cancel each other there."""
    frequencies = zeros.imag[zeros.imag > 1e-9 * np.max(np.abs(zeros))]
    if not frequencies.size:
        return ", one whose drive of it adds up to nothing"
    halves = ", ".join(repr(float(np.pi / w)) for w in frequencies)
    often = "" if len(frequencies) == 1 else f", once for each T of {halves}"
    return f", such as 0.5 * (r + r.shifted({halves if not often else 'T'})) of a reference r{often}"
