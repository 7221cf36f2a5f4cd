"""The optimum at one frequency, from coprime factors of the plant, and as a kernel in time.

The factors keep it regular at poles of the plant on the imaginary axis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from invtrack.arrays import Array, ComplexArray, real_matrix
from invtrack.errors import RedesignError
from invtrack.linear.state_space import StateSpace
from invtrack.redesign.cost import FARTHEST, Weights
from invtrack.redesign.prefilter.fourier import FourierWindow
from invtrack.redesign.prefilter.frequency_weight import FrequencyWeight

AXIS_TOLERANCE = 1e-7
"""A pole of the optimum counts as on the axis where its real part is below this share of the fastest: it is a double one there."""

FAR = 1e6
"""Where a response is looked at for a direct feedthrough, in multiples of the bandwidth."""

FALLEN = 1e-3
"""A response that has fallen to this share by then has no direct feedthrough: the slowest fall is as 1 / w."""


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """From y_d to the optimum at w (m,) [rad/s]: G_u (m, p, p) to u, G_xu = G_x G_u (m, n, p) to x, G_f (m, p, p) to y."""

    w: Array
    G_u: ComplexArray
    G_xu: ComplexArray
    G_f: ComplexArray

    @property
    def stacked(self) -> ComplexArray:
        """[G_u; G_xu; G_f]: (m, p + n + p, p)."""
        return np.concatenate([self.G_u, self.G_xu, self.G_f], axis=1)


@dataclass(frozen=True, eq=False)
class OptimalResponse:
    """The optimum as a function of frequency.

    With G_x = N_x M^-1, G_y = N_y M^-1, N_x = (jw - A + B K)^-1 B, M = 1 - K N_x, N_y = C N_x + D M, the optimal input is u = M v,
    v the least-squares solution of [F_R M; F_x N_x; F_y N_y] v = [0; 0; F_y] y_d, where F*F is the weight.

    Args:
        model: the plant.
        R: weight of the inputs.
        Q_x: weight of the states.
        Q_y: weight of the output errors.
        K: a gain (p, n) for which A - B K is stable; the optimum does not depend on it.
    """

    model: StateSpace
    R: FrequencyWeight
    Q_x: FrequencyWeight
    Q_y: FrequencyWeight
    K: Array

    def factors(self, w: Array) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """M (k, m, m), N_x (k, n, m), N_y (k, p, m) at frequencies w (k,)."""
        model, n = self.model, self.model.n_states
        pencil = 1j * w[:, None, None] * np.eye(n) - (model.A - model.B @ self.K)
        N_x = np.asarray(np.linalg.solve(pencil, np.broadcast_to(model.B, (len(w), *model.B.shape))), dtype=complex)
        M = np.asarray(np.eye(model.n_inputs) - self.K @ N_x, dtype=complex)
        return M, N_x, np.asarray(model.C @ N_x + model.D @ M)

    def __call__(self, w: Array) -> FrequencyResponse:
        """The response at frequencies w (m,), not negative.

        Raises RedesignError where the weights leave a direction of the input free, so that the optimum is not unique.
        """
        n, m, p = self.model.n_states, self.model.n_inputs, self.model.n_outputs
        if self.Q_y.is_zero:
            return FrequencyResponse(w, *(np.zeros((len(w), rows, p), dtype=complex) for rows in (m, n, p)))
        M, N_x, N_y = self.factors(w)
        F_y = self.Q_y.factor(w)
        Q, T = np.linalg.qr(np.concatenate([self.R.factor(w) @ M, self.Q_x.factor(w) @ N_x, F_y @ N_y], axis=1))
        pivots = np.min(np.abs(np.diagonal(T, axis1=1, axis2=2)), axis=1)
        if not np.all(pivots > 0):
            raise RedesignError(
                f"the weights leave an input free at w = {w[int(np.argmin(pivots))]:.6g} rad/s: nothing that it moves costs "
                "anything, so the optimum is not unique; make R positive definite"
            )
        v = np.linalg.solve(T, np.swapaxes(Q[:, m + n :].conj(), 1, 2) @ F_y)
        return FrequencyResponse(w, M @ v, N_x @ v, N_y @ v)

    def poles(self, w: float) -> ComplexArray:
        """Poles of the optimum left of the axis, or on it, with the weights as they are at frequency w.

        Generalized eigenvalues of the optimality conditions x' = A x + B u, -l' = A'l + Q x + S u, 0 = B'l + S'x + (R + D'Q_y D) u;
        for R > 0, D = 0 those of [[A, -B R^-1 B'], [-(Q_x + C'Q_y C), -A']].
        """
        A, B, C, D = self.model.A, self.model.B, self.model.C, self.model.D
        n, m = self.model.n_states, self.model.n_inputs
        weights = Weights(*(weight.at(w).real for weight in (self.R, self.Q_x, self.Q_y)))
        weights = weights.in_unit() if weights.size > 0 else weights  # a common factor changes nothing
        R, Q_x, Q_y = weights.R, weights.Q_x, weights.Q_y
        S = C.T @ Q_y @ D
        H = np.block(
            [[A, np.zeros((n, n)), B], [-(Q_x + C.T @ Q_y @ C), -A.T, -S], [S.T, B.T, R + D.T @ Q_y @ D]],
        )
        E = scipy.linalg.block_diag(np.eye(2 * n), np.zeros((m, m)))
        alpha, beta = scipy.linalg.eigvals(H, E, homogeneous_eigvals=True)
        size = np.linalg.norm(H, 1)
        finite = np.abs(beta) * size * 1e6 > np.abs(alpha)
        poles = alpha[finite] / beta[finite]
        return np.asarray(poles[poles.real <= AXIS_TOLERANCE * np.max(np.abs(poles), initial=0.0)])


def factoring_gain(model: StateSpace, given: ArrayLike | None = None) -> Array:
    """A gain K (m, n) with A - B K stable: the one given, checked, or one from a Riccati equation with unit weights.

    Raises RedesignError where there is none, or the given one does not stabilize.
    """
    n, m = model.n_states, model.n_inputs
    if given is None:
        try:
            K = model.B.T @ scipy.linalg.solve_continuous_are(model.A, model.B, np.eye(n), np.eye(m))
        except (np.linalg.LinAlgError, ValueError) as error:
            raise RedesignError(
                f"the plant cannot be stabilized: {error}; a mode on or right of the imaginary axis is out of reach of the inputs "
                f"{list(model.inputs.names)}, remove it from the model or choose other inputs"
            ) from error
    else:
        K = real_matrix("stabilizing_gain (K of u = -K x)", given, shape=(m, n), error=RedesignError)
    poles = np.linalg.eigvals(model.A - model.B @ K)
    if np.any(poles.real >= 0):
        raise RedesignError(f"the gain does not stabilize the plant: A - B K has poles {np.round(poles, 6).tolist()}")
    return np.asarray(K)


def time_scales(response: OptimalResponse, probes: Array) -> tuple[float, float]:
    """Slowest decay [1/s] and fastest pole [rad/s] of the optimum.

    Weights that vary are taken as they are at each of the frequencies `probes`, which increase from zero; the poles that this gives
    say something about the optimum where they are near that frequency, between its neighbours.

    Raises RedesignError where constant weights leave a pole of the optimum on the imaginary axis.
    """
    model = response.model
    own = np.linalg.eigvals(model.A - model.B @ response.K)
    if response.Q_y.is_zero:
        return float(-np.max(own.real)), float(np.max(np.abs(own)))
    if all(weight.is_constant for weight in (response.R, response.Q_x, response.Q_y)):
        Weights(*(weight.at(0.0).real for weight in (response.R, response.Q_x, response.Q_y))).require_within(FARTHEST)
        poles = response.poles(0.0)
        _require_off_axis(poles)
    else:
        families = [response.poles(float(w)) for w in probes]
        lower, upper = np.append(0.0, probes[:-1]), np.append(probes[1:], np.inf)
        sizes = [np.abs(family) for family in families]
        near = [
            family[(size >= low) & (size <= high)] for family, size, low, high in zip(families, sizes, lower, upper, strict=True)
        ]
        poles = np.concatenate(near)
    stable = poles[-poles.real > AXIS_TOLERANCE * np.max(np.abs(poles), initial=0.0)]
    if stable.size == 0:
        stable = own
    return float(np.min(-stable.real)), float(np.max(np.abs(stable)))


def require_strictly_proper(response: OptimalResponse, bandwidth: float) -> None:
    """Raises RedesignError where the response does not fall off far above the bandwidth [rad/s]."""
    low, far = (np.max(np.abs(response(bandwidth * np.array(w)).stacked), axis=(0, 2)) for w in ([0.01, 0.1, 1.0], [FAR]))
    if np.any(far > FALLEN * low):
        raise RedesignError(
            "the kernel contains an impulse, because the optimum does not fall off at high frequencies (a direct feedthrough D, or "
            "an input that costs nothing there); use apply, which needs no kernel, or give weight R to the input"
        )


def impulse_samples(stacked: ComplexArray, window: FourierWindow) -> Array:
    """Samples of [g_u; g_x; g_f] (samples, (p + n + p) p) on a window about time 0, of the response at its frequencies.

    The kernels may jump or have kinks at time 0, so that their transforms fall slowly. What the transform is at the band's edge is
    taken out as a two-sided exponential, whose kernel is known: j b w / (c^2 + w^2) belongs to -b sgn(t) exp(-c |t|) / 2, and
    b / (c^2 + w^2) to b exp(-c |t|) / (2 c).
    """
    w = window.frequencies
    G = stacked.reshape(len(w), -1)
    edge = w[-1]
    c = 40.0 / window.length * np.sqrt(window.harmonics / 40.0 + 1.0)  # dies out within the window, far below the band's edge
    odd, even = G[-1].imag * (c**2 + edge**2) / edge, G[-1].real * (c**2 + edge**2)
    shape = 1.0 / (c**2 + w**2)[:, None]
    rest = (G - (even + 1j * odd * w[:, None]) * shape) * np.exp(1j * w * window.start)[:, None]
    t = window.sample_times[:, None]
    decay = np.exp(-c * np.abs(t))
    return np.asarray(window.synthesize(rest) + decay * (even / (2 * c) - odd * np.sign(t) / 2))


def _require_off_axis(poles: ComplexArray) -> None:
    offending = poles[np.abs(poles.real) <= AXIS_TOLERANCE * np.max(np.abs(poles), initial=0.0)]
    if offending.size:
        raise RedesignError(
            f"the optimum has poles on the imaginary axis at {np.round(offending, 6).tolist()}: an undamped mode that the weights "
            "leave free, or (R = Q_x = 0) a zero of the plant there; give weight to that mode in Q_x, or to the input in R"
        )
