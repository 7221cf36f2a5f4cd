"""The bounded least-squares search for an equilibrium that departs least from where it starts."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy  # loads scipy.optimize at its first use

from invtrack.arrays import Array
from invtrack.errors import PlantError
from invtrack.plant.equilibrium.equations import EquilibriumEquations
from invtrack.plant.equilibrium.given import Mask

ANCHORS = (1e-1, 1e-3, 1e-5)
"""Weights of the departure from the start, relative to the equations, one after the other."""

DAMPING = 1e-7
"""Weight of the departure from the last iterate, once the equilibrium is near: what does not matter does not move."""

CONTROL_SHARE = 1e-4
"""Weight of a control's or activation's departure in terms of a position's: posture first, then least control."""

ROUNDS = 12
"""Most corrections with the last iterate as anchor."""

HOPELESS = 1e-2
"""A scaled residual that corrections of the last iterate will not remove."""

INSIDE = 0.05
"""How far from its bounds a search begins, in units of the unknown or of its range."""

ASIDE = 0.2
"""How far a stationary start is moved aside, in units of the positions."""

ACTS = 1e-9
"""An unknown acts on an equation where a unit of it changes the equation by more than this, both scaled."""

NEAR_START, NEAR_BOUND = 1e-9, 1e-6
"""How near to its start, or to a bound, an unknown is put there, in its unit, where that costs nothing."""

ROUNDING = 1e-13
"""A scaled residual that is nothing but rounding."""

_GOLDEN_RATIO = (1 + math.sqrt(5)) / 2


@dataclass(frozen=True, eq=False)
class Iterate:
    """Unknowns z (nv + na + nu,) as (displacement, act, ctrl), and what is left of the equations that count, scaled."""

    z: Array
    residual: Array

    @property
    def miss(self) -> float:
        """The largest of what is left."""
        return float(np.max(np.abs(self.residual), initial=0.0))


@dataclass(frozen=True, eq=False)
class EquilibriumSearch:
    """Searches of one set of equations; all within `equations.forces()`.

    equations: what is to vanish. tolerance: the largest scaled residual of an equilibrium.
    """

    equations: EquilibriumEquations
    tolerance: float

    def found(self, iterate: Iterate) -> bool:
        """Whether an iterate is an equilibrium."""
        return iterate.miss <= self.tolerance

    def nearest(self, start: Array) -> Iterate:
        """The equilibrium in the posture of `start`, if there is one, else in the nearest; with the least controls in it.

        Where there is none, the point that comes nearest to one.
        """
        equations = self.equations
        inputs = equations.free & ~equations.is_position
        here = self._solve(start, inputs)
        if self.found(here):
            return self._tidied(here, inputs)
        moved = self.solve(start, equations.free)
        if not self.found(moved):
            return moved
        settled = self._solve(np.where(equations.is_position, moved.z, start), inputs)
        return self._tidied(settled if self.found(settled) else moved, equations.free)

    def solve(self, start: Array, free: Mask, *, bounded: bool = True, rows: Mask | None = None) -> Iterate:
        """The equilibrium nearest to `start`, or the point that comes nearest to one.

        From a little aside where the start is stationary for an equation: a stretched arm does not know which way to bend.

        Args:
            start: (nv + na + nu,); moved within the bounds if it is beyond.
            free: which of the unknowns may change.
            bounded: whether they stay within their bounds.
            rows: which equations count; all unless given.
        """
        tries = [self._solve(start, free, bounded=bounded, rows=rows)]
        if not self.found(tries[0]) and self._is_stationary(start, free, rows):
            for aside in (self.aside(free), -self.aside(free)):
                tries.append(self._solve(start + aside, free, bounded=bounded, rows=rows, anchor=start))
                if self.found(tries[-1]):
                    break
        return min(tries, key=lambda iterate: iterate.miss)

    def aside(self, free: Mask) -> Array:
        """A small displacement of the positions in no particular direction."""
        pattern = np.modf(_GOLDEN_RATIO * np.arange(1, len(free) + 1))[0] - 0.5
        return np.asarray(ASIDE * pattern * self.equations.units * (free & self.equations.is_position))

    def _is_stationary(self, z: Array, free: Mask, rows: Mask | None) -> bool:
        """Whether an equation is not met at z, and nothing that is free acts on it there."""
        unmet = np.abs(self.equations.residual(z)) > self.tolerance
        idle = np.max(np.abs(self.equations.jacobian(z, free)), axis=1, initial=0.0) <= ACTS
        return bool(np.any(unmet & idle & (True if rows is None else rows)))

    def _solve(
        self, start: Array, free: Mask, *, bounded: bool = True, rows: Mask | None = None, anchor: Array | None = None
    ) -> Iterate:
        """Least squares with Tikhonov regularisation towards the start, weaker and weaker, then towards each iterate in turn.

        Args:
            start, free, bounded, rows: as in `solve`.
            anchor: from where the departure is to be least; from the start unless given.
        """
        equations = self.equations
        beyond = free & (not bounded)
        low, high = np.where(beyond, -np.inf, equations.bounds[:, 0]), np.where(beyond, np.inf, equations.bounds[:, 1])
        rows = np.ones(len(equations.scales), dtype=bool) if rows is None else rows
        anchor = np.clip(start if anchor is None else anchor, low, high)
        current = np.clip(start, low, high)
        best = Iterate(current, equations.residual(current)[rows])
        if not np.all(np.isfinite(best.residual)):
            raise PlantError(f"accelerations of plant {equations.plant.name!r} are not finite where it is; check its masses")
        if not np.any(free):
            return best
        share = CONTROL_SHARE if np.any(free & equations.is_position) else 1.0
        weights = np.where(equations.is_position, 1.0, share)[free]
        for weight in ANCHORS:
            best = self._regularised(self._inside(best.z, free, low, high), anchor, free, rows, weight * weights, (low, high))
        for _ in range(ROUNDS):
            if best.miss == 0 or best.miss > HOPELESS:
                break
            found = self._regularised(best.z, best.z, free, rows, np.full(len(weights), DAMPING), (low, high))
            improved = found.miss <= best.miss / 2
            best = found if found.miss < best.miss else best
            if not improved:
                break
        return best

    def _inside(self, z: Array, free: Mask, low: Array, high: Array) -> Array:
        """The same with what is free a little off its bounds, where the steps of the trust region would be short."""
        if self.equations.constraints:  # off its stops nothing holds the mechanism
            free = free & ~self.equations.is_position
        room = INSIDE * np.minimum(high - low, self.equations.units)
        return np.where(free, np.clip(z, low + room, high - room), z)

    def _regularised(
        self, start: Array, anchor: Array, free: Mask, rows: Mask, weights: Array, bounds: tuple[Array, Array]
    ) -> Iterate:
        """Least squares of the equations and of weights * (unknowns - anchor), scaled, by a bounded trust region.

        Args:
            start, anchor: from where, and towards where (nv + na + nu,).
            free, rows: which unknowns may change, and which equations count.
            weights: of the departure of each free unknown.
            bounds: lowest and highest values of all unknowns.
        """
        units = self.equations.units[free]

        def full(scaled: Array) -> Array:
            z = np.array(start)
            z[free] = np.clip(scaled * units, *(bound[free] for bound in bounds))
            return z

        def extended(scaled: Array) -> Array:
            return np.concatenate([self.equations.residual(full(scaled))[rows], weights * (scaled - anchor[free] / units)])

        def derivative(scaled: Array) -> Array:
            return np.vstack([self.equations.jacobian(full(scaled), free)[rows], np.diag(weights)])

        found = scipy.optimize.least_squares(
            extended,
            start[free] / units,
            jac=derivative,
            bounds=tuple(bound[free] / units for bound in bounds),
            ftol=1e-8,
            xtol=1e-14,
            gtol=1e-15,
            max_nfev=50,
        )
        z = full(found.x)
        return Iterate(z, self.equations.residual(z)[rows])

    def _tidied(self, found: Iterate, free: Mask) -> Iterate:
        """The same without the rounding in unknowns that need not differ from their start or are at a bound."""
        equations = self.equations
        z = np.array(found.z)
        for target, near in ((equations.start, NEAR_START), *((bound, NEAR_BOUND) for bound in equations.bounds.T)):
            z = np.where(free & (np.abs(z - target) <= near * equations.units), target, z)
        rest = free & (z == found.z)
        allowed = max(2 * found.miss, ROUNDING)
        tidy = Iterate(z, equations.residual(z))
        if tidy.miss > allowed and np.any(rest):
            rows, weights = np.ones(len(equations.scales), dtype=bool), np.full(np.sum(rest), DAMPING)
            tidy = self._regularised(z, z, rest, rows, weights, (equations.bounds[:, 0], equations.bounds[:, 1]))
        return tidy if tidy.miss <= allowed else found
