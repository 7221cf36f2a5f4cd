"""The programs in README and guide run as they stand."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from invtrack.plans.plan import Plan
from invtrack.recording.recording_file import load_recording
from invtrack.results import max_error
from invtrack.results.result import RunResult

CHECKOUT = Path(__file__).parents[1]


def sections(document: str) -> dict[str, list[str]]:
    """The Python blocks under each heading."""
    found: dict[str, list[str]] = {}
    heading = ""
    pieces = re.finditer(
        r"^```(\w*)\n(.*?)^```|^#+ ([^\n]*)$", (CHECKOUT / document).read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    )
    for kind, block, title in (piece.groups() for piece in pieces):
        if title is not None:
            heading = title
        elif kind == "python":
            found.setdefault(heading, []).append(block)
    return found


DOCUMENTS = ("docs/guide.md", "docs/sweeps.md")
GUIDE = [pytest.param(blocks, id=heading) for document in DOCUMENTS for heading, blocks in sections(document).items()]


@pytest.mark.parametrize("blocks", GUIDE)
def test_blocks_under_one_heading_run_one_after_the_other(
    blocks: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for block in blocks:
        exec(compile(block, "document", "exec"), names)
    plans = [value for value in names.values() if isinstance(value, Plan)]
    runs = [value for value in names.values() if isinstance(value, RunResult)]
    assert all(plan.certificate.dynamics_residual < 1e-8 for plan in plans)
    assert all(run.status == "completed" for run in runs)


def test_the_program_of_the_readme_tracks_and_leaves_a_recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    (program,) = sections("README.md")["In a program"]
    exec(compile(program, "README.md", "exec"), names)
    assert max_error(names["result"]) < 1e-5
    (recorded,) = load_recording(tmp_path / "run.rrd").values()
    assert recorded.equals(names["result"])


def test_there_are_programs_to_run() -> None:
    assert len(GUIDE) >= 10


PAGES = ["README.md", "CHANGELOG.md", *(path.relative_to(CHECKOUT).as_posix() for path in sorted((CHECKOUT / "docs").glob("*.md")))]


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_to_files_and_headings_that_are_there(page: str) -> None:
    text = re.sub(r"^```.*?^```", "", (CHECKOUT / page).read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if "://" in target:
            continue
        name, _, heading = target.partition("#")
        linked = (CHECKOUT / page).parent / name if name else CHECKOUT / page
        assert linked.exists(), f"{page}: {target}"
        if heading:
            assert heading in anchors(linked), f"{page}: {target}"


def anchors(path: Path) -> set[str]:
    """The names by which headings of a page are linked to."""
    headings = re.findall(r"^#+ (.*)$", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}
