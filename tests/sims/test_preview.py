"""The script as a user runs it, two preview times of one machine with a coarse step to keep it short."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.sims.scripts import summary_of


def test_errors_stay_below_the_bound_and_fall_with_the_preview(tmp_path: Path) -> None:
    case = ("--case", "two_disc_redesign_over_preview", "--ahead", "5", "--ahead", "20")
    summary = summary_of("preview", tmp_path, *case, timestep=0.02, says="largest error over preview")
    near, far = summary["two_disc_redesign_over_preview"]
    for row in (near, far):
        assert 0 < row["measured"] < row["bound"]
    assert far["bound"] / near["bound"] < 2 * np.exp(-15.0 * far["rate"])
    assert far["measured"] < 0.1 * near["measured"]
