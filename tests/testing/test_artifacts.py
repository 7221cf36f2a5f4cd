"""What is kept of runs: of any run, under names that tell tests apart, once."""

from __future__ import annotations

from pathlib import Path

import invtrack
from invtrack.testing import Artifacts
from tests.synthetic_runs import diverged, two_mode_run


def test_a_run_is_kept_once_and_reads_back(tmp_path: Path) -> None:
    artifacts, run = Artifacts(tmp_path / "kept"), two_mode_run()
    kept = artifacts.keep(run, "tests/test_a.py::test[x/y]")
    assert artifacts.keep(run, "tests/test_b.py::test") == kept
    assert sorted(kept) == ["figure", "recording"]
    assert invtrack.load_recording(kept["recording"])["exact"].equals(run)
    assert Path(kept["figure"]).read_bytes().startswith(b"\x89PNG")
    other = artifacts.keep(two_mode_run(), "other/test_a.py::test[x/y]")
    assert Path(other["recording"]).parent != Path(kept["recording"]).parent
    assert Path(other["recording"]).parent.name.startswith("test_a.py-test-x-y")


def test_a_run_that_diverged_is_kept_too(tmp_path: Path) -> None:
    kept = Artifacts(tmp_path).keep(diverged(two_mode_run(), at=5.0), "test_a.py::test")
    assert all(Path(path).is_file() for path in kept.values()), kept


def test_what_is_discarded_is_that_test_s_alone(tmp_path: Path) -> None:
    artifacts = Artifacts(tmp_path)
    first, second = (artifacts.keep(two_mode_run(name), f"test_a.py::test_{name}") for name in ("one", "two"))
    artifacts.discard("test_a.py::test_one")
    artifacts.discard("test_a.py::test_three")
    assert not Path(first["recording"]).parent.exists()
    assert Path(second["recording"]).is_file()
