"""The script as a user runs it, with a coarse step to keep it short."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import invtrack
from tests.sims.scripts import summary_of

WAYS = ("inverse", "linear_inverse", "feedback_only")


def test_only_the_inverse_of_the_motion_carries_the_load_along_its_path(tmp_path: Path) -> None:
    words = [word for way in WAYS for word in ("--case", way)]
    summary = summary_of("slung_load", tmp_path, *words, timestep=4e-3, says="Load on a rope")
    motion, linear, feedback = (summary["cases"][way] for way in WAYS)
    assert motion["error_share"] < 2e-5  # sixteen times that of steps of 1 ms
    assert linear["error_share"] > 0.1
    assert feedback["error_share"] > 0.1
    assert 0.1 < motion["preactuation_time"] < 0.6  # the zero nearest to the axis is 11.6 rad/s
    run = invtrack.load_recording(tmp_path / "inverse.rrd")["inverse"]
    assert np.max(np.abs(run.error)) < 1e-4
    heading = run.output["body:vehicle:yaw"]
    assert heading[-1] == pytest.approx(np.pi / 2, abs=1e-4)
