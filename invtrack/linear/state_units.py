"""Units of the states in which a plant's matrices speak clearly."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import scipy  # loads scipy.optimize at its first use
from numpy.typing import NDArray

from invtrack.arrays import Array, Indices, as_divisor
from invtrack.linear.scaling import balancing_scale, pace_of, parts
from invtrack.linear.state_space import StateSpace

CLEAR = 1e-10
"""Shares below this are all alike: rounding, where the parts of a plant do not act on each other."""

COARSE_PACES, FINER_STEPS = tuple(range(-20, 41, 6)), (3, 1)
"""Exponents of two, over the fastest mode, of the paces that are looked at, and the steps in which the best is then refined."""

ABOUT_AS_CLEAR = 1.0
"""Mean logarithms of shares that differ by less than this are about equally good."""

ALIKE = 1e-9
"""Mean logarithms that differ by less are the same."""

NOTHING = -1e6
"""log2 of what an input does to an output that it does not reach."""

LARGEST_EXPONENT = 1000.0
"""Bound on log2 of a feedback gain, close to what numbers hold."""


def plant_units(system: StateSpace) -> Array:
    """Units (n,) of the states, powers of two, in which they act on each other, and between inputs and outputs, about equally.

    They undo whatever units states, inputs, outputs and time came in.
    """
    return _clearest(system)[0]


def plant_pace(system: StateSpace) -> float:
    """How fast [rad/s] the loops through inputs and outputs are in whose units the couplings stand out most clearly."""
    return _clearest(system)[1]


def own_pace(system: StateSpace) -> float:
    """How fast a plant moves by itself [rad/s]: the size of A in units in which its states act on each other about equally."""
    units = plant_units(system)
    return min(float(np.linalg.norm(system.A * units / units[:, None], 2)), pace_of(system.A))


@lru_cache(maxsize=64)
def _clearest(system: StateSpace) -> tuple[Array, float]:
    """Units and pace.

    A alone may fall apart into parts without a common scale: each output is fed back to each input with the gain with which the
    strongest loop through both is as fast as a pace. Which one is no property of the plant: a hovering vehicle's drag is far slower
    than what its outputs ask of it. Taken is the one in whose units the couplings stand out most clearly; of two about as good the
    faster one, since at the pace of a slow drag the rounding of a linearization couples, too.
    """
    known = ((name, np.abs(getattr(system, name))) for name in "ABC")
    A, B, C = (np.where(size > system.errors(name), size, 0.0) for name, size in known)
    root = float(np.max(np.abs(np.linalg.eigvals(A))))
    centre, paths = np.log2(root if root > 0 else 1.0), _path_sizes(A, B, C)
    found: dict[float, tuple[float, Array]] = {}

    def look(exponent: float) -> float:
        """How clear the couplings are where the loops are as fast as 2^exponent times the fastest mode."""
        if exponent not in found:
            loops = _loops(A, B, C, paths, centre + exponent)
            finite = bool(np.all(np.isfinite(loops)))
            units = balancing_scale(loops if finite else A)
            found[exponent] = _clarity(system, units, parts(loops)) if finite else -np.inf, units
        return found[exponent][0]

    coarse = {exponent: look(exponent) for exponent in COARSE_PACES}
    around = [-np.inf, *coarse.values(), -np.inf]
    peaks = [e for e, before, after in zip(coarse, around, around[2:], strict=False) if coarse[e] >= max(before, after)]
    clear = max(e for e in peaks if coarse[e] >= max(coarse.values()) - ABOUT_AS_CLEAR)
    # Where the pace makes no difference the plant's own will do.
    best = min((e for e in peaks if abs(coarse[e] - coarse[clear]) <= ALIKE), key=abs)
    for step in FINER_STEPS:
        best = max((best, best - step, best + step), key=look)
    units = found[best][1]
    units.setflags(write=False)
    return units, float(np.exp2(centre + best))


def _loops(A: Array, B: Array, C: Array, paths: Array, pace: float) -> Array:
    """A with every output fed back to every input such that the strongest loop through both is as fast as 2^pace [rad/s] (n, n).

    But for inputs that do next to nothing to an output beside what both are for: with a gain that makes up for that, rounding in a
    thrust of zero, which pushes a satellite aside as it turns, would couple its place with its attitude.
    """
    strongest = np.max(paths - np.arange(len(paths))[:, None, None] * pace, axis=0)
    fed_back = np.isfinite(strongest) & _matter(strongest)
    gains = np.exp2(np.clip(pace - strongest, None, LARGEST_EXPONENT), where=fed_back, out=np.zeros_like(strongest))
    with np.errstate(over="ignore"):  # at paces far above all that the plant does
        return np.asarray(A + B @ gains.T @ C)


def _matter(strength: Array) -> NDArray[np.bool_]:
    """Which pairs of outputs and inputs matter, for log2 of what each input does to each output (p, m).

    Of a square plant inputs and outputs are paired one to one, so that the product of what each input does to its output is the
    largest. Any other pair matters where the best such product with it is no smaller than the share CLEAR of that one: units of
    inputs and outputs do not change that share. With more of the ones than of the others all pairs matter.
    """
    p, m = strength.shape
    if p != m or m == 1:
        return np.ones((p, m), dtype=bool)
    known = np.where(np.isfinite(strength), strength, NOTHING)
    own = scipy.optimize.linear_sum_assignment(known, maximize=True)[1]  # the input of each output
    taken = known[:, own]
    gain = taken - np.diag(taken)  # of output r that takes the input of output q, which is left without one
    chains = np.where(np.eye(p, dtype=bool), 0.0, gain)  # the best of outputs that each take the input of the next
    for k in range(p):
        chains = np.maximum(chains, chains[:, [k]] + chains[[k]])
    result = np.empty((p, m), dtype=bool)
    result[:, own] = gain + chains.T >= np.log2(CLEAR)
    return result


def _path_sizes(A: Array, B: Array, C: Array) -> Array:
    """log2 of C A^k B for k < n, entry by entry: (n, p, p), A, B, C without negative entries."""
    exponent, sizes = np.zeros(B.shape[1]), np.full((len(A), len(C), B.shape[1]), -np.inf)
    for k in range(len(A)):
        unit = np.exp2(np.ceil(np.log2(np.max(B, axis=0), where=np.any(B, axis=0), out=np.zeros(B.shape[1]))))
        B, exponent = B / unit, exponent + np.log2(unit)
        reached = C @ B
        sizes[k] = np.log2(reached, where=reached > 0, out=sizes[k]) + exponent
        B = A @ B
    return sizes


def _clarity(system: StateSpace, scale: Array, part: Indices) -> float:
    """How far the couplings stand out in these units: mean logarithm of their shares, of A's norm, of a column of B, a row of C.

    Only those of states that act on each other both ways, which `part` (n,) says: one-way couplings any units make as large as one
    likes.
    """
    A, B, C = (np.abs(M) for M in (system.A * scale / scale[:, None], system.B / scale[:, None], system.C * scale))
    np.fill_diagonal(A, 0.0)  # what acts on itself couples nothing
    sizes = (np.linalg.norm(A), np.linalg.norm(B, axis=0, keepdims=True), np.linalg.norm(C, axis=1, keepdims=True))
    counted = ((A > 0) & (part[:, None] == part), B > 0, C > 0)
    shares = np.concatenate([(M / as_divisor(size))[which] for M, size, which in zip((A, B, C), sizes, counted, strict=True)])
    return float(np.mean(np.log(np.maximum(shares, CLEAR)))) if shares.size else 0.0
