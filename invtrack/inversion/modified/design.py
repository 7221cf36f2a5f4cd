"""The freedom in a modified inverse, in F (several outputs) and in L, used to keep the predicted error small."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from invtrack.arrays import Array
from invtrack.errors import InversionError
from invtrack.inversion.modified.design_problem import Candidate, DesignProblem, Solved, with_least_squares, without_feedforward
from invtrack.inversion.modified.direction_search import best_directions
from invtrack.inversion.modified.modified_dynamics import ModifiedDynamics, equilibrium, modified_dynamics
from invtrack.inversion.modified.placement import MovablePart, robust_gain
from invtrack.linear.internal_dynamics import InternalDynamics, format_zeros


def robust_design(problem: DesignProblem) -> Solved:
    """F by robust pole placement, L = 0. Raises InversionError where the poles cannot be placed."""
    dynamics = _dynamics(problem, lambda part, _: robust_gain(part, problem.output_scale))
    if dynamics is None:
        raise _not_placed(problem)
    return without_feedforward(problem, _placement_name(problem), dynamics)


def least_error_design(problem: DesignProblem) -> Solved:
    """The choice with the least integral square error among several of F, each with L = 0 and with L by least squares.

    Choices whose solution misses the plant's equations, because of rounding, are passed over.

    Raises InversionError where the poles cannot be placed in any way.
    """
    placed = {_placement_name(problem): _dynamics(problem, lambda part, _: robust_gain(part, problem.output_scale))}
    if len(problem.output_scale) > 1 and any(len(part.targets) for part in problem.parts):
        planning, scale, active = problem.planning, problem.output_scale, problem.active
        placed["optimized directions"] = _dynamics(
            problem,
            lambda part, internal: best_directions(part, internal, equilibrium(internal), planning.deviation, scale, active),
        )
    found: list[Solved] = []
    for name, dynamics in placed.items():
        if dynamics is not None:
            plain = without_feedforward(problem, name, dynamics)
            found += [plain, with_least_squares(problem, plain)]
    if not found:
        raise _not_placed(problem)
    ranked = sorted(found, key=lambda solved: solved.integral_square_error)
    best = next((solved for solved in ranked if problem.is_accurate(solved.solution)), ranked[0])
    candidates = tuple(Candidate(solved.name, solved.integral_square_error) for solved in found)
    listed = ", ".join(f"{c.name}: {c.integral_square_error:.3e}" for c in candidates)
    remark = (
        f"integral square error of the choices of F and L, in s times the outputs' scale squared: {listed}; {best.name} was taken"
    )
    if best is not ranked[0]:
        remark += ", since those with less are too ill-conditioned"
    return replace(best, candidates=candidates, remarks=(remark,))


def _placement_name(problem: DesignProblem) -> str:
    return "robust placement" if len(problem.output_scale) > 1 else "placement"


def _not_placed(problem: DesignProblem) -> InversionError:
    wanted = "; ".join(dict.fromkeys(format_zeros(part.poles) for part in problem.parts))
    return InversionError(
        f"the poles {wanted} cannot be placed to within rounding: the inputs move too little of what is to be placed; choose "
        "error_poles of about the pace of the zeros moved, and move these less far"
    )


def _dynamics(
    problem: DesignProblem, gain: Callable[[MovablePart, InternalDynamics], Array | None]
) -> list[ModifiedDynamics] | None:
    """The modified inverse of each interval, shared by those with the same model and moved zeros; None without a gain."""
    known: dict[tuple[int, bytes], ModifiedDynamics] = {}
    result = []
    for internal, part, unmoved in zip(problem.internals, problem.parts, problem.unmoved, strict=True):
        key = (id(internal), part.targets.tobytes())
        if key not in known:
            found = gain(part, internal)
            if found is None:
                return None
            known[key] = modified_dynamics(internal, part, found, unmoved)
        result.append(known[key])
    return result
