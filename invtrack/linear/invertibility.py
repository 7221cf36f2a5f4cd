"""Why a plant has no inverse: the necessary condition that fails, by name."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
import scipy.linalg

from invtrack.arrays import Array, ComplexArray, as_divisor
from invtrack.linear.scaling import pace_of
from invtrack.linear.state_space import StateSpace
from invtrack.linear.state_units import plant_units

RANK_TOLERANCE = 1e-10
"""Singular values below this share of the largest are none, rows and columns scaled to unit size."""

REACHED = 1e-11
"""An entry of the transfer matrix is none below this share of the terms that it is the sum of."""

PROBES = np.exp(1j * np.array([0.6, 1.0, 1.3]))
"""Where the transfer matrix is looked at, times the plant's pace: anywhere will do that is no zero or pole."""

MOST_CHOICES, SHOWN_CHOICES = 200, 4
"""How many choices of outputs are looked at where there are too many of them, and how many are named."""

NO_INVERSE_NEEDED = (
    "methods that need no inverse: invtrack.quadratic_redesign, invtrack.constrained_redesign and invtrack.redesign.prefilter, "
    "which follow the outputs as well as the inputs can"
)


def why_not_invertible(system: StateSpace) -> str:
    """The sentence for a refusal: which necessary condition of exact tracking fails, and what serves instead.

    At least as many inputs m as outputs p; independent inputs, rank [B; D] >= p; independent outputs, rank [C, D] = p; each output
    reached by an input; normal rank p of the transfer matrix G(s).
    """
    m, p, inputs, outputs = system.n_inputs, system.n_outputs, system.inputs.names, system.outputs.names
    unit = plant_units(system)
    A, B, C, D = system.A * unit / unit[:, None], system.B / unit[:, None], system.C * unit, system.D
    remedy = f"; choose other outputs or inputs, or use {NO_INVERSE_NEEDED}"
    transfer = _transfer(A, B, C, D)
    if p > m:
        return _too_many_outputs(system, transfer)
    for name, row in zip(outputs, np.moveaxis(transfer, 1, 0), strict=True):
        if not np.any(row):
            return f"output {name!r} is not reached by any input (its row of the transfer matrix vanishes){remedy}"
    for name, column in zip(inputs, np.moveaxis(transfer, 2, 0), strict=True):
        if m == p and not np.any(column):
            return f"input {name!r} reaches no output (its column of the transfer matrix vanishes){remedy}"
    redundant, needless = _null(np.vstack([B, D])), _null(np.hstack([C, D]).T)
    if m - redundant.shape[1] < p:
        told = _combination(redundant[:, 0], inputs)
        rank = f"rank [B; D] is {m - redundant.shape[1]} where {p} outputs need {p}"
        return f"the inputs are not independent: {told} acts on nothing, {rank}{remedy}"
    if needless.shape[1]:
        told = _combination(needless[:, 0], outputs)
        return f"the outputs are not independent: {told} is always zero, rank [C, D] is {p - needless.shape[1]} of {p}{remedy}"
    reached = max(m - _null(matrix).shape[1] for matrix in transfer)
    if reached < p:
        left = [_null(matrix.T.conj())[:, 0] for matrix in transfer]
        told = "they obey an equation of their own"
        first = left[0] / left[0][np.argmax(np.abs(left[0]))]
        if all(np.linalg.norm(v - first * (first.conj() @ v) / (first.conj() @ first)) < 1e-6 for v in left) and not np.any(
            np.abs(first.imag) > 1e-6
        ):
            told = f"no input moves {_combination(first.real, outputs)}"
        return (
            f"the outputs {list(outputs)} cannot follow independent trajectories: the transfer matrix has normal rank {reached} of "
            f"{p} ({told}){remedy}"
        )
    return (
        f"how the inputs {list(inputs)} set the outputs {list(outputs)} independently cannot be told from rounding or from the "
        f"errors of the model{remedy}"
    )


def _too_many_outputs(system: StateSpace, transfer: ComplexArray) -> str:
    """The sentence for more outputs than inputs: which of them can be tracked exactly, together."""
    m, p, inputs, outputs = system.n_inputs, system.n_outputs, system.inputs.names, system.outputs.names
    rank = max(m - _null(matrix).shape[1] for matrix in transfer)
    served: list[str] = []
    for chosen in itertools.islice(itertools.combinations(range(p), rank), MOST_CHOICES):
        if max(m - _null(matrix[list(chosen)]).shape[1] for matrix in transfer) == rank:
            served.append(str([outputs[i] for i in chosen]))
    message = (
        f"more outputs than inputs: {m} input(s) {list(inputs)} for the {p} outputs {list(outputs)}, of which no more than {rank} "
        "(or as many combinations) can follow trajectories of their own exactly"
    )
    if served and rank == m:
        first = served[0]
        message += (
            f": {' or '.join(served[:SHOWN_CHOICES])}{' or others' if len(served) > SHOWN_CHOICES else ''} "
            f"(model.with_outputs({first}) and a reference for no others)"
        )
    return f"{message}; to follow all of them, use {NO_INVERSE_NEEDED}"


def _transfer(A: Array, B: Array, C: Array, D: Array) -> ComplexArray:
    """G(s) at each probe (k, p, m), entries that are rounding set to zero."""
    pace = max(pace_of(A), np.finfo(float).tiny)
    result = []
    for s in pace * PROBES:
        resolvent = scipy.linalg.solve(s * np.eye(len(A)) - A, np.eye(len(A)))
        G = C @ resolvent @ B + D
        terms = np.abs(C) @ np.abs(resolvent) @ np.abs(B) + np.abs(D)
        result.append(np.where(np.abs(G) <= REACHED * terms, 0.0, G))
    return np.array(result)


def _null(matrix: Array | ComplexArray) -> Array | ComplexArray:
    """Orthonormal basis of the null space, of rows and columns scaled to unit size, back in the columns' units (m, k)."""
    scaled = matrix / as_divisor(np.max(np.abs(matrix), axis=1, keepdims=True, initial=0.0))
    column = as_divisor(np.max(np.abs(scaled), axis=0, initial=0.0))
    _, sizes, Vh = np.linalg.svd(scaled / column)
    rank = int(np.sum(sizes > RANK_TOLERANCE * max(sizes[0], 1.0)))
    return np.asarray(Vh[rank:].conj().T / column[:, None])


def _combination(weights: Array | ComplexArray, names: Sequence[str]) -> str:
    """Text such as "y1 - 2 y2", the first weight that counts scaled to one."""
    weights = np.real(weights)
    weights = np.where(np.abs(weights) > 1e-9 * np.max(np.abs(weights)), weights, 0.0)
    first = int(np.flatnonzero(weights)[0])
    text = names[first]
    for weight, name in zip((weights / weights[first])[first + 1 :].tolist(), names[first + 1 :], strict=True):
        if weight:
            size = f"{abs(weight):.4g} "
            text += f" {'-' if weight < 0 else '+'} " + ("" if size == "1 " else size) + name
    return text
