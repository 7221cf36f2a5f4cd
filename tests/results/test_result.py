"""Signals and their channels."""

from __future__ import annotations

import sys

import numpy as np
import pytest

import invtrack
from invtrack.channels import Channels
from invtrack.errors import ChannelError, InvtrackError
from invtrack.frames import data_frame
from invtrack.results.result import Signal


def test_a_signal_is_read_by_name() -> None:
    signal = Signal(np.array([[1.0, 2.0]]), Channels(("a", "b"), ("m", "N")))
    assert signal["b"].tolist() == [2.0]
    with pytest.raises(ChannelError, match="no channel is named 'c'; there are: a, b"):
        signal["c"]
    with pytest.raises(InvtrackError, match=r"expected values \(samples, 2\) of a \[m\], b \[N\], got shape \(3, 1\)"):
        Signal(np.zeros((3, 1)), signal.channels)


def test_a_run_as_a_data_frame_has_every_signal_at_every_time() -> None:
    model = invtrack.StateSpace([[0.0, 1.0], [-9.0, -2.0]], [[0.0], [9.0]], [[1.0, 0.0]])
    plan = invtrack.invert(model, invtrack.rest_to_rest(0.0, 0.2, 1.0, smoothness=3))
    run = invtrack.simulate(invtrack.LinearPlant(model), invtrack.TrackingController(plan), timestep=1e-2)
    frame = run.to_pandas()
    assert frame.index.name == "time [s]"
    assert np.array_equal(frame.index, run.time)
    for kind, signal in (("y", run.output), ("u", run.applied), ("x", run.state)):
        for label, values in zip(signal.channels.labels, signal.values.T, strict=True):
            assert np.array_equal(frame[f"{kind}.{label}"][: len(values)], values)
            assert np.all(np.isnan(frame[f"{kind}.{label}"][len(values) :]))
    sampled = invtrack.plans.sampled_plan(plan, rate=50.0)
    assert np.array_equal(sampled.to_pandas()["u_ff.u1"], sampled.u_ff[:, 0])


def test_without_pandas_it_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(InvtrackError, match="pip install pandas"):
        data_frame({"a": [1.0]}, index=[0.0], index_name="time [s]")
