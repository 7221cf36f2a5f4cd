"""The directions in which zeros are moved, chosen so that the outputs pay as little as possible for it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy  # loads scipy.optimize and scipy.signal, which cost a second, at their first use
from numpy.typing import NDArray

from invtrack.arrays import Array, ComplexArray, Indices
from invtrack.inversion.modified.design_problem import TIME_CONSTANTS, best_weights
from invtrack.inversion.modified.modified_dynamics import Equilibrium, derivative_columns
from invtrack.inversion.modified.placement import MovablePart, integrator_chains, structured_gain
from invtrack.inversion.modified.target_chains import TargetChains
from invtrack.linear.internal_dynamics import InternalDynamics
from invtrack.linear.pole_placement import repeated
from invtrack.references.signal import PiecewiseSignal

GRID = 3000
"""Points of time at most on which the search looks at the error; the choice found is worked out exactly afterwards."""

APART = 1e-3
"""The search works with modes: repeated poles are drawn apart by this share of the largest."""

STARTS = 3
"""How many of the starts, the best of them, the search goes on from."""

PARALLEL = 1e12
"""Condition number of the eigenvectors from which directions count as not reaching the zeros."""

ITERATIONS = 60
"""Steps of the search from each start."""

FLAT = 1e-3
"""Slope of the error, as a share of its value, at which the search ends."""


@dataclass(frozen=True, eq=False)
class _Modes:
    """The movable part in modes of the poles wanted, with the responses of each mode to each derivative of the reference.

    poles (m,): those of the errors, then the zeros moved; D (m, n_d): drive of z by the derivatives; responses (n, m, n_d): their
    triangular factor, which has the same inner products as the responses over time; owner: output of each error pole.
    """

    part: MovablePart
    poles: ComplexArray
    owner: Indices
    D: Array
    responses: ComplexArray
    output_scale: Array

    def error(self, directions: ComplexArray) -> float:
        """Integral square error for the directions (p, k) of the zeros moved, one for each mode, with the best L."""
        p, m = len(self.output_scale), len(self.poles)
        G = np.hstack([np.eye(p)[:, self.owner], directions])
        Q = np.linalg.solve(self.poles[:, None, None] * np.eye(m) - self.part.M, (self.part.B @ G).T[:, :, None])[:, :, 0].T
        size = np.linalg.norm(Q, axis=0)
        if not np.all(size > 0):
            return np.inf
        Q, G = Q / size, G / size
        if np.linalg.cond(Q) > PARALLEL:
            return np.inf
        W = np.linalg.solve(Q, np.hstack([self.D, self.part.B]))
        outputs = self._output_rows(Q, G) / self.output_scale[:, None]
        n_d = self.D.shape[1]
        start = np.einsum("ij,jl,njl->ni", outputs, W[:, :n_d], self.responses).ravel()
        added = np.einsum("ij,jv,njl->nivl", outputs, W[:, n_d:] * self.output_scale, self.responses).reshape(len(start), -1)
        plain, responses = np.concatenate([start.real, start.imag]), np.vstack([added.real, added.imag])
        return float(np.sum((plain + responses @ best_weights(responses, plain)) ** 2))

    def _output_rows(self, Q: ComplexArray, G: ComplexArray) -> ComplexArray:
        """e of each output per mode: the head of its chain, or for an output without one v itself."""
        heads = np.cumsum([0, *self.part.degrees[:-1]])
        return np.array([Q[heads[i]] if r else G[i] for i, r in enumerate(self.part.degrees)])


def best_directions(
    part: MovablePart,
    internal: InternalDynamics,
    rest: Equilibrium,
    reference: PiecewiseSignal,
    output_scale: Array,
    active: NDArray[np.bool_],
) -> Array | None:
    """Gain (p, m) by `structured_gain`, through directions with the least integral square error, L chosen along with them.

    The interval is looked at by itself, as if it had no end. The search descends (BFGS) from the best of these starts: one output
    alone bears the error, or all of them share it in the proportion in which they move the zeros. Equal zeros go to as many Jordan
    chains as the inputs can keep apart. None where no directions reach the zeros.

    Args:
        part: what is placed.
        internal: internal dynamics of the interval.
        rest: their equilibrium for a held output.
        reference: wanted outputs, as deviations from the operating point.
        output_scale: sizes of the outputs in which errors are measured (p,).
        active: which outputs are to move at all (p,).
    """
    if part.chains is None or part.keeps_a_pole:
        return None
    chains, starts = _reaching(part, output_scale)
    if not starts:
        return None
    modes = _modes(part, chains, internal, rest, reference, output_scale, active)
    vectors = chains.eigenvectors(modes.poles[len(part.error_poles) :])

    def directions(parameters: Array) -> Array:
        return parameters.reshape(-1, len(output_scale)).T * output_scale[:, None]

    def error(parameters: Array) -> float:
        return modes.error(directions(parameters) @ vectors)

    starts = sorted(starts, key=error)[:STARTS]
    best, unit = starts[0], error(starts[0])
    if np.isfinite(unit) and unit > 0:
        with np.errstate(invalid="ignore", over="ignore"):  # directions that do not reach the zeros count as infinitely bad
            found = [
                scipy.optimize.minimize(
                    lambda x: error(x) / unit, start, method="BFGS", options={"maxiter": ITERATIONS, "gtol": FLAT}
                )
                for start in starts
            ]
        best = min(found, key=lambda result: float(result.fun)).x
    return structured_gain(part, chains, directions(best))


def _reaching(part: MovablePart, output_scale: Array) -> tuple[TargetChains, list[Array]]:
    """The most chains of equal zeros for which there are starts that reach them, and these starts."""
    most = max(map(len, repeated(part.targets)), default=1)
    for count in range(min(most, len(output_scale)), 0, -1):
        chains = TargetChains.of(part.targets, count)
        starts = _starts(part, chains, output_scale)
        reaching = [
            start
            for start in starts
            if structured_gain(part, chains, start.reshape(-1, len(output_scale)).T * output_scale[:, None]) is not None
        ]
        if reaching:
            break
    return chains, reaching


def _starts(part: MovablePart, chains: TargetChains, output_scale: Array) -> list[Array]:
    """Each output alone, and all of them in proportion to what they do to the zeros moved; equal zeros by turns."""
    p, rho = len(output_scale), sum(part.degrees)
    effect = part.B[rho:] * output_scale
    reach = np.linalg.norm(effect, axis=0)
    # Where no output's highest derivative drives the zeros at once, each may do so through its lower ones.
    moving = reach > 1e-9 * reach.max() if np.any(reach) else np.ones(p, dtype=bool)
    weights = [np.eye(p)[i] + 1e-3 for i in np.flatnonzero(moving)]
    if len(effect):
        weights += [row / np.max(np.abs(row)) for row in effect[:1] if np.any(row)]
    starts = []
    for first in range(len(weights)):
        rows = []
        for number, chain in enumerate(chains.chains):
            turn = sum(1 for other in chains.chains[:number] if other[0] == chain[0])
            w = weights[(first + turn) % len(weights)]
            # What follows a chain's head, the imaginary part of a pair's, starts small but not at zero, where the error is even.
            rows += [w] + [0.1 * w[::-1]] * (len(chain) * (1 if chain[0].imag == 0 else 2) - 1)
        starts.append(np.array(rows).reshape(len(part.targets), p).ravel())
    return starts


def _modes(
    part: MovablePart,
    chains: TargetChains,
    internal: InternalDynamics,
    rest: Equilibrium,
    reference: PiecewiseSignal,
    output_scale: Array,
    active: NDArray[np.bool_],
) -> _Modes:
    form = internal.form
    J, E = integrator_chains(form)
    R = np.hstack([internal.A_eta @ rest.H + internal.A_zeta - rest.H @ J, internal.B_r - rest.H @ E])
    used = [(i, k, column) for i, k, column in derivative_columns(form) if active[i]]
    D = np.vstack([np.zeros((sum(form.orders), len(used))), part.Y.T @ R[:, [column for _, _, column in used]]])
    poles = _drawn_apart(np.concatenate([part.error_poles, chains.poles]))
    tail = TIME_CONSTANTS / float(np.min(np.abs(poles.real)))
    start, end = reference.manoeuvre
    h = max(0.05 / float(np.max(np.abs(poles))), (end - start + 2 * tail) / GRID)
    times = np.arange(start - tail, end + tail, h)
    signals = {k: reference(times, derivative=k) for k in {k for _, k, _ in used}}
    d = np.array([signals[k][:, i] for i, k, _ in used]).reshape(len(used), len(times))
    responses = np.array([[_mode_response(pole, signal, h) for signal in d] for pole in poles])  # (m, n_d, times)
    factor = np.asarray(np.linalg.qr(responses.reshape(-1, len(times)).T * np.sqrt(h), mode="r"))
    owner = np.repeat(np.arange(len(part.degrees)), part.degrees)
    return _Modes(part, poles, owner, D, factor.reshape(len(factor), len(poles), len(used)), output_scale)


def _drawn_apart(poles: ComplexArray) -> ComplexArray:
    """Equal poles moved apart a little, away from the origin, conjugates alike."""
    result = poles.copy()
    step = APART * float(np.max(np.abs(poles)))
    for i in range(len(result)):
        while np.any(np.abs(result[:i] - result[i]) < 0.5 * step):
            result[i] *= 1 + step / abs(result[i])
    return result


def _mode_response(pole: complex, signal: Array, h: float) -> ComplexArray:
    """Bounded q of q' = pole q + signal on an even grid, the signal linear in between: forward if stable, else backward."""
    forward = pole.real < 0
    s = pole if forward else -pole
    samples = signal if forward else -signal[::-1]
    decay = np.exp(s * h)
    b_1 = (decay - 1 - s * h) / (s * s * h)
    b_0 = (decay - 1) / s - b_1
    q: ComplexArray = scipy.signal.lfilter([b_1, b_0], [1.0, -decay], samples.astype(complex))
    return q if forward else q[::-1]
