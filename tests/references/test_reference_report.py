"""What the report says about a reference is what is known of it: peaks, smoothness, rest, noise."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from invtrack.channels import Channels
from invtrack.errors import TrajectoryError
from invtrack.references.profiles import autonomous, constant, piecewise_polynomial, raised_cosine, rest_to_rest
from invtrack.references.reference_report import reference_report
from invtrack.references.samples import sampled_reference
from invtrack.references.signal import PiecewiseSignal, stack

OMEGA = 2.0 * np.pi


def sinusoid(pieces_per_period: int, periods: int = 20, amplitude: float = 3.0) -> PiecewiseSignal:
    S = np.array([[0.0, OMEGA], [-OMEGA, 0.0]])
    signal = autonomous(S, [[amplitude, 0.0]], [0.0, 1.0], start=0.0, end=float(periods))
    return signal.refined(np.arange(1, periods * pieces_per_period) / pieces_per_period)


def test_peaks_of_a_sinusoid_are_powers_of_its_frequency() -> None:
    report = reference_report(sinusoid(40), highest=5)
    np.testing.assert_allclose(report.peaks[:, 0], 3.0 * OMEGA ** np.arange(6), rtol=1e-2)


@pytest.mark.parametrize("pieces_per_period", [5, 8, 25])
def test_roughness_of_a_sinusoid_tells_its_pieces_per_period(pieces_per_period: int) -> None:
    report = reference_report(sinusoid(pieces_per_period, periods=100), highest=3)
    np.testing.assert_allclose(report.roughness, 2.0 * np.sin(np.pi / pieces_per_period), rtol=0.02)
    assert (report.first_rough(0) is None) == (pieces_per_period > 6)


@pytest.mark.parametrize("smoothness", [1, 2, 3, 4])
def test_rest_and_continuity_of_rest_to_rest_motions(smoothness: int) -> None:
    report = reference_report(rest_to_rest(0.0, 2.0, 3.0, smoothness=smoothness), highest=3)
    assert report.continuous == (min(smoothness, 3) + 1,)
    assert report.rest == ((min(smoothness, 3),) * 2,)
    assert report.pieces == (1 if smoothness < 3 else 2)
    assert report.span == (0.0, 3.0)
    assert np.all(np.isnan(report.roughness))  # too few pieces to judge by their neighbours


@pytest.mark.parametrize(
    "signal",
    [
        raised_cosine(2.0),
        rest_to_rest(0.0, 1.0, 1e-3, smoothness=3),
        rest_to_rest(0.0, 1.0, 1.0, smoothness=3) + rest_to_rest(0.0, 1e-6, 1.0, smoothness=1),
        piecewise_polynomial([0.0, 1.0, 3.0], [[0.0, 1.0, 2.0], [3.0, 5.0]]),
        sampled_reference(np.arange(8.0), np.sin(np.arange(8.0)) * 1e6 + 1e6, degree=5),
        sampled_reference(np.arange(8.0), np.sin(np.arange(8.0)), degree=7, smoothness=1),
    ],
)
def test_continuity_agrees_with_the_signal_itself(signal: PiecewiseSignal) -> None:
    assert reference_report(signal, highest=6).continuous == (signal.smoothness(0, 7),)


def test_a_constant_rests_throughout() -> None:
    report = reference_report(constant([1.0, -2.0]), highest=3)
    np.testing.assert_array_equal(report.peaks, [[1.0, 2.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]])
    assert report.rest == (((3, 3),) * 2)
    assert "0 piece(s) at rest throughout" in str(report)


def test_one_end_at_rest_and_one_in_motion() -> None:
    report = reference_report(piecewise_polynomial([0.0, 1.0], [[0.0, 0.0, 0.0, 1.0]]))  # t^3
    assert report.rest == ((2, 0),)
    assert "starts at rest: derivatives 1 to 2 vanish there" in str(report)
    assert "ends in motion" in str(report)


@pytest.mark.parametrize("gain", [1.0, 1e-6])
def test_noise_shows_first_in_the_order_that_amplifies_it_past_the_motion(gain: float) -> None:
    """Noise s in samples h apart is about s / h^r in the r-th derivative, the motion's is of size 1."""
    h, motion = 0.01, rest_to_rest(0.0, 2.0, 6.0, smoothness=6)
    times = np.arange(0.0, 6.0 + h / 2, h)
    noise = np.random.default_rng(0).standard_normal((len(times), 1))
    found = []
    for s in (0.0, 1e-9, 1e-7, 1e-5, 1e-3):
        report = reference_report(sampled_reference(times, gain * (motion(times) + s * noise)), highest=5)
        found.append(report.first_rough(0))
        assert ("changes mostly from sample to sample" in str(report)) == (found[-1] is not None)
    assert found == [None, 4, 3, 2, 2]


def test_text_names_channels_and_units() -> None:
    both = stack([rest_to_rest(0.0, 2.0, 3.0), rest_to_rest(0.0, 1.0, 2.0)])
    text = str(reference_report(both, highest=2, channels=Channels(["tip", "angle"], ["m", "rad"])))
    for expected in ("from 0 s to 3 s, 2 piece(s) of 1 s to 2 s", "tip", "2 m ", "angle", "rad/s ", "rad/s^2 "):
        assert expected in text
    assert " 1/s^2 " in str(reference_report(both, highest=2))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"highest": 0}, "highest must be a whole number from 1 to 1000, got 0"),
        ({"highest": 2.5}, "highest must be a whole number from 1 to 1000, got 2.5"),
        ({"channels": ["a", "b"]}, r"the reference has 1 channel\(s\), got names for 2: a, b"),
    ],
)
def test_bad_options_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(TrajectoryError, match=message):
        reference_report(rest_to_rest(0.0, 1.0, 1.0), **options)
