"""Polynomials by pieces as autonomous signals: their states are their derivatives, in a unit of time that fits each piece."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction

import numpy as np
import scipy.linalg

from invtrack.arrays import Array
from invtrack.references.bernstein import bernstein_derivatives, graded_breakpoints, pieces_for
from invtrack.references.generator import Generator, constant_generator
from invtrack.references.signal import PiecewiseSignal

SERIES_DEGREE = 8
"""Up to this degree the Taylor series of a propagator ends by itself, whatever the unit of time of the states."""

LENGTHS_PER_UNIT = 16.0
"""Pieces of higher degree whose lengths differ by more than this factor get states in other units of time."""


def polynomial_signal(
    breakpoints: Array, units: Array, derivatives: Array, held: tuple[Array, Array], *, rows: Array, offset: Array
) -> PiecewiseSignal:
    """The signal y = offset + rows f, the f polynomials by pieces, held still before and after.

    Its states are f, unit f', unit^2 f'', ...: their generator is the shift divided by `unit`, whose exponential has no negative
    entries, so that rounding costs no more than the terms of the Taylor series are large.

    Args:
        breakpoints: edges of the pieces (m + 1,) [s].
        units: of time for each piece's states (m,) [s]; those that are equal share a generator.
        derivatives: f^(i) unit^i at each piece's start (m, g, degree + 1).
        held: y before and after, (p,) each.
        rows: (p, g).
        offset: (p,).
    """
    m, g, width = derivatives.shape
    p, first = len(rows), np.eye(1, width)
    offset_states = int(np.any(offset))  # a state that stands still at 1
    R = np.hstack([np.kron(rows, first), np.outer(offset, np.ones(offset_states))])
    shift = scipy.linalg.block_diag(*[np.eye(width, k=1)] * g, np.zeros((offset_states, offset_states)))
    distinct, which = np.unique(units, return_inverse=True)
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):  # refused by the generator
        shifts = [shift / unit for unit in distinct]
    generators = (constant_generator(p), *(Generator(S, R) for S in shifts))
    anchors = np.zeros((m + 2, max(p, R.shape[1])))
    anchors[1:-1, : g * width] = derivatives.reshape(m, -1)
    anchors[1:-1, g * width : R.shape[1]] = 1.0
    anchors[0, :p], anchors[-1, :p] = held
    kind = np.concatenate([[0], which + 1, [0]]).astype(np.intp)
    return PiecewiseSignal(breakpoints, generators, kind, anchors)


def state_units(lengths: Array, degree: int) -> Array:
    """Powers of two [s] in which to measure the states of pieces of these lengths (m,) [s]: (m,), as few as will do.

    A polynomial of size 1 on its piece then has derivatives of about that size, as the propagators' Taylor series need it; those of
    low degree do not.
    """
    share = 2 / max(degree, SERIES_DEGREE)
    if degree <= SERIES_DEGREE:
        return np.full(len(lengths), power_of_two_below(share * float(np.median(lengths))))
    group = np.floor(np.log2(np.max(lengths) / lengths) / np.log2(LENGTHS_PER_UNIT))
    _, first = np.unique(group, return_inverse=True)
    shortest = np.full(int(np.max(first)) + 1, np.inf)
    np.minimum.at(shortest, first, lengths)
    return np.array([power_of_two_below(share * length) for length in shortest.tolist()])[first]


def power_of_two_below(value: float) -> float:
    """The largest power of two that is no larger than a positive number."""
    return math.ldexp(0.5, math.frexp(value)[1])


def derivative_weights(degree: int, ratio: float) -> Array:
    """i! ratio^i for i = 0 ... degree: from Taylor coefficients to derivatives, in a unit of time `ratio` times as long."""
    with np.errstate(over="ignore"):
        return np.asarray(np.cumprod(np.concatenate([[1.0], ratio * np.arange(1, degree + 1)])))


def from_power(lengths: Array, given: Sequence[Array], time_scale: float) -> tuple[Array, Array]:
    """Units of time (m,) of pieces of these lengths (m,) [s] and the derivatives in them (m, p, degree + 1).

    given: coefficients of each piece (p, degree_j + 1), of the powers of time since its start in units of time_scale [s].
    """
    degree = max(c.shape[1] for c in given) - 1
    units = state_units(lengths, degree)
    with np.errstate(over="ignore", invalid="ignore"):  # refused by the signal
        parts = [c * derivative_weights(c.shape[1] - 1, unit / time_scale) for c, unit in zip(given, units.tolist(), strict=True)]
    return units, np.stack([_widened(part, degree) for part in parts])


def from_bernstein(times: Array, given: Sequence[Array]) -> tuple[Array, Array, Array]:
    """Breakpoints (m + 1,) of the pieces that those between `times` are cut into, units (m,) and derivatives (m, p, degree + 1).

    given: Bernstein coefficients of each piece between `times` (p, degree_j + 1).
    """
    degree = max(c.shape[1] for c in given) - 1
    edges = [
        graded_breakpoints(start, end, pieces_for(c.shape[1] - 1))
        for start, end, c in zip(times[:-1].tolist(), times[1:].tolist(), given, strict=True)
    ]
    units = state_units(np.array([np.min(np.diff(inner)) for inner in edges]), degree)
    parts = []
    for c, inner, unit in zip(given, edges, units.tolist(), strict=True):
        channels = [bernstein_derivatives([Fraction(b) for b in row], inner, unit) for row in c.tolist()]
        parts.append(_widened(np.stack(channels, axis=1), degree))
    cuts = np.concatenate([*(inner[:-1] for inner in edges), times[-1:]])
    return cuts, np.repeat(units, [len(part) for part in parts]), np.concatenate(parts)


def _widened(part: Array, degree: int) -> Array:
    """With zeros for the derivatives beyond its own degree."""
    return np.pad(part, [(0, 0)] * (part.ndim - 1) + [(0, degree + 1 - part.shape[-1])])
