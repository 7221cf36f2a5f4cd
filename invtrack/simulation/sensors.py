"""What real sensors add to a measurement: delay, noise, quantization."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from invtrack.errors import SimulationError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Sensor:
    """Imperfections of one measurement: noise, its standard deviation; quantization, the size of a digit; both in the measurement's
    unit; delay [s]. Zero: none.

    Raises SimulationError for negative values.
    """

    noise: float = 0.0
    quantization: float = 0.0
    delay: float = 0.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (np.isfinite(value) and value >= 0):
                raise SimulationError(f"a sensor's {name} must be finite and not negative, got {value}")


class SensorChain:
    """All measurements of one run: ideal values in, what the controller sees out. Seeded: the same run gives the same noise."""

    def __init__(self, names: Sequence[str], sensors: Mapping[str, Sensor], seed: int) -> None:
        unknown = [name for name in sensors if name not in names]
        if unknown:
            raise SimulationError(f"sensors are given for {unknown}; the plant's measurements are: {', '.join(names)}")
        chosen = [sensors.get(name, Sensor()) for name in names]
        self._noise = np.array([sensor.noise for sensor in chosen])
        self._digit = np.array([sensor.quantization for sensor in chosen])
        self._delay = np.array([sensor.delay for sensor in chosen])
        self._noisy, self._digital, self._late = bool(np.any(self._noise)), bool(np.any(self._digit)), bool(np.any(self._delay))
        self._random = np.random.default_rng(seed)

    def sample(self, index: int, time: Array, ideal: Array, columns: NDArray[np.intp]) -> Array:
        """What the sensors show at time[index] (m,), from ideal values (N, k) up to and including row `index`, in m columns.

        A delayed sensor shows an earlier value, interpolated between steps; before the run began, the first.
        """
        shown = self._delayed(index, time, ideal, columns) if self._late else ideal[index, columns]
        if self._noisy:
            shown += self._noise * self._random.standard_normal(len(shown))
        if self._digital:
            digital = self._digit > 0
            shown[digital] = np.rint(shown[digital] / self._digit[digital]) * self._digit[digital]
        return shown

    def _delayed(self, index: int, time: Array, ideal: Array, columns: NDArray[np.intp]) -> Array:
        if index == 0:
            return np.asarray(ideal[0, columns])
        instants = time[index] - self._delay
        after = np.clip(np.searchsorted(time[: index + 1], instants), 1, index)
        span = time[after] - time[after - 1]
        share = np.clip((instants - time[after - 1]) / span, 0.0, 1.0)
        return np.asarray(ideal[after - 1, columns] * (1 - share) + ideal[after, columns] * share)
