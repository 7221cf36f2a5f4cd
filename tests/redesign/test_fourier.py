"""The transform of a reference's rate against numerical integration of the rate itself."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from invtrack.errors import TrajectoryError
from invtrack.redesign.prefilter.fourier import rate_spectrum
from invtrack.redesign.prefilter.prefilter import held_values
from invtrack.references.profiles import autonomous, piecewise_polynomial, raised_cosine, rest_to_rest
from invtrack.references.samples import sampled_reference
from invtrack.references.signal import PiecewiseSignal, stack

SAMPLED = sampled_reference(np.linspace(0.0, 2.0, 9), np.sin(np.linspace(0.0, np.pi, 9)) ** 4)


@pytest.mark.parametrize(
    "reference",
    [rest_to_rest(0.0, 1.0, 3.0), rest_to_rest(2.0, -1.0, 0.5, start_time=-4.0), raised_cosine(2.0, period=2.0, cycles=3), SAMPLED],
    ids=["slew", "short slew", "raised_cosine", "sampled"],
)
def test_transform_is_the_integral_of_the_rate(reference: PiecewiseSignal) -> None:
    w = np.array([0.0, np.pi, 7.0, 40.0])  # pi: the raised_cosine's own frequency
    found = rate_spectrum(reference, w, origin=-1.0)[:, 0]
    expected = np.zeros(len(w), dtype=complex)
    for a, b in zip(reference.breakpoints[:-1], reference.breakpoints[1:], strict=True):
        for k, frequency in enumerate(w):
            for part, phase in ((np.cos, 1.0), (np.sin, -1j)):
                integral = quad(
                    lambda t, part=part, frequency=frequency: (
                        reference(t, derivative=1, inside=(a + b) / 2)[0] * part(frequency * (t + 1.0))  # noqa: B023
                    ),
                    a,
                    b,
                    epsabs=1e-11,
                    epsrel=1e-10,
                    limit=200,
                )[0]
                expected[k] += phase * integral
    assert np.max(np.abs(found - expected)) < 1e-9


def test_a_jump_of_the_reference_has_a_flat_transform() -> None:
    step = piecewise_polynomial([0.0, 1.0], [[2.0]], held=(0.0, 2.0))
    assert rate_spectrum(step, np.array([0.0, 1.0, 100.0]), origin=-0.5) == pytest.approx(
        2.0 * np.exp(-0.5j * np.array([[0.0], [1.0], [100.0]]))
    )


def test_at_zero_it_is_the_whole_change() -> None:
    reference = stack([rest_to_rest(0.5, 2.0, 3.0), raised_cosine(2.0, period=2.0)])
    y_0, y_f = held_values(reference)
    assert y_0 == pytest.approx([0.5, 0.0])
    assert y_f == pytest.approx([2.0, 0.0])
    assert rate_spectrum(reference, np.zeros(1), origin=0.0)[0] == pytest.approx(y_f - y_0, abs=1e-12)


def test_a_reference_that_does_not_come_to_rest_is_refused() -> None:
    ramp = autonomous([[0.0, 1.0], [0.0, 0.0]], [[1.0, 0.0]], [0.0, 1.0], start=0.0, end=1.0)
    kind = ramp.kind.copy()
    kind[-1] = kind[1]  # goes on rising
    anchors = ramp.anchors.copy()
    anchors[-1] = [1.0, 1.0]
    with pytest.raises(TrajectoryError, match=r"holds still outside its manoeuvre.*changes after it"):
        held_values(PiecewiseSignal(ramp.breakpoints, ramp.generators, kind, anchors))
