"""From a problem to the motion that meets it: mesh and window, continuation, refinement."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from invtrack.arrays import Array
from invtrack.errors import PlanError
from invtrack.inversion.nonlinear.certificate import state_sizes
from invtrack.inversion.nonlinear.choice import Choice, choose
from invtrack.inversion.nonlinear.continuation import Progress, follow
from invtrack.inversion.nonlinear.decoupling import require_hold_of_outputs
from invtrack.inversion.nonlinear.elements import Scheme
from invtrack.inversion.nonlinear.ends import NEUTRAL, End
from invtrack.inversion.nonlinear.mesh import EVEN, Mesh
from invtrack.inversion.nonlinear.problem import MotionProblem
from invtrack.inversion.nonlinear.refinement import MARGIN, DenseError, carried_over, dense_error, parts_for, steps_for, wanted_at
from invtrack.inversion.nonlinear.rest import rest_with
from invtrack.inversion.nonlinear.shooting import Iteration, Motion, Shooting, at_rest, remaining
from invtrack.inversion.nonlinear.tails import tail_error, tails_of
from invtrack.plans.dynamics import Dynamics

COUNT = 4
"""Coefficients of each input on an element."""

ELEMENTS = 50
"""Elements of the manoeuvre, at least, before refinement."""

FASTEST = 1.0
"""Step of the integration times the fastest mode [rad], at most: classical RK4 is stable up to 2.5."""

LAYER = 12
"""Elements of the window before and after the manoeuvre, at least: in these what the mesh adds of its own dies out."""

FIRST_SHARE = 0.03
"""The window ends at first where so much of the motion in the slowest zero is left."""

LAST_SHARE = 0.5
"""It is extended to where linear tails meet the accuracy, at most until the share left is this times the accuracy's square root:
tails are off by the square of what is left."""

ROUGHLY = 1e-2
"""Of a motion that is to show how long the window must be, so much may be left to find."""

MOST_ELEMENTS = 20_000
"""Elements that are planned, at most."""

WIDESPREAD = 0.25
"""Where the integration is too coarse on fewer elements than this share, these are split; else all take shorter steps."""

REFINEMENTS = 8
"""Meshes that are tried, at most."""


@dataclass(frozen=True, eq=False)
class Solution:
    """The motion that meets its conditions, and the log of Newton's method."""

    shooting: Shooting
    motion: Motion
    log: tuple[Iteration, ...]


@dataclass(frozen=True, eq=False)
class MotionSolver:
    """From a problem to its motion.

    Args:
        problem: mechanism, reference, changes.
        accuracy: largest output error, as a share of the motion.
        limits: longest preactuation and postactuation [s], or None.
        progress: called with the share of the motion that has been found.
    """

    problem: MotionProblem
    accuracy: float
    limits: tuple[float | None, float | None]
    progress: Progress | None

    def refined(self) -> Solution:
        """The motion with continuous inputs on each stretch, on a mesh that meets the accuracy. Raises PlanError."""
        choice = choose(self.problem, COUNT, self._length(), fixed=False)
        solution = self._extended(choice)
        for _ in range(REFINEMENTS):
            solution = self._sized(solution)
            error = dense_error(solution.shooting, solution.motion, self.problem.reference)
            if error.worst <= self.accuracy:
                return solution
            finer = self._finer(solution, choice, error)
            if finer is None:
                break
            choice, solution = finer
        error = dense_error(solution.shooting, solution.motion, self.problem.reference)
        k, mesh = int(np.argmax(np.maximum(error.output, error.defect))), solution.shooting.mesh
        raise PlanError(
            f"the mesh does not get fine enough: with {len(mesh)} elements the error is {error.worst:.1e} of the motion at "
            f"t = {mesh.edges[k]:.6g} s, accuracy={self.accuracy:g} asks for less; ask for no more than can be had, or for a "
            "smoother reference"
        )

    def _finer(self, solution: Solution, choice: Choice, error: DenseError) -> tuple[Choice, Solution] | None:
        """The motion on a finer mesh, or with finer integration on the same one; None where neither helps."""
        shooting = solution.shooting
        both = np.maximum(error.output, error.defect)
        few = np.mean(error.defect > self.accuracy) < WIDESPREAD
        parts = choice.allowed(parts_for(both if few else error.output, self.accuracy, COUNT + 1), shooting.mesh)
        factor = 1 if few and np.any(parts > 1) else steps_for(error.defect, self.accuracy)
        if factor > 1:
            choice, mesh, guess = choice.with_steps(factor), shooting.mesh, solution.motion
        else:
            mesh, owner, shares = shooting.mesh.split(parts)
            if np.all(parts == 1) or len(mesh) > MOST_ELEMENTS:
                return None
            guess = carried_over(shooting, solution.motion, owner, shares)
        conditions = self._conditions(choice.scheme, mesh, 1.0)
        if conditions is None:
            return None
        motion, log = conditions.solve(guess, 1.0, self._newton_tolerance)
        return None if motion is None else (choice, Solution(conditions, motion, solution.log + tuple(log)))

    def held(self, hold: float) -> Solution:
        """The motion with inputs that are constant over each hold, the outputs met once in each."""
        return self._sized(self._extended(choose(self.problem, 1, hold, fixed=True)))

    @property
    def _newton_tolerance(self) -> float:
        return min(1e-8, 0.1 * self.accuracy)

    def _length(self) -> float:
        """Of the elements before refinement [s]."""
        begin, end = self.problem.manoeuvre
        fastest = max(float(np.max(np.abs(np.linalg.eigvals(model.A)))) for model in self.problem.linear_models)
        lengths = [(end - begin) / ELEMENTS] if end > begin else []
        lengths += [FASTEST * Scheme(COUNT, ()).steps / fastest] if fastest > 0 else []
        return min(lengths, default=1.0)

    def _extended(self, choice: Choice) -> Solution:
        """The motion in a window that reaches to where linear tails meet the accuracy, or to the limits."""
        length = choice.length
        slowest = self._slowest(length)
        most = np.maximum(LAYER * length, -np.log(LAST_SHARE * np.sqrt(self.accuracy)) / slowest)
        for end, limit in enumerate(self.limits):
            most[end] = most[end] if limit is None else max(LAYER * length, min(most[end], limit))
        windows = np.minimum(most, np.maximum(LAYER * length, -np.log(FIRST_SHARE) / slowest))
        solution = self._followed(choice.scheme, self._mesh(windows, length), ROUGHLY)
        log = solution.log
        while True:
            errors = self._tail_errors(solution)
            wanting = (errors > self.accuracy) & (windows < most)
            if not np.any(wanting):
                if remaining(solution.log) > self._newton_tolerance:
                    solution = self._followed(choice.scheme, solution.shooting.mesh, self._newton_tolerance, solution)
                    log += solution.log
                return replace(solution, log=log)
            longer = np.log(np.maximum(errors, self.accuracy) / (MARGIN * self.accuracy)) / (2 * slowest)
            windows = np.where(wanting, np.minimum(most, windows + np.maximum(longer, length)), windows)
            solution = self._followed(choice.scheme, self._mesh(windows, length), ROUGHLY, solution)
            log += solution.log

    def _mesh(self, windows: Array, length: float) -> Mesh:
        """Even elements of that length [s] over the manoeuvre and windows (2,) [s] before and after it. Raises PlanError."""
        edges, counts = self.problem.stops, np.ceil(windows / length * (1 - EVEN))
        if counts.sum() + (edges[-1] - edges[0]) / length > MOST_ELEMENTS:
            raise PlanError(
                f"the plan takes {counts.sum() * length + edges[-1] - edges[0]:.4g} s in elements of {length:.3g} s, of which "
                f"{MOST_ELEMENTS} are planned at most; take a longer hold, a shorter motion, less accuracy, or limit "
                "max_preactuation and max_postactuation"
            )
        stops = np.concatenate([[edges[0] - counts[0] * length], edges, [edges[-1] + counts[1] * length]])
        return Mesh.even(stops, self.problem.switch_times, length)

    def _slowest(self, length: float) -> Array:
        """Rates [1/s] of the slowest unstable zero at the start and of the slowest stable one at the end, infinite for none."""
        found = [self.problem.zeros[0].real, -self.problem.zeros[-1].real]
        return np.array([float(np.min(rates[rates * length > NEUTRAL], initial=np.inf)) for rates in found])

    def _tail_errors(self, solution: Solution) -> Array:
        """Of the linear tails before and after the window (2,)."""
        solution, problem = self._sized(solution), self.problem
        shooting, motion = solution.shooting, solution.motion
        model = problem.model(shooting.mesh.edges)
        size = state_sizes(shooting, motion, model)
        tails = tails_of(problem, motion, model, size)
        ends = ((problem.dynamics[0], 0, problem.linear_models[0]), (problem.last_dynamics, -1, problem.linear_models[-1]))
        return np.array(
            [
                tail_error(dynamics, motion.points[end], tail, linear, (size, shooting.motion_size))
                for tail, (dynamics, end, linear) in zip(tails, ends, strict=True)
            ]
        )

    def _conditions(self, scheme: Scheme, mesh: Mesh, amplitude: float) -> Shooting | None:
        """The conditions for a share of the motion; None where its end has no equilibrium, or no such one as the start."""
        problem, last = self.problem, self.problem.rests[-1]
        start = problem.rests[0]
        first, final = problem.held_outputs
        if amplitude < 1.0:
            found = rest_with(problem.last_dynamics, first + amplitude * (final - first), start)
            if found is None:
                return None
            last = found
        ends = (
            End.of(problem.dynamics[0], start, scheme, float(mesh.lengths[0]), problem.zeros[0]),
            End.of(problem.last_dynamics, last, scheme, float(mesh.lengths[-1]), problem.zeros[-1]),
        )
        if ends[0].expanding != ends[1].expanding:
            return None
        wanted = wanted_at(mesh, problem.reference, np.arange(1, scheme.steps + 1) / scheme.steps)
        wanted = first + amplitude * (wanted - first)
        matched = np.stack([wanted[:, scheme.points[i] - 1, i] for i in range(wanted.shape[2])], axis=1)
        return Shooting(problem.dynamics, mesh, scheme, matched, problem.motion_size, ends)

    def _followed(self, scheme: Scheme, mesh: Mesh, tolerance: float, inner: Solution | None = None) -> Solution:
        """The motion on a mesh, from one on a part of it if that is known, else from rest. Raises PlanError.

        Args:
            scheme, mesh: the elements.
            tolerance: of what is left after the last Newton step, as a share of peaks.
            inner: the motion on a part of the mesh.
        """
        whole = self._conditions(scheme, mesh, 1.0)
        if whole is None:
            raise PlanError("elements of unlike lengths at the ends have unlike numbers of expanding multipliers; plan with a hold")
        if inner is not None:
            motion, log = whole.solve(_padded(inner, whole), 1.0, tolerance)
            if motion is not None:
                return Solution(whole, motion, tuple(log))
        first = at_rest(whole.ends[0], mesh, scheme)
        found = follow(lambda amplitude: self._conditions(scheme, mesh, amplitude), first, tolerance, self.progress)
        if found.motion is not None:
            require_hold_of_outputs(found.shooting, found.motion, self.problem.relative_degree, found.amplitude)
        if found.motion is None or found.amplitude < 1.0:
            raise PlanError(
                f"no motion found: Newton's method follows it up to {found.amplitude:.3g} of the way from rest ({len(found.log)} "
                "steps); beyond, the inverse may cease to exist (an actuator that loses its effect, a posture that turns over). "
                "Ask for a smaller or slower motion, or go by way of another posture"
            )
        return Solution(found.shooting, found.motion, found.log)

    def _sized(self, solution: Solution) -> Solution:
        """With sizes also for outputs that are to stay still: what the states could make of them."""
        shooting, motion, models = solution.shooting, solution.motion, self.problem.linear_models
        moves = self.problem.motion_size
        possible = np.abs(models[0].C) @ state_sizes(shooting, motion, self.problem.model(shooting.mesh.edges))
        size = np.where(moves > 0, moves, np.where(possible > 0, possible, 1.0))
        return replace(solution, shooting=replace(shooting, motion_size=size))


def _padded(inner: Solution, whole: Shooting) -> Motion:
    """A motion on a mesh that has more elements at its ends, over which it leaves and returns as a small motion about rest does."""
    before = int(np.argmin(np.abs(whole.mesh.edges - inner.shooting.mesh.edges[0])))
    after = len(whole.mesh) - len(inner.shooting.mesh) - before
    points, coefficients = inner.motion.points, inner.motion.coefficients
    (start, end), dynamics = whole.ends, whole.dynamics
    first = start.leaving(dynamics[0].difference(points[:1], start.rest.point[None])[0], before)
    away = dynamics[-1].difference(points[-1:], end.rest.point[None])
    last = end.returning(away[0], after)
    return Motion(
        np.vstack([_about(start, first, dynamics[0]), points, _about(end, last, dynamics[-1])]),
        np.concatenate(
            [_held(start, first, coefficients), coefficients, _held(end, np.vstack([away, last])[:after], coefficients)]
        ),
    )


def _about(end: End, away: Array, dynamics: Dynamics) -> Array:
    """The points at tangents (k, n) from rest (k, .)."""
    return dynamics.retract(np.repeat(end.rest.point[None], len(away), axis=0), away)


def _held(end: End, away: Array, like: Array) -> Array:
    """Coefficients (k, s, m) of the inputs on elements that start at tangents (k, n) from rest, in the form of others'."""
    coefficients = (away @ end.inputs.T).reshape(len(away), *like.shape[1:])
    coefficients[:, 0] += end.rest.inputs
    return np.asarray(coefficients)
