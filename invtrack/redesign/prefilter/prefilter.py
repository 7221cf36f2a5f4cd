"""Optimal output-trajectory redesign in the frequency domain: a prefilter, computed once, for any reference."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arrays import Array, ComplexArray, real_numbers, require_share
from invtrack.errors import RedesignError, TrajectoryError
from invtrack.linear.switched import as_switched
from invtrack.plans.problem import require_reference
from invtrack.redesign.cost import FREE_HOLDING, without_rounding
from invtrack.redesign.prefilter.fourier import FourierWindow, OncePerFrequency, rate_spectrum, refine
from invtrack.redesign.prefilter.frequency_response import (
    FrequencyResponse,
    OptimalResponse,
    factoring_gain,
    impulse_samples,
    require_strictly_proper,
    time_scales,
)
from invtrack.redesign.prefilter.frequency_weight import WeightLike, frequency_weight
from invtrack.references.signal import PiecewiseSignal

ZERO_TOLERANCE = 1e-12
"""G_y counts as singular where its smallest singular value is below this share of the terms it is the sum of."""

REST_TOLERANCE = 1e-9
"""Largest change of the reference outside its manoeuvre, as a share of its size, that counts as holding still."""

PROBES = 10.0 ** np.arange(-3.0, 2.1, 0.5)
"""Frequencies at which weights that vary are looked at beforehand, in multiples of the plant's fastest pole; and zero."""

BANDWIDTH_FACTOR = 8.0
"""First guess of the bandwidth, in multiples of the fastest pole."""


@dataclass(frozen=True, eq=False)
class PrefilteredTrajectory:
    """The optimum for one reference, at any times.

    Args:
        time: (m,) [s].
        u: inputs (m, p), absolute.
        x: states (m, n), as deviations from the operating point.
        y: outputs (m, p), absolute.
        y_d: the wanted outputs (m, p), absolute.
        truncation_error: what the last doubling of the window and of the bandwidth changed, as a share of each channel's peak.
        remarks: what a user should know, for instance that the tolerance was not met, and why.
    """

    time: Array
    u: Array
    x: Array
    y: Array
    y_d: Array
    truncation_error: float
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class ImpulseResponse:
    """The filter's kernels: u_opt = g_u * y_d, x_opt = g_x * y_d, y_opt = g_f * y_d, by convolution.

    Not causal: values before time 0 are what the optimum does ahead of the reference. At a jump at time 0 the sample is the mean of
    both sides.

    Args:
        time: (m,) [s].
        g_u: kernel of the inputs (m, p, p).
        g_x: kernel of the states (m, n, p).
        g_f: kernel of the outputs (m, p, p).
        truncation_error: what the last doubling of window and bandwidth changed, as a share of each kernel's peak.
        remarks: what a user should know, for instance that the tolerance was not met, and why.
    """

    time: Array
    g_u: Array
    g_x: Array
    g_f: Array
    truncation_error: float
    remarks: tuple[str, ...] = ()

    def preview_time(self, level: float) -> float:
        """How long [s] before time 0 the kernel of some input first exceeds `level` of that input's peak; 0 where it never does.

        Raises RedesignError for a level outside 0 ... 1, and for one that the truncation error hides.
        """
        require_share("level", level, error=RedesignError)
        if self.truncation_error > level / 2:
            raise RedesignError(
                f"the kernel is truncated by {self.truncation_error:.1e} of its peak, which hides when it stays below {level:g} of "
                f"it; ask for a level above {2 * self.truncation_error:.1e} or for a smaller tolerance, or use weights that change "
                "less abruptly with frequency"
            )
        size = np.max(np.abs(self.g_u), axis=2)  # (m, p)
        above = np.any(size > level * np.max(size, axis=0), axis=1) & (self.time < 0)
        return float(-self.time[above][0]) if np.any(above) else 0.0


@dataclass(frozen=True, eq=False)
class Prefilter:
    """u_opt = G_u y_d, x_opt = G_xu y_d, y_opt = G_f y_d: made by `prefilter`, independent of the reference.

    decay_rate [1/s]: how fast the optimum dies out before and after the reference moves. bandwidth [rad/s]: first guess of the
    highest frequency that matters. Both are those of the optimum's poles, and starting points only: `apply` and `impulse_response`
    measure what they leave out.
    """

    response: OptimalResponse
    decay_rate: float
    bandwidth: float

    def frequency_response(self, w: ArrayLike) -> FrequencyResponse:
        """G_u (m, p, p), G_xu (m, n, p), G_f (m, p, p) at frequencies w (m,) [rad/s] of either sign, poles of the plant included.

        Raises TrajectoryError for frequencies that are not finite, RedesignError where the optimum is not unique.
        """
        frequencies = _finite("frequencies", w)
        above = self.response(np.abs(frequencies))
        G_u, G_xu, G_f = (np.where((frequencies < 0)[:, None, None], G.conj(), G) for G in (above.G_u, above.G_xu, above.G_f))
        return FrequencyResponse(frequencies, G_u, G_xu, G_f)

    def input_change(self, w: ArrayLike) -> ComplexArray:
        """G_v (m, p, p), the change of input against exact inversion: u_opt = u_ff + G_v y_d, G_v = G_u - G_y^-1.

        Source: Devasia 1996 (AIAA note), eq. 3. Raises RedesignError at a zero of the plant on the imaginary axis.
        """
        frequencies = _finite("frequencies", w)
        model, (M, N_x, N_y) = self.response.model, self.response.factors(frequencies)
        terms = np.max(np.abs(model.C) @ np.abs(N_x) + np.abs(model.D) @ np.abs(M), axis=(1, 2))
        share = np.linalg.svd(N_y, compute_uv=False)[:, -1] / terms
        if np.min(share) < ZERO_TOLERANCE:
            raise RedesignError(
                f"the plant has a zero at w = {frequencies[int(np.argmin(share))]:.6g} rad/s, where exact inversion has no bounded "
                "input; ask for other frequencies, or use frequency_response, which is regular there"
            )
        return np.asarray(self.frequency_response(frequencies).G_u - M @ np.linalg.inv(N_y))

    def impulse_response(self, times: ArrayLike | None = None, *, tolerance: float = 1e-4) -> ImpulseResponse:
        """The kernels g_u, g_x, g_f (y_opt = g_f * y_d, by convolution) at times (m,) [s], by default over all of the window.

        `tolerance` is the truncation error aimed at, as a share of each peak. Weights that change abruptly with frequency make
        kernels that die out only as a power of time; where it is not met, `remarks` says so.

        Raises RedesignError where the attained error is above 1e-2 (and above `tolerance`), and where a kernel contains an impulse
        itself (D not zero, or R = 0), for which there are no samples.
        """
        require_strictly_proper(self.response, self.bandwidth)
        reach = self._reach(tolerance)
        wanted = None if times is None else _finite("times", times)
        response = OncePerFrequency(lambda w: self.response(w).stacked)
        found = refine(
            lambda window: impulse_samples(response(window.frequencies), window),
            FourierWindow.covering(-reach, reach, self.bandwidth),
            wanted,
            tolerance,
            self._groups(),
        )
        n, m, p = self.response.model.n_states, self.response.model.n_inputs, self.response.model.n_outputs
        g_u, g_x, g_f = np.split(found.values.reshape(len(found.times), m + n + p, p), [m, m + n], axis=1)
        return ImpulseResponse(found.times, g_u, g_x, g_f, found.truncation_error, found.remarks)

    def preview_time(self, level: float = 0.01) -> float:
        """How long [s] before the reference the input has to start: before that its kernel stays below `level` of its peak.

        Raises RedesignError as `impulse_response` and its `preview_time` do.
        """
        require_share("level", level, error=RedesignError)
        return self.impulse_response(tolerance=max(min(1e-3, level / 10), float(np.finfo(float).eps))).preview_time(level)

    def apply(
        self, reference: PiecewiseSignal, times: ArrayLike | None = None, *, tolerance: float = 1e-8
    ) -> PrefilteredTrajectory:
        """The optimum for a reference that holds still outside its manoeuvre, at times (m,) [s], by default over the window.

        The rate of the reference is filtered and the result integrated, with the change over all of time known from the response at
        w = 0: a reference that ends elsewhere than it began is not wrapped around.

        `tolerance` is the truncation error aimed at, as a share of each channel's peak. Weights that change abruptly with frequency
        make optima that die out only as a power of time, before and after the manoeuvre; where it is not met, `truncation_error`
        says what was attained and `remarks` why.

        Raises TrajectoryError for a reference of other channels or not at rest outside its manoeuvre; RedesignError where holding
        its first or last value costs something for ever, and where the attained error is above 1e-2 (and above `tolerance`).
        """
        model = self.response.model
        require_reference(model, reference)
        y_0 = model.operating_point.y0
        held = without_rounding(np.array(held_values(reference)) - y_0, reference, y_0)
        self._require_free_holding(held)
        initial = (self.response(np.zeros(1)).stacked[0].real @ held[0]).astype(float)
        start, end = reference.manoeuvre
        reach = self._reach(tolerance)
        spectrum = OncePerFrequency(
            lambda w: np.asarray(np.einsum("mij,mj->mi", self.response(w).stacked, rate_spectrum(reference, w, start)))
        )

        def samples(window: FourierWindow) -> Array:
            w = window.frequencies
            return window.integrate(spectrum(w) * np.exp(1j * w * (window.start - start))[:, None], initial)

        window = FourierWindow.covering(start - reach, end + reach, self.bandwidth)
        found = refine(samples, window, None if times is None else _finite("times", times), tolerance, self._groups())
        u, x, y = np.split(found.values, [model.n_inputs, model.n_inputs + model.n_states], axis=1)
        point = model.operating_point
        return PrefilteredTrajectory(
            time=found.times,
            u=u + point.u0,
            x=x + model.rest,
            y=y + point.y0,
            y_d=reference(found.times),
            truncation_error=found.truncation_error,
            remarks=found.remarks,
        )

    def _reach(self, tolerance: float) -> float:
        """Distance [s] over which the slowest pole decays to less than the tolerance."""
        require_share("tolerance", tolerance, error=RedesignError)
        return float((np.log(1 / tolerance) + 4.0) / self.decay_rate)

    def _groups(self) -> list[int]:
        model = self.response.model
        return [model.n_inputs, model.n_states, model.n_outputs]

    def _require_free_holding(self, held: Array) -> None:
        Q_y = self.response.Q_y.at(0.0).real
        G_f = self.response(np.zeros(1)).G_f[0].real
        # The least cost per second of holding y_d = h: h'Q_y (1 - G_f(0)) h.
        for side, h in zip(("first", "last"), held, strict=True):
            cost, size = float(h @ Q_y @ (h - G_f @ h)), float(h @ Q_y @ h)
            if cost > FREE_HOLDING * size:
                raise RedesignError(
                    f"holding the reference's {side} value for ever costs {cost:.3g} per second (G_f(0) is "
                    f"{np.round(G_f, 6).tolist()}, not 1), so the cost over all of time diverges; let the reference start and end "
                    "at the operating point's output, or give no weight at w = 0 to what holding needs"
                )


def prefilter(
    model: Any, *, R: WeightLike, Q_x: WeightLike = 0.0, Q_y: WeightLike, stabilizing_gain: ArrayLike | None = None
) -> Prefilter:
    """The filter from y_d to the trajectory that minimises the integral over time of u'R u + x'Q_x x + (y - y_d)'Q_y (y - y_d).

    G_u = (R + G_x*Q_x G_x + G_y*Q_y G_y)^-1 G_y*Q_y, with the plant's G_x = (jw - A)^-1 B and G_y = C G_x + D; the filter's parts
    are G_u, G_x G_u and G_f = G_y G_u. A weight is a number (that multiple of the identity), a matrix, or a function of the
    frequency w [rad/s] with such values, Hermitian, positive semidefinite and conjugate at w and -w. Q_y = 0 gives zero, and
    R = Q_x = 0 exact inversion.

    Args:
        model: StateSpace, or anything with A, B, C, D, that does not jump.
        R: weight of the inputs (p, p).
        Q_x: weight of the states (n, n).
        Q_y: weight of the output errors (p, p).
        stabilizing_gain: K (p, n) of u = -K x, with which the plant is factored; the filter does not depend on it.

    Raises RedesignError for a plant that jumps, one that cannot be stabilized, malformed weights, and weights that leave an
    undamped mode free; ModelError for a malformed model. Source: S. Devasia, "Optimal output-trajectory redesign for invertible
    systems", AIAA J. of Guidance, Control, and Dynamics 19(5), 1996, lemma.
    """
    plant = as_switched(model)
    if len(plant) > 1:
        raise RedesignError(
            f"a prefilter needs a plant that stays the same, this one has {len(plant)} intervals; use quadratic_redesign"
        )
    (system,) = plant.systems
    n, m, p = system.n_states, system.n_inputs, system.n_outputs
    K = factoring_gain(system, stabilizing_gain)
    scale = float(np.max(np.abs(np.linalg.eigvals(system.A - system.B @ K))))
    probes = np.append(0.0, scale * PROBES)
    response = OptimalResponse(
        system,
        frequency_weight("R", R, m, probes),
        frequency_weight("Q_x", Q_x, n, probes),
        frequency_weight("Q_y", Q_y, p, probes),
        K,
    )
    decay_rate, fastest = time_scales(response, probes)
    return Prefilter(response, decay_rate, BANDWIDTH_FACTOR * fastest)


def held_values(reference: PiecewiseSignal) -> tuple[Array, Array]:
    """(y_0, y_f): the values (p,) that the reference holds before and after its manoeuvre.

    Raises TrajectoryError where it does not hold still there, so that its rate has no Fourier transform.
    """
    start, end = reference.manoeuvre
    distance = np.array([1e-3, 1.0, np.pi, 10.0]) * max(end - start, 1.0)
    before, after = reference(start - distance), reference(end + distance)
    size = max(float(np.max(np.abs(reference(reference.breakpoints)))), np.max(np.abs(before)), np.max(np.abs(after)))
    for side, values in (("before", before), ("after", after)):
        if np.max(np.abs(values - values[0])) > REST_TOLERANCE * size:
            raise TrajectoryError(
                f"expected a reference that holds still outside its manoeuvre from {start:.6g} to {end:.6g} s, this one changes "
                f"{side} it; end it at rest (see rest_to_rest, or autonomous with its start and end)"
            )
    return before[0], after[0]


def _finite(name: str, values: ArrayLike) -> Array:
    array = np.atleast_1d(real_numbers(name, values))
    if array.ndim != 1 or array.size == 0 or not np.all(np.isfinite(array)):
        raise TrajectoryError(f"{name} must be finite numbers, one or a vector of them, got shape {array.shape}")
    return array
