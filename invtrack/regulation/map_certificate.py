"""How well a regulation map meets its equations, and which exosystem states it cannot serve."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from invtrack.arrays import Array, Indices
from invtrack.errors import PlanError
from invtrack.linear.state_sizes import unit_ratios
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.certificate import ACCURACY
from invtrack.plans.trajectory import Trajectory
from invtrack.references.exosystem import Exosystem
from invtrack.regulation.admissible import entry_sizes
from invtrack.regulation.map_pieces import column_weights

NODES, WEIGHTS = np.polynomial.legendre.leggauss(10)

TOTAL_PANELS = 4000
"""Panels checked in all; beyond as many pieces, pieces are skipped evenly."""


@dataclass(frozen=True)
class RegulationCertificate:
    """How well a map meets its equations, measured from its values alone, not from how it was found.

    dynamics_residual: largest |G(b) - G(a) - integral of A G + B F - G A_e| over panels, relative to the size of each entry.
    output_error: largest |C G + D F - C_e|, relative to the size of C_e and of the terms. boundary_residual: how far the stable
    internal coordinates are at T_i, and the antistable ones at T_f, from the bounded particular solutions outside. continuity:
    largest jump of G x_e at a breakpoint, over the admissible exosystem states (of the Francis regulators, which are known to jump:
    over all of them). Relative to the size of G.
    """

    dynamics_residual: float
    output_error: float
    boundary_residual: float
    continuity: float

    def require(self) -> None:
        """The last guard: raises PlanError for a map that misses its own equations by more than ACCURACY, whatever the reason."""
        worst = max(self.dynamics_residual, self.output_error, self.boundary_residual, self.continuity)
        if not worst <= ACCURACY:
            raise PlanError(
                f"the exosystem's map is too ill-conditioned to be trusted: it misses its own equations by {worst:.1e} of its size "
                f"({self}); look for states in badly chosen units, or for exosystem modes that grow or decay by many powers of ten"
            )


def certify_map(
    model: SwitchedSystem,
    exosystem: Exosystem,
    trajectory: Trajectory,
    span: tuple[float, float],
    *,
    weights: Array,
    boundary_residual: float,
    continuity: float,
) -> RegulationCertificate:
    """Residuals of a map over `span`, for the exosystem's states times `weights`, relative to `entry_sizes`.

    Args:
        model: the plant.
        exosystem: as it was given, not weighted.
        trajectory: G and F row by row, one above the other.
        span: first and last time looked at [s].
        weights: of the exosystem's states (q,), see `visibility`.
        boundary_residual, continuity: worked out by the caller, from the map's values too, and handed on.
    """
    n, q = model.n_states, exosystem.n_states
    exosystem, w, ratios = exosystem.weighted(weights), column_weights(weights), unit_ratios(model)
    starts, ends, piece = _panels(trajectory, span)
    middle, half = (starts + ends) / 2, (ends - starts) / 2
    times = (middle[:, None] + half[:, None] * NODES).ravel()
    values = trajectory(times, np.repeat(piece, len(NODES))).reshape(len(piece), len(NODES), -1, q) / w
    G, F = values[:, :, :n], values[:, :, n:]
    G_start, G_end = (trajectory(t, piece, slice(0, n * q)).reshape(-1, n, q) / w for t in (starts, ends))
    size = entry_sizes(np.max(np.abs(G), axis=1), ratios)
    residual, output = np.empty((len(piece), n, q)), 0.0
    owners = np.stack([model.interval(middle), exosystem.interval(middle)], axis=1)
    for k, e in np.unique(owners, axis=0):
        chosen = np.all(owners == (k, e), axis=1)
        system, A_e, C_e = model.systems[k], exosystem.A[e], exosystem.C[e]
        g, f = G[chosen], F[chosen]
        slope = np.einsum("mgij,g->mij", system.A @ g + system.B @ f - g @ A_e, WEIGHTS) * half[chosen, None, None]
        terms = np.abs(system.A) @ np.abs(g) + np.abs(system.B) @ np.abs(f) + np.abs(g) @ np.abs(A_e)
        size[chosen] = np.maximum(size[chosen], entry_sizes(np.max(terms, axis=1) * half[chosen, None, None], ratios))
        residual[chosen] = np.abs(G_end[chosen] - G_start[chosen] - slope)
        missed = np.abs(system.C @ g + system.D @ f - C_e)
        # Where C_e has a zero, G's entries only add up to rounding: measured against what they could add up to.
        possible = np.abs(system.C) @ size[chosen] + np.max(np.abs(system.D) @ np.abs(f), axis=1) + np.abs(C_e)
        output = max(output, float(np.max(missed / np.where(possible > 0, possible, 1.0)[:, None], initial=0.0)))
    largest = np.zeros((int(piece.max()) + 1, n, q))
    np.maximum.at(largest, piece, size)  # where G dies out, its errors are those of what it came from
    return RegulationCertificate(
        dynamics_residual=float(np.max(residual / largest[piece], initial=0.0)),
        output_error=output,
        boundary_residual=boundary_residual,
        continuity=continuity,
    )


def _panels(trajectory: Trajectory, span: tuple[float, float]) -> tuple[Array, Array, Indices]:
    """Starts, ends and pieces of panels that cross no breakpoint, each short against the fastest dynamics of its piece."""
    inner = trajectory.breakpoints
    edges = np.concatenate([[min(span[0], inner[0] - 1.0)], inner, [max(span[1], inner[-1] + 1.0)]])
    fastest = trajectory.paces()
    per_piece = max(1, TOTAL_PANELS // (len(edges) - 1))
    starts, ends, owners = [], [], []
    for j in range(0, len(edges) - 1, max(1, (len(edges) - 1) // TOTAL_PANELS)):
        length = edges[j + 1] - edges[j]
        panel = min(length, 1.0 / max(float(fastest[j]), np.finfo(float).tiny))
        count = int(min(np.ceil(length / panel), per_piece, 200))
        first = edges[j] + (length - panel) * np.linspace(0.0, 1.0, count)
        starts.append(first)
        ends.append(np.minimum(first + panel, edges[j + 1]))
        owners.append(np.full(count, j))
    return np.concatenate(starts), np.concatenate(ends), np.concatenate(owners)
