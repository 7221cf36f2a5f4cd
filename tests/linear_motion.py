"""Motion of a linear plant under forces that are known at all times, by scipy's exponentials and Gauss's rule."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

POINTS, WEIGHTS = np.polynomial.legendre.leggauss(8)


def states(A: ArrayLike, x: ArrayLike, forces: Callable[[Array], Array], times: Array, *, longest: float) -> Array:
    """States (m, n) at increasing times (m,) [s] of x' = A x + forces(t), from x (n,) at the first of them.

    x(end) = exp(A h) x(start) + int exp(A (end - t)) forces(t) dt over pieces; forces, smooth between the times, gives (k, n) at
    many at once. With pieces of one radian of the fastest mode and of the forces the rule is exact to rounding.

    Args:
        A: (n, n).
        x: the first state.
        forces: of times (k,) [s], all of them within the first and the last.
        times: of the states.
        longest: piece [s].
    """
    pairs = list(itertools.pairwise(times.tolist()))
    counts = [int(np.ceil((b - a) / longest)) for a, b in pairs]
    edges = np.concatenate([np.linspace(a, b, n + 1)[:-1] for (a, b), n in zip(pairs, counts, strict=True)] + [times[-1:]])
    h = np.diff(edges)[:, None]
    since = (POINTS + 1) / 2 * h
    force = forces((edges[:-1, None] + since).ravel()).reshape(len(h), len(POINTS), -1)
    within = scipy.linalg.expm(np.asarray(A) * (h - since)[:, :, None, None])
    added = np.einsum("kj,kjab,kjb->ka", WEIGHTS * h / 2, within, force)
    found = [np.asarray(x, dtype=float)]
    for E, each in zip(scipy.linalg.expm(np.asarray(A) * h[:, :, None]), added, strict=True):
        found.append(E @ found[-1] + each)
    return np.array(found)[np.cumsum([0, *counts])]
