"""What plans by modified inversion have in common: a trajectory of the plant whose output is near the wanted one, not on it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arrays import Array
from invtrack.inversion.modified.error_bound import error_bound, positive_sizes
from invtrack.inversion.redesign_call import redesign_call
from invtrack.plans.plan import Plan
from invtrack.references.signal import PiecewiseSignal

COSTLY = 10.0
"""A plan whose error is this many times the wanted motion says so."""

ERROR_SAMPLES = 4000
"""Points over the manoeuvre, and as many before and after it, at which the largest predicted error is looked for."""

INPUT_SAMPLES = 4001
"""Instants at which the size of the input is looked for."""

STILL = 1e-12
"""An output that departs from where it is held by no more than this share of its values is to stay still."""


@dataclass(frozen=True, eq=False, repr=False)
class ModifiedPlan(Plan, ABC):
    """A trajectory of the plant whose output is near the wanted one, not on it.

    output_scale: sizes of the outputs at which their errors count alike (p,).
    """

    output_scale: Array = field(default_factory=lambda: np.zeros(0))

    @property
    @abstractmethod
    def alpha(self) -> float:
        """Rate [rad/s] at which the input decays backward in time before the manoeuvre; infinite without preactuation."""

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

    @cached_property
    def error_bound(self) -> float | None:
        """What no plan that starts from rest at the same time can bring `relative_error` below; None where none is known.

        See `invtrack.inversion.error_bound`. For a plan on a nonlinear motion it is that of the linear model of its start, to which
        it keeps as the motion gets small.
        """
        return self.error_bound_from(self.start)

    def error_bound_from(self, start: float) -> float | None:
        """The same for plans that start from rest at another time, no later than the manoeuvre [s]."""
        model = self.model if self.linearizations is None else self.model.systems[0]
        return error_bound(model, self.reference, start=start, output_scale=self.output_scale)

    def _largest_error(self, start: float, end: float) -> Array:
        edges = np.unique(np.concatenate([[start, end], self.breakpoints]).clip(start, end))
        if len(edges) < 2:
            return np.zeros(len(self.output_scale))
        count = max(16, ERROR_SAMPLES // len(edges))
        a, b = edges[:-1, np.newaxis], edges[1:, np.newaxis]
        even = np.linspace(0.0, 1.0, count)
        # Dense next to the manoeuvre: the tails are long and nearly empty.
        before, after = a < self.manoeuvre[0], b > self.manoeuvre[1]
        share = np.where(before, 1 - even[::-1] ** 3, np.where(after, even**3, even))
        t, inside = a + (b - a) * share, np.broadcast_to((a + b) / 2, (len(a), count))
        return np.asarray(np.max(np.abs(self.tracking_error(t.ravel(), inside=inside.ravel())), axis=0))


def output_sizes(output_scale: ArrayLike | None, motion: Array) -> Array:
    """Sizes (p,) at which errors of the outputs count alike, by default those of their motion (p,) or of the largest one."""
    if output_scale is None:
        return np.where(motion > 0, motion, np.max(motion)) if np.any(motion > 0) else np.ones(len(motion))
    return positive_sizes(output_scale, len(motion))


def wanted_motion(reference: PiecewiseSignal, deviation: PiecewiseSignal, manoeuvre: tuple[float, float]) -> Array:
    """Largest distance of each wanted output from where it is held before (p,).

    Args:
        reference: the wanted outputs, absolute.
        deviation: the same from where the outputs are at rest.
        manoeuvre: from when to when they move [s].
    """
    start, end = manoeuvre
    t = np.concatenate([np.linspace(start, end, 501), deviation.breakpoints])
    distance = np.max(np.abs(reference(t) - reference(start - 1.0)), axis=0)
    return np.where(distance > STILL * deviation.size(0), distance, 0.0)


def costly(plan: ModifiedPlan, motion: Array) -> tuple[str, ...]:
    """A remark where the error of some output is COSTLY times its wanted motion (p,), and what to do instead."""
    times = plan.max_error / motion
    if not np.max(times) > COSTLY:
        return ()
    worst, n = int(np.argmax(times)), plan.model.n_states
    inputs = np.max(np.abs(plan.departures(np.linspace(plan.start, plan.end, INPUT_SAMPLES)).u), axis=0)
    call = redesign_call(motion, inputs, held=plan.trajectory.after.held[n : n + plan.model.n_inputs], error=1.0)
    return (
        f"output {plan.model.outputs.names[worst]!r} strays from its reference by {times[worst]:.3g} times the wanted motion: too "
        f"much for a plan to follow; {call} weighs the error against the input instead; "
        "or move the zeros less far, or to the other side, or take a slower reference",
    )
