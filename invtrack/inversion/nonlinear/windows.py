"""How far a mesh reaches before and after the manoeuvre: to where tails do, in elements that grow on the way out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from invtrack.arrays import Array, ComplexArray
from invtrack.inversion.nonlinear.choice import Choice
from invtrack.inversion.nonlinear.ends import NEUTRAL
from invtrack.inversion.nonlinear.mesh import EVEN, Mesh
from invtrack.inversion.nonlinear.problem import MotionProblem
from invtrack.plans.tail import SIDES, Side

LAYER = 12
"""Elements before and after the manoeuvre, at least: in these what the mesh adds of its own dies out."""

FIRST_SHARE = 0.03
"""The mesh ends at first where so much of the motion in the slowest zero is left."""

SHORT = 0.1
"""Where inputs are held, and elements are short, tails are tried from where so much of it is left."""

LAST_SHARE = 0.5
"""It reaches to where linear tails meet the accuracy, at most until the share left is this times the accuracy's square root: tails
are off by the square of what is left."""

GROWTH = 1.4
"""Each element is longer than its inner neighbour by this factor, at most."""

RESOLVED = 0.5
"""Elements of length H resolve a zero z that lives among them where |z| H is below this."""

MARGIN = 0.1
"""Share of the accuracy that tails are to reach when the mesh is made longer for them."""


NONE_RESTING: tuple[ComplexArray, ComplexArray] = (np.zeros(0, dtype=complex), np.zeros(0, dtype=complex))
"""Where any zero may move before and after the manoeuvre."""


@dataclass(frozen=True, eq=False)
class Windows:
    """The elements before and after a manoeuvre.

    Args:
        problem: mechanism, reference, changes.
        choice: of the elements of the manoeuvre.
        accuracy: of the plan, as a share of the motion.
        limits: longest preactuation and postactuation [s], or None.
        longest: of all elements, over which the integration follows the fastest mode [s].
        resting: zeros of the start and of the end [rad/s] in which nothing moves outside the manoeuvre.
    """

    problem: MotionProblem
    choice: Choice
    accuracy: float
    limits: tuple[float | None, float | None]
    longest: float
    resting: tuple[ComplexArray, ComplexArray] = NONE_RESTING

    def first(self, mesh: Mesh) -> Mesh:
        """The mesh of the manoeuvre with its first elements before and after."""
        lengths = [
            self._outward(side, mesh.lengths[end], min(self._most(side), -np.log(FIRST_SHARE) / self._slowest(side)), LAYER)
            for end, side in zip((0, -1), SIDES, strict=True)
        ]
        return mesh.with_more(lengths[0], lengths[1])

    def inner(self, mesh: Mesh) -> slice:
        """The elements of the manoeuvre, and those before and after it until SHORT of the motion in the slowest zero is left."""
        begin, end = self.problem.manoeuvre
        before, after = (-np.log(SHORT) / self._slowest(side) for side in SIDES)
        first = int(np.searchsorted(mesh.edges, begin - before, side="right")) - 1 if before > 0 else 0
        last = int(np.searchsorted(mesh.edges, end + after)) if after > 0 else len(mesh)
        return slice(max(first, 0), min(last, len(mesh)))

    def lacking(self, mesh: Mesh, errors: Array, degrees: Array) -> Array:
        """How much further out the mesh should end on either side (2,) [s], where its tails are off by errors (2,).

        These fall with the power degrees + 1 (2,) of what is left where tails begin, or faster: a mesh that ends further out than
        it should is cut by half of what that would allow.
        """
        begin, end = self.problem.manoeuvre
        reach, most = np.array([begin - mesh.edges[0], mesh.edges[-1] - end]), np.array([self._most(side) for side in SIDES])
        slowest = np.array([self._slowest(side) for side in SIDES])
        further: Array = np.log(np.maximum(errors, np.finfo(float).tiny) / (MARGIN * self.accuracy)) / ((degrees + 1) * slowest)
        return np.asarray(np.clip(reach + np.maximum(further, further / 2), 0.0, most) - reach)

    def longer(self, mesh: Mesh, errors: Array, degrees: Array) -> Mesh | None:
        """The mesh with more elements where tails are off by more than the accuracy (2,); None where that is not so."""
        lacking, more = np.where(errors > self.accuracy, self.lacking(mesh, errors, degrees), 0.0), []
        for side, inner, reach in zip(SIDES, mesh.lengths[[0, -1]], lacking, strict=True):
            more.append(self._outward(side, inner, reach, 1) if reach > EVEN * inner else np.zeros(0))
        return mesh.with_more(more[0], more[1]) if len(more[0]) + len(more[1]) else None

    def _outward(self, side: Side, inner: float, reach: float, least: int) -> Array:
        """Lengths of elements that reach so far [s], `least` in number, each longer than its inner neighbour where that suits."""
        longest = self._longest(side)
        found: list[float] = []
        length, total = float(inner), 0.0
        while len(found) < least or total < reach * (1 - EVEN):
            wanted = min(GROWTH * length, longest)
            if wanted > length and self.choice.suits_as_well(wanted):
                length = wanted
            found.append(length)
            total += length
        return np.array(found)

    def _rates(self, side: Side) -> tuple[Array, Array]:
        """Of the zeros that live on that side: how fast they die out on the way out [1/s], and their sizes [rad/s]."""
        end = -SIDES.index(side)
        zeros = self.problem.zeros[end]
        for resting in self.resting[end]:
            zeros = np.delete(zeros, np.argmin(np.abs(zeros - resting)))
        rates = zeros.real if side == "before" else -zeros.real
        living = rates * self.choice.length > NEUTRAL
        return rates[living], np.abs(zeros[living])

    def _slowest(self, side: Side) -> float:
        """Rate [1/s] of the slowest one, infinite for none."""
        return float(np.min(self._rates(side)[0], initial=np.inf))

    def _most(self, side: Side) -> float:
        """How far out the mesh reaches at most [s]."""
        limit = self.limits[SIDES.index(side)]
        reach = float(-np.log(LAST_SHARE * np.sqrt(self.accuracy)) / self._slowest(side))
        return reach if limit is None else max(LAYER * self.choice.length, min(reach, limit))

    def _longest(self, side: Side) -> float:
        """Of the elements on that side [s]: those of the manoeuvre where nothing lives there, or where a limit leaves no room."""
        rates, sizes = self._rates(side)
        if not len(rates) or self.limits[SIDES.index(side)] is not None:
            return 0.0
        lasting = rates * -np.log(FIRST_SHARE) <= -np.log(self.accuracy) * np.min(rates)
        return float(min(self.longest, RESOLVED / max(np.max(sizes[lasting]), np.max(np.abs(self.resting), initial=0.0))))
