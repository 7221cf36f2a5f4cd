"""Least-squares splines within a band: what they reproduce, how much noise they leave, and what they refuse."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.interpolate

from invtrack.errors import TrajectoryError
from invtrack.references import smoothed_reference

TIMES = np.sort(np.concatenate([np.linspace(-1.0, 9.0, 2001), np.random.default_rng(3).uniform(-1.0, 9.0, 300)]))


def tied_spline(degree: int, pieces: int, smoothness: int, seed: int) -> scipy.interpolate.BSpline:
    """A random spline of even pieces over the times, `smoothness` derivatives vanishing at its ends."""
    edges = np.linspace(TIMES[0], TIMES[-1], pieces + 1)
    knots = np.concatenate([np.full(degree, edges[0]), edges, np.full(degree, edges[-1])])
    c = np.random.default_rng(seed).standard_normal((len(knots) - degree - 1, 2))
    c[: smoothness + 1], c[len(c) - smoothness - 1 :] = c[0], c[-1]
    return scipy.interpolate.BSpline(knots, c, degree)


@pytest.mark.parametrize(("degree", "pieces", "smoothness"), [(7, 30, 6), (3, 12, 1), (5, 1, 2), (1, 20, 0)])
def test_a_spline_of_the_space_is_reproduced(degree: int, pieces: int, smoothness: int) -> None:
    spline = tied_spline(degree, pieces, smoothness, seed=degree)
    band = pieces * np.pi / (TIMES[-1] - TIMES[0])
    found = smoothed_reference(TIMES, spline(TIMES), band=band, degree=degree, smoothness=smoothness)
    assert np.max(np.abs(found(TIMES) - spline(TIMES))) < 1e-10
    inside = np.linspace(TIMES[0] + 1e-3, TIMES[-1] - 1e-3, 77)
    third = min(3, degree - 1)
    assert found(inside, derivative=third) == pytest.approx(spline(inside, nu=third), abs=1e-6 * band**third)
    assert found(-5.0) == pytest.approx(spline(TIMES[0]), abs=1e-10)
    assert found(50.0) == pytest.approx(spline(TIMES[-1]), abs=1e-10)


def test_nothing_of_the_space_is_nearer() -> None:
    rng = np.random.default_rng(1)
    samples = np.sign(np.sin(TIMES))[:, np.newaxis] + 0.1 * rng.standard_normal((len(TIMES), 1))
    found = smoothed_reference(TIMES, samples, band=12 * np.pi / (TIMES[-1] - TIMES[0]), degree=5)
    left = samples - found(TIMES)
    for seed in range(5):
        other = tied_spline(5, 12, 4, seed)(TIMES)[:, :1]
        assert abs(np.sum(left * other)) < 1e-10 * np.linalg.norm(left) * np.linalg.norm(other)


def test_ends_are_at_rest_and_a_known_start_is_kept() -> None:
    samples = 3.0 + np.cos(TIMES)
    found = smoothed_reference(TIMES, samples, band=6.0, start=[4.0])
    assert found(-1.0) == found(-9.0) == 4.0
    for order in range(1, 7):
        left, right = found.sides(order)
        assert left[0] == right[-1] == 0.0
        assert np.max(found.jumps(order)) < 1e-9
    free = smoothed_reference(TIMES, samples, band=6.0)
    assert np.linalg.norm(free(TIMES)[:, 0] - samples) < np.linalg.norm(found(TIMES)[:, 0] - samples)


def test_noise_is_averaged_over_each_piece() -> None:
    times = np.linspace(0.0, 10.0, 20_001)
    noise = np.random.default_rng(0).standard_normal((len(times), 20))
    left = smoothed_reference(times, noise, band=40 * np.pi / 10.0)(times)
    unknowns = 40 + 7 - 2 * 6
    assert np.mean(left**2) == pytest.approx(unknowns / len(times), rel=0.1)  # the trace of a projection


@pytest.mark.parametrize(
    ("times", "options", "says"),
    [
        (TIMES, {"band": 0.0}, "band must be a positive number"),
        (TIMES, {"band": np.inf}, "band must be a positive number"),
        (TIMES, {"band": 1e4}, "too many for 2301 samples"),
        (TIMES[::-1], {"band": 1.0}, "expected times that increase"),
        (TIMES, {"band": 1.0, "degree": 3, "smoothness": 3}, "smoothness"),
        (TIMES, {"band": 1.0, "start": [0.0, 1.0]}, "start must be finite, one number for each"),
        (np.r_[np.linspace(0, 1, 400), 10.0], {"band": 10.0}, "some have too few samples"),
    ],
)
def test_what_cannot_be_fitted_is_refused(times: np.ndarray, options: dict[str, object], says: str) -> None:
    with pytest.raises(TrajectoryError, match=says):
        smoothed_reference(times, np.zeros(len(times)), **options)  # type: ignore[arg-type]
