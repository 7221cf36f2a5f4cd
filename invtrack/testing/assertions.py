"""What a test asserts of a run, in plain functions: they serve pytest, any other test runner, and none."""

from __future__ import annotations

import math
from typing import NoReturn

import numpy as np

from invtrack.arguments import flag
from invtrack.arrays import Array, real_number
from invtrack.channels import Channels
from invtrack.errors import InvtrackError
from invtrack.results.measured import time_tolerance
from invtrack.results.result import RunResult, require_run
from invtrack.results.vibration import PERIODS, vibration_window
from invtrack.testing.ringing import Oscillation, oscillation

UNDAMPED = 1e-6
"""A damping ratio smaller than this is zero to within what a run shows."""


class RunAssertionError(AssertionError):
    """A run does not do what a test asserts; the message says measured, limit, unit, when, and what rings.

    run: the run. oscillation: what rings in it after its manoeuvre, None where that was not looked for or nothing does.
    """

    def __init__(self, message: str, run: RunResult, ringing: Oscillation | None = None) -> None:
        super().__init__(message)
        self.run = run
        self.oscillation = ringing

    def __reduce__(self) -> tuple[type[RunAssertionError], tuple[object, ...]]:
        return type(self), (self.args[0], self.run, self.oscillation)


def assert_settles(run: RunResult, *, within: float, after: float = 0.0, output: str | None = None) -> None:
    """From `after` [s] past the end of the manoeuvre until the run's end, |y - y_d| stays within `within`.

    Args:
        run: a run that lasts for at least one period of the slowest flexible mode longer than that, where there is one.
        within: in the output's unit.
        after: [s], counted from the end of the manoeuvre.
        output: which one; all of them, if they have one unit, unless given.

    Raises RunAssertionError where it does not, or the run diverged; InvtrackError for arguments out of range, an output that does
    not exist, and a run too short to show it.
    """
    __tracebackhide__ = True
    limit, delay = _limit("within", within), real_number("after", after, unit="s", error=InvtrackError)
    if not 0 <= delay < math.inf:
        raise InvtrackError(f"after must be a finite number of seconds after the manoeuvre, not negative, got {delay}")
    columns = _columns("output", output, run)
    start = run.manoeuvre[1] + delay
    _require_completed(run, "settle")
    shown = start + (run.vibration_period if math.isfinite(run.vibration_period) else 0.0)
    if run.time[-1] < shown - time_tolerance(run):
        raise InvtrackError(
            f"run {run.name!r} ends at t = {run.time[-1]:.6g} s; to show that it settles from t = {start:.6g} s on it must last "
            f"for one period of the slowest flexible mode more, until {shown:.6g} s: simulate with end={shown:.6g} or later"
        )
    size = np.abs(run.error)
    time, worst, column = _worst(run.time, np.where((run.time >= start - time_tolerance(run))[:, None], size, 0.0), columns)
    if worst <= limit:
        return
    channels = run.output.channels
    last = int(np.flatnonzero(size[:, column] > limit)[-1])
    settled = "not settled when the run ends" if last == len(size) - 1 else f"settled from t = {run.time[last + 1]:.6g} s on"
    facts = {
        "measured": f"|y - y_d| = {_quantity(worst, channels, column)} at {_when(run, time)}{_planned(run, time, column)}",
        "limit": f"{_quantity(limit, channels, column)} from {delay:g} s after the manoeuvre on; {settled}",
    }
    _fail(run, f"{channels.names[column]} does not settle", facts, rings_in=column, start=start)


def assert_tracks(run: RunResult, *, within: float, output: str | None = None) -> None:
    """Over the whole run |y - y_d| is at most `within`, in the output's unit.

    output: which one; all of them, if they have one unit, unless given. Raises as `assert_settles` does.
    """
    __tracebackhide__ = True
    limit = _limit("within", within)
    columns = _columns("output", output, run)
    _require_completed(run, "track")
    time, worst, column = _worst(run.time, np.abs(run.error), columns)
    if worst <= limit:
        return
    channels = run.output.channels
    facts = {
        "measured": f"largest |y - y_d| = {_quantity(worst, channels, column)} at {_when(run, time)}{_planned(run, time, column)}",
        "limit": f"{_quantity(limit, channels, column)} over the whole run",
    }
    _fail(run, f"{channels.names[column]} does not follow the reference", facts, rings_in=column)


def assert_residual_vibration(
    run: RunResult, *, at_most: float, output: str | None = None, periods: float = PERIODS, duration: float | None = None
) -> None:
    """The peak to peak of y - y_d over the window after the manoeuvre is at most `at_most`, see `invtrack.residual_vibration`.

    Args:
        run: a run that lasts until the end of the window.
        at_most: peak to peak, in the output's unit.
        output: which one; all of them, if they have one unit, unless given.
        periods: length of the window in periods of the slowest flexible mode.
        duration: length of the window [s] in place of that.

    Raises as `assert_settles` does.
    """
    __tracebackhide__ = True
    limit = _limit("at_most", at_most)
    columns = _columns("output", output, run)
    _require_completed(run, "come to rest")
    length = vibration_window(run, periods=periods, duration=duration).required()
    start, tolerance = run.manoeuvre[1], time_tolerance(run)
    if run.time[-1] < start + length - tolerance:
        raise InvtrackError(
            f"run {run.name!r} ends at t = {run.time[-1]:.6g} s, before the window for residual vibration does: simulate with "
            f"end={start + length:.6g} or later, or ask for fewer periods or a shorter duration"
        )
    error = run.error[(run.time >= start - tolerance) & (run.time <= start + length + tolerance)]
    column = max(columns, key=lambda i: float(np.ptp(error[:, i])))
    measured, channels = float(np.ptp(error[:, column])), run.output.channels
    if measured <= limit:
        return
    facts = {
        "measured": f"{_quantity(measured, channels, column)} peak to peak, {start:.6g} s to {start + length:.6g} s",
        "limit": f"{_quantity(limit, channels, column)} peak to peak",
    }
    _fail(run, f"{channels.names[column]} vibrates on after the manoeuvre", facts, rings_in=column)


def assert_peak_input(run: RunResult, *, at_most: float, input: str | None = None, commanded: bool = False) -> None:
    """Over the whole run |u| is at most `at_most`, in the input's unit.

    Args:
        run: the run.
        at_most: in the input's unit.
        input: which one; all of them, if they have one unit, unless given.
        commanded: whether the input counts as the controller commands it, before the actuators' limits, rather than as applied.

    Raises as `assert_settles` does.
    """
    __tracebackhide__ = True
    limit, before = _limit("at_most", at_most), flag("commanded", commanded, error=InvtrackError)
    columns = _columns("input", input, run)
    _require_completed(run, "keep to its input")
    signal = run.commanded if before else run.applied
    time, worst, column = _worst(run.time, np.abs(signal.values), columns)
    if worst <= limit:
        return
    kind = "commanded" if before else "applied"
    facts = {
        "measured": f"largest {kind} |u| = {_quantity(worst, signal.channels, column)} at {_when(run, time)}",
        "limit": _quantity(limit, signal.channels, column),
    }
    _fail(run, f"{signal.channels.names[column]} exceeds its limit", facts)


def _limit(name: str, value: float) -> float:
    limit = real_number(name, value, error=InvtrackError)
    if not 0 <= limit < math.inf:
        raise InvtrackError(f"{name} must be finite and not negative, got {limit}")
    return limit


def _columns(kind: str, name: str | None, run: RunResult) -> list[int]:
    """The columns of the output or input of this name, or of all that there are."""
    require_run(run)
    channels = run.output.channels if kind == "output" else run.applied.channels
    if name is not None:
        return [channels.index(name)]
    if len(set(channels.units)) > 1:
        raise InvtrackError(f"one limit cannot hold for {channels}: say which, {kind}={channels.names[0]!r}")
    return list(range(len(channels)))


def _require_completed(run: RunResult, what: str) -> None:
    __tracebackhide__ = True
    if run.status != "completed":
        _fail(run, f"the run diverged, so it does not {what}", {"diverged": run.message})
    if not (np.all(np.isfinite(run.error)) and np.all(np.isfinite(run.applied.values))):
        raise InvtrackError(f"run {run.name!r} was completed, but holds outputs or inputs that are not finite")


def _worst(time: Array, size: Array, columns: list[int]) -> tuple[float, float, int]:
    """When [s] and how large the largest of these columns is, and which one it is."""
    row, place = np.unravel_index(np.argmax(size[:, columns]), (len(size), len(columns)))
    column = columns[int(place)]
    return float(time[row]), float(size[row, column]), column


def _quantity(value: float, channels: Channels, column: int) -> str:
    unit = channels.units[column]
    return f"{value:.4g} {unit}" if unit not in ("", "1") else f"{value:.4g}"


def _when(run: RunResult, time: float) -> str:
    """A time [s], and where it lies from the manoeuvre."""
    (T_i, T_f), text = run.manoeuvre, f"t = {time:.6g} s"
    if time < T_i:
        return f"{text}, {T_i - time:.4g} s before the manoeuvre"
    return f"{text}, {time - T_f:.4g} s after the manoeuvre" if time > T_f else f"{text}, in the manoeuvre"


def _planned(run: RunResult, time: float, column: int) -> str:
    """How much of the error at a time [s] is the plan's own, where that is worth saying."""
    row = int(np.searchsorted(run.time, time))
    planned = abs(float(run.planned_output.values[row, column] - run.reference.values[row, column]))
    if planned <= 0.01 * abs(run.error[row, column]):
        return ""
    return f"; the plan itself is {_quantity(planned, run.output.channels, column)} off there"


def _fail(
    run: RunResult, headline: str, facts: dict[str, str], *, rings_in: int | None = None, start: float | None = None
) -> NoReturn:
    """Raise the failure; with what rings in the output of that column after the manoeuvre, or from `start` [s] on."""
    __tracebackhide__ = True
    ringing = None
    if rings_in is not None:
        ringing = oscillation(run, run.output.channels.names[rings_in], start=start)
        facts = {**facts, **_ringing(ringing, run.output.channels, rings_in)}
    width = max(map(len, facts))
    lines = [f"run {run.name!r} of {run.model!r}: {headline}", *(f"  {name:<{width}}  {text}" for name, text in facts.items())]
    raise RunAssertionError("\n".join(lines), run, ringing)


def _ringing(found: Oscillation | None, channels: Channels, column: int) -> dict[str, str]:
    if found is None:
        return {"rings": "nothing: what is left after the manoeuvre does not oscillate"}
    damping = found.damping if abs(found.damping) > UNDAMPED else 0.0
    grows = " and grows" if damping < 0 else ""
    amplitude, share = _quantity(found.amplitude, channels, column), f"{100 * found.share:.0f} % of what the error varies"
    rings = (
        f"at {found.frequency:.4g} Hz{grows}, damping ratio {damping:.2g}, amplitude {amplitude} at t = {found.start:.6g} s: "
        f"{share}"
    )
    states = ", ".join(f"{label}: {size:.3g}" for label, size in found.states)
    return {"rings": rings, "in states": states} if states else {"rings": rings}
