"""Splines through samples: they interpolate, rest at the ends, converge at their order, and refuse what they cannot follow."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from invtrack.errors import FileError, TrajectoryError
from invtrack.inversion.exact import invert
from invtrack.linear.state_space import StateSpace
from invtrack.references.profiles import rest_to_rest
from invtrack.references.reference_file import load_reference
from invtrack.references.reference_report import reference_report
from invtrack.references.samples import sampled_reference
from invtrack.references.signal import PiecewiseSignal
from tests.cited_plants import cantilever_paper

Array = NDArray[np.float64]

# Degree 13, with more vanishing derivatives at the ends than any of the splines: they can only approach it.
SMOOTH = rest_to_rest([0.0, 1.0], [2.0, -1.0], 6.0, smoothness=6)


def samples(count: int, *, seed: int | None = None) -> tuple[Array, Array]:
    """Times on SMOOTH's span, even or (with a seed) unevenly spread, and its values there."""
    shares = np.ones(count - 1) if seed is None else np.random.default_rng(seed).uniform(0.5, 1.5, count - 1)
    times = 6.0 * np.concatenate([[0.0], np.cumsum(shares) / shares.sum()])
    return times, SMOOTH(times)


def left_limits(signal: PiecewiseSignal, derivative: int = 0) -> Array:
    """At all breakpoints but the first."""
    times = signal.breakpoints
    return signal(times[1:], derivative=derivative, inside=(times[:-1] + times[1:]) / 2)


@settings(max_examples=40, deadline=None)
@given(
    spacings=st.lists(st.floats(0.5, 2.0), min_size=1, max_size=12),
    degree=st.sampled_from([1, 2, 3, 4, 5, 6, 7]),
    start=st.floats(-100.0, 100.0),
    data=st.data(),
)
def test_passes_through_every_sample_from_both_sides(spacings: list[float], degree: int, start: float, data: st.DataObject) -> None:
    times = start + np.concatenate([[0.0], np.cumsum(spacings)])
    values = np.array(data.draw(st.lists(st.floats(-1e3, 1e3), min_size=len(times), max_size=len(times))))
    signal = sampled_reference(times, values, degree=degree)
    if degree % 2:
        assert np.array_equal(signal(times)[:, 0], values)
    near = 1e-9 * max(1.0, np.ptp(values))
    np.testing.assert_allclose(signal(times)[:, 0], values, atol=near)
    np.testing.assert_allclose(left_limits(signal)[:, 0], signal(signal.breakpoints[1:])[:, 0], atol=near)
    np.testing.assert_array_equal(signal([times[0] - 1e3, times[-1] + 1e3])[:, 0], values[[0, -1]])


@pytest.mark.parametrize("degree", [3, 4, 5, 6, 7])
@pytest.mark.parametrize("seed", [None, 1])
def test_derivatives_are_continuous_and_vanish_at_the_ends(degree: int, seed: int | None) -> None:
    times, values = samples(20, seed=seed)
    signal = sampled_reference(times, values + np.random.default_rng(2).standard_normal(values.shape), degree=degree)
    for order in range(1, degree):
        assert np.all(signal.jumps(order)[1:-1] < 1e-9)
    for order in range(1, degree // 2 + 1):
        assert np.all(np.abs(signal(times[0], derivative=order)) == 0)
        assert np.all(np.abs(left_limits(signal, order)[-1]) < 1e-12 * signal.size(order))


@pytest.mark.parametrize("smoothness", [0, 1])
def test_degree_three_is_the_known_cubic_spline(smoothness: int) -> None:
    times, values = samples(15, seed=3)
    oracle = CubicSpline(times, values, bc_type=["natural", "clamped"][smoothness])
    fine = np.linspace(0.0, 5.999, 400)
    signal = sampled_reference(times, values, degree=3, smoothness=smoothness)
    for order in range(3):
        np.testing.assert_allclose(signal(fine, derivative=order), oracle(fine, order), atol=1e-11)


@pytest.mark.parametrize("smoothness", [0, 1, 2, 3])
def test_rests_as_asked_and_no_spline_bends_less(smoothness: int) -> None:
    """The fourth derivative's square has the smallest integral: none of the perturbations that keep samples and rest lowers it."""
    times, values = samples(12, seed=4)
    signal = sampled_reference(times, values, degree=7, smoothness=smoothness)
    nodes, weights = np.polynomial.legendre.leggauss(12)
    middle, half = (times[:-1] + times[1:]) / 2, np.diff(times)[:, None] / 2
    at = (middle[:, None] + half * nodes).ravel()
    bump = np.prod([at - t for t in times], axis=0) * ((at - 0.0) * (at - 6.0)) ** smoothness  # zero at samples, rests at the ends
    coefficients = np.polynomial.Polynomial.fit(at, bump / np.max(np.abs(bump)), len(times) + 2 * smoothness)
    curvature, change = signal(at, derivative=4)[:, 0], coefficients.deriv(4)(at)
    measure = (half * weights).ravel()
    slope = np.sum(measure * curvature * change)
    assert abs(slope) < 1e-6 * np.sqrt(np.sum(measure * curvature**2) * np.sum(measure * change**2))
    for order in range(1, smoothness + 1):
        assert np.all(signal.jumps(order)[[0, -1]] < 1e-9)


def test_two_samples_give_the_rest_to_rest_polynomial() -> None:
    fine = np.linspace(-1.0, 4.0, 101)
    for smoothness in (0, 1, 2, 3):
        signal = sampled_reference([0.5, 2.5], [[1.0, 0.0], [3.0, -2.0]], degree=2 * smoothness + 1)
        exact = rest_to_rest([1.0, 0.0], [3.0, -2.0], 2.0, smoothness=smoothness, start_time=0.5)
        np.testing.assert_allclose(signal(fine), exact(fine), atol=1e-14)


@pytest.mark.parametrize(
    ("degree", "counts"),
    [
        (1, (24, 48, 96)),
        (2, (24, 48, 96)),
        (3, (24, 48, 96)),
        (4, (24, 48, 96)),
        (5, (24, 48, 96)),
        (6, (24, 36, 54)),
        (7, (24, 36, 54)),
    ],
)
@pytest.mark.parametrize("seed", [None, 5])
def test_error_falls_with_the_power_of_the_spacing(degree: int, counts: tuple[int, ...], seed: int | None) -> None:
    fine = np.linspace(0.0, 6.0, 2001)
    errors, spacings = [], []
    for count in counts:
        times, _ = samples(count, seed=seed)
        signal = sampled_reference(times, np.sin(np.pi * times / 6.0) ** 8, degree=degree)
        errors.append(np.max(np.abs(signal(fine)[:, 0] - np.sin(np.pi * fine / 6.0) ** 8)))
        spacings.append(np.max(np.diff(times)))
    slope = np.polyfit(np.log(spacings), np.log(errors), 1)[0]
    assert slope > degree + 1 - 0.4


def test_shift_and_scale_of_time_and_values_change_nothing_else() -> None:
    times, values = samples(30, seed=6)
    fine = np.linspace(0.0, 6.0, 301)[1:-1]  # at the ends rounding decides the side
    plain = sampled_reference(times, values)
    moved = sampled_reference(1e-4 * times + 0.25, 1e6 * values + 3e6)
    for order in range(4):
        expected = plain(fine, derivative=order) * 1e6 * 1e4**order + (3e6 if order == 0 else 0.0)
        np.testing.assert_allclose(moved(1e-4 * fine + 0.25, derivative=order), expected, atol=1e-6 * np.max(np.abs(expected)))


def test_inverse_of_samples_approaches_the_exact_inverse() -> None:
    plant = StateSpace(*cantilever_paper(0.0))  # relative degree 2
    exact_reference = rest_to_rest(0.0, 2.0, 6.0, smoothness=6)
    exact = invert(plant, exact_reference)
    fine = np.linspace(-5.0, 10.0, 300)
    errors = []
    for count in (10, 19, 37):
        times = np.linspace(0.0, 6.0, count)
        sampled = invert(plant, sampled_reference(times, exact_reference(times)))
        assert sampled.certificate.output_error < 1e-9
        errors.append(np.max(np.abs(sampled(fine).u - exact(fine).u)))
    assert errors[-1] < 1e-3 * np.max(np.abs(exact(fine).u))
    assert np.all(np.log2(np.divide(errors[:-1], errors[1:])) > 5 + 1 - 2 - 0.5)


def test_a_hundred_thousand_samples_keep_their_continuity() -> None:
    times, values = samples(100_000)
    signal = sampled_reference(times, values[:, :1], degree=7)
    assert np.array_equal(signal(times), values[:, :1])
    report = reference_report(signal, highest=4)
    assert report.continuous == (4,)  # the fourth derivative starts with a jump
    assert report.first_rough(0) == 4  # and consists of rounding, 1e-16 / spacing^4 = 8; of the third one that is 1e-3


@pytest.mark.parametrize(
    ("times", "values", "options", "message"),
    [
        ([0.0, 1.0, 1.0], [0.0, 1.0, 2.0], {}, r"sample 2: expected times that increase, got 1 s after 1 s"),
        ([0.0, 2.0, 1.0], [0.0, 1.0, 2.0], {}, r"sample 2"),
        ([0.0, 1.0], [0.0, np.nan], {}, r"sample 1 has a value that is not finite"),
        ([0.0, np.inf], [0.0, 1.0], {}, r"sample 1 has a time that is not finite"),
        ([0.0, 1.0, 2.0], [0.0, 1.0], {}, r"got shapes \(3,\) and \(2,\)"),
        ([[0.0, 1.0]], [[0.0, 1.0]], {}, r"expected times \(m,\)"),
        ([0.0, 1.0], ["a", "b"], {}, r"values of the samples must be real numbers"),
        ([0.0, 1.0], [0.0, 1j], {}, r"values of the samples must be real numbers"),
        ([0.0, 1.0], [0.0, 1.0], {"smoothness": 3}, r"smoothness for degree 5 must be a whole number from 0 to 2, got 3"),
        ([0.0], [0.0], {}, r"at least 2 samples for a spline of degree 5"),
        ([], [], {}, r"at least 2 samples"),
        ([0.0, 1.0, 2.0], [0.0, 1.0, 2.0], {"degree": 7, "smoothness": 0}, r"at least 4 samples .* got 3"),
    ],
)
def test_refuses_samples_without_a_spline(times: Any, values: Any, options: dict[str, int], message: str) -> None:
    with pytest.raises(TrajectoryError, match=message):
        sampled_reference(times, values, **options)


def test_refuses_samples_that_lie_too_unevenly() -> None:
    times = np.cumsum(np.concatenate([[0.0], 10.0 ** np.linspace(-9, 0, 12)]))
    for degree in (5, 7):
        with pytest.raises(TrajectoryError, match=r"magnifies rounding .* the largest spacing is 1\.0e\+09 times the smallest"):
            sampled_reference(times, np.sin(times), degree=degree)
    assert np.max(np.abs(sampled_reference(times, np.sin(times), degree=1)(np.linspace(0.0, times[-1], 500)))) <= 1.0


def write(folder: Path, text: str) -> Path:
    path = folder / "motion.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_file_gives_the_reference_of_its_columns(tmp_path: Path) -> None:
    times, values = samples(20, seed=7)
    rows = [f"{t!r},note,{b!r},{a!r}" for t, (a, b) in zip(times.tolist(), values.tolist(), strict=True)]
    text = "\n".join(["# measured", '"time [s]",remark,"second, turned [rad]",first [m]', rows[0], "", "# pause", *rows[1:]])
    signal = load_reference(write(tmp_path, "\ufeff" + text), channels=["first", "second, turned [rad]"], degree=3)
    expected = sampled_reference(times, values, degree=3)
    assert np.array_equal(signal.breakpoints, expected.breakpoints)
    assert np.array_equal(signal.anchors, expected.anchors)


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        ("", {}, r"motion\.csv is empty; expected a header row"),
        ("# only a comment\n", {}, r"is empty"),
        ("time,y\n", {}, r"no rows of numbers"),
        ("time,y\n0,0\n1\n", {}, r"line 3: expected 2 cells as in the header row, got 1"),
        ("time,y\n0,0\n1,2,3\n", {}, r"line 3: expected 2 cells .* got 3"),
        ("time,y\n0,0\n# note\n\n1,nan\n", {}, r"line 5, column 'y': expected a finite number, got 'nan'"),
        ("time,y\n0,\n1,1\n", {}, r"line 2, column 'y': .* got ''"),
        ("time,y\n0,fast\n1,1\n", {}, r"line 2, column 'y': .* got 'fast'"),
        ("time,y\n0,0\n# note\n2,1\n2,3\n", {}, r"line 5: expected times that increase, got 2 s after 2 s"),
        ("time,y\n0,0\n1,1\n", {"time": "t"}, r"no column named 't'; its columns are: time, y"),
        ("time,y\n0,0\n1,1\n", {"channels": ["z"]}, r"no column named 'z'; its columns are: time, y"),
        ("time,y [m],y [rad]\n0,0,0\n1,1,1\n", {"channels": ["y"]}, r"2 columns named 'y'"),
        ("time,y\n0,0\n1,1\n", {"channels": []}, r"at least one column of values"),
        ("time,y,y\n0,0,0\n", {}, r"names a column twice"),
        ("time [fortnights],y\n0,0\n1,1\n", {}, r"expected the column 'time \[fortnights\]' in \[s\]"),
        ("when,y\n0,0\n1,1\n", {}, r"no column, or more than one, named 'time' or 't'; say which .* columns are: when, y"),
        ("0,0\n1,1\n", {"channels": ["a", "b"]}, r"no header row, so its 1 column\(s\) .* expected 2, for a, b"),
        ("0,0\n1,1\n", {"time": "time"}, r"no header row, so none named 'time'; leave `time` out"),
        ("0,0\n1,1,2\n", {}, r"line 2: expected 2 cells as in the first row, got 3"),
        ("t;y\n0,5;0\n1.5;1\n", {}, r"line 3: expected one decimal sign throughout, got a comma in line 2 and a point in line 3"),
        ("t;y\n1,000;0\n2,000;1\n", {}, r"line 2: a comma there may be the decimal sign or set off thousands"),
        ("t;y\n0;1,000,000\n1;0,5\n", {}, r"line 2, column 'y': expected a finite number, got '1,000,000'"),
        ("t;y\n0;0\n1\n", {}, r"line 3: expected 2 cells as in the header row, got 1"),
        ("time,y\n0,0\n1,1\n", {"degree": 7, "smoothness": 0}, r"motion\.csv: expected at least 4 samples"),
        ('time,y\n"0,5",1\n1,"2\n', {}, r"motion\.csv, line 2, column 'time': .* got '0,5'"),
    ],
)
def test_a_bad_file_is_refused_with_its_line(tmp_path: Path, text: str, options: dict[str, Any], message: str) -> None:
    with pytest.raises(FileError, match=message):
        load_reference(write(tmp_path, text), **options)


def test_files_that_are_no_text_or_not_there_are_refused(tmp_path: Path) -> None:
    (tmp_path / "binary.csv").write_bytes(b"time,y\n\xff\xfe\x00\n")
    with pytest.raises(FileError, match=r"binary\.csv is not a CSV file in UTF-8"):
        load_reference(tmp_path / "binary.csv")
    with pytest.raises(FileError, match=r"cannot read .*absent\.csv: No such file"):
        load_reference(tmp_path / "absent.csv")
