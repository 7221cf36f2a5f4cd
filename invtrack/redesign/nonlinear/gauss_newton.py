"""Gauss-Newton's method for the motion of least cost: steps of the linear-quadratic model, driven with its feedback."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from invtrack.errors import RedesignError
from invtrack.inversion.nonlinear.shooting import Motion
from invtrack.redesign.nonlinear.costed import CostedMotions, Course
from invtrack.redesign.nonlinear.sweep import Step, best_step

MOST_STEPS = 60
"""On one mesh."""

CONVERGED = 1e-13
"""Share of its cost that the best step may still take off a plan: states and inputs are then known to the root of that."""

ROUNDING = 1e-9
"""Steps that promise to take off less than this share of the cost are over where they no longer fall, or do not take it off as a
whole: what is left is rounding of derivatives that come from differences."""

FALLING = 0.5
"""The next step promises no more than this share of what the last one did, or steps no longer fall."""

SUFFICIENT = 1e-4
"""Share of what its model promises that a step must take off the cost (L. Armijo, Pacific J. Math. 16, 1966)."""

SHORTEST = 2.0**-14
"""Shares of a step that are tried, at least."""

CONTINUOUS = 1e-11
"""Gaps between elements, as shares of the states' sizes, above which a course is no motion yet and its cost means nothing."""


@dataclass(frozen=True)
class GaussNewtonStep:
    """One step of Gauss-Newton's method.

    Args:
        cost: of the motion that it leads to.
        decrease: what the quadratic model promised that the whole step takes off the cost, as a share of it: how far from
            stationary the motion before it was.
        share: of the step that was taken.
        mesh: on which of the meshes that were tried, counted from 1.
        elements: how many that mesh has.
        coefficients: of each input on one of them; 1 where it is constant over each hold.
    """

    cost: float
    decrease: float
    share: float
    mesh: int
    elements: int
    coefficients: int


def converged(
    motions: CostedMotions, course: Course, log: Sequence[GaussNewtonStep], unit: float
) -> tuple[Course, Step, tuple[GaussNewtonStep, ...]]:
    """The motion of least cost near by, the step that would still be taken there, and all steps. Raises RedesignError.

    Each step is driven: inputs change by the step's and by its feedback on what the states have come to, so that the motion stays
    one, and near to what the model promised. Of a step that takes too little off the cost a smaller share is tried. Source: the
    iterative linear-quadratic regulator (W. Li, E. Todorov, ICINCO 2004; Y. Tassa, N. Mansard, E. Todorov, ICRA 2014).

    Args:
        motions: on one mesh.
        course: to start from; its elements need not meet.
        log: of steps that led here.
        unit: of the cost, for the log.
    """
    found, cost = list(log), np.inf
    if not _has_gaps(motions, course):
        cost = motions.cost(course)
    last = np.inf
    for _ in range(MOST_STEPS):
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                step = best_step(motions, course)
        except (np.linalg.LinAlgError, ValueError) as reason:  # scipy says ValueError of what is not finite
            raise _not_found(f"the equations of a step cannot be solved ({reason})", len(found)) from reason
        settling = np.isfinite(cost) and step.decrease <= ROUNDING * cost
        if settling and (step.decrease <= CONVERGED * cost or step.decrease > FALLING * last):
            return course, step, tuple(found)
        taken = _taken(motions, course, cost, step, shortest=1.0 if settling else SHORTEST)
        if taken is None:
            if settling:
                return course, step, tuple(found)
            raise _not_found("no share of the last step lowers the cost", len(found))
        course, cost, share = taken
        promised = step.decrease / cost if cost > 0 else 0.0
        last = step.decrease
        found.append(GaussNewtonStep(cost * unit, promised, share, motions.number, len(motions.mesh), motions.scheme.count))
    raise _not_found(f"a further one would still lower the cost by {step.decrease / cost:.1e} of it", len(found))


def driven(motions: CostedMotions, course: Course, step: Step, share: float) -> Course:
    """The motion that this share of a step leads to, with the step's feedback on the way."""
    dynamics, mesh, steps, old = motions.dynamics, motions.mesh, motions.scheme.integration, course.motion
    v = course.v + share * step.dv
    points, coefficients = np.empty_like(old.points), np.empty_like(old.coefficients)
    nodes = np.empty((len(mesh), motions.scheme.steps + 1, old.points.shape[1]))
    points[0] = motions.ends[0].point(v)
    for at, k in enumerate(mesh.interval.tolist()):
        dx = motions.difference(points[at : at + 1], old.points[at : at + 1])[0]
        change = -share * step.k[at] - step.K[at] @ dx
        coefficients[at] = old.coefficients[at] + change.reshape(coefficients.shape[1:])
        here = slice(at, at + 1)
        nodes[at] = dynamics[k].motion(points[here], coefficients[here], steps, mesh.lengths[here])[0]
        points[at + 1] = nodes[at, -1]
        if not np.all(np.isfinite(points[at + 1])):
            points[at + 1 :], coefficients[at + 1 :], nodes[at + 1 :] = np.nan, np.nan, np.nan
            break
    motion = Motion(points, coefficients)
    motions.remember(motion, nodes)
    return Course(motion, v)


def _taken(motions: CostedMotions, course: Course, cost: float, step: Step, shortest: float) -> tuple[Course, float, float] | None:
    """The motion, its cost and the share of the step that lowers it enough; None where none does."""
    share = 1.0
    with np.errstate(over="ignore", invalid="ignore"):
        while share >= shortest:
            found = driven(motions, course, step, share)
            after = motions.cost(found)
            promised = share * (2 - share) * step.decrease
            if np.isfinite(after) and (cost == np.inf or after <= cost - SUFFICIENT * promised):
                return found, after, share
            share /= 2
    return None


def _has_gaps(motions: CostedMotions, course: Course) -> bool:
    start = motions.difference(motions.ends[0].point(course.v)[None], course.motion.points[:1])
    gaps = np.abs(np.vstack([start, motions.gaps(course.motion)]))
    return bool(np.any(gaps > CONTINUOUS * motions.sizes(course.motion)))


def _not_found(why: str, steps: int) -> RedesignError:
    return RedesignError(
        f"no motion of least cost found in {steps} steps of Gauss-Newton's method: {why}; ask for a smaller or slower motion, or "
        "bring the weights closer to each other"
    )
