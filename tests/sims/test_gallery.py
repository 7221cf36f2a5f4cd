"""The entries of the gallery whose package is light, as a user runs them, with a coarse step to keep it short."""

from __future__ import annotations

import importlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import invtrack
from tests.sims.scripts import SIMS, run_script, summary_of


@pytest.fixture
def gallery(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(SIMS)
    return importlib.import_module("gallery")


def test_mechanisms_of_a_package_come_to_a_recording_or_a_right_refusal(tmp_path: Path) -> None:
    says = "standing_hopper was refused: "
    summary = summary_of("gallery", tmp_path, "--package", "gymnasium", timestep=4e-3, says=says)
    cases = summary["cases"]
    refused = {name: case["reason"] for name, case in cases.items() if case["status"] == "refused"}
    assert sorted(refused) == ["pusher", "standing_hopper"]
    assert "contact of table and" in refused["pusher"]  # the object that lies on it
    assert "contact of floor and foot_geom" in refused["standing_hopper"]
    done = {name: case for name, case in cases.items() if name not in refused}
    assert len(done) == 6
    for name, case in done.items():
        assert case["error_share"] < 0.05, name
        assert case["range_share"] < 0.5, name
        assert f"{name}.rrd" in summary["files"]
    assert {name for name, case in done.items() if case["preactuation_time"] > 0.1} == {
        "inverted_pendulum",
        "double_pendulum",
        "cleared_pusher",
    }


@pytest.mark.parametrize(
    ("name", "order"),
    [("reacher", 2), ("cleared_pusher", 2), ("held_hopper", 2), ("double_pendulum", 3)],  # mirrored, a pendulum does the same
)
def test_what_is_left_of_the_error_is_what_a_linear_model_leaves_out(gallery: Any, name: str, order: int) -> None:
    entry = gallery.ENTRIES[name]

    def error(share: float) -> float:
        case = replace(entry, motion=tuple(share * amount for amount in entry.motion)).case()
        result = invtrack.simulate(case.plant, case.controller(), timestep=2e-3, end=entry.duration + 1.0)
        return invtrack.max_error(result)

    assert error(1.0) / error(0.5) == pytest.approx(2.0**order, rel=0.1)


def test_no_file_of_a_package_is_kept_here() -> None:
    assert not [path for path in SIMS.rglob("*") if path.suffix in {".xml", ".stl", ".obj", ".png"}]


def test_a_package_that_is_not_in_the_gallery_or_not_installed(
    tmp_path: Path, gallery: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    finished = run_script("gallery", tmp_path, "--package", "gym")
    assert finished.returncode == 1
    assert "there is no package gym; there are: gymnasium, dm-control" in finished.stderr
    entries = importlib.import_module("mechanisms.entry")
    with pytest.raises(invtrack.InvtrackError, match=r"has no file gymnasium/envs/mujoco/assets/unicycle\.xml"):
        entries.installed_file("gymnasium", "unicycle.xml")
    monkeypatch.setitem(entries.PACKAGES, "no-such-package", "nowhere")
    with pytest.raises(invtrack.InvtrackError, match=r"no-such-package is not installed; pip install '\.\[gallery\]'"):
        entries.installed_file("no-such-package", "unicycle.xml")
