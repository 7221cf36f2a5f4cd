"""A signal, later and weighed, several times over: what a finite impulse response makes of it."""

from __future__ import annotations

import numpy as np
import scipy.linalg

from invtrack.arrays import Array, Indices
from invtrack.references.generator import Generator
from invtrack.references.signal import PiecewiseSignal

SAME_TIME = 8.0
"""Breakpoints that differ by less than so many units in their last place are one, computed in two ways."""


def delayed_sum(signal: PiecewiseSignal, weights: Array, delays: Array) -> PiecewiseSignal:
    """sum over i of weights_i signal(t - delays_i): weights (k,), delays (k,) [s].

    Copies whose pieces have the same generator add up in one and the same state, so its size does not grow with their number.
    """
    edges = np.sort(np.add.outer(signal.breakpoints, delays).ravel())
    apart = np.diff(edges, prepend=-np.inf) > SAME_TIME * np.spacing(np.abs(edges))
    edges = edges[apart]
    middle = edges[:-1] + np.diff(edges) / 2
    inside = np.concatenate([[edges[0] - 1.0], middle, [edges[-1] + 1.0]])
    starts = np.concatenate([edges[:1], edges])
    # Which piece of the signal each copy is in (k, m + 2); outside of the sum's breakpoints it is certain without looking.
    piece = np.array([np.searchsorted(signal.breakpoints + delay, inside, side="right") for delay in delays])
    kind = signal.kind[piece]
    w = np.array([weight * _states(signal, p, starts - d) for weight, p, d in zip(weights, piece, delays, strict=True)])

    present = np.array([np.any(kind == g, axis=0) for g in range(len(signal.generators))]).T  # of each piece, which generators
    distinct, which = np.unique(present, axis=0, return_inverse=True)
    which = which.ravel()
    generators, sizes = [], [len(g.S) for g in signal.generators]
    anchors = np.zeros((len(which), max(int(np.sum(np.array(sizes)[row])) for row in distinct)))
    for number, row in enumerate(distinct):
        chosen, place = which == number, 0
        members = np.flatnonzero(row).tolist()
        for g in members:
            ours = (kind[:, chosen] == g)[:, :, np.newaxis]
            anchors[chosen, place : place + sizes[g]] = np.sum(np.where(ours, w[:, chosen, : sizes[g]], 0.0), axis=0)
            place += sizes[g]
        parts = [signal.generators[g] for g in members]
        generators.append(Generator(scipy.linalg.block_diag(*(g.S for g in parts)), np.hstack([g.R for g in parts])))
    return PiecewiseSignal(edges, tuple(generators), which.astype(np.intp), anchors)


def _states(signal: PiecewiseSignal, piece: Indices, times: Array) -> Array:
    """The generators' states (k, q) of these pieces (k,) at times (k,) [s], padded to the largest q."""
    since = times - signal.breakpoints[np.maximum(piece - 1, 0)]
    result = np.zeros((len(piece), signal.anchors.shape[1]))
    for g, generator in enumerate(signal.generators):
        q = len(generator.S)
        for before in (False, True):
            chosen = (signal.kind[piece] == g) & ((piece == 0) == before)
            if not np.any(chosen):
                continue
            tau = np.maximum(-since[chosen] if before else since[chosen], 0.0)
            result[chosen, :q] = generator.propagator(-1.0 if before else 1.0).states(signal.anchors[piece[chosen], :q], tau)
    return result
