"""The optimal trajectory over one interval of the plant: what its end values carry across it, and what the reference adds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from invtrack.linear.propagation import Propagator, forced_states
from invtrack.plans.plan import TwoSidedGenerator
from invtrack.redesign.optimal.optimum import Optimum
from invtrack.references.signal import Generator, PiecewiseSignal

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Interval:
    """xi is known at the start of the interval and s at its end; both follow within it.

    xi at the end is E_f xi(start) + p_f, s at the start is E_b s(end) + p_b. pieces: the reference's pieces in it (none, where it
    lies outside the manoeuvre), kind: which of the generators each of them uses; forced_f, forced_b: xi at the start and s at the
    end of each piece that the reference alone causes. start_w, end_w: the reference's own states there.
    """

    optimum: Optimum
    pieces: NDArray[np.intp]
    kind: NDArray[np.intp]
    start_w: Array
    end_w: Array
    edges: Array
    E_f: Array
    p_f: Array
    E_b: Array
    p_b: Array
    forced_f: Array
    forced_b: Array

    def parts(self, xi: Array, s: Array) -> tuple[Array, Array]:
        """xi at the start and s at the end of each piece, both (pieces, n), for xi (n,) at the interval's start, s at its end."""
        one = np.zeros(len(self.pieces), dtype=np.intp)
        identity = np.eye(len(xi))
        since, until = self.edges[:-1] - self.edges[0], self.edges[-1] - self.edges[1:]
        carried_f = Propagator(self.optimum.A_c).outputs(identity, xi[np.newaxis], one, since)
        carried_b = Propagator(self.optimum.A_c.T).outputs(identity, s[np.newaxis], one, until)
        return self.forced_f + carried_f, self.forced_b + carried_b


def two_sided(optimum: Optimum, generator: Generator) -> TwoSidedGenerator:
    """[x; u; y] of the optimum driven by one generator of the reference, w' = S w, y_d = R w."""
    forward = _augmented(optimum.A_c, optimum.E_f @ generator.R, generator.S)
    backward = _augmented(-optimum.A_c.T, optimum.E_b @ generator.R, generator.S)
    X_w = optimum.X_y @ generator.R
    return TwoSidedGenerator(
        forward, np.hstack([optimum.X_f, X_w]), backward, np.hstack([optimum.X_b, np.zeros_like(X_w)])
    )  # the reference acts on the values once


def make_interval(
    optimum: Optimum, reference: PiecewiseSignal, end_anchors: Array, pieces: NDArray[np.intp], generators: list[TwoSidedGenerator]
) -> Interval:
    """The interval that holds the reference's pieces stated; generators: those of `two_sided`, in the reference's order."""
    n = len(optimum.A_c)
    # Where the interval holds no piece, it has no length and any edge will do.
    edges = reference.breakpoints[np.append(pieces - 1, pieces[-1])] if len(pieces) else reference.breakpoints[:1]
    lengths, kind = np.diff(edges), reference.kind[pieces]
    start_w, end_w = reference.anchors[pieces], end_anchors[pieces]
    added_f, added_b = np.zeros((len(pieces), n)), np.zeros((len(pieces), n))
    for index in np.unique(kind):
        chosen, q = kind == index, len(reference.generators[index].S)
        for propagator, w, added in zip(generators[index].propagators, (start_w, end_w), (added_f, added_b), strict=True):
            start = np.hstack([np.zeros((int(np.sum(chosen)), n)), w[chosen, :q]])
            added[chosen] = propagator.outputs(np.eye(n, n + q), start, np.arange(len(start)), lengths[chosen])
    forward, backward = Propagator(optimum.A_c), Propagator(optimum.A_c.T)
    forced_f = forced_states(forward, added_f, lengths)
    forced_b = forced_states(backward, added_b[::-1], lengths[::-1])[::-1]
    whole = np.full(n, edges[-1] - edges[0])
    return Interval(
        optimum=optimum,
        pieces=pieces,
        kind=kind,
        start_w=start_w,
        end_w=end_w,
        edges=edges,
        E_f=forward.states(np.eye(n), whole).T,
        p_f=forced_f[-1],
        E_b=backward.states(np.eye(n), whole).T,
        p_b=forced_b[0],
        forced_f=forced_f[:-1],
        forced_b=forced_b[1:],
    )


def _augmented(A: Array, E: Array, S: Array) -> Array:
    return np.block([[A, E], [np.zeros((len(S), len(A))), S]])
