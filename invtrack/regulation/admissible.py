"""Which exosystem states a continuous state of the plant can follow: those that the jumps of G map to zero."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from invtrack.arrays import Array
from invtrack.linear.normal_form import NormalForm, normal_form
from invtrack.linear.state_sizes import RESOLVED, comparable_size, unit_ratios
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.trajectory import Trajectory
from invtrack.references.exosystem import Exosystem
from invtrack.regulation.map_pieces import column_weights, inner_times

JUMP_TOLERANCE = 1e-9
"""An entry of G counts as continuous where it jumps by less than this share of its size around the breakpoint."""


@dataclass(frozen=True)
class InadmissibleState:
    """A named state of the exosystem (x_e(T_i) = that unit vector) whose output no continuous state of the plant can follow.

    Args:
        name: of the state.
        time: at which the plant cannot follow [s].
        output: the output of which a derivative jumps there; "" where none does but the plant's state has to.
        derivative: the order of that derivative, -1 for "".
        jump: by how much it jumps, in units of that derivative (of the state, for "").
    """

    name: str
    time: float
    output: str
    derivative: int
    jump: float

    def __str__(self) -> str:
        if not self.output:
            return f"{self.name}: at t = {self.time:.6g} s the state that keeps the output exact jumps by {self.jump:.3g}"
        return (
            f"{self.name}: at t = {self.time:.6g} s derivative {self.derivative} of output {self.output!r} jumps by {self.jump:.3g}"
        )


@dataclass(frozen=True, eq=False)
class Jumps:
    """Discontinuities of a map at its breakpoints t_0 ... t_m, for an exosystem whose states are of comparable size.

    times (m + 1,) [s]. jump (m + 1, n, q): G(t_k+) - G(t_k-) beyond what is allowed, entries within rounding set to zero; size
    (m + 1, n, q): of G around each breakpoint; Phi (m + 1, q, q): x_e(t_k) = Phi_k x_e(t_0). All for w x_e, the weighted states:
    see `visibility`.
    """

    times: Array
    jump: Array
    size: Array
    Phi: Array

    def of_states(self, count: int) -> Jumps:
        """Those of the first states alone, which the others do not drive."""
        return Jumps(self.times, self.jump[:, :, :count], self.size[:, :, :count], self.Phi[:, :count, :count])

    @property
    def where(self) -> list[int]:
        """Numbers of the breakpoints at which anything jumps."""
        return np.flatnonzero(np.any(self.jump, axis=(1, 2))).tolist()


def map_jumps(trajectory: Trajectory, exosystem: Exosystem, plant: SwitchedSystem, weights: Array, allowed: Array) -> Jumps:
    """Jumps of G (n, q), from its values on both sides of each breakpoint, for the exosystem's states times `weights` (q,).

    Args:
        trajectory: G and F row by row, one above the other.
        exosystem: what drives the map, not weighted.
        plant: the plant.
        weights: of the exosystem's states (q,).
        allowed: jumps that do not count (m + 1, n, q), see `rest_jumps`.
    """
    exosystem, w = exosystem.weighted(weights), column_weights(weights)
    n, q, edges = plant.n_states, exosystem.n_states, trajectory.breakpoints
    sides = np.arange(len(edges))
    middles = inner_times(edges)
    rows = slice(0, n * q)
    left, right = (trajectory(edges, sides + side, rows).reshape(-1, n, q) / w for side in (0, 1))
    inner = np.abs(trajectory(middles, np.arange(len(middles)), rows).reshape(-1, n, q)) / w
    around = np.maximum(np.maximum(np.abs(left), np.abs(right)), np.maximum(inner[:-1], inner[1:]))
    size, jump = entry_sizes(around, unit_ratios(plant)), right - left - allowed
    steps = [exosystem.transition(a, b) for a, b in itertools.pairwise(edges.tolist())]
    Phi = np.array(list(itertools.accumulate(steps, lambda so_far, step: step @ so_far, initial=np.eye(q))))
    return Jumps(edges, np.where(np.abs(jump) > JUMP_TOLERANCE * size, jump, 0.0), size, Phi)


def entry_sizes(values: Array, ratios: Array) -> Array:
    """What the entries of matrices (m, n, q) are measured against: row size times column size, free of the units of the rows.

    Columns are comparable, since the exosystem's states are weighted; rows, which are states of the plant, by `ratios` (n, n), see
    `unit_ratios`. A row or column far smaller than comparable ones, because the terms that make it up cancel, holds only their
    rounding (the velocities of a plant at rest, for instance): no size is below the share RESOLVED of comparable ones.
    """
    row = np.max(values, axis=2, initial=0.0)
    row = comparable_size(row, ratios)[:, :, None]
    row = np.where(row > 0, row, 1.0)
    column = np.max(values / row, axis=1, keepdims=True, initial=0.0)
    column = np.maximum(column, RESOLVED * np.max(column, axis=2, keepdims=True))
    return np.asarray(row * np.where(column > 0, column, 1.0))


def admissible_states(jumps: Jumps) -> Array:
    """Orthonormal basis (q, d) of the weighted states x_e(t_0) with [G(t_k+) - G(t_k-)] x_e(t_k) = 0 at every breakpoint."""
    if not jumps.where:
        return np.eye(jumps.Phi.shape[1])
    conditions = np.vstack([_conditions(jumps, k) for k in jumps.where])
    basis: Array = scipy.linalg.null_space(conditions, rcond=JUMP_TOLERANCE)
    return basis


def _conditions(jumps: Jumps, k: int) -> Array:
    """The conditions of breakpoint k on x_e(t_0), rows (., q) of unit length, or zero."""
    row, size = jumps.jump[k] @ jumps.Phi[k], jumps.size[k] @ np.abs(jumps.Phi[k])
    rows = np.where(np.abs(row) > JUMP_TOLERANCE * size, row, 0.0)
    norms = np.linalg.norm(rows, axis=1, keepdims=True)
    return np.asarray(rows / np.where(norms > 0, norms, 1.0))


def directions_left(jumps: Jumps) -> tuple[tuple[float, int], ...]:
    """(time [s], d) of each breakpoint that leaves fewer directions of x_e admissible than those before it do: d of them."""
    found: list[tuple[float, int]] = []
    basis = np.eye(jumps.Phi.shape[1])
    for k in jumps.where:
        if not basis.shape[1]:
            break
        _, sizes, rows = np.linalg.svd(_conditions(jumps, k) @ basis)
        lost = int(np.sum(sizes > JUMP_TOLERANCE))
        if lost:
            basis = basis @ rows[lost:].T
            found.append((float(jumps.times[k]), basis.shape[1]))
    return tuple(found)


def largest_jump(jumps: Jumps, states: Array) -> float:
    """Largest jump of G x_e at a breakpoint for weighted x_e(t_0) in the columns of `states` (q, d), relative to its size there."""
    worst = 0.0
    for k in jumps.where:
        x_e = jumps.Phi[k] @ states
        size = jumps.size[k] @ np.abs(x_e)
        worst = max(worst, float(np.max(np.abs(jumps.jump[k] @ x_e) / np.where(size > 0, size, 1.0), initial=0.0)))
    return worst


def inadmissible_states(
    plant: SwitchedSystem, jumps: Jumps, names: Sequence[str], admissible: Array, weights: Array
) -> tuple[InadmissibleState, ...]:
    """The named states outside the admissible subspace: where each fails most, in which derivative, and by how much.

    Args:
        plant: the plant.
        jumps: those of the map.
        names: of the exosystem's states (q,).
        admissible: basis of the admissible weighted states (q, d), see `admissible_states`.
        weights: of the exosystem's states (q,), see `visibility`.
    """
    q, w = len(names), column_weights(weights)
    found: list[InadmissibleState] = []
    for j in np.flatnonzero(np.linalg.norm(np.eye(q) - admissible @ admissible.T, axis=0) > JUMP_TOLERANCE).tolist():
        jumped = {k: jumps.jump[k] @ jumps.Phi[k, :, j] for k in jumps.where}
        shares = {k: float(np.max(np.abs(jump) / jumps.size[k].max(axis=1))) for k, jump in jumped.items()}
        # The first of the worst: later ones are often the same failure, grown a little.
        worst = min(k for k, share in shares.items() if share >= max(shares.values()) / 2)
        time = float(jumps.times[worst])
        form = normal_form(plant.systems[int(plant.interval(time))])
        jump = jumped[worst] * w[j]
        found.append(InadmissibleState(names[j], time, *_where(form, plant.outputs.names, jump)))
    return tuple(found)


def _where(form: NormalForm, names: tuple[str, ...], jump: Array) -> tuple[str, int, float]:
    """The lowest derivative of an output that jumps, with the output's name; ("", -1) where only the internal state does."""
    zeta = form.C_star @ jump
    terms = np.abs(form.C_star) @ np.abs(jump)
    broken = np.flatnonzero(np.abs(zeta) > 1e-6 * np.where(terms > 0, terms, 1.0))
    if not broken.size:
        return "", -1, float(np.max(np.abs(jump)))
    owners = [(i, k) for i, r in enumerate(form.orders) for k in range(r)]
    row = min(broken.tolist(), key=lambda row: owners[row][1])
    return names[owners[row][0]], owners[row][1], float(zeta[row])
