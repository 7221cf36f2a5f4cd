"""The usual practice on a nonlinear mechanism: the posture and the inputs that would hold each wanted output at rest."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import scipy  # loads scipy.interpolate at its first use

from invtrack.arrays import Array
from invtrack.errors import PlanError
from invtrack.inversion.nonlinear.problem import MotionProblem
from invtrack.inversion.nonlinear.rest import Rest, rests_along
from invtrack.linear.state_sizes import comparable_size, unit_ratios
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.certificate import Certificate
from invtrack.plans.dynamics import Dynamics, Mechanism, ScheduledChange
from invtrack.plans.linearizations import Linearizations
from invtrack.plans.plan import Plan, intervals_of_pieces
from invtrack.plans.problem import left_out_of
from invtrack.plans.tail import Tail
from invtrack.plans.trajectory import PolynomialSegments, Trajectory
from invtrack.references.signal import PiecewiseSignal

POSTURES = 64
"""Stretches of time between postures that are solved, on each piece of the motion."""


def steady_motion(mechanism: Mechanism, reference: PiecewiseSignal, schedule: Sequence[ScheduledChange] = ()) -> Plan:
    """State and input that would hold the outputs of a mechanism at y_d(t) if it stood still there: f(x, u) = 0, h(x, u) = y_d.

    Between the postures that are solved it is a cubic spline. See `invtrack.inversion.steady_state_feedforward`.

    Args:
        mechanism: at an equilibrium in which the reference begins.
        reference: from rest to rest, absolute.
        schedule: changes of its parameters.

    Raises PlanError where there is no equilibrium on the way, and what `invert` raises of the same arguments.
    """
    return steady_plan(MotionProblem.of(mechanism, reference, schedule))


def steady_plan(problem: MotionProblem, postures: int = POSTURES) -> Plan:
    """The steady motion of a problem, with so many stretches between postures on each piece of it.

    Raises PlanError where there is no equilibrium on the way.
    """
    mechanism, reference = problem.mechanism, problem.reference
    stretches = _stretches(problem, postures)
    edges = np.concatenate([*(times[:-1] for times, _, _ in stretches), stretches[-1][0][-1:]])
    model = problem.model(edges)
    interval = intervals_of_pieces(model, edges)[1:-1]
    rest = np.hstack([model.rest_states, model.rest_inputs, model.rest_outputs])
    coefficients = np.concatenate([_spline(times, values) for times, values, _ in stretches])
    coefficients[:, 0] -= rest[interval]
    ends = [values[end] - rest[end] for end, (_, values, _) in ((0, stretches[0]), (-1, stretches[-1]))]
    trajectory = Trajectory(
        breakpoints=edges,
        groups=(PolynomialSegments(coefficients, np.diff(edges)),),
        group=np.zeros(len(coefficients), dtype=np.intp),
        number=np.arange(len(coefficients)),
        before=Tail.holding(-1, ends[0]),
        after=Tail.holding(1, ends[1]),
    )
    A, B = (np.concatenate([both[which] for _, _, both in stretches]) for which in (0, 1))
    return Plan(
        method="steady-state feedforward",
        model=model,
        reference=reference,
        trajectory=trajectory,
        manoeuvre=problem.manoeuvre,
        preactuation=0.0,
        postactuation=0.0,
        tolerance=1e-10,
        certificate=_certificate(stretches, model),
        remarks=("not a trajectory of the plant: the steady state of each wanted output", *left_out_of(model)),
        difference=mechanism.state_difference if mechanism.turns else None,
        linearizations=Linearizations(edges, A, B),
    )


Stretch = tuple[Array, Array, tuple[Array, Array]]
"""Times (k,) [s], [x; u; y] of the postures then (k, r), and A and B between them (k - 1, n, n) and (k - 1, n, m)."""


def _stretches(problem: MotionProblem, postures: int) -> list[Stretch]:
    """The postures between two stops of the motion, for all of them."""
    stops = problem.stops if len(problem.stops) > 1 else problem.stops[0] + np.array([0.0, 1.0])  # where nothing ever moves
    near, found = problem.rests[0], []
    for begin, end in pairwise(stops):
        times, middle = np.linspace(begin, end, postures + 1), (begin + end) / 2
        dynamics = problem.dynamics[int(np.searchsorted(problem.switch_times, middle, side="right"))]
        outputs = problem.reference(times, inside=np.full(len(times), middle))
        rests = _postures(problem, dynamics, times, outputs, near)
        near = rests[-1]
        points, inputs = np.array([rest.point for rest in rests]), np.array([rest.inputs for rest in rests])
        between = dynamics.retract(points[:-1], dynamics.difference(points[1:], points[:-1]) / 2)
        along = dynamics.derivatives(between, (inputs[1:] + inputs[:-1]) / 2)
        states = dynamics.state_coordinates
        values = np.hstack([dynamics.states(points), inputs, outputs])
        found.append((times, values, (along.A[:, states][:, :, states], along.B[:, states])))
    return found


def _postures(problem: MotionProblem, dynamics: Dynamics, times: Array, outputs: Array, near: Rest) -> list[Rest]:
    """The equilibria with outputs (k, p), each found from the one before it. Raises PlanError where there is none."""
    rests = []
    for time, wanted, rest in zip(times, outputs, rests_along(dynamics, outputs, near), strict=True):
        if rest is None:
            raise PlanError(
                f"plant {problem.mechanism.name!r} has no equilibrium with the outputs {np.round(wanted, 6).tolist()} that are "
                f"wanted at t = {time:.6g} s, at least none near those before it; lead the reference past postures in which the "
                "inputs can hold it"
            )
        rests.append(rest)
    return rests


def _spline(times: Array, values: Array) -> Array:
    """Coefficients (k - 1, 4, r), by powers of the share of each stretch, of the cubic spline through values (k, r)."""
    coefficients = scipy.interpolate.CubicSpline(times, values).c[::-1].transpose(1, 0, 2)
    return np.asarray(coefficients * np.diff(times)[:, None, None] ** np.arange(4)[:, None])


def _certificate(stretches: Sequence[Stretch], model: SwitchedSystem) -> Certificate:
    """How far it is from a motion: at rest in each posture, the plant does not go on to the next one."""
    n = model.n_states
    states = [values[:, :n] for _, values, _ in stretches]
    size = comparable_size(np.max(np.abs(np.vstack(states) - model.rest_states[0]), axis=0), unit_ratios(model))
    size = np.where(size > 0, size, 1.0)
    jumps = np.array([after[0] - before[-1] for before, after in pairwise(states)]).reshape(-1, n)
    return Certificate(
        dynamics_residual=float(max(np.max(np.abs(np.diff(each, axis=0)) / size) for each in states)),
        output_error=0.0,
        continuity=float(np.max(np.abs(jumps) / size, initial=0.0)),
        rest_residual=0.0,
    )
