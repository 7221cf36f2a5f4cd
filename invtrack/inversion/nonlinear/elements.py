"""Elements of time: where the output is matched on them, and how what comes out of one depends on what goes in."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np

from invtrack.arrays import Array, Indices
from invtrack.inversion.nonlinear.rest import Rest
from invtrack.plans.dynamics import Derivatives, Dynamics
from invtrack.plans.runge_kutta import CLASSICAL, RungeKutta, Steps, legendre

STEP_ANGLE = 0.25
"""By how much the fastest mode turns over a step [rad] of a map of an element, where the scheme's own steps are no longer: a fourth
order method is then off by 3e-5 of it."""

MOST_REFINED = 8
"""Steps of such a map between neighbouring half distances of the points, at most."""

LOOKED_AT = 8
"""Of so many elements the fastest mode is looked for."""

IN_CACHE = 2**16
"""Numbers of the derivatives of elements that are carried on together."""


@dataclass(frozen=True)
class Scheme:
    """The input of an element is a polynomial with `count` coefficients; each output is matched at as many points.

    The points of an output lie evenly: either symmetric inside the element, at the odd multiples of half their distance, or with
    the element's end among them. The one suits outputs of even relative degree, the other those of odd; the wrong set has a mode
    that neither decays nor grows from element to element (the sampling zeros of K. J. Astrom, P. Hagander, J. Sternby, 1984).

    Args:
        count: s, of the coefficients of each input.
        at_end: for each output, whether the element's end is one of its points.
        refinement: steps of integration between neighbouring half distances of the points.
        method: of the integration.
    """

    count: int
    at_end: tuple[bool, ...]
    refinement: int = 1
    method: RungeKutta = CLASSICAL

    @property
    def steps(self) -> int:
        """Steps of integration per element, S."""
        return 2 * self.count * self.refinement

    @cached_property
    def integration(self) -> Steps:
        """The steps."""
        return Steps(self.method, self.steps, self.count)

    @cached_property
    def points(self) -> Indices:
        """After how many steps each output is matched (p, s)."""
        odd = np.arange(1, 2 * self.count, 2)
        return np.array([odd + end for end in self.at_end], dtype=np.intp) * self.refinement

    @cached_property
    def basis(self) -> Array:
        """The polynomials at the starts, middles and ends of the steps (2 S + 1, s)."""
        return legendre(self.count, np.linspace(0.0, 1.0, 2 * self.steps + 1))

    @property
    def knots(self) -> Indices:
        """After how many steps derivatives are taken (k,): in the middle, or symmetric to it and near the Gauss points.

        The polynomials between which they are interpolated miss them by what is orthogonal to low powers, and so hardly add up.
        """
        if self.count == 1:
            return np.array([self.refinement], dtype=np.intp)
        first = int(np.round(self.steps * (1 - 1 / np.sqrt(3)) / 2))
        return np.array([first, self.steps - first], dtype=np.intp)

    @cached_property
    def spread(self) -> Array:
        """From values at the knots to those at the starts, middles and ends of the steps (2 S + 1, k)."""
        return between_knots(self.knots / self.steps, self.steps)


def between_knots(knots: Array, steps: int) -> Array:
    """From values at knots (k,), shares of an element, to those at the starts, middles and ends of so many steps (2 S + 1, k)."""
    at = np.linspace(0.0, 1.0, 2 * steps + 1)
    if len(knots) == 1:
        return np.ones((len(at), 1))
    first, second = knots
    return np.asarray(np.column_stack([second - at, at - first]) / (second - first))


@dataclass(frozen=True, eq=False)
class ElementMaps:
    """Derivatives of K elements: of their ends and matched outputs with respect to their starts and coefficients.

    dx_end = end_x dx + end_c dc, dy = out_x dx + out_c dc at the matched points.

    Args:
        end_x, end_c: (K, n, n) and (K, n, s m).
        out_x, out_c: (K, p s, n) and (K, p s, s m), output by output.
    """

    end_x: Array
    end_c: Array
    out_x: Array
    out_c: Array

    @cached_property
    def inverse(self) -> tuple[Array, Array]:
        """out_c^-1 out_x (K, s m, n) and out_c^-1 (K, s m, p s). Raises LinAlgError where an element's input acts on no output."""
        eye = np.broadcast_to(np.eye(self.out_c.shape[1]), self.out_c.shape)
        size = np.max(np.abs(self.out_c), axis=2, keepdims=True)  # rows in the outputs' own units
        scale = np.where(size > 0, size, 1.0)
        solved = np.linalg.solve(self.out_c / scale, np.concatenate([self.out_x / scale, eye / scale], axis=2))
        n = self.out_x.shape[2]
        return solved[:, :, :n], solved[:, :, n:]

    @cached_property
    def exact(self) -> Array:
        """From start to end with the outputs kept: the discrete inverse dynamics (K, n, n)."""
        return np.asarray(self.end_x - self.end_c @ self.inverse[0])


def element_maps(derivatives: Derivatives, scheme: Scheme, lengths: Array) -> ElementMaps:
    """The derivative of classical RK4 over each element, for derivatives of the dynamics at its knots.

    Its steps follow the fastest mode as well as an iteration needs. They are never shorter than the scheme's own where that is
    integrated by classical RK4 too, as inputs are that are held.

    Args:
        derivatives: at the knots of each element, in order (K k, ...).
        scheme: of the elements.
        lengths: of the elements (K,) [s].
    """
    K = len(lengths)
    at_knots = [a.reshape(K, -1, *a.shape[1:]) for a in (derivatives.A, derivatives.B, derivatives.C, derivatives.D)]
    n, m = at_knots[1].shape[2:]
    rough = _rough(scheme, at_knots[0][:: max(1, K // LOOKED_AT), 0], float(np.max(lengths)))
    knots = scheme.knots / scheme.steps
    block = max(1, IN_CACHE // (n * (n + scheme.count * m)))
    parts = [slice(start, start + block) for start in range(0, K, block)]

    def work(part: slice) -> ElementMaps:
        return _maps_of([a[part] for a in at_knots], rough, between_knots(knots, rough.steps), lengths[part])

    if len(parts) == 1:
        return work(parts[0])
    with ThreadPoolExecutor(min(len(parts), os.cpu_count() or 1)) as pool:
        found = list(pool.map(work, parts))
    return ElementMaps(*(np.concatenate([getattr(maps, field.name) for maps in found]) for field in fields(ElementMaps)))


def _rough(scheme: Scheme, A: Array, length: float) -> Scheme:
    """Steps that follow the fastest mode of A (..., n, n) over elements of that length [s] as well as an iteration needs."""
    turned = float(np.max(np.abs(np.linalg.eigvals(A)), initial=0.0)) * length
    needed = int(np.ceil(turned / (STEP_ANGLE * 2 * scheme.count))) if np.isfinite(turned) else scheme.refinement
    most = scheme.refinement if scheme.method is CLASSICAL else MOST_REFINED
    return replace(scheme, refinement=min(max(1, needed), most))


def _maps_of(at_knots: Sequence[Array], scheme: Scheme, spread: Array, lengths: Array) -> ElementMaps:
    """The maps of K elements, from A, B, C and D at their knots (K, k, ., .), which `spread` leads to all instants."""
    K, s, S = len(lengths), scheme.count, scheme.steps
    n, m = at_knots[1].shape[2:]
    p = at_knots[2].shape[2]

    def at(which: int, instant: int) -> Array:
        first, *others = spread[instant]
        result = first * at_knots[which][:, 0]
        for i, weight in enumerate(others):
            result += weight * at_knots[which][:, i + 1]
        return np.asarray(result)

    # Columns: the start, then the coefficients one polynomial after the other.
    V = np.zeros((K, n, n + s * m))
    V[:, :, :n] = np.eye(n)
    out_x, out_c = np.empty((K, p, s, n)), np.empty((K, p, s, s * m))
    h = (lengths / S)[:, None, None]
    k, W = np.empty_like(V), np.empty_like(V)

    def slope(instant: int, A: Array, V: Array) -> None:
        np.matmul(A, V, out=k)
        B = at(1, instant)
        for i, value in enumerate(scheme.basis[instant]):
            k[:, :, n + i * m : n + (i + 1) * m] += value * B

    def ahead(step: Array) -> Array:
        np.multiply(k, step, out=W)
        np.add(W, V, out=W)
        return W

    A_start = at(0, 0)
    for step in range(S):
        A_middle, A_end = at(0, 2 * step + 1), at(0, 2 * step + 2)
        slope(2 * step, A_start, V)
        total = k.copy()
        for instant, A, after, weight in ((1, A_middle, h / 2, 2.0), (1, A_middle, h / 2, 2.0), (2, A_end, h, 1.0)):
            slope(2 * step + instant, A, ahead(after))
            total += weight * k
        V, A_start = V + h / 6 * total, A_end
        for output, point in np.argwhere(scheme.points == step + 1):
            C, D = at(2, 2 * step + 2)[:, output : output + 1], at(3, 2 * step + 2)[:, output]
            rows = (C @ V)[:, 0]
            out_x[:, output, point], out_c[:, output, point] = rows[:, :n], rows[:, n:]
            out_c[:, output, point] += (scheme.basis[2 * step + 2][:, None] * D[:, None, :]).reshape(K, s * m)
    return ElementMaps(V[:, :, :n], V[:, :, n:], out_x.reshape(K, p * s, n), out_c.reshape(K, p * s, s * m))


def map_at_rest(dynamics: Dynamics, rest: Rest, scheme: Scheme, length: float) -> ElementMaps:
    """Those of one element of that length [s] at an equilibrium: like `element_maps` for A, B, C and D that do not change.

    A step of classical RK4 then takes x to R x + G_0 u_0 + G_1 u_1 + G_2 u_2, with the inputs at its start, middle and end.
    """
    found = rest.derivatives(dynamics)
    A, B, C, D = found.A[0], found.B[0], found.C[0], found.D[0]
    rough = _rough(scheme, A, length)
    (n, m), p, s, S = B.shape, len(C), scheme.count, rough.steps
    h = length / S
    hA = h * A
    hB = h / 6 * B
    AB = hA @ hB
    AAB = hA @ AB
    R = np.eye(n) + hA + hA @ hA / 2 + hA @ hA @ hA / 6 + hA @ hA @ hA @ hA / 24
    G = np.stack([hB + AB + AAB / 2 + hA @ AAB / 4, 4 * hB + 2 * AB + AAB / 2, hB])
    driven = np.einsum("kgi,gnm->knim", rough.basis[2 * np.arange(S)[:, None] + np.arange(3)], G).reshape(S, n, s * m)
    V, out = np.hstack([np.eye(n), np.zeros((n, s * m))]), np.empty((p, s, n + s * m))
    for step in range(S):
        V = R @ V
        V[:, n:] += driven[step]
        for output, point in np.argwhere(rough.points == step + 1):
            out[output, point] = C[output] @ V
            out[output, point, n:] += np.outer(rough.basis[2 * step + 2], D[output]).ravel()
    out = out.reshape(1, p * s, n + s * m)
    return ElementMaps(V[None, :, :n], V[None, :, n:], out[:, :, :n], out[:, :, n:])


def candidate_schemes(count: int, outputs: int) -> Sequence[Scheme]:
    """Schemes to choose from: every choice of points for up to four outputs, beyond that the same for all."""
    if outputs > 4:
        choices = [(end,) * outputs for end in (False, True)]
    else:
        choices = [tuple(bool(number >> i & 1) for i in range(outputs)) for number in range(2**outputs)]
    return [Scheme(count, at_end) for at_end in choices]
