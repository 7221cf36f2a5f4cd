"""From a problem to the motion that meets it: mesh, Newton's method, continuation, refinement."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from invtrack.arrays import Array
from invtrack.errors import PlanError
from invtrack.inversion.nonlinear.balance import balanced
from invtrack.inversion.nonlinear.bend import Bending
from invtrack.inversion.nonlinear.certificate import state_sizes
from invtrack.inversion.nonlinear.choice import Choice, choose
from invtrack.inversion.nonlinear.continuation import Progress, follow
from invtrack.inversion.nonlinear.decoupling import require_hold_of_outputs
from invtrack.inversion.nonlinear.elements import Scheme
from invtrack.inversion.nonlinear.ends import End
from invtrack.inversion.nonlinear.manifold import curved
from invtrack.inversion.nonlinear.mesh import EVEN, Mesh
from invtrack.inversion.nonlinear.newton import Iteration, converged, remaining
from invtrack.inversion.nonlinear.problem import MotionProblem
from invtrack.inversion.nonlinear.refinement import DenseError, dense_error, parts_for, steps_for, wanted_at
from invtrack.inversion.nonlinear.rest import rest_with
from invtrack.inversion.nonlinear.shooting import Motion, Shooting, at_rest
from invtrack.inversion.nonlinear.tails import known, tail_errors
from invtrack.inversion.nonlinear.windows import LAYER, MARGIN, NONE_RESTING, Windows
from invtrack.plans.tail import SIDES
from invtrack.references.signal import PiecewiseSignal

COUNT = 4
"""Coefficients of each input on an element."""

ELEMENTS = 50
"""Elements of the manoeuvre, at least, before refinement."""

FASTEST = 1.0
"""Step of the integration times the fastest mode [rad], at most: classical RK4 is stable up to 2.5."""

ROUGHLY = 1e-2
"""A motion of which so much is left to find shows which mesh it needs."""

KNOWN = 0.5
"""Misses at matched points up to this share of the accuracy do not hide those in between."""

LEFT = 0.1
"""Share of the accuracy that Newton's method may leave to find."""

WORTHWHILE = 1e-2
"""Tails with powers are used where they are off by no more than this share of what linear ones are."""

MOST_ELEMENTS = 20_000
"""Elements that are planned, at most."""

WIDESPREAD = 0.25
"""Where the integration is too coarse on fewer elements than this share, these are split; else all take shorter steps."""

MESHES = 10
"""Meshes that are tried, at most."""


@dataclass(frozen=True, eq=False)
class Solution:
    """A motion, the conditions that it meets, what its elements were chosen by, and the log of Newton's method."""

    choice: Choice
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
        bending: by what outputs may be bent, and which zeros are to rest outside of that for it; None: they are followed exactly.
    """

    problem: MotionProblem
    accuracy: float
    limits: tuple[float | None, float | None]
    progress: Progress | None
    bending: Bending | None = None

    def refined(self) -> Solution:
        """The motion with continuous inputs on each stretch, on a mesh that meets the accuracy. Raises PlanError.

        The mesh is changed as soon as the motion is known roughly, so that Newton's method takes its first steps on coarse meshes,
        and hardly more of them than on one: on each mesh it begins from what it knew on the one before.
        """
        solution = coarse = self._rough()
        windows, known_to = self._windows(solution.choice), ROUGHLY
        while True:
            size = state_sizes(solution.shooting, solution.motion, self.problem.model(solution.shooting.mesh.edges))
            error = dense_error(solution.shooting, solution.motion, self.outputs_of(solution.motion), size)
            finer = self._finer(solution, error, windows)
            if finer is not None:
                found, log = self._carried(solution, *finer, known_to)
                if found is not None:
                    solution = found
                elif known_to > self._tolerance:  # errors of a motion that was known too roughly called for that mesh
                    known_to = self._tolerance
                    solution = self._continued(replace(coarse, log=log), coarse.choice, coarse.shooting.mesh, known_to)
                else:
                    solution = self._followed(*finer, known_to, replace(solution, log=log))
            elif self._left(solution) > self._tolerance:
                solution = self._continued(solution, solution.choice, solution.shooting.mesh, self._tolerance)
            elif np.max(error.worst) <= self.accuracy:
                return solution
            else:
                raise _not_fine_enough(solution.shooting.mesh, error, self.accuracy)

    def held(self, hold: float) -> Solution:
        """The motion with inputs that are constant over each hold, the outputs met once in each: found from the continuous one."""
        choice, (begin, end) = choose(self.problem, 1, hold, fixed=True), self.problem.manoeuvre
        solution = self._rough()
        windows = self._windows(solution.choice)
        solution = self._within(solution, windows.inner(solution.shooting.mesh))
        while True:
            mesh, final = solution.shooting.mesh, solution.choice is choice
            errors = tail_errors(self.problem, solution.shooting, solution.motion, known_well=final)
            more = windows.lacking(mesh, errors, _degrees(solution.shooting))
            if final and np.all((errors <= self.accuracy) | (more < hold)):
                return solution
            reach = np.maximum(np.array([begin - mesh.edges[0], mesh.edges[-1] - end]) + more, LAYER * hold)
            first, last = np.array([begin, end]) + np.array([-1, 1]) * hold * np.ceil(reach / hold * (1 - EVEN))
            _require_few((last - first) / hold, last - first, f"in holds of {hold:.3g} s")
            stops = np.unique(np.concatenate([[first], self.problem.stops, [last]]))
            held = Mesh.even(stops, self.problem.switch_times, hold)
            solution = self._held_on(held, choice, solution)

    def _within(self, solution: Solution, kept: slice) -> Solution:
        """The part of a motion on some of its elements, with tails from there on."""
        shooting, motion, mesh = solution.shooting, solution.motion, solution.shooting.mesh
        if len(range(len(mesh))[kept]) == len(mesh):
            return solution
        inner = Mesh(mesh.edges[kept.start : kept.stop + 1], mesh.interval[kept])
        found = self._conditions(shooting.scheme, inner, 1.0)
        if found is None:
            return solution
        found = replace(found, motion_size=shooting.motion_size, number=shooting.number)
        motion = Motion(motion.points[kept.start : kept.stop + 1], motion.coefficients[kept], motion.bend)
        return replace(solution, shooting=self._with_tails(found, motion), motion=motion)

    def _held_on(self, mesh: Mesh, choice: Choice, solution: Solution) -> Solution:
        """The motion for inputs held on a mesh, from what is known of it; misses beside stops are as small as they get."""
        found = self._continued(solution, choice, mesh, ROUGHLY)
        shooting, motion = found.shooting, found.motion
        _, away = shooting.misses(motion, shooting.nodes(motion))
        if np.max(np.abs(away) / shooting.motion_size[:, None]) > KNOWN * self.accuracy and self._left(found) > self._tolerance:
            found = self._continued(found, choice, mesh, self._tolerance)
        if self.bending is None:
            own = balanced(found.shooting, found.motion, self.problem.reference, self.problem.stops, self.accuracy)
            if own is not None:
                return self._continued(replace(found, shooting=own), choice, mesh, self._tolerance)
        return found if self._left(found) <= self._tolerance else self._continued(found, choice, mesh, self._tolerance)

    def outputs_of(self, motion: Motion) -> PiecewiseSignal:
        """The outputs that a motion is to have, absolute."""
        wanted = self.problem.reference
        return wanted if self.bending is None else wanted + self.bending.bumps.signal(motion.bend)

    @property
    def _tolerance(self) -> float:
        """What Newton's method may leave to find in the plan, as a share of peaks."""
        return LEFT * self.accuracy

    def _rough(self) -> Solution:
        """The motion with continuous inputs, known well enough to show what mesh it needs. Raises PlanError."""
        begin, end = self.problem.manoeuvre
        length = min(self._longest, (end - begin) / ELEMENTS if end > begin else 1.0)
        choice = choose(self.problem, COUNT, length, fixed=False)
        stops = self.problem.stops if self.bending is None else np.union1d(self.problem.stops, self.bending.bumps.knots)
        mesh = self._windows(choice).first(Mesh.even(stops, self.problem.switch_times, choice.length))
        _require_few(len(mesh), mesh.edges[-1] - mesh.edges[0], f"in elements of {choice.length:.3g} s and more")
        return self._followed(choice, mesh, ROUGHLY)

    def _windows(self, choice: Choice) -> Windows:
        resting = NONE_RESTING if self.bending is None else self.bending.zeros
        return Windows(self.problem, choice, self.accuracy, self.limits, self._longest, resting)

    @property
    def _longest(self) -> float:
        """Length of elements [s] over which the integration follows the fastest mode."""
        fastest = max(float(np.max(np.abs(np.linalg.eigvals(model.A)))) for model in self.problem.linear_models)
        return FASTEST * Scheme(COUNT, ()).steps / fastest if fastest > 0 else np.inf

    def _finer(self, solution: Solution, error: DenseError, windows: Windows) -> tuple[Choice, Mesh] | None:
        """Elements and mesh that a motion needs to meet the accuracy, None where those it has will do, or others do not help."""
        shooting, choice = solution.shooting, solution.choice
        if shooting.number >= MESHES:
            return None
        few = np.mean(error.defect > self.accuracy) < WIDESPREAD
        to_blame = np.maximum(error.between, error.defect) if few else error.between
        parts = choice.allowed(parts_for(to_blame, self.accuracy, COUNT + 1), shooting.mesh)
        factor = 1 if few and np.any(parts > 1) else steps_for(error.defect, self.accuracy, choice.scheme.method.order)
        mesh = shooting.mesh.split(parts)
        known_well = self._left(solution) <= self._tolerance
        errors = tail_errors(self.problem, shooting, solution.motion, known_well=known_well)
        longer = windows.longer(mesh, errors, _degrees(shooting))
        if longer is None and np.all(parts == 1) and factor == 1:
            return None
        mesh = mesh if longer is None else longer
        _require_few(len(mesh), mesh.edges[-1] - mesh.edges[0], f"in elements of {choice.length:.3g} s and less")
        return choice.with_steps(factor), mesh

    def _continued(self, solution: Solution, choice: Choice, mesh: Mesh, tolerance: float) -> Solution:
        """The motion on a mesh, another one or its own, from what is known of it, or else from rest."""
        found, log = self._carried(solution, choice, mesh, tolerance)
        return self._followed(choice, mesh, tolerance, replace(solution, log=log)) if found is None else found

    def _carried(
        self, solution: Solution, choice: Choice, mesh: Mesh, tolerance: float
    ) -> tuple[Solution | None, tuple[Iteration, ...]]:
        """The motion on a mesh, another one or its own, from what is known of it, and all steps; None where they lead nowhere."""
        conditions, guess = solution.shooting, solution.motion
        if mesh is not conditions.mesh:
            guess = known(self.problem, conditions, guess).on(mesh, choice.scheme.count)
            found = self._conditions(choice.scheme, mesh, 1.0)
            if found is None:
                raise _unlike_ends(mesh)
            found = replace(found, number=conditions.number + 1, motion_size=conditions.motion_size)
            conditions = self._with_tails(found, guess)
        motion, log = converged(conditions, guess, tolerance, log=solution.log)
        return (None if motion is None else self._sized(Solution(choice, conditions, motion, log))), log

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
        border = None if self.bending is None else self.bending.border(ends)
        return Shooting(problem.dynamics, mesh, scheme, matched, problem.motion_size, ends, border=border)

    def _followed(self, choice: Choice, mesh: Mesh, tolerance: float, tried: Solution | None = None) -> Solution:
        """The motion on a mesh, from rest. Raises PlanError.

        Args:
            choice, mesh: the elements.
            tolerance: of what is left after the last Newton step, as a share of peaks.
            tried: what did not lead to it.
        """
        whole = self._conditions(choice.scheme, mesh, 1.0)
        if whole is None:
            raise _unlike_ends(mesh)
        number = 1 if tried is None else tried.shooting.number + 1
        before = () if tried is None else tried.log

        def conditions(amplitude: float) -> Shooting | None:
            found = self._conditions(choice.scheme, mesh, amplitude)
            return None if found is None else replace(found, number=number)

        first = at_rest(whole)
        found = follow(conditions, first, tolerance, self.progress)
        if found.motion is not None:
            require_hold_of_outputs(found.shooting, found.motion, self.problem.relative_degree, found.amplitude)
        if found.motion is None or found.amplitude < 1.0:
            sooner = "" if self.bending is None else "; outputs may be bent for too short a time, then move zeros less far"
            raise PlanError(
                f"no motion found: Newton's method follows it up to {found.amplitude:.3g} of the way from rest ({len(found.log)} "
                "steps); beyond, the inverse may cease to exist (an actuator that loses its effect, a posture that turns over). "
                f"Ask for a smaller or slower motion, or go by way of another posture{sooner}"
            )
        solution = self._sized(Solution(choice, found.shooting, found.motion, (*before, *found.log)))
        return replace(solution, shooting=self._with_tails(solution.shooting, solution.motion))

    def _with_tails(self, shooting: Shooting, motion: Motion) -> Shooting:
        """Conditions with ends that know how the motion goes on beyond them as exactly as the accuracy asks, and rounding allows.

        motion: about the one that meets them.
        """
        if self.bending is not None:  # what is to rest is told by linear rows, to which linear tails belong
            return shooting
        enough, linear = MARGIN * self.accuracy, tail_errors(self.problem, shooting, motion)
        if np.all(linear <= enough):
            return shooting
        tails = [
            curved(shooting.dynamics[number], end, shooting.scheme, side, away)
            for side, number, end, away in zip(SIDES, (0, -1), shooting.ends, shooting.ends_away(motion), strict=True)
        ]
        start, end = (replace(end, curved=tail) for end, tail in zip(shooting.ends, tails, strict=True))
        errors = tail_errors(self.problem, replace(shooting, ends=(start, end)), motion)
        better = (linear > enough) & (errors <= np.maximum(WORTHWHILE * linear, enough))
        return replace(shooting, ends=(start if better[0] else shooting.ends[0], end if better[1] else shooting.ends[1]))

    def _left(self, solution: Solution) -> float:
        """What is left to find of a motion, as a share of peaks: by Newton's method, and at the ends."""
        return max(remaining(solution.log), solution.shooting.ends_missed(solution.motion))

    def _sized(self, solution: Solution) -> Solution:
        """With sizes also for outputs that are to stay still: what the states could make of them."""
        shooting, motion, models = solution.shooting, solution.motion, self.problem.linear_models
        moves = self.problem.motion_size
        possible = np.abs(models[0].C) @ state_sizes(shooting, motion, self.problem.model(shooting.mesh.edges))
        size = np.where(moves > 0, moves, np.where(possible > 0, possible, 1.0))
        return replace(solution, shooting=replace(shooting, motion_size=size))


def _degrees(shooting: Shooting) -> Array:
    """Of the polynomials in the tails (2,)."""
    return np.array([float(end.degree) for end in shooting.ends])


def _require_few(elements: float, duration: float, what: str) -> None:
    """Raises PlanError for more elements than are planned."""
    if elements > MOST_ELEMENTS:
        raise PlanError(
            f"the plan takes {duration:.4g} s {what}, {elements:.0f} in number, of which {MOST_ELEMENTS} are planned at "
            "most; take a longer hold, a shorter motion, less accuracy, or limit max_preactuation and max_postactuation"
        )


def _unlike_ends(mesh: Mesh) -> PlanError:
    return PlanError(
        f"the elements at the ends, of {mesh.lengths[0]:.3g} and {mesh.lengths[-1]:.3g} s, have unlike numbers of expanding "
        "multipliers: zeros are about as fast as they are; plan with another hold, or for another duration"
    )


def _not_fine_enough(mesh: Mesh, error: DenseError, accuracy: float) -> PlanError:
    k = int(np.argmax(error.worst))
    return PlanError(
        f"the mesh does not get fine enough: with {len(mesh)} elements the error is {error.worst[k]:.1e} of the motion at "
        f"t = {mesh.edges[k]:.6g} s, accuracy={accuracy:g} asks for less; ask for no more than can be had, or for a smoother "
        "reference"
    )
