"""The reference for which a plan with preview misses most: y^(r) at its limit throughout, with the kernel's signs."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial

from invtrack.arrays import Array
from invtrack.preview.kernel import Missed
from invtrack.preview.output_chain import OutputChain
from invtrack.references.generator import Generator, constant_generator
from invtrack.references.signal import PiecewiseSignal


@dataclass(frozen=True, eq=False)
class WorstReference:
    """A reference with |y_d,j^(r_j)| <= 1, from rest to rest, and when its error comes up to the bound.

    reference: the signal. time: of the largest error [s]. error: what it comes up to, in the output's unit.
    """

    reference: PiecewiseSignal
    time: float
    error: float


def worst_reference(chain: OutputChain, missed: Missed) -> WorstReference:
    """chi = sign of the kernel; after the last cell that counts the outputs are brought to rest."""
    signs = np.sign(missed.values)
    kept = np.concatenate([[True], np.any(np.diff(signs, axis=0) != 0, axis=1)])
    edges, signs = np.append(missed.edges[:-1][kept], missed.edges[-1]), signs[kept]
    zeta, anchors, generator = np.zeros(chain.size), [], chain.generator
    for length, chi in zip(np.diff(edges), signs, strict=True):
        w = np.concatenate([zeta, chi])
        anchors.append(w)
        zeta = (generator.propagator(1.0).matrices(np.array([length]))[0] @ w)[: chain.size]
    duration, coefficients = _stop(chain, zeta)
    slowing, held = _power_generator(duration, coefficients), constant_generator(len(chain.orders))
    still, end = np.zeros(len(chain.orders)), coefficients.sum(axis=1)
    anchors = [still, *anchors, np.eye(1, coefficients.shape[1])[0], end]
    width = max(map(len, anchors))
    kind = np.array([2, *[0] * len(signs), 1, 2])
    reference = PiecewiseSignal(
        np.append(edges, edges[-1] + duration),
        (generator, slowing, held),
        kind,
        np.array([np.pad(w, (0, width - len(w))) for w in anchors]),
    )
    return WorstReference(reference, missed.time, float(missed.gain.sum()))


def _stop(chain: OutputChain, zeta: Array) -> tuple[float, Array]:
    """How long [s] the outputs may slow down, with |chi| <= 1, and the powers of the share of that time that do it (p, k + 1).

    Of lowest degree with the derivatives given at the start, up to order r - 1, and none at the end.
    """
    highest = max(2 * max(chain.orders) - 2, 1)
    share = np.linspace(0.0, 1.0, 64)
    duration = 1.0
    while True:
        coefficients = np.zeros((len(chain.orders), highest + 1))
        fastest = 0.0
        for i, (first, r) in enumerate(zip(chain.values, chain.orders, strict=True)):
            given = zeta[first : first + r]
            own = _slowing(given * duration ** np.arange(r))
            coefficients[i, : len(own)] = own
            fastest = max(fastest, float(np.max(np.abs(Polynomial(own).deriv(r)(share)))) / duration**r)
        if fastest <= 1:
            return duration, coefficients
        duration *= 2


def _slowing(derivatives: Array) -> Array:
    """Coefficients of the polynomial with these derivatives 0 ... r - 1 at 0, and none from the first on at 1."""
    r = len(derivatives)
    known: Array = derivatives / np.array([math.factorial(k) for k in range(r)])
    if r == 1:
        return known
    powers = np.arange(r, 2 * r - 1)
    rows = np.array([[math.perm(k, order) for k in powers] for order in range(1, r)], dtype=float)
    left = -np.array([sum(known[k] * math.perm(k, order) for k in range(order, r)) for order in range(1, r)])
    return np.asarray(np.concatenate([known, np.linalg.solve(rows, left)]))


def _power_generator(duration: float, coefficients: Array) -> Generator:
    """w = (1, s, s^2, ...), s = t / duration, value = coefficients w."""
    return Generator(np.diag(np.arange(1, coefficients.shape[1]) / duration, k=-1), coefficients)
