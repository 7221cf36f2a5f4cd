"""`invtrack view`: one recording as it is, several as one whose cases stand side by side."""

from __future__ import annotations

import dataclasses
import subprocess
from pathlib import Path
from typing import Any

import pytest

from invtrack.command.view import View
from invtrack.recording import load_recording, save_recording
from tests.synthetic_runs import two_mode_run


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, list[str]]]:
    """For each start of the viewer the cases of each recording that it is given."""
    starts: list[dict[str, list[str]]] = []

    def run(command: list[str], **_: Any) -> subprocess.CompletedProcess[str]:
        starts.append({path: list(load_recording(path)) for path in command if path.endswith(".rrd")})
        return subprocess.CompletedProcess(command, 0)

    monkeypatch.setattr(subprocess, "run", run)
    return starts


def test_several_recordings_open_as_one_and_apart_as_they_are(tmp_path: Path, shown: list[dict[str, list[str]]]) -> None:
    run = two_mode_run(start=-1.0, end=5.0)
    paths = [save_recording(dataclasses.replace(run, name=name), tmp_path / f"{name}.rrd") for name in ("one", "two")]
    assert View(runs=(tmp_path,)).execute() == 0
    assert View(runs=(tmp_path,), apart=True).execute() == 0
    assert View(runs=(paths[0],)).execute() == 0
    (together,) = shown[0].items()
    assert together[1] == ["one", "two"]
    assert not Path(together[0]).exists()
    assert shown[1:] == [{str(paths[0]): ["one"], str(paths[1]): ["two"]}, {str(paths[0]): ["one"]}]
