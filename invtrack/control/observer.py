"""State estimators for sampled controllers: gains by pole placement or from noise (Kalman)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import scipy  # loads scipy.signal, which costs a second, at its first use
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from invtrack.checks import real_numbers, real_vector, stable_poles
from invtrack.control.gains import placed_gain
from invtrack.errors import ControlError
from invtrack.linear.state_space import StateSpace
from invtrack.linear.zero_order_hold import sampled_noise, zero_order_hold

Array = NDArray[np.float64]


class Observer(Protocol):
    """Designs the correction of a current estimator: x_hat = x_prior + M (y_m - C_m x_prior)."""

    def gain(self, system: StateSpace, period: float) -> Array:
        """M (n, m) for one interval's plant, measured every `period` seconds."""
        ...


@dataclass(frozen=True, eq=False)
class LuenbergerObserver:
    """Estimation error with the continuous-time poles stated, the same in every interval: exp(s period) once sampled.

    poles: n of them left of the imaginary axis, complex ones in conjugate pairs, none more often than there are measurements.
    """

    poles: Sequence[complex]

    def gain(self, system: StateSpace, period: float) -> Array:
        """M (n, m) with eig(A_d - M C_m A_d) = exp(poles period). Raises ControlError where the poles cannot be placed."""
        wanted = stable_poles("observer poles", self.poles, system.n_states, error=ControlError)
        A_d, _ = zero_order_hold(system.A, np.zeros((system.n_states, 0)), period)
        C_m = measured(system).C
        advice = f"the measurements {list(system.measurement.channels.names)} must show every mode"
        return placed_gain(A_d.T, (C_m @ A_d).T, np.exp(wanted * period), name="observer poles", advice=advice).T


@dataclass(frozen=True, eq=False)
class KalmanFilter:
    """Steady-state Kalman filter of each interval.

    input_noise: standard deviation per square root of Hz of white noise that acts like the inputs (p,), or a number for all: the
    disturbance that the filter is to expect. measurement_noise: standard deviation (m,) of one sample of each measurement.
    """

    input_noise: ArrayLike
    measurement_noise: ArrayLike

    def gain(self, system: StateSpace, period: float) -> Array:
        """M (n, m) from the discrete Riccati equation. Raises ControlError where it has no stabilizing solution."""
        C_m = measured(system).C
        intensity = _levels("input_noise", self.input_noise, system.inputs.names)
        deviation = _levels("measurement_noise", self.measurement_noise, system.measurement.channels.names)
        A_d, Q_d = sampled_noise(system.A, system.B * intensity, period)
        try:
            P = scipy.linalg.solve_discrete_are(A_d.T, C_m.T, Q_d, np.diag(deviation**2))
        except (np.linalg.LinAlgError, ValueError) as error:
            raise ControlError(f"no steady Kalman gain: {error}; a mode on or right of the axis is not measured") from error
        innovation = C_m @ P @ C_m.T + np.diag(deviation**2)
        return np.asarray(scipy.linalg.solve(innovation, C_m @ P, assume_a="pos").T)


def measured(system: StateSpace) -> Any:
    """The system's measurement, if an observer can use it. Raises ControlError where the input acts on it at once."""
    if np.any(system.measurement.D):
        through = [name for name, row in zip(system.measurement.channels.names, system.measurement.D, strict=True) if np.any(row)]
        raise ControlError(f"measurements {through} depend on the input at once (accelerations?); measure positions or velocities")
    return system.measurement


def _levels(name: str, value: ArrayLike, channels: Sequence[str]) -> Array:
    """Standard deviations, one for each channel; a number stands for all of them."""
    levels = real_numbers(name, value, error=ControlError)
    levels = real_vector(name, np.full(len(channels), levels) if levels.ndim == 0 else levels, channels, error=ControlError)
    if np.any(levels <= 0):
        raise ControlError(f"{name} must be positive, got {levels.tolist()}: a filter without noise has no optimal gain")
    return levels
