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
    edges = edges[np.diff(edges, prepend=-np.inf) > SAME_TIME * np.spacing(np.abs(edges))]
    inside = np.concatenate([[edges[0] - 1.0], edges[:-1] + np.diff(edges) / 2, [edges[-1] + 1.0]])
    starts = np.concatenate([edges[:1], edges])
    sums = [np.zeros((len(inside), len(generator.S))) for generator in signal.generators]
    present = np.zeros((len(inside), len(sums)), dtype=bool)  # which generators take part in each piece of the sum
    for weight, delay in zip(weights.tolist(), delays.tolist(), strict=True):
        piece = np.searchsorted(signal.breakpoints + delay, inside, side="right")
        for g, states in enumerate(sums):
            ours = signal.kind[piece] == g
            present[:, g] |= ours
            states[ours] += weight * _states(signal, g, piece[ours], starts[ours] - delay)

    members, which = np.unique(present, axis=0, return_inverse=True)
    groups = [np.flatnonzero(row).tolist() for row in members]
    anchors = np.zeros((len(inside), max(sum(sums[g].shape[1] for g in group) for group in groups)))
    generators = []
    for number, group in enumerate(groups):
        chosen = which.ravel() == number
        joined = np.hstack([sums[g][chosen] for g in group])
        anchors[chosen, : joined.shape[1]] = joined
        parts = [signal.generators[g] for g in group]
        generators.append(Generator(scipy.linalg.block_diag(*(part.S for part in parts)), np.hstack([part.R for part in parts])))
    return PiecewiseSignal(edges, tuple(generators), which.ravel().astype(np.intp), anchors)


def _states(signal: PiecewiseSignal, g: int, piece: Indices, times: Array) -> Array:
    """The states (k, q) of generator number g in these pieces of the signal (k,) at times (k,) [s]."""
    generator = signal.generators[g]
    since = times - signal.breakpoints[np.maximum(piece - 1, 0)]
    result = np.empty((len(piece), len(generator.S)))
    for direction, chosen in ((-1.0, piece == 0), (1.0, piece > 0)):
        if np.any(chosen):
            w = signal.anchors[piece[chosen], : len(generator.S)]
            result[chosen] = generator.propagator(direction).states(w, np.maximum(direction * since[chosen], 0.0))
    return result
