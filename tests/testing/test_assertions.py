"""What the assertions let pass, what they say of what they do not, and what they refuse to judge."""

from __future__ import annotations

import pickle
import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from invtrack.channels import Channels
from invtrack.errors import ChannelError, InvtrackError
from invtrack.results.result import RunResult, Signal
from invtrack.testing import RunAssertionError, assert_peak_input, assert_residual_vibration, assert_settles, assert_tracks
from tests.synthetic_runs import PEAK_INPUT, TwoModes, diverged, two_mode_run

SINE = two_mode_run(modes=TwoModes(slow=1e-3), timestep=5e-3)  # 1 mm at 0.5 Hz from before the manoeuvre to 12 s after it


def decaying_run(rate: float = 0.5) -> RunResult:
    """|y - y_d| = 1 mm exp(-rate t) at most, t from the end of the manoeuvre; rings at 0.5 Hz."""
    envelope = np.exp(-rate * np.maximum(SINE.time - 4.0, 0.0))[:, None]
    return replace(SINE, output=Signal(SINE.reference.values + envelope * SINE.error, SINE.output.channels))


def two_outputs() -> RunResult:
    """The tip of SINE in metres, and an angle in rad off by 0.2 throughout."""
    channels = Channels(("tip", "angle"), ("m", "rad"))

    def beside(signal: Signal, value: float) -> Signal:
        return Signal(np.column_stack([signal.values, np.full(len(signal.values), value)]), channels)

    return replace(
        SINE, output=beside(SINE.output, 0.2), reference=beside(SINE.reference, 0.0), planned_output=beside(SINE.reference, 0.0)
    )


def test_what_holds_passes() -> None:
    assert_tracks(SINE, within=1.0001e-3)
    assert_settles(SINE, within=1.0001e-3)
    assert_settles(decaying_run(), within=1e-4, after=np.log(10) / 0.5)
    assert_residual_vibration(SINE, at_most=2.0001e-3)
    assert_residual_vibration(SINE, at_most=2.0001e-3, output="tip_position", periods=2)
    assert_residual_vibration(SINE, at_most=1e-12, duration=1e-6)
    assert_peak_input(SINE, at_most=PEAK_INPUT)
    assert_peak_input(SINE, at_most=PEAK_INPUT, input="base_force", commanded=True)
    assert_settles(two_outputs(), within=0.2, output="angle")


@pytest.mark.parametrize(
    ("check", "says"),
    [
        (
            lambda: assert_tracks(SINE, within=5e-4),
            r"run 'exact' of 'two_mode': tip_position does not follow the reference\n"
            r"  measured +largest \|y - y_d\| = 0.001 m at t = \S+ s, (in|\S+ s (before|after)) the manoeuvre\n"
            r"  limit +0.0005 m over the whole run\n"
            r"  rings +at 0.5 Hz, damping ratio 0, amplitude 0.001 m at t = 4 s: 100 % of what the error varies\n"
            r"  in states +tip \[m\]: 0.001, base \[m\]: 0.0005",
        ),
        (
            lambda: assert_settles(SINE, within=5e-4, after=2.0),
            r"tip_position does not settle\n  measured +\|y - y_d\| = 0.001 m at t = \S+ s, \S+ s after the manoeuvre\n"
            r"  limit +0.0005 m from 2 s after the manoeuvre on; (not settled when the run ends|settled from t = 15.\d+ s on)\n",
        ),
        (
            lambda: assert_residual_vibration(SINE, at_most=1e-3),
            r"vibrates on after the manoeuvre\n  measured +0.002 m peak to peak, 4 s to 14 s\n  limit +0.001 m peak to peak\n",
        ),
        (
            lambda: assert_peak_input(SINE, at_most=30.0),
            r"base_force exceeds its limit\n  measured +largest applied \|u\| = 40 N at t = 1.99\d* s, in the manoeuvre\n"
            r"  limit +30 N$",
        ),
        (
            lambda: assert_settles(two_outputs(), within=0.1, output="angle"),
            r"angle does not settle\n  measured .* 0.2 rad .*\n.*\n  rings +nothing: what is left after the manoeuvre does",
        ),
        (
            lambda: assert_tracks(diverged(SINE, at=5.0), within=1.0),
            r"the run diverged, so it does not track\n  diverged  state is not finite at t = 5",
        ),
    ],
    ids=["tracks", "settles", "vibration", "input", "offset", "diverged"],
)  # fmt: skip
def test_what_does_not_hold_is_said_with_measured_limit_unit_when_and_what_rings(check: Callable[[], None], says: str) -> None:
    with pytest.raises(RunAssertionError) as failure:
        check()
    assert re.search(says, str(failure.value)), str(failure.value)


def test_when_it_settled_is_said() -> None:
    """1 mm exp(-0.5 t) has its last excursion above 0.1 mm shortly before ln(10) / 0.5 = 4.6 s."""
    with pytest.raises(RunAssertionError) as failure:
        assert_settles(decaying_run(), within=1e-4, after=1.0)
    settled = re.search(r"settled from t = (\S+) s on", str(failure.value))
    assert settled
    assert 4.6 - 1.0 <= float(settled[1]) - 4.0 <= 4.61
    found = failure.value.oscillation
    assert found is not None
    assert (found.start, found.frequency) == (5.0, pytest.approx(0.5, rel=1e-3))
    assert found.damping == pytest.approx(0.5 / np.hypot(0.5, np.pi), rel=1e-2)


def test_a_failure_is_an_assertion_with_its_run_and_can_be_sent_to_another_process() -> None:
    with pytest.raises(AssertionError) as failure:
        assert_tracks(SINE, within=0.0)
    error = failure.value
    assert isinstance(error, RunAssertionError)
    assert error.run is SINE
    copied = pickle.loads(pickle.dumps(error))
    assert str(copied) == str(error)
    assert copied.run.equals(SINE)


@pytest.mark.parametrize(
    ("check", "error", "says"),
    [
        (lambda: assert_tracks(SINE, within=-1.0), InvtrackError, "within must be finite and not negative, got -1.0"),
        (lambda: assert_settles(SINE, within=1.0, after=-1.0), InvtrackError, "after must be a finite number of seconds after"),
        (lambda: assert_settles(SINE, within=1.0, after=11.0), InvtrackError, r"must last .* until 17 s: simulate with end=17"),
        (lambda: assert_residual_vibration(SINE, at_most=1.0, periods=9), InvtrackError, "simulate with end=22 or later"),
        (lambda: assert_tracks(SINE, within=1.0, output="hip"), ChannelError, "no channel is named 'hip'; there are: tip_position"),
        (lambda: assert_tracks(two_outputs(), within=1.0), InvtrackError, r"tip \[m\], angle \[rad\]: say which, output='tip'"),
        (lambda: assert_tracks("run", within=1.0), InvtrackError, "the result of a run"),
    ],
)
def test_what_cannot_be_judged_is_refused(check: Callable[[], None], error: type[Exception], says: str) -> None:
    with pytest.raises(error, match=says) as refusal:
        check()
    assert not isinstance(refusal.value, AssertionError)
