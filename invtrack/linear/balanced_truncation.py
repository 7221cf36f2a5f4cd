"""Reduction to what inputs move and outputs show most, on an average over the intervals of a switched plant."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg

from invtrack.arrays import Array, as_divisor
from invtrack.errors import ModelError
from invtrack.linear.invariant_parts import invariant_parts
from invtrack.linear.normal_form import normal_form
from invtrack.linear.reduction import Projection, Reduction, checked, chosen, damped, require_square
from invtrack.linear.state_space import StateSpace
from invtrack.linear.state_units import plant_units
from invtrack.linear.switched import SwitchedSystem, as_switched

SAME_DIRECTION = 1e-6
"""Directions that intervals share to within this share of their length are one."""

NOTHING_LEFT = 1e-10
"""A direction is not worth a state where its Hankel singular value is below this share of the largest."""


def balanced_truncation(model: Any, *, band: float, accuracy: float = 0.01, modes: int | None = None) -> Reduction:
    """The plant in the states that inputs move and outputs show most, the same directions in all intervals of a switched plant.

    Of each interval the damped part has the Gramians A P + P A' + B B' = 0 and A' Q + Q A + C'C = 0; their averages over the
    distinct models are balanced, and the directions with the largest Hankel singular values kept, as many pairs as it takes for
    the inverse of the reduced model to lose no more than `accuracy` of the full model's output within the band, in every interval
    (as for `modal_truncation`).

    Besides these V has the directions of all modes that are at rest or grow in any interval, and each interval's W has the rows of
    its own such modes, so that they stay exactly as they are: of a mechanism whose payload changes its place, and the centre of
    mass that each payload makes. W also has the rows of outputs whose rates the inputs do not enter, so that their relative degree
    is not one. All other rows are the balanced ones. The state x = V z is continuous at a switch where z is.

    Args:
        model: StateSpace, SwitchedSystem, or anything with A, B, C, D, with as many inputs as outputs.
        band: up to which frequency the reduced model is to be right [rad/s]: see `modal_truncation`.
        accuracy: share of the output that may be lost, between 0 and 1.
        modes: how many pairs of states to keep besides those at rest, in place of what the accuracy asks for.

    Raises ModelError for unequal numbers of inputs and outputs, options out of range, a plant without damped modes, and where every
    state is needed; RelativeDegreeError where the plant has no inverse. Sources: B. Moore, "Principal component analysis in linear
    systems", IEEE Trans. Automatic Control 26(1), 1981; averages over the modes of a switched system: N. Monshizadeh, H.
    Trentelman, M. Camlibel, "A simultaneous balanced truncation approach to model reduction of switched linear systems", IEEE
    Trans. Automatic Control 57(12), 2012.
    """
    plant = as_switched(model)
    limits = checked(band, accuracy, modes)
    require_square(plant, "balanced truncation")
    candidates = _candidates(plant)
    return chosen("balanced truncation", plant, candidates, band=limits[0], accuracy=limits[1], modes=limits[2])


@dataclass(frozen=True, eq=False)
class _Parts:
    """What stays of an interval: directions R (n, a) and rows L (a, n); and Gramians P, Q (n, n) of what is damped."""

    R: Array
    L: Array
    P: Array
    Q: Array


def _parts(system: StateSpace, units: Array) -> _Parts:
    A, B, C = system.A * units / units[:, None], system.B / units[:, None], system.C * units
    B, C = B / as_divisor(np.linalg.norm(B, axis=0)), C / as_divisor(np.linalg.norm(C, axis=1))[:, None]
    is_damped = damped(system)
    parts = invariant_parts(A, lambda s: not bool(is_damped(np.array([s]))[0]))
    if not len(parts.A_2):
        raise ModelError("balanced truncation needs damped modes, as all others are kept, and this plant has none of them")
    B_2, C_2 = parts.L_2 @ B, C @ parts.W_2
    P = scipy.linalg.solve_continuous_lyapunov(parts.A_2, -B_2 @ B_2.T)
    Q = scipy.linalg.solve_continuous_lyapunov(parts.A_2.T, -C_2.T @ C_2)
    return _Parts(parts.W_1, parts.L_1, parts.W_2 @ P @ parts.W_2.T, parts.L_2.T @ Q @ parts.L_2)


def _candidates(plant: SwitchedSystem) -> Iterator[Projection]:
    """Projections on what stays, and on more and more pairs of balanced directions."""
    units = plant_units(plant.distinct[0])
    each = [_parts(system, units) for system in plant.distinct]
    Z_P, Z_Q = (_root(np.mean(gramians, axis=0)) for gramians in ([part.P for part in each], [part.Q for part in each]))
    V_1 = _span([part.R for part in each])
    W_1 = np.mean([np.linalg.lstsq(part.L @ V_1, part.L, rcond=None)[0] for part in each], axis=0).T
    W_1 = np.linalg.solve(W_1.T @ V_1, W_1.T).T if V_1.size else W_1
    Z_P, Z_Q = Z_P - V_1 @ (W_1.T @ Z_P), Z_Q - W_1 @ (V_1.T @ Z_Q)
    left, size, right = scipy.linalg.svd(Z_Q.T @ Z_P)
    useful = int(np.sum(size > NOTHING_LEFT * size[0]))
    outputs = [_output_rows(system, units) for system in plant.distinct]
    for count in range(0, useful + 1, 2):
        V = np.hstack([V_1, _unit_columns(Z_P @ right[:count].T)])
        more = [V.shape[1] - len(part.L) for part in each]
        if not (0 < V.shape[1] < plant.n_states and min(more) >= 0 and max(more) <= useful):
            continue
        W = []
        for part, rows, number in zip(each, outputs, more, strict=True):
            balanced = _unit_columns(Z_Q @ left[:, :number]).T
            M = np.vstack([part.L, _with_rows(balanced, rows - (rows @ V_1) @ W_1.T, Z_P)])
            W.append(np.linalg.solve(M @ V, M) / units)
        yield Projection(tuple(W), V * units[:, None], np.zeros((plant.n_states, plant.n_inputs)), count // 2)


def _with_rows(balanced: Array, rows: Array, Z_P: Array) -> Array:
    """As many rows as `balanced` has (k, n), with `rows` (q, n) among what they span in place of what comes nearest to them.

    Near is what is moved alike: rows are compared by what the inputs make of them, w Z_P.
    """
    if not len(rows) or len(balanced) < len(rows):
        return balanced
    basis, R = np.linalg.qr((balanced @ Z_P).T)
    shares = basis.T @ (rows @ Z_P).T
    others = np.linalg.qr(shares, mode="complete")[0][:, len(rows) :]
    return np.vstack([rows, np.linalg.solve(R, others).T @ balanced])


def _output_rows(system: StateSpace, units: Array) -> Array:
    """The rows of the outputs (q, n), in these units, whose rates the inputs do not enter."""
    form = normal_form(system)
    found = system.C[[order > 1 for order in form.orders]] * units
    return np.asarray(found / as_divisor(np.linalg.norm(found, axis=1))[:, None])


def _unit_columns(M: Array) -> Array:
    return M / as_divisor(np.linalg.norm(M, axis=0))


def _root(gramian: Array) -> Array:
    """Z (n, r) with Z Z' the Gramian."""
    values, vectors = np.linalg.eigh((gramian + gramian.T) / 2)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _span(bases: list[Array]) -> Array:
    """Orthonormal directions (n, r) of all of the bases together."""
    directions = np.hstack([_unit_columns(basis) for basis in bases])
    if not directions.size:
        return directions
    left, size, _ = np.linalg.svd(directions, full_matrices=False)
    return np.asarray(left[:, size > SAME_DIRECTION * size[0]])
