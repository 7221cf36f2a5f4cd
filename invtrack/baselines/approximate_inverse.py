"""Approximate inverses of sampled plants, which keep zeros outside the unit circle uncancelled: ZPETC, ZMETC, zeros ignored."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from invtrack.arguments import one_of
from invtrack.arrays import Array, ComplexArray, require_duration, require_not_negative
from invtrack.baselines.feedback_tracking import inexact
from invtrack.baselines.sampled_zeros import SampledInverse
from invtrack.baselines.zero_filters import Kind, filtered
from invtrack.errors import PlanError, RelativeDegreeError
from invtrack.inversion.no_preactuation import quasi_static
from invtrack.linear.internal_dynamics import format_zeros
from invtrack.linear.state_space import StateSpace
from invtrack.plans.plan import Plan
from invtrack.plans.problem import PlanningProblem
from invtrack.plans.tail import Tail
from invtrack.plans.trajectory import Trajectory, TwoSidedSegments
from invtrack.plans.two_sided import DrivenSystem, Part, TwoSidedSystem
from invtrack.references.signal import PiecewiseSignal

AT_REST = 1e-13
"""Share of a departure from rest with which the plan ends."""

MOST_HOLDS = 200_000
"""Holds of a plan at most; each is a piece of its trajectory."""

UNDAMPED = 1e-9
"""A zero whose damping ratio is below this lies on the unit circle, rounded."""

STILL = 1e-12
"""A reference holds still where its state changes by less than this share of the terms that make up the change."""


def approximate_inverse(model: Any, reference: PiecewiseSignal, *, kind: Kind, hold: float, least_damping: float = 0.02) -> Plan:
    """The plan of a feedforward filter that inverts the sampled plant but for zeros that would make its input explode, or ring.

    The plant with its input held over each `hold` is z^-d B_s(z) B_u(z) / A(z), with B_s the zeros that are cancelled. With B_u
    scaled to B_u(1) = 1 the output is, at the samples,

    | kind | y / y_d | |
    |---|---|---|
    | "NPZ-ignore" | B_u(z) | the zeros are left as they are, the gain at rest is put right |
    | "ZPETC" | B_u(z) B_u(1/z) | no phase error at any frequency (zero phase error tracking control) |
    | "ZMETC" | B_u(z) / B_u^f(z) | no magnitude error at any frequency, the zeros cancelled at their reciprocals |

    each with the few samples of preview that it needs: the input begins that much before the reference does. Feedback around it
    changes nothing as long as the plant is the model's, so the same plan stands for the filter in front of a closed loop and for
    the one that adds to the plant's input. The plan's states are exact between samples, too: follow it with
    TrackingController(plan, gains, period=hold), in a run that begins where it does or whole holds before.

    Args:
        model: StateSpace, or anything with A, B, C, D, with one input and one output.
        reference: absolute, in the output's unit, from rest to rest; sampled at its start plus whole holds.
        kind: see above.
        hold: period of the zero-order hold [s].
        least_damping: of zeros inside the unit circle in its left half, which sampling makes: those whose damping ratio (of
            log(z) / hold) is below this are not cancelled either, as the input that cancels them rings from hold to hold. "ZMETC"
            leaves them as they are, too. In the right half lie the mechanism's own; they are cancelled unless they are undamped.

    Raises PlanError for a model that switches, an output that cannot be held, a reference that does not begin and end at rest, a
    number of holds beyond 200 000, and where rounding spoils the plan; RelativeDegreeError for other numbers of inputs and outputs.
    Sources: M. Tomizuka, "Zero phase error tracking algorithm for digital control", ASME Journal of Dynamic Systems, Measurement,
    and Control 109(1), 1987; J. Butterworth, L. Pao, D. Abramovitch, "Analysis and comparison of three discrete-time feedforward
    model-inverse control techniques for nonminimum-phase systems", Mechatronics 22(5), 2012.
    """
    one_of("kind", kind, get_args(Kind), error=PlanError)
    require_duration("hold", hold, error=PlanError)
    require_not_negative("least_damping", least_damping, error=PlanError)
    problem = PlanningProblem.of(model, reference)
    system = _single(problem)
    held = _held_values(problem.deviation)
    inverse = SampledInverse.of(system, float(hold))
    static = quasi_static(system, 1)[0]
    chosen = _not_cancelled(inverse.zeros, float(hold), float(least_damping))
    kept = inverse.zeros[chosen]
    start, end = problem.manoeuvre
    before = 2 * len(kept) + inverse.lead + 1
    needed = before + (end - start) / float(hold) + len(kept) + _settling(kind, inverse.zeros, chosen)
    if not needed <= MOST_HOLDS:
        raise PlanError(
            f"a hold of {hold:.6g} s makes {needed:.6g} holds until the zeros that are cancelled have died out, of which at most "
            f"{MOST_HOLDS} are planned; take a longer hold"
        )
    count = math.ceil(needed)
    times = np.asarray(start + float(hold) * np.arange(-before, count - before + 1), dtype=float)
    x, u = inverse.followed(filtered(kind, kept, np.diff(problem.deviation(times)[:, 0])), static[:, 0])
    values: Array = np.hstack([x[:-1], u[:, np.newaxis]]) + held[0] * static[:, 0]
    trajectory = _held(system, times, values, np.outer(held, static[:, 0]))
    plan: Plan = problem.plan(kind, trajectory, exact=False)
    return replace(plan, remarks=(inexact(plan), *_remarks(kept), *plan.remarks))


def _single(problem: PlanningProblem) -> StateSpace:
    """The one model of a plant with one input and one output."""
    plant = problem.plant
    if (plant.n_inputs, plant.n_outputs) != (1, 1):
        raise RelativeDegreeError(
            f"approximate_inverse needs one input and one output, got {plant.n_inputs} and {plant.n_outputs}; choose them with "
            "StateSpace.with_inputs and with_outputs, or use invtrack.invert"
        )
    if len(plant.distinct) > 1:
        raise PlanError(
            "approximate_inverse needs one model for all of time, as the zeros of a transfer function are those of one plant; "
            "use invtrack.invert for a model that switches"
        )
    return plant.systems[0]


def _held_values(deviation: PiecewiseSignal) -> tuple[float, float]:
    """The values at which the reference holds still before and after."""
    values = []
    for end, place in ((0, "before"), (-1, "after")):
        generator = deviation.generators[deviation.kind[end]]
        w = deviation.anchors[end, : len(generator.S)]
        if np.any(np.abs(generator.S @ w) > STILL * np.abs(generator.S) @ np.abs(w)):
            raise PlanError(f"expected a reference from rest to rest, this one moves on for ever {place} its manoeuvre")
        values.append(float((generator.R @ w)[0]))
    return values[0], values[1]


def _not_cancelled(zeros: ComplexArray, hold: float, least_damping: float) -> NDArray[np.bool_]:
    """Which zeros (k,) are not cancelled: those outside the unit circle or on it, and in its left half the hardly damped ones."""
    with np.errstate(divide="ignore"):  # a zero at 0 dies out at once
        rate = np.log(zeros) / hold
    damping = -rate.real / np.maximum(np.abs(rate), np.finfo(float).tiny)
    return np.asarray(~(damping >= np.where(zeros.real < 0, least_damping, UNDAMPED)) & (zeros != 0))


def _settling(kind: Kind, zeros: ComplexArray, kept: NDArray[np.bool_]) -> float:
    """Holds until what follows the reference is at rest: the zeros that are cancelled, and for ZMETC those reflected."""
    size = np.abs(zeros)
    reflected = 1 / size[size > 1] if kind == "ZMETC" else np.zeros(0)
    slowest = float(np.max(np.concatenate([size[~kept], reflected]), initial=0.0))
    if slowest >= 1:
        return math.inf
    return 2 + (math.log(AT_REST) / math.log(slowest) if slowest > AT_REST else 0)


def _held(system: StateSpace, times: Array, values: Array, rest: Array) -> Trajectory:
    """The trajectory of x' = A x + B u_k, u_k constant over each hold.

    Args:
        system: the model.
        times: edges of the holds (m + 1,) [s].
        values: [x_k; u_k] at the start of each hold (m, n + 1).
        rest: [x; u] before and after (2, n + 1).
    """
    n, m = system.n_states, system.n_inputs
    rows = np.vstack([np.eye(n), np.zeros((m, n)), system.C])
    two_sided = TwoSidedSystem(Part(system.A, rows, np.eye(n)), Part.empty(n + m + len(system.C), n), np.eye(n))
    driven = DrivenSystem(
        system=two_sided,
        S=np.zeros((m, m)),
        D_f=system.B,
        D_b=np.zeros((0, m)),
        X_w=np.vstack([np.zeros((n, m)), np.eye(m), system.D]),
        J_w=np.zeros((n, m)),
    )
    count = len(values)
    to_values = np.hstack([rows, driven.X_w])
    before, after = (Tail.holding(side, to_values @ at) for side, at in zip((-1, 1), rest, strict=True))
    segments = TwoSidedSegments(driven, values, values[:, n:])
    return Trajectory(times, (segments,), np.zeros(count, dtype=np.intp), np.arange(count), before, after)


def _remarks(kept: ComplexArray) -> tuple[str, ...]:
    if not len(kept):
        return ()
    return (f"zeros of the sampled plant that are not cancelled: {format_zeros(kept)}",)
