"""Thinning a run for a recording."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from invtrack.channels import Channels
from invtrack.errors import ChannelError, InvtrackError
from invtrack.results.result import Signal
from tests.synthetic_runs import two_mode_run


def test_thinning_keeps_events_changes_and_the_ends() -> None:
    run = two_mode_run()
    thin = run.thinned(10)
    assert len(run.time) / 10 <= len(thin.time) < len(run.time) / 5
    assert set(thin.time) <= set(run.time)
    assert (thin.time[0], thin.time[-1]) == (run.time[0], run.time[-1])
    changed = np.flatnonzero(np.diff(run.parameters.values[:, 0])) + 1
    assert set(run.time[changed]) <= set(thin.time)
    assert np.array_equal(np.unique(thin.parameters.values), np.unique(run.parameters.values))
    rows = np.searchsorted(run.time, thin.time)
    assert np.array_equal(thin.output.values, run.output.values[rows])
    assert np.array_equal(thin.applied.values, run.applied.values[rows[:-1]])


def test_thinning_by_one_changes_nothing() -> None:
    run = two_mode_run()
    assert run.thinned(1).equals(run)


def test_thinning_by_less_is_refused() -> None:
    with pytest.raises(InvtrackError, match="every 1st, 2nd"):
        two_mode_run().thinned(0)


def test_a_signal_is_read_by_name() -> None:
    signal = Signal(np.array([[1.0, 2.0]]), Channels(("a", "b"), ("m", "N")))
    assert signal["b"].tolist() == [2.0]
    with pytest.raises(ChannelError, match="no channel is named 'c'; there are: a, b"):
        signal["c"]
    with pytest.raises(InvtrackError, match=r"expected values \(samples, 2\) of a \[m\], b \[N\], got shape \(3, 1\)"):
        Signal(np.zeros((3, 1)), signal.channels)


def test_a_run_without_parameters_is_thinned_alike() -> None:
    run = two_mode_run()
    bare = replace(run, parameters=Signal(np.zeros((len(run.time) - 1, 0)), Channels()), parameter_bodies={})
    thin = bare.thinned(10)
    assert len(thin.parameters.values) == len(thin.time) - 1
