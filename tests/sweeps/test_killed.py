"""A sweep that is killed in the middle of writing, and resumed, leaves the file that an undisturbed one leaves, byte for byte."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import invtrack
from tests.sweeps.oscillators import POINTS, swept

PROGRAM = Path(__file__).with_name("oscillators.py")
CHECKOUT = Path(invtrack.__file__).parents[1]


def run(out: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """The program of its own, warnings being errors; whatever it started is gone when it is, also where it hangs."""
    command = [sys.executable, "-W", "error", str(PROGRAM), str(out), *words]
    environment = {**os.environ, "PYTHONPATH": str(CHECKOUT)}
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment, start_new_session=True
    )
    try:
        said, complained = process.communicate(timeout=300)
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    return subprocess.CompletedProcess(command, process.returncode, said, complained)


def only_folder(out: Path) -> Path:
    (folder,) = out.iterdir()
    return folder


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    out = tmp_path_factory.mktemp("undisturbed")
    assert swept(out, workers=2).computed == POINTS
    return (only_folder(out) / "rows.parquet").read_bytes()


@pytest.mark.parametrize("workers", ["threads", "dask"])
def test_a_sweep_killed_as_it_writes_is_resumed_without_losing_or_repeating_a_row(
    undisturbed: bytes, tmp_path: Path, workers: str
) -> None:
    if workers == "dask" and importlib.util.find_spec("distributed") is None:
        pytest.skip("distributed is not installed: pip install 'invtrack[dask]'")
    out = tmp_path / "out"
    killed = run(out, "--on", workers, "--killed-at", "3")
    assert killed.returncode == -signal.SIGKILL, killed.stderr
    folder = only_folder(out)
    parts = list(folder.glob("part-*.parquet"))
    assert len(parts) == 2
    assert len(list(folder.glob(".*.tmp"))) == 1  # what it was writing
    resumed = run(out, "--on", workers, *(("--worker-dies", str(tmp_path / "marker")) if workers == "dask" else ()))
    assert resumed.returncode == 0, resumed.stderr
    assert 0 < int(resumed.stdout) <= POINTS - len(parts)  # rows of the parts are not computed again
    assert [path.name for path in folder.iterdir()] == ["rows.parquet"]
    assert (folder / "rows.parquet").read_bytes() == undisturbed
    assert (tmp_path / "marker").exists() == (workers == "dask")  # a worker died, and its points went to another one
