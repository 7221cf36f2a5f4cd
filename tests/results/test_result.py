"""Signals and their channels."""

from __future__ import annotations

import numpy as np
import pytest

from invtrack.channels import Channels
from invtrack.errors import ChannelError, InvtrackError
from invtrack.results.result import Signal


def test_a_signal_is_read_by_name() -> None:
    signal = Signal(np.array([[1.0, 2.0]]), Channels(("a", "b"), ("m", "N")))
    assert signal["b"].tolist() == [2.0]
    with pytest.raises(ChannelError, match="no channel is named 'c'; there are: a, b"):
        signal["c"]
    with pytest.raises(InvtrackError, match=r"expected values \(samples, 2\) of a \[m\], b \[N\], got shape \(3, 1\)"):
        Signal(np.zeros((3, 1)), signal.channels)
