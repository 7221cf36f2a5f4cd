"""Figures show what a run holds: labels, units, marks, and every extremum of long signals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure
from matplotlib.image import imread

from invtrack.channels import Channels
from invtrack.errors import FileError, InvtrackError
from invtrack.figures.comparison import comparison_figure
from invtrack.figures.panels import envelope, parameter_intervals
from invtrack.figures.preactuation_figure import preactuation_figure
from invtrack.figures.style import save_figure
from invtrack.figures.tracking import tracking_figure
from invtrack.results.result import RunResult, Signal
from tests.synthetic_runs import JUMP, MANOEUVRE, TwoModes, diverged, two_mode_run


def texts(figure: Figure) -> str:
    return "\n".join(artist.get_text() for artist in figure.findobj(matplotlib.text.Text))


@pytest.fixture(scope="module")
def run() -> RunResult:
    return two_mode_run(modes=TwoModes(slow=1e-3, fast=2e-4))


def test_every_axis_has_its_unit(run: RunResult) -> None:
    for figure in (tracking_figure(run), preactuation_figure(run, preactuation_time=0.5), comparison_figure([run])):
        assert figure.axes
        for axes in figure.axes:
            assert axes.get_ylabel().endswith("]")
        assert "time [s]" in texts(figure)


def test_tracking_figure_names_states_parameters_and_the_manoeuvre(run: RunResult) -> None:
    shown = texts(tracking_figure(run)).replace("\n100 kg", " = 100 kg")
    for expected in (*run.state.channels.names, "tip_mass = 100 kg", "$T_i$", "$T_f$", "reference"):
        assert expected in shown


def test_parameter_intervals_meet_at_the_jump(run: RunResult) -> None:
    assert parameter_intervals(run) == [
        (run.time[0], pytest.approx(JUMP), "tip_mass = 0 kg"),
        (pytest.approx(JUMP), run.time[-1], "tip_mass = 100 kg"),
    ]
    assert len(parameter_intervals(two_mode_run(tip_masses=(5.0, 5.0)))) == 1
    assert parameter_intervals(replace(run, parameters=Signal(np.zeros((len(run.time) - 1, 0)), Channels()))) == []


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 3000), bins=st.integers(1, 50))
def test_an_envelope_keeps_ends_and_extrema(seed: int, count: int, bins: int) -> None:
    values = np.random.default_rng(seed).standard_normal(count)
    time = np.arange(float(count))
    thin_time, thin = envelope(time, values, bins=bins)
    assert len(thin) <= max(4 * bins, 1)
    assert np.all(np.diff(thin_time) > 0)
    np.testing.assert_array_equal(thin, values[thin_time.astype(int)])
    assert (thin.min(), thin.max()) == (values.min(), values.max())
    assert (thin_time[0], thin_time[-1]) == (0, count - 1)


def test_an_envelope_sees_a_single_spike_among_gaps() -> None:
    values = np.full(10_000, np.nan)
    values[7_777] = 3.0
    assert 3.0 in envelope(np.arange(10_000.0), values, bins=10)[1]


def test_an_error_of_exactly_zero_is_said_to_be_so(run: RunResult, tmp_path: Path) -> None:
    perfect = replace(run, output=run.reference)
    assert "exactly zero" in texts(tracking_figure(perfect))
    assert "exactly zero" in texts(comparison_figure([perfect, perfect]))
    save_figure(comparison_figure([perfect, run]), tmp_path / "mixed.png")
    silent = replace(run, applied=replace(run.applied, values=np.zeros_like(run.applied.values)))
    assert "exactly zero" in texts(preactuation_figure(silent, preactuation_time=0.0))


def test_a_diverged_run_can_be_drawn(run: RunResult, tmp_path: Path) -> None:
    for amplitude in (1e6, 1e200):
        broken = diverged(run, at=5.0, amplitude=amplitude)
        for figure in (
            tracking_figure(broken),
            comparison_figure([run, broken]),
            preactuation_figure(broken, preactuation_time=0.0),
        ):
            picture = imread(save_figure(figure, tmp_path / "diverged.png"))
            assert np.std(picture[..., :3]) > 0.01  # not a blank page


def test_png_is_whole_and_at_150_dots_per_inch(run: RunResult, tmp_path: Path) -> None:
    figure = preactuation_figure(run, preactuation_time=0.5)
    path = save_figure(figure, tmp_path / "preactuation.png")
    width, height = figure.get_size_inches()
    assert imread(path).shape[:2] == (int(height * 150), int(width * 150))
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(FileError, match="cannot write"):
        save_figure(figure, tmp_path / "missing" / "preactuation.png")


def test_drawing_leaves_the_settings_of_matplotlib_alone(run: RunResult) -> None:
    before = dict(matplotlib.rcParams)
    tracking_figure(run)
    assert dict(matplotlib.rcParams) == before


def test_windows_and_runs_that_do_not_fit_are_refused(run: RunResult) -> None:
    for window in ((3.0, 3.0), (20.0, 30.0), (5.0, 1.0), (float("nan"), 1.0)):
        with pytest.raises(InvtrackError, match="cannot show the times"):
            tracking_figure(run, window=window)
    with pytest.raises(InvtrackError, match="at least one run"):
        comparison_figure([])
    other = replace(run, name="rig", applied=replace(run.applied, channels=Channels(run.applied.channels.names, ["N m"])))
    with pytest.raises(InvtrackError, match=r"'rig' has the applied channels base_force \[N m\], expected .* \[N\]"):
        comparison_figure([run, other])


def test_the_default_window_is_the_manoeuvre_with_its_surroundings(run: RunResult) -> None:
    start, end = MANOEUVRE
    low, high = tracking_figure(run).axes[0].get_xlim()
    assert (low, high) == (2 * start - end, 2 * end - start)
    low, high = tracking_figure(two_mode_run(start=-1.0, end=5.0)).axes[0].get_xlim()
    assert (low, high) == (-1.0, 5.0)
