"""How a motion leaves rest, and comes to it, beyond what is small: the invariant manifold of elements with the outputs kept."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg

from invtrack.arrays import Array
from invtrack.inversion.nonlinear.elements import Scheme, map_at_rest
from invtrack.inversion.nonlinear.ends import Departure, End, Split
from invtrack.inversion.nonlinear.powers import Powers
from invtrack.plans.dynamics import Dynamics
from invtrack.plans.tail import Side

MONOMIALS, DEGREE = 36, 7
"""Of the manifold's polynomials, at most."""

APART = 7.0
"""Motions that die out faster than the slowest one by more than this factor are small where tails begin, and stay linear."""

ROOM = 1.2
"""The polynomials are fitted up to so many times the motion that they are for."""

THIN = 1e-3
"""A coordinate in which the motion is smaller than this share of its largest one is fitted as far as that."""

STEPS, SETTLED, GOOD = 60, 1e-14, 1e-7
"""Of the iteration, at most; a change with which it has ended, and one with which it has been of use (shares in balanced units)."""

ALONG = 64
"""Times at which the linear tail is looked at for how large its coordinates become."""


@dataclass(frozen=True, eq=False)
class Manifold:
    """x = W phi(w), the mean of u - u_rest over an element from there = C phi(w), at its end w = N phi(w).

    Args:
        powers: phi of the coordinates w.
        V: w = V x for the states x on it (k, n).
        W, N, C: (n, K), (k, K), (m, K).
    """

    powers: Powers
    V: Array
    W: Array
    N: Array
    C: Array


def curved(dynamics: Dynamics, end: End, scheme: Scheme, side: Side, away: Array) -> Departure:
    """The motions about rest that `End.departure` has, with the terms of higher order that the mechanism adds to the slow ones.

    An element takes x to F(x) with the outputs kept. Wanted are polynomials W and N in the coordinates w of the slow motions with
    F(W(w)) = W(N(w)): the manifold of states that leave rest, or come to it, and how they move on it (X. Cabre, E. Fontich, R. de
    la Llave, "The parameterization method for invariant manifolds", 2003 to 2005, in the style of a graph: V W(w) = w). Powers of w
    then follow phi' = A phi in a linear system of their own (Carleman's), cut off above the highest degree.

    Args:
        dynamics: at that end.
        end: the linear map at rest.
        scheme: of the elements.
        side: of the manoeuvre.
        away: the state where the tail begins, as it is known, less rest (n,): up to there the polynomials hold.

    Returns the linear departure where nothing departs, where it has more slow coordinates than polynomials are affordable in, or
    where these are not found.
    """
    end = replace(end, curved=None)
    linear, multipliers = end.departure(side), end.lasting(side)
    rates = np.abs(np.log(np.abs(multipliers)))
    near = rates <= APART * np.min(rates, initial=np.inf)
    powers, split = Powers.most(int(np.sum(near)), MONOMIALS, DEGREE), end.split(multipliers[near])
    if not np.any(split.V @ away) or powers.degree == 1:
        return linear
    found = _manifold(dynamics, end, scheme, powers, split, _radius(split, side, split.V @ away))
    if found is None:
        return linear
    k, fast = powers.variables, end.split(multipliers[~near])
    together = Powers(k, powers.degree, plain=len(fast.T))
    places = np.concatenate([np.arange(k), len(together) - len(powers) + np.arange(k, len(powers))])
    N = np.zeros((together.all, len(together)))
    N[:k, places], N[k:, k : together.all] = found.N, fast.T
    X, means = np.zeros((len(found.W), len(together))), np.zeros((len(found.C), len(together)))
    X[:, places], X[:, k : together.all] = found.W, fast.X
    means[:, places], means[:, k : together.all] = found.C, end.inputs[: len(means)] @ fast.X
    A = np.real(scipy.linalg.logm(together.carried(N))) / end.length
    return Departure(side, A, X, end.inputs_of(A, means), np.vstack([found.V, fast.V]), together)


def _radius(split: Split, side: Side, v: Array) -> Array:
    """How large the slow coordinates of a linear tail from v (k,) become (k,), with room."""
    outward = np.linalg.inv(split.T) if side == "before" else split.T
    lasts = -1 / np.log(np.max(np.abs(np.linalg.eigvals(outward))))
    step, largest, here = np.linalg.matrix_power(outward, max(1, round(lasts / ALONG))), np.abs(v), v
    for _ in range(ALONG):
        here = step @ here
        largest = np.maximum(largest, np.abs(here))
    return np.asarray(ROOM * np.maximum(largest, THIN * np.max(largest)))


def _manifold(dynamics: Dynamics, end: End, scheme: Scheme, powers: Powers, split: Split, radius: Array) -> Manifold | None:
    """The polynomials, from the linear ones on; None where they are not found.

    Each step takes the residual of F(W(w)) = W(N(w)) at samples, fits polynomials to it, and takes off what the linear map makes of
    these: their slow part from N, and from W what solves M C - C P = their other part, with phi(M_slow w) = P phi(w).

    Args:
        dynamics, end, scheme: see `curved`.
        powers: of the slow coordinates.
        split: these and the others.
        radius: of the slow coordinates (k,), in whose units they are.
    """
    k, m, X, V = powers.variables, len(end.rest.inputs), split.X * radius, split.V / radius[:, None]
    W, N = np.zeros((len(X), len(powers))), np.zeros((k, len(powers)))
    W[:, :k], N[:, :k] = X, split.T * radius / radius[:, None]
    growth = max(1.0, float(np.max(np.abs(np.linalg.eigvals(split.T)))))
    w = powers.samples / growth  # what grows over an element stays within the radius
    phi = powers.values(w)
    to_powers, lifted = np.linalg.pinv(phi), powers.carried(N)
    maps = map_at_rest(dynamics, end.rest, scheme, end.length)
    gain, end_c = maps.inverse[1][0], maps.end_c[0]
    coefficients = (w @ (end.inputs @ X).T).reshape(len(w), scheme.count, m)
    coefficients[:, 0] += end.rest.inputs
    size, last = np.max(np.abs(W @ phi.T) / end.scale[:, None]) * end.scale, np.inf
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(STEPS):
            ended, missed = _carried(dynamics, end, scheme, phi @ W.T, coefficients)
            change = -missed @ gain.T
            coefficients = coefficients + change.reshape(coefficients.shape)
            residual = ended + change @ end_c.T - powers.values(phi @ N.T) @ W.T
            if not np.all(np.isfinite(residual)):
                return None
            R = (to_powers @ residual).T
            slow, others = V @ R, split.Z @ scipy.linalg.solve_sylvester(split.S, -lifted, -split.Y @ R)
            N, W = N + slow, W + others
            moved = max(float(np.max(np.abs(others @ phi.T) / size[:, None])), float(np.max(np.abs(slow))))
            if moved <= SETTLED or (moved <= GOOD and moved > last / 2):
                means = (to_powers @ (coefficients[:, 0] - end.rest.inputs)).T
                return Manifold(powers, V, W, N, means)
            last = moved
    return None


def _carried(dynamics: Dynamics, end: End, scheme: Scheme, x: Array, coefficients: Array) -> tuple[Array, Array]:
    """Where elements from x (s, n) end, and by how much outputs miss rest at their points (s, p s), output by output.

    Args:
        dynamics, end, scheme: see `curved`.
        x: starts, in the tangent space at rest.
        coefficients: of the inputs (s, count, m).
    """
    s, origin = len(x), np.repeat(end.rest.point[None], len(x), axis=0)
    y_rest = np.repeat(dynamics.evaluate(end.rest.point[None], end.rest.inputs[None])[1], s, axis=0)
    nodes = dynamics.motion(dynamics.retract(origin, x), coefficients, scheme.integration, np.full(s, end.length))
    missed = np.empty((s, *scheme.points.shape))
    for point in np.unique(scheme.points).tolist():
        inputs = np.einsum("kim,i->km", coefficients, scheme.basis[2 * point])
        away = dynamics.output_difference(dynamics.evaluate(nodes[:, point], inputs)[1], y_rest)
        for output, place in np.argwhere(scheme.points == point):
            missed[:, output, place] = away[:, output]
    return dynamics.difference(nodes[:, -1], origin), missed.reshape(s, -1)
