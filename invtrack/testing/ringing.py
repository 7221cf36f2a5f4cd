"""What rings after a manoeuvre: the strongest damped sinusoid in a run's own signals, and the mode of the model nearest to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from invtrack.arguments import instance
from invtrack.arrays import Array, ComplexArray, finite_number
from invtrack.channels import Channels
from invtrack.errors import InvtrackError
from invtrack.linear.state_space import StateSpace
from invtrack.results.measured import time_tolerance
from invtrack.results.result import RunResult, require_run

SAMPLES = 300
"""Samples that one level of resolution looks at; those that it needs at least."""
LEAST_SAMPLES = 40

PERIODS = 2.5
"""Periods that must lie in a level's window for an oscillation to be known from it."""

NOISE = 1e-4
"""Singular values below this share of the largest are noise, as far as what rings is asked for."""

MOST_COMPONENTS = 16
FASTEST = 0.5 * np.pi
"""Largest angle [rad] from one sample to the next that a level answers for: four samples a period. Finer levels have the rest."""

LARGEST_GROWTH, GONE = 1e3, 1e-6
"""What a component may grow over a window, and what it must leave from one sample to the next, to be more than noise."""

OVERDAMPED = 0.7
"""Damping ratio from which on nobody would call it ringing."""

LEAST_SHARE = 0.02
"""Share of the error's variation (rms) that an oscillation must make up to be told of."""

TAKES_PART = 0.1
"""Share of the largest amplitude, among states of one unit, from which on a state takes part."""


@dataclass(frozen=True)
class Oscillation:
    """amplitude exp(-damping |s| t) cos(Im(s) t + phase) in the error of one output, t counted from `start`.

    Args:
        output: name of the output.
        start: [s], on the run's clock.
        frequency: Im(s) / 2 pi [Hz].
        damping: damping ratio -Re(s) / |s|; negative where it grows.
        amplitude: at `start`, in the output's unit.
        share: of the error's variation (rms) over the window in which it was found.
        states: the positions and activations that take part, the largest of each unit first: (name with unit, amplitude).
    """

    output: str
    start: float
    frequency: float
    damping: float
    amplitude: float
    share: float
    states: tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class _Component:
    """One damped sinusoid: s [rad/s], complex amplitudes of all signals at the start (k,), rms of the first one in the window."""

    s: complex
    amplitudes: ComplexArray
    rms: float
    share: float


def oscillation(run: RunResult, output: str, *, start: float | None = None) -> Oscillation | None:
    """The strongest oscillation of y - y_d from `start` [s] on, the end of the manoeuvre unless given; None where nothing rings.

    Damped sinusoids are fitted to the error by the shift invariance of its Hankel matrix's signal space (ESPRIT), at every
    resolution from the run's own steps to windows that last to its end; of all of them counts the one with the largest rms in its
    window. The same sinusoid is then fitted to the states' deviations, which says which of them take part.

    Source: Roy and Kailath, ESPRIT: estimation of signal parameters via rotational invariance techniques, IEEE Trans. ASSP 37(7),
    1989. Raises ChannelError for an output that does not exist, InvtrackError for what is no run and no time.
    """
    require_run(run)
    column = run.output.channels.index(output)
    start = run.manoeuvre[1] if start is None else finite_number("start", start, unit="s", error=InvtrackError)
    names, signals, step = _even_signals(run, column, start)
    size = float(np.max(np.abs(signals[:, 0]), initial=0.0))
    if not size > 0:
        return None
    signals[:, 0] /= size  # squares of large errors would overflow, those of small ones vanish
    found = _strongest(signals, step)
    if found is None or found.share < LEAST_SHARE:
        return None
    return Oscillation(
        output=output,
        start=start,
        frequency=found.s.imag / (2 * np.pi),
        damping=-found.s.real / abs(found.s),
        amplitude=size * float(2 * abs(found.amplitudes[0])),
        share=min(found.share, 1.0),
        states=_taking_part(names, 2 * np.abs(found.amplitudes[1:])),
    )


@dataclass(frozen=True)
class Mode:
    """An oscillatory mode of a linear model: frequency [Hz], damping ratio, the states that take part."""

    frequency: float
    damping: float
    states: tuple[str, ...]


def nearest_mode(model: StateSpace, frequency: float) -> Mode | None:
    """The oscillatory mode of x' = A x whose frequency is nearest to this one [Hz], by its ratio; None where nothing oscillates.

    Raises InvtrackError for what is no StateSpace, and a frequency that is not positive and finite.
    """
    instance("model", model, StateSpace, expected="an invtrack.StateSpace, such as linearize(plant)", error=InvtrackError)
    frequency = finite_number("frequency", frequency, unit="Hz", error=InvtrackError)
    if not frequency > 0:
        raise InvtrackError(f"frequency must be positive [Hz], got {frequency}")
    values, vectors = np.linalg.eig(model.A)
    modes = np.flatnonzero(values.imag > 1e-6 * np.max(np.abs(values), initial=0.0))
    if not len(modes):
        return None
    nearest = modes[np.argmin(np.abs(np.log(values[modes].imag / (2 * np.pi * frequency))))]
    s, shape = values[nearest], np.abs(vectors[:, nearest])
    kept = [i for i, name in enumerate(model.states.names) if not _is_velocity(name, model.states)]
    taking = _taking_part(model.states.subset([model.states.names[i] for i in kept]), shape[kept])
    return Mode(float(s.imag / (2 * np.pi)), float(-s.real / abs(s)), tuple(name for name, _ in taking))


def _even_signals(run: RunResult, column: int, start: float) -> tuple[Channels, Array, float]:
    """The states looked at, and from `start` on the output's error and their deviations (n, 1 + k) at even steps [s]."""
    channels = run.state.channels
    states = channels.subset([name for name in channels.names if not _is_velocity(name, channels)])
    kept = [channels.index(name) for name in states.names]
    after = (run.time >= start - time_tolerance(run)) & np.all(np.isfinite(run.state.values), axis=1)
    error, planned = run.error[after, column], (run.planned_output.values - run.reference.values)[after, column]
    deviations, wanted = run.state.values[after][:, kept], run.state_reference.values[after][:, kept]
    if np.any(np.isnan(wanted)) or (len(error) and np.ptp(planned) > np.ptp(error - planned)):
        # No state is wanted, or the plan itself moves on: then it is the states that ring, not what they miss.
        wanted = np.mean(deviations, axis=0)
    time, signals = run.time[after], np.column_stack([error, deviations - wanted])
    if len(time) < LEAST_SAMPLES:
        return states, np.zeros((0, signals.shape[1])), 1.0
    count = len(time)
    step = (time[-1] - time[0]) / (count - 1)
    even = time[0] + step * np.arange(count)
    return states, np.column_stack([np.interp(even, time, signal) for signal in signals.T]), float(step)


def _strongest(signals: Array, step: float) -> _Component | None:
    """Of all oscillations of the first signal, at all resolutions, the one with the largest rms."""
    best: _Component | None = None
    delay, passed = 0.0, list[float]()
    while len(signals) >= LEAST_SAMPLES:
        for component in _components(signals[:SAMPLES], step):
            # What halving the rate has done to this exponential: moved its start, and multiplied it by cosh^4 at every step.
            gain = np.exp(component.s * delay) * np.prod([np.cosh(component.s * h / 2) ** 4 for h in passed])
            if best is None or component.rms > best.rms:
                best = _Component(component.s, component.amplitudes / gain, component.rms, component.share)
        smooth = (signals[:-4] + 4 * signals[1:-3] + 6 * signals[2:-2] + 4 * signals[3:-1] + signals[4:]) / 16
        passed.append(step)
        signals, delay, step = smooth[::2], delay + 2 * step, 2 * step
    return best


def _components(signals: Array, step: float) -> list[_Component]:
    """The oscillations that the first signal (n,) consists of, as far as this window at this step [s] shows them."""
    error, count = signals[:, 0], len(signals)
    size = float(np.max(np.abs(error)))
    if not size > 0:
        return []
    hankel = np.lib.stride_tricks.sliding_window_view(error / size, count // 2)
    _, strength, rows = np.linalg.svd(hankel, full_matrices=False)
    rank = min(int(np.sum(strength > NOISE * strength[0])), MOST_COMPONENTS)
    space = rows[:rank].T
    shifts = np.linalg.eigvals(np.linalg.lstsq(space[:-1], space[1:], rcond=None)[0])
    shifts = shifts[(np.abs(shifts) > GONE) & (np.abs(shifts) ** count < LARGEST_GROWTH)]
    if not len(shifts):
        return []
    powers = shifts[np.newaxis] ** np.arange(count)[:, np.newaxis]
    amplitudes = np.linalg.lstsq(powers, signals.astype(complex), rcond=None)[0]
    variation = float(np.std(error))
    found = []
    for z, row, power in zip(shifts, amplitudes, powers.T, strict=True):
        angle = float(np.angle(z))
        if not 2 * np.pi * PERIODS / count <= angle <= FASTEST:
            continue
        s = complex(np.log(z) / step)
        if -s.real < OVERDAMPED * abs(s):
            rms = float(np.sqrt(np.mean((2 * (row[0] * power).real) ** 2)))
            found.append(_Component(s, row, rms, rms / variation))
    return found


def _taking_part(states: Channels, amplitudes: Array) -> tuple[tuple[str, float], ...]:
    """Of each unit the states whose amplitude (k,) is not small beside the largest, with their units, that one first."""
    found: list[tuple[str, float]] = []
    for unit in dict.fromkeys(states.units):
        alike = [i for i, its in enumerate(states.units) if its == unit]
        largest = max(amplitudes[i] for i in alike)
        for i in sorted(alike, key=lambda i: -amplitudes[i]):
            if amplitudes[i] >= TAKES_PART * largest > 0:
                found.append((states.labels[i], float(amplitudes[i])))
    return tuple(found)


def _is_velocity(name: str, channels: Channels | Sequence[str]) -> bool:
    """Whether it is the velocity of another of the channels, which rings with it and says nothing more."""
    return name.endswith(" velocity") and name.removesuffix(" velocity") in channels
