"""What panels over time share: envelopes keep every extremum, intervals meet at the jumps; and what all figures share."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.image import imread

from invtrack.channels import Channels
from invtrack.errors import FileError
from invtrack.figures import save_figure, tracking_figure
from invtrack.figures.lines import envelope
from invtrack.figures.marks import parameter_intervals, within
from invtrack.figures.style import channel_looks, line_looks
from invtrack.results import Signal
from tests.synthetic_runs import JUMP, two_mode_run


def test_parameter_intervals_meet_at_the_jump() -> None:
    run = two_mode_run()
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


def test_a_window_takes_one_sample_more_on_either_side() -> None:
    time = np.arange(10.0)
    assert time[within(time, (2.5, 4.5))].tolist() == [2.0, 3.0, 4.0, 5.0]
    assert time[within(time, (-5.0, 50.0))].tolist() == time.tolist()


def test_thirty_six_lines_look_different_by_colour_and_dashes_alone() -> None:
    for looks in (line_looks(36), channel_looks(36)):
        assert len({(look["color"], look["linestyle"]) for look in looks}) == 36


def test_a_saved_figure_is_the_drawn_one_at_150_dots_per_inch(tmp_path: Path) -> None:
    figure = tracking_figure(two_mode_run())
    path = save_figure(figure, tmp_path / "tracking.png")
    width, height = figure.get_size_inches()
    picture = imread(path)[..., :3]
    assert picture.shape[:2] == (int(height * 150), int(width * 150))
    figure.axes[0].lines[0].set_visible(False)
    without = imread(save_figure(figure, tmp_path / "without.png"))[..., :3]
    assert np.any(picture != without)
    assert sorted(tmp_path.iterdir()) == sorted([path, tmp_path / "without.png"])


def test_a_figure_that_cannot_be_saved_says_so(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="cannot write"):
        save_figure(tracking_figure(two_mode_run()), tmp_path / "missing" / "tracking.png")


def test_drawing_leaves_the_settings_of_matplotlib_alone() -> None:
    before = dict(matplotlib.rcParams)
    tracking_figure(two_mode_run())
    assert dict(matplotlib.rcParams) == before
