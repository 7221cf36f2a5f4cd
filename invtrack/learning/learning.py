"""The error of one run corrects the plan for the next: iterative learning control with the inverse as the learning filter."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from invtrack.arguments import instance
from invtrack.arrays import Array, finite_number, real_number, real_vector, shown, whole_number
from invtrack.errors import LearningError
from invtrack.plans.plan import Plan, require_plan
from invtrack.references.signal import PiecewiseSignal
from invtrack.references.smoothing import smoothed_reference
from invtrack.results.result import RunResult, require_run

Planner = Callable[[PiecewiseSignal], Plan]
"""A method of planning with everything but the reference settled, as `lambda y_d: invtrack.invert(model, y_d)`."""

SPECTRUM_SAMPLES = 4096
"""Times at which an error within the band is looked at."""

LAST = 0.05
"""Last share of the window in which what was learned is to have come to rest."""

SETTLED = 0.01
"""Share of itself within which it has."""

NOTICED = 0.1
"""Share of the largest amplitude from which on a frequency counts, where the growth of an error is explained."""


@dataclass(frozen=True, eq=False)
class LearningStep:
    """What one run showed.

    Args:
        number: of the run, from 0 on, the one before anything was learned.
        run: it.
        max_error: largest |y - y_d| of what was learned from, over the window.
        error: root mean square of y - y_d within the band, over window and outputs.
        contraction: that as a share of the error of the run before; None for the first.
        plan: the plan that was driven.
    """

    number: int
    run: RunResult
    max_error: float
    error: float
    contraction: float | None
    plan: Plan


class Learning:
    """What has been learned so far, and the plan for the next run.

    The wanted output y_d stays; what the inverse is made for is y_d + c, and c grows by the error of each run within the band:
    c <- c + gain P(y_d - y). P is the projection onto splines with pieces of pi / band (`smoothed_reference`): it passes what the
    model knows about and averages over noise, which inversion would differentiate. Where plant and model are linear, and H is how
    the closed loop answers a plan for its output, the error within the band is multiplied with 1 - gain H from run to run; of a
    model that is right H = 1.

        learning = Learning(lambda y_d: invtrack.invert(model, y_d), reference, band=30.0)
        learning.add(run)  # a RunResult from simulate, or a log of hardware by read_log, driven with learning.plan

    Args:
        planner: makes a plan for a reference; of a linear model, or of the MuJoCo model (then the inverse along the motion learns).
        reference: the wanted output y_d.
        band: highest frequency that is learned [rad/s]: below those at which the model is wrong by more than itself.
        gain: share of the error that is learned from one run, above 0 and below 2; less where noise matters more than speed.
        degree: of the splines; the plant's relative degree at least.
        window: (start, end) [s] of what is learned; the first run's span unless given. After it the correction stays as it is, so
            it should last until all has come to rest; a remark of the plan says where it does not.

    Raises LearningError for arguments out of range. Source: the inverse as learning filter, e.g. Ghosh, Paden, "Iterative learning
    control for nonlinear nonminimum phase plants", ASME J. Dyn. Syst. Meas. Control 123, 2001.
    """

    def __init__(
        self,
        planner: Planner,
        reference: PiecewiseSignal,
        *,
        band: float,
        gain: float = 1.0,
        degree: int = 7,
        window: tuple[float, float] | None = None,
    ) -> None:
        if not callable(planner):
            raise LearningError(f"planner must be a function that makes a plan for a reference, got {shown(planner)}")
        instance("reference", reference, PiecewiseSignal, expected="a reference such as rest_to_rest(...)", error=LearningError)
        self.band = finite_number("band [rad/s]", band, error=LearningError)
        self.gain = real_number("gain", gain, error=LearningError)
        if not self.band > 0:
            raise LearningError(f"band must be a positive number [rad/s], got {band}")
        if not 0 < self.gain < 2:
            raise LearningError(f"gain must lie above 0 and below 2, a share of the error that is learned at once, got {gain}")
        if window is not None:
            start, end = real_vector("window [s]", window, ["start", "end"], error=LearningError).tolist()
            if not start < end:
                raise LearningError(f"window must be two times [s], the first one earlier, got {window}")
            window = (start, end)
        self.reference, self.window = reference, window
        self.degree = whole_number("degree", degree, lowest=1, error=LearningError)
        self.steps: list[LearningStep] = []
        self._planner = planner
        self._correction: PiecewiseSignal | None = None
        self._errors: list[PiecewiseSignal] = []
        first = planner(reference)
        require_plan(first, error=LearningError)
        self._manoeuvre, self.plan = first.manoeuvre, first

    @property
    def best(self) -> LearningStep:
        """The step with the least error within the band. Raises LearningError before the first run."""
        if not self.steps:
            raise LearningError("nothing has been learned yet; add the run that was driven with learning.plan")
        return min(self.steps, key=lambda step: step.error)

    def add(self, run: RunResult) -> LearningStep:
        """Learn from a run that was driven with `plan`, which then is the one for the next run.

        Of a run with sensors for all outputs it is what they showed that is learned from, else the outputs themselves.

        Raises LearningError for a run that diverged, that does not cover the window, or that has other outputs.
        """
        require_run(run)
        if run.status != "completed":
            raise LearningError(f"run {run.name!r} {run.message or run.status}; there is nothing to learn from a run that diverged")
        times, y = observed(run)
        if y.shape[1] != self.reference.n_channels:
            raise LearningError(
                f"run {run.name!r} has the outputs {run.output.channels}, expected {self.reference.n_channels} as in the reference"
            )
        if self.window is None:
            self.window = (float(times[0]), float(times[-1]))
        inside = (times >= self.window[0] - 1e-9) & (times <= self.window[1] + 1e-9)
        slack = 1e-6 * (self.window[1] - self.window[0]) + float(np.max(np.diff(times), initial=0.0))
        if times[0] > self.window[0] + slack or times[-1] < self.window[1] - slack:
            raise LearningError(
                f"run {run.name!r} lasts from {times[0]:.6g} to {times[-1]:.6g} s; expected one over the window that is learned, "
                f"{self.window[0]:.6g} to {self.window[1]:.6g} s"
            )
        times, error = times[inside], self.reference(times[inside]) - y[inside]
        left = self._in_band(times, error)
        size = _root_mean_square(left, self.window)
        before = self.steps[-1].error if self.steps else None
        step = LearningStep(
            number=len(self.steps),
            run=run,
            max_error=float(np.max(np.abs(error))),
            error=size,
            contraction=None if before is None else (size / before if before > 0 else math.inf),
            plan=self.plan,
        )
        corrected = self.gain * error + (0.0 if self._correction is None else self._correction(times))
        correction = self._in_band(times, corrected)
        self.plan = self._for_the_reference(self._planner(self.reference + correction), correction)
        self._correction = correction
        self._errors.append(left)
        self.steps.append(step)
        return step

    def spectra(self) -> tuple[Array, Array]:
        """Frequencies (k,) [rad/s] up to the band, and the amplitudes (runs, k) of each run's error, all outputs together."""
        if self.window is None:
            raise LearningError("nothing has been learned yet; add the run that was driven with learning.plan")
        times = np.linspace(*self.window, SPECTRUM_SAMPLES)
        omega = 2 * np.pi * np.fft.rfftfreq(SPECTRUM_SAMPLES, times[1] - times[0])
        values = np.array([np.linalg.norm(np.abs(np.fft.rfft(left(times), axis=0)), axis=1) for left in self._errors])
        within = omega <= self.band
        return omega[within], values[:, within] * 2 / SPECTRUM_SAMPLES

    def growing(self) -> float | None:
        """The lowest frequency [rad/s] at which the last run's error is larger than that of the run before; None where none is."""
        omega, amplitudes = self.spectra()
        if len(amplitudes) < 2:
            return None
        before, now = amplitudes[-2:]
        grown = np.flatnonzero((now > before) & (now > NOTICED * np.max(now)))
        return float(omega[grown[0]]) if len(grown) else None

    def _in_band(self, times: Array, error: Array) -> PiecewiseSignal:
        return smoothed_reference(times, error, band=self.band, start=np.zeros(error.shape[1]), degree=self.degree)

    def _for_the_reference(self, plan: Plan, correction: PiecewiseSignal) -> Plan:
        """A plan for y_d + c as one for y_d, from which what it is to deliver differs."""
        T_i, T_f = self._manoeuvre
        times = np.linspace(*correction.manoeuvre, SPECTRUM_SAMPLES)
        values = correction(times)
        late = values[times > times[-1] - LAST * (times[-1] - times[0])]
        moving = float(np.max(np.ptp(late, axis=0)) / max(float(np.max(np.ptp(values, axis=0))), np.finfo(float).tiny))
        text = f"what was learned still changes by {moving:.2g} of itself at the end of its window, {times[-1]:.4g} s: drive longer"
        return replace(
            plan,
            method=f"{plan.method}, learned",
            reference=self.reference,
            manoeuvre=self._manoeuvre,
            preactuation=max(0.0, T_i - plan.start),
            postactuation=max(0.0, plan.end - T_f),
            remarks=(*plan.remarks, *([text] if moving > SETTLED else [])),
        )


def observed(run: RunResult) -> tuple[Array, Array]:
    """Times (m,) [s] and outputs (m, p) of a run: as its sensors showed them, where there is one for each."""
    names = run.output.channels.names
    if run.measured.channels and set(names) <= set(run.measured.channels.names):
        return run.time[:-1], np.column_stack([run.measured[name] for name in names])
    return run.time, run.output.values


def _root_mean_square(signal: PiecewiseSignal, window: tuple[float, float]) -> float:
    values = signal(np.linspace(*window, SPECTRUM_SAMPLES))
    return float(np.sqrt(np.mean(np.sum(values**2, axis=1))))
