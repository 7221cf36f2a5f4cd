"""The programs in README and in the pages of docs/ run as they stand, and links lead somewhere."""

from __future__ import annotations

import re
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from invtrack.plans.plan import Plan
from invtrack.recording.recording_file import load_recording
from invtrack.results import max_error
from invtrack.results.result import RunResult

CHECKOUT = Path(__file__).parents[1]
PLUGIN = () if entry_points(group="pytest11", name="invtrack") else ("-p", "invtrack.testing.plugin")
WRITTEN = [CHECKOUT / "README.md", CHECKOUT / "CHANGELOG.md", *sorted((CHECKOUT / "docs").rglob("*.md"))]
PAGES = [path.relative_to(CHECKOUT).as_posix() for path in WRITTEN]


class Block(NamedTuple):
    """A fenced block: its language, the name of the file that it is, "" for none, and its text."""

    language: str
    file: str
    text: str


def blocks(page: str) -> list[Block]:
    text = (CHECKOUT / page).read_text(encoding="utf-8")
    return [Block(*found) for found in re.findall(r'^```(\w+)(?: title="([^"\n]+)")?\n(.*?)^```', text, re.MULTILINE | re.DOTALL)]


def programs(page: str) -> list[Block]:
    """Blocks of Python that belong to no file; what is only to be looked at is fenced as `py`."""
    return [block for block in blocks(page) if block.language == "python" and not block.file]


def in_a_folder(page: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Go to a folder that has the page's files."""
    monkeypatch.chdir(folder)
    for block in blocks(page):
        if block.file:
            (folder / block.file).write_text(block.text, encoding="utf-8")


RUNNING = [page for page in PAGES if page != "README.md" and programs(page)]


@pytest.mark.parametrize("page", RUNNING)
def test_programs_of_a_page_run_one_after_the_other(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    in_a_folder(page, tmp_path, monkeypatch)
    names: dict[str, Any] = {}
    for block in programs(page):
        exec(compile(block.text, page, "exec"), names)
    plans = [value for value in names.values() if isinstance(value, Plan)]
    runs = [value for value in names.values() if isinstance(value, RunResult)]
    assert all(plan.certificate.dynamics_residual < 1e-8 for plan in plans)
    assert all(run.status == "completed" for run in runs)


def test_there_are_programs_to_run() -> None:
    assert len(RUNNING) >= 20


def test_the_program_of_the_readme_tracks_and_leaves_a_recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    (program,) = programs("README.md")
    exec(compile(program.text, "README.md", "exec"), names)
    assert max_error(names["result"]) < 1e-5
    (recorded,) = load_recording(tmp_path / "run.rrd").values()
    assert recorded.equals(names["result"])


def test_tests_that_a_page_shows_pass(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> None:
    page = "docs/guide/testing.md"
    in_a_folder(page, pytester.path, monkeypatch)
    pytester.runpytest_subprocess("-p", "no:xdist", *PLUGIN, "test_arm.py").assert_outcomes(passed=5)


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_to_files_and_headings_that_are_there(page: str) -> None:
    text = re.sub(r"^```.*?^```", "", (CHECKOUT / page).read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if "://" in target:
            continue
        name, _, heading = target.partition("#")
        linked = (CHECKOUT / page).parent / name if name else CHECKOUT / page
        if linked.resolve() == (CHECKOUT / "docs/api/index.md").resolve():  # made with the site, of the package's docstrings
            continue
        assert linked.exists(), f"{page}: {target}"
        if heading:
            assert heading in anchors(linked), f"{page}: {target}"


def anchors(path: Path) -> set[str]:
    """The names by which headings of a page are linked to."""
    text = re.sub(r"^```.*?^```", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    headings = re.findall(r"^#+ (.*)$", text, flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}
