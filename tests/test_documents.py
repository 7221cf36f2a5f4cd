"""The programs in README and guide run as they stand."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

CHECKOUT = Path(__file__).parents[1]


def sections(document: str) -> dict[str, list[str]]:
    """The Python blocks under each heading."""
    found: dict[str, list[str]] = {}
    for part in re.split(r"^#+ ", (CHECKOUT / document).read_text(encoding="utf-8"), flags=re.MULTILINE):
        blocks = re.findall(r"^```python\n(.*?)^```", part, flags=re.MULTILINE | re.DOTALL)
        if blocks:
            found[part.partition("\n")[0]] = blocks
    return found


PROGRAMS = [
    pytest.param(blocks, id=f"{document}: {heading}")
    for document in ("README.md", "docs/guide.md")
    for heading, blocks in sections(document).items()
]


@pytest.mark.parametrize("blocks", PROGRAMS)
def test_blocks_under_one_heading_run_one_after_the_other(
    blocks: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for block in blocks:
        exec(compile(block, "document", "exec"), names)


def test_there_are_programs_to_run() -> None:
    assert len(PROGRAMS) >= 10
