"""What modified inversion returns: a planned trajectory that says what it gave up, and for what."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invtrack.linear.internal_dynamics import format_zeros
from invtrack.plans.plan import Plan

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

ERROR_SAMPLES = 4000
"""Points over the manoeuvre, and as many before and after it, at which the largest predicted error is looked for."""


@dataclass(frozen=True, eq=False)
class Modification:
    """How the inverse was modified in one interval: v = F [e; eta - eta_eq] + L [zeta_d; y_d^(r)].

    F (p, n) and L (p, rho + p) refer to the coordinates of `normal_form`; e = zeta - zeta_d, eta_eq the internal equilibrium of the
    held output. zeros_before, zeros_after: the zeros and where they went, in the same order. error_poles: those of e. alpha
    [rad/s]: smallest positive real part of the modified inverse's poles, the rate at which the input before the manoeuvre decays
    backward in time; infinite where none is antistable (no preactuation).
    """

    interval: int
    F: Array
    L: Array
    zeros_before: ComplexArray
    zeros_after: ComplexArray
    error_poles: ComplexArray

    @property
    def alpha(self) -> float:
        """Smallest positive real part [rad/s] among the poles, infinite without one."""
        return min((float(s.real) for s in self.zeros_after if s.real > 0), default=math.inf)

    def __str__(self) -> str:
        moved = np.abs(self.zeros_after - self.zeros_before) > 0
        pairs = [(a, b) for a, b in zip(self.zeros_before[moved], self.zeros_after[moved], strict=True) if a.imag >= 0]
        text = ", ".join(f"{format_zeros(a)} to {format_zeros(b)}" for a, b in pairs) or "none"
        return f"interval {self.interval}: zeros moved: {text}; alpha = {self.alpha:.4g} rad/s"


@dataclass(frozen=True, eq=False)
class Candidate:
    """One choice of the freedom in F and L: its name, and the integral square of its predicted error over output_scale [s]."""

    name: str
    integral_square_error: float


@dataclass(frozen=True, eq=False, repr=False)
class ModifiedTrajectory(Plan):
    """A plan of `modified_inversion`: a trajectory of the plant whose output is near the wanted one, not on it.

    modification: per interval. design: the name of the choice taken among `candidates`, all of which were worked out. output_scale
    (p,): sizes of the outputs at which their errors count alike.
    """

    modification: tuple[Modification, ...] = ()
    design: str = ""
    candidates: tuple[Candidate, ...] = ()
    output_scale: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def alpha(self) -> float:
        """Rate [rad/s] at which the input decays backward in time before the manoeuvre; infinite without preactuation."""
        return self.modification[0].alpha

    def tracking_error(self, t: ArrayLike, *, inside: ArrayLike | None = None) -> Array:
        """Predicted error y - y_d (m, p) at times t (m,) [s], before the manoeuvre too; `inside` as in a call."""
        values = self(t, inside=inside)
        return np.asarray(values.y - values.y_d)

    @cached_property
    def max_error(self) -> Array:
        """Largest predicted |y - y_d| of each output over all of time, (p,) in the outputs' units."""
        return self._largest_error(self.start, self.end)

    @property
    def max_error_after(self) -> Array:
        """Largest predicted |y - y_d| of each output after the manoeuvre's end T_f, (p,)."""
        return self._largest_error(self.manoeuvre[1], self.end)

    @property
    def relative_error(self) -> float:
        """Largest predicted error of any output, as a share of `output_scale`."""
        return float(np.max(self.max_error / self.output_scale))

    def _largest_error(self, start: float, end: float) -> Array:
        edges = np.unique(np.concatenate([[start, end], self.breakpoints]).clip(start, end))
        largest = np.zeros(len(self.output_scale))
        for a, b in itertools.pairwise(edges):
            count = max(16, ERROR_SAMPLES // len(edges))
            outside = a < self.manoeuvre[0] or b > self.manoeuvre[1]
            share = np.linspace(0.0, 1.0, count) ** 3 if outside else np.linspace(0.0, 1.0, count)
            if a < self.manoeuvre[0]:
                share = 1 - share[::-1]  # dense next to the manoeuvre: the tails are long and nearly empty
            t = a + (b - a) * share
            largest = np.maximum(largest, np.max(np.abs(self.tracking_error(t, inside=np.full(count, (a + b) / 2))), axis=0))
        return largest
