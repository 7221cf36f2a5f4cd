"""Exact tracking by inputs that a zero-order hold makes: the inverse of the sampled plant, linear and switched."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from invtrack.arrays import Indices, require_duration
from invtrack.errors import BoundednessError, NonHyperbolicError, PlanError, RelativeDegreeError
from invtrack.inversion.axis_zeros import require_rest_held, split_through_axis
from invtrack.inversion.bounded_solution import inverse_problem
from invtrack.inversion.held_end import HeldEnd
from invtrack.inversion.held_mean import HeldMean
from invtrack.inversion.held_motion import HeldMotion
from invtrack.inversion.held_outputs import held_outputs
from invtrack.inversion.held_trajectory import trajectory_of_holds
from invtrack.inversion.hold_coordinates import HoldCoordinates
from invtrack.inversion.inverse_system import InverseSystem, inverse_systems
from invtrack.inversion.nonlinear.elements import candidate_schemes
from invtrack.inversion.nonlinear.ends import gap_of
from invtrack.inversion.nonlinear.mesh import Mesh
from invtrack.inversion.sampled_element import LEAST_GAP, SampledElement
from invtrack.inversion.smoothness import require_smooth
from invtrack.inversion.whole_holds import held_remark, in_whole_holds
from invtrack.linear.internal_dynamics import format_zeros
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.linear.zeros import zeros
from invtrack.plans.certificate import Certificate, certify, rest_residual
from invtrack.plans.plan import Plan
from invtrack.plans.problem import PlanningProblem, actuation_times
from invtrack.plans.trajectory import Trajectory

FORGOTTEN = 36.0
"""The plan has as many holds before and after the manoeuvre as take what they add of their own to exp(-FORGOTTEN)."""

LOOKED_AT = (0.25, 0.5, 0.75, 1.0)
"""Shares of a hold after which outputs are compared with those wanted."""

AS_FAST = (0.5, 50.0)
"""Zeros z with |z| times the hold between these are about as fast as the holds."""

MOST_MISSED = 1.0
"""A plan whose outputs miss by more than this share of their motion between the points where they are met is none."""

MOST_HOLDS = 200_000
"""Holds that are planned, at most."""


def held_inverse(problem: PlanningProblem, hold: float) -> Plan:
    """The plan whose inputs are constant over each hold, with the outputs exact once in it; see `invtrack.invert`.

    x_(k+1) = A_d x_k + B_d u_k with exact matrix exponentials. Outputs of even relative degree are met in the middle of each hold,
    those of odd at its end: so sampling zeros stay away from the unit circle (K. J. Astrom, P. Hagander, J. Sternby, 1984). Holds
    begin at breakpoints of the reference and at jumps; where these lie no whole number of holds apart, those between are even, and
    shorter. What is solved for is what holds change of the continuous inverse.

    Args:
        problem: of a plant with as many inputs as outputs, and a reference from rest to rest.
        hold: the period [s].
    """
    require_duration("hold", hold, error=PlanError)
    plant = problem.plant
    _require_square(plant)
    held_outputs(problem.reference, "a plan for a zero-order hold")  # refuses a reference that goes on moving
    splits = split_through_axis(plant)
    require_rest_held(problem, splits)
    require_smooth(plant, [split.internal for split in splits], problem.deviation)
    inverses = inverse_systems(plant, splits)
    of_each = [inverses[int(np.argmax(plant.numbers == k))] for k in range(len(plant.distinct))]
    holds = [
        _chosen(system, HoldCoordinates.of(inverse, hold), hold) for system, inverse in zip(plant.distinct, of_each, strict=True)
    ]
    # It need not be continuous at jumps: what it misses there is made good as well.
    continuous = inverse_problem(problem, inverses).solve().trajectory()
    ends = _ends(plant, inverses, continuous, [element for element, _ in holds])
    mesh = _mesh(problem, hold, [holds[plant.numbers[k]][1] for k in (0, -1)])
    elements = _elements(plant, mesh, [element for element, _ in holds])
    motion = HeldMotion.of(plant, HeldMean.of(plant, continuous, mesh, elements), mesh, elements, ends)
    trajectory = trajectory_of_holds(plant, motion, ends)
    certificate, missed = _certified(problem, motion, trajectory, elements)
    replace(certificate, output_error=missed).require(exact=problem.asks_for_motion, method="stable inversion for a hold")
    _require_followed(hold, certificate)
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


def _require_followed(hold: float, certificate: Certificate) -> None:
    """Raises PlanError where outputs are far off between the points at which they are met."""
    if certificate.output_error > MOST_MISSED:
        raise PlanError(
            f"inputs held over {hold:g} s do not make the outputs follow: met once in each hold, these miss by "
            f"{certificate.output_error:.2g} of their motion in between. Try shorter holds; where that makes it no better, "
            "parameters jump so that no continuous state keeps the outputs, as `invert` without hold then says: use "
            "quadratic_redesign, which spreads the error"
        )


def _chosen(system: StateSpace, coordinates: HoldCoordinates, hold: float) -> tuple[SampledElement, float]:
    """A hold [s] of the model, each output met where that leaves the largest gap to the unit circle, and this gap.

    Raises RelativeDegreeError or NonHyperbolicError where nothing suits.
    """
    found: list[tuple[SampledElement, float]] = []
    for scheme in candidate_schemes(1, system.n_outputs):
        try:
            element = SampledElement.of(coordinates, hold, scheme.at_end)
        except np.linalg.LinAlgError:
            continue
        found.append((element, gap_of(element.exact, zeros(system) * hold, 1)))
    if not found:
        raise RelativeDegreeError(
            f"no inverse for holds of {hold:.3g} s: within one the inputs {list(system.inputs.names)} hardly act on the outputs "
            f"{list(system.outputs.names)}; track outputs nearer to the actuators"
        )
    element, gap = max(found, key=lambda each: each[1])
    if gap < LEAST_GAP:
        rates = np.abs(zeros(system)) * hold
        if np.any((rates > AS_FAST[0]) & (rates < AS_FAST[1])):
            reason = f"zeros about as fast as the holds do that, and there are {format_zeros(zeros(system))}"
        else:
            reason = "no zero is about as fast: sampling adds such modes where inputs reach outputs late, or several together"
        raise NonHyperbolicError(
            f"no inverse for holds of {hold:.3g} s that forgets its errors: modes of the sampled inverse come within "
            f"|log |lambda|| = {gap:.2g} of the unit circle, {LEAST_GAP} is the least; {reason}. Plan with another hold or "
            "without, or track another output"
        )
    return element, gap


def _mesh(problem: PlanningProblem, hold: float, gaps: Sequence[float]) -> Mesh:
    """Holds over the manoeuvre, and on both sides of it until what they add of their own is forgotten. Raises PlanError."""
    stops = np.unique(np.concatenate([problem.reference.breakpoints, problem.plant.switch_times]))
    before, after = (hold * np.ceil(FORGOTTEN / min(gap, LEAST_GAP * 5)) for gap in gaps)
    count = (stops[-1] - stops[0] + before + after) / hold
    if count > MOST_HOLDS:
        raise PlanError(
            f"the plan takes {count:.0f} holds of {hold:g} s, of which {MOST_HOLDS} are planned at most; take a longer hold, or a "
            "shorter motion"
        )
    return Mesh.even(np.concatenate([[stops[0] - before], stops, [stops[-1] + after]]), problem.plant.switch_times, hold)


def _ends(
    plant: SwitchedSystem, inverses: Sequence[InverseSystem], continuous: Trajectory, elements: Sequence[SampledElement]
) -> tuple[HeldEnd, HeldEnd]:
    """Conditions before and after the manoeuvre. Raises BoundednessError or NonHyperbolicError.

    Args:
        plant, inverses: the plant, and the inverse of each interval.
        continuous: the trajectory of the inverse.
        elements: a hold of each distinct model.
    """
    before = HeldEnd.of(inverses[0], elements[plant.numbers[0]], continuous.before, "before")
    after = HeldEnd.of(inverses[-1], elements[plant.numbers[-1]], continuous.after, "after")
    if before.expanding != after.expanding:
        raise BoundednessError(
            f"no bounded inverse for holds of {before.element.length:g} s: before the manoeuvre {before.expanding} mode(s) of the "
            f"sampled inverse grow, which gives as many unknowns, after it {after.expanding}, which gives as many conditions; the "
            "last interval's parameters, or the output, have to change"
        )
    return before, after


def _elements(plant: SwitchedSystem, mesh: Mesh, models: Sequence[SampledElement]) -> list[tuple[Indices, SampledElement]]:
    """The distinct elements, and which holds (k,) are of each kind; models: a hold of each distinct model."""
    lengths = np.array([float(f"{length:.10g}") for length in mesh.lengths])
    kinds, kind = np.unique(np.column_stack([plant.numbers[mesh.interval], lengths]), axis=0, return_inverse=True)
    found = []
    for k, number in enumerate(kinds[:, 0].astype(int).tolist()):
        chosen = np.flatnonzero(kind == k)
        found.append((chosen, models[number].lasting(float(np.mean(mesh.lengths[chosen])))))
    return found


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
