"""Exact tracking by inputs that a zero-order hold makes: the inverse of the sampled plant, linear and switched."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.linalg

from invtrack.arrays import Array, Indices, require_duration
from invtrack.errors import BoundednessError, NonHyperbolicError, PlanError, RelativeDegreeError
from invtrack.inversion.axis_zeros import split_through_axis
from invtrack.inversion.held_outputs import held_outputs
from invtrack.inversion.held_trajectory import HeldMotion, trajectory_of_holds
from invtrack.inversion.nonlinear.boundary_value import TwoPointProblem
from invtrack.inversion.nonlinear.elements import candidate_schemes
from invtrack.inversion.nonlinear.ends import End
from invtrack.inversion.nonlinear.mesh import Mesh
from invtrack.inversion.sampled_element import LEAST_GAP, SampledElement
from invtrack.inversion.smoothness import require_smooth
from invtrack.inversion.whole_holds import held_remark, in_whole_holds
from invtrack.linear.internal_dynamics import format_zeros
from invtrack.linear.state_space import StateSpace
from invtrack.linear.state_units import plant_units
from invtrack.linear.switched import SwitchedSystem
from invtrack.linear.zeros import zeros
from invtrack.plans.certificate import ACCURACY, Certificate, certify, rest_residual
from invtrack.plans.plan import Plan
from invtrack.plans.problem import PlanningProblem, actuation_times
from invtrack.plans.trajectory import Trajectory

FORGOTTEN = 36.0
"""The plan has as many holds before and after the manoeuvre as take what they add of their own to exp(-FORGOTTEN)."""

LOOKED_AT = (0.25, 0.5, 0.75, 1.0)
"""Shares of a hold after which outputs are compared with those wanted."""

SHORT = 1e-3
"""A hold times the slowest zero below which rounding is to blame: the zero's multiplier then is 1 to within three digits."""

MOST_HOLDS = 200_000
"""Holds that are planned, at most."""


def held_inverse(problem: PlanningProblem, hold: float) -> Plan:
    """The plan whose inputs are constant over each hold, with the outputs exact once in it; see `invtrack.invert`.

    x_(k+1) = A_d x_k + B_d u_k with exact matrix exponentials. Outputs of even relative degree are met in the middle of each hold,
    those of odd at its end: so sampling zeros stay away from the unit circle (K. J. Astrom, P. Hagander, J. Sternby, 1984). Holds
    begin at breakpoints of the reference and at jumps; where these lie no whole number of holds apart, those between are even, and
    shorter.

    Args:
        problem: of a plant with as many inputs as outputs, and a reference from rest to rest.
        hold: the period [s].
    """
    require_duration("hold", hold, error=PlanError)
    plant = problem.plant
    _require_square(plant)
    levels = held_outputs(problem.reference, "a plan for a zero-order hold")
    require_smooth(plant, [split.internal for split in split_through_axis(plant)], problem.deviation)
    rests = [_rest(system, y) for system, y in zip((plant.systems[0], plant.systems[-1]), levels, strict=True)]
    at_end, ends = _choice(plant, hold)
    if ends[0].expanding != ends[1].expanding:
        raise BoundednessError(
            f"no bounded inverse for holds of {hold:g} s: before the manoeuvre {ends[0].expanding} mode(s) of the sampled inverse "
            f"grow, which gives as many unknowns, after it {ends[1].expanding}, which gives as many conditions; the last "
            "interval's parameters, or the output, have to change"
        )
    mesh = _mesh(problem, hold, ends)
    elements = _elements(plant, mesh, at_end)
    motion = _solve(problem, mesh, elements, ends, rests)
    trajectory = trajectory_of_holds(plant, motion, ends, rests)
    certificate, missed = _certified(problem, motion, trajectory, elements)
    _require_long_enough(hold, certificate, ends)
    replace(certificate, output_error=missed).require(exact=problem.asks_for_motion, method="stable inversion for a hold")
    method = "stable inversion for a zero-order hold"
    plan: Plan = problem.plan(method, trajectory, exact=False, remarks=(held_remark(hold, certificate),), certificate=certificate)
    return in_whole_holds(plan, hold)


def _require_square(plant: SwitchedSystem) -> None:
    if plant.n_inputs != plant.n_outputs:
        raise RelativeDegreeError(
            f"a plan for a zero-order hold needs as many inputs as outputs, got {plant.n_inputs} inputs {list(plant.inputs.names)} "
            f"for {plant.n_outputs} output(s) {list(plant.outputs.names)}; leave inputs out (StateSpace.with_inputs), or plan "
            "without hold: then the controller holds the mean of a continuous input"
        )


def _require_long_enough(hold: float, certificate: Certificate, ends: Sequence[End]) -> None:
    """Raises PlanError for holds that are so short beside the zeros that rounding is left of the modes that take long."""
    rates = np.abs(np.concatenate([end.zeros for end in ends]))
    slowest = float(np.min(rates[rates > 0], initial=np.inf))
    if certificate.worst(exact=False) > ACCURACY and slowest * hold < SHORT:
        raise PlanError(
            f"holds of {hold:g} s are too short beside zeros of {slowest:.3g} rad/s: one changes what belongs to these so little "
            f"that rounding leaves {certificate.worst(exact=False):.1e} of the motion; plan without hold, which costs an error of "
            "the order of the hold squared, or with a longer one"
        )


def _rest(system: StateSpace, outputs: Array) -> tuple[Array, Array]:
    """State and input, as deviations from the interval's rest, that hold absolute outputs; raises NonHyperbolicError for none."""
    n = system.n_states
    away = outputs - system.operating_point.y0
    J, rhs = np.block([[system.A, system.B], [system.C, system.D]]), np.concatenate([np.zeros(n), away])
    rows = np.max(np.abs(J), axis=1, initial=0.0)
    rows = np.where(rows > 0, rows, 1.0)
    columns = np.max(np.abs(J / rows[:, None]), axis=0, initial=0.0)
    columns = np.where(columns > 0, columns, 1.0)
    found = scipy.linalg.lstsq(J / rows[:, None] / columns, rhs / rows, cond=1e-12)[0] / columns
    if np.max(np.abs(J @ found - rhs) / rows, initial=0.0) > ACCURACY * np.max(np.abs(rhs) / rows, initial=0.0):
        raise NonHyperbolicError(
            f"no rest with the outputs held at {outputs.tolist()}: they drive zeros at the origin, and what belongs to these never "
            "comes to rest; let the reference start and end at the operating point"
        )
    return found[:n], found[n:]


def _choice(plant: SwitchedSystem, hold: float) -> tuple[tuple[bool, ...], tuple[End, End]]:
    """Whether each output is met at the end of a hold, and both ends, for the largest gap. Raises what `_nothing_suits` says."""
    best: tuple[float, tuple[bool, ...], list[End]] | None = None
    for scheme in candidate_schemes(1, plant.n_outputs):
        try:
            found = [SampledElement.of(system, hold, scheme.at_end).end(zeros(system)) for system in plant.distinct]
        except np.linalg.LinAlgError:
            continue
        gap = min(end.gap for end in found)
        if best is None or gap > best[0]:
            best = gap, scheme.at_end, found
    if best is None:
        raise RelativeDegreeError(
            f"no inverse for holds of {hold:.3g} s: within one the inputs {list(plant.inputs.names)} hardly act on the outputs "
            f"{list(plant.outputs.names)}; track outputs nearer to the actuators"
        )
    gap, at_end, found = best
    if gap < LEAST_GAP:
        listed = format_zeros(np.concatenate([zeros(system) for system in plant.distinct]))
        raise NonHyperbolicError(
            f"no inverse for holds of {hold:.3g} s that forgets its errors: modes of the sampled inverse come within "
            f"|log |lambda|| = {gap:.2g} of the unit circle, {LEAST_GAP} is the least; the zeros are {listed}. Zeros about as fast "
            "as the holds do that: plan with another hold, or track another output"
        )
    return at_end, (found[plant.numbers[0]], found[plant.numbers[-1]])


def _mesh(problem: PlanningProblem, hold: float, ends: Sequence[End]) -> Mesh:
    """Holds over the manoeuvre, and on both sides of it until what they add of their own is forgotten. Raises PlanError."""
    stops = np.unique(np.concatenate([problem.reference.breakpoints, problem.plant.switch_times]))
    before, after = (hold * np.ceil(FORGOTTEN / min(end.gap, LEAST_GAP * 5)) for end in ends)
    count = (stops[-1] - stops[0] + before + after) / hold
    if count > MOST_HOLDS:
        raise PlanError(
            f"the plan takes {count:.0f} holds of {hold:g} s, of which {MOST_HOLDS} are planned at most; take a longer hold, or a "
            "shorter motion"
        )
    return Mesh.even(np.concatenate([[stops[0] - before], stops, [stops[-1] + after]]), problem.plant.switch_times, hold)


def _elements(plant: SwitchedSystem, mesh: Mesh, at_end: tuple[bool, ...]) -> list[tuple[Indices, SampledElement]]:
    """The distinct elements, and which holds (k,) are of each kind."""
    lengths = np.array([float(f"{length:.10g}") for length in mesh.lengths])
    kinds, kind = np.unique(np.column_stack([plant.numbers[mesh.interval], lengths]), axis=0, return_inverse=True)
    return [
        (np.flatnonzero(kind == k), SampledElement.of(plant.distinct[int(number)], float(length), at_end))
        for k, (number, length) in enumerate(kinds)
    ]


def _solve(
    problem: PlanningProblem,
    mesh: Mesh,
    elements: Sequence[tuple[Indices, SampledElement]],
    ends: tuple[End, End],
    rests: Sequence[tuple[Array, Array]],
) -> HeldMotion:
    """The bounded motion.

    Args:
        problem: plant and reference.
        mesh, elements: the holds, and which are of each kind.
        ends: conditions before and after.
        rests: state and input held there, as deviations from the interval's rest.
    """
    plant, N = problem.plant, len(mesh)
    rest_x, rest_u, rest_y = (rest[mesh.interval] for rest in (plant.rest_states, plant.rest_inputs, plant.rest_outputs))
    M, b = np.empty((N, plant.n_states, plant.n_states)), np.empty((N, plant.n_states))
    wanted = np.empty((N, plant.n_outputs))
    for chosen, element in elements:
        inside = (mesh.edges[chosen] + mesh.edges[chosen + 1]) / 2
        for i, share in enumerate(element.shares):
            times = np.minimum(mesh.edges[chosen] + share * mesh.lengths[chosen], mesh.edges[chosen + 1])
            wanted[chosen, i] = problem.reference(times, inside=inside)[:, i] - rest_y[chosen, i]
        M[chosen] = element.exact
        b[chosen] = rest_x[chosen] - rest_x[chosen] @ element.exact.T + wanted[chosen] @ element.push.T
    (start, end), first, last = ends, plant.rest_states[0] + rests[0][0], plant.rest_states[-1] + rests[1][0]
    L, R = start.start_rows(), end.end_rows()
    x = TwoPointProblem.of(M, L, R, plant_units(plant.systems[0])).solve(b, L @ first, R @ last)
    u = np.empty((N, plant.n_inputs))
    for chosen, element in elements:
        u[chosen] = rest_u[chosen] + wanted[chosen] @ element.gain.T - (x[chosen] - rest_x[chosen]) @ element.back.T
    return HeldMotion(mesh, x, u)


def _certified(
    problem: PlanningProblem, motion: HeldMotion, trajectory: Trajectory, elements: Sequence[tuple[Indices, SampledElement]]
) -> tuple[Certificate, float]:
    """The certificate of the plan's values over its holds, and by how much outputs miss at their points (share of their motion).

    Args:
        problem, motion, trajectory: the plan.
        elements: which holds are of each kind.
    """
    mesh, first = motion.mesh, problem.plant.n_states + problem.plant.n_inputs
    within = certify(problem.plant, trajectory, problem.deviation, (float(mesh.edges[0]), float(mesh.edges[-1])))
    size = problem.deviation.size(0)
    size = np.where(size > 0, size, max(float(np.max(size)), np.finfo(float).tiny))

    def miss(i: int, chosen: Indices, share: float) -> float:
        times = np.minimum(mesh.edges[chosen] + share * mesh.lengths[chosen], mesh.edges[chosen + 1])
        wanted = problem.deviation(times, inside=(mesh.edges[chosen] + mesh.edges[chosen + 1]) / 2)[:, i]
        reached = trajectory(times, chosen + 1, slice(first + i, first + i + 1))[:, 0]
        return float(np.max(np.abs(reached - wanted), initial=0.0) / size[i])

    outputs, every = range(problem.plant.n_outputs), np.arange(len(mesh))
    between = max(miss(i, every, share) for i in outputs for share in LOOKED_AT)
    matched = max(miss(i, chosen, float(element.shares[i])) for i in outputs for chosen, element in elements)
    # Beyond the mesh the plan goes on along its tails, which are those of the holds and no motion under the plan's own input.
    (start, stop), limits = problem.manoeuvre, (problem.max_preactuation, problem.max_postactuation)
    before, after, _ = actuation_times(trajectory, (start, stop), problem.tolerance, limits)
    peaks = trajectory.peaks[: problem.plant.n_states]
    at_rest = rest_residual(trajectory, (start - before, stop + after), np.where(peaks > 0, peaks, 1.0))
    return replace(within, output_error=max(within.output_error, between), rest_residual=at_rest), matched
