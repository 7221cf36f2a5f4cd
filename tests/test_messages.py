"""What messages and docstrings tell a user to call exists."""

from __future__ import annotations

import ast
import importlib
import re
from pathlib import Path

import pytest

import invtrack

PACKAGE = Path(invtrack.__file__).parent
NAMED = re.compile(r"\binvtrack((?:\.[A-Za-z_]\w*)+)")


def named_in(source: str) -> set[str]:
    """Dotted names that begin with invtrack in the text of a module's strings."""
    strings = (node.value for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Constant) and isinstance(node.value, str))
    return {f"invtrack{name}" for text in strings for name in NAMED.findall(text)}


def exists(name: str) -> bool:
    parts = name.split(".")
    for length in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:length]))
        except ModuleNotFoundError:
            continue
        for part in parts[length:]:
            if not hasattr(found, part):
                return False
            found = getattr(found, part)
        return True
    return False


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_calls_that_texts_name_exist(path: Path) -> None:
    missing = sorted(name for name in named_in(path.read_text(encoding="utf-8")) if not exists(name))
    assert not missing


def test_a_call_that_does_not_exist_is_seen() -> None:
    assert named_in('"""Use invtrack.invert or invtrack.inverted."""') == {"invtrack.invert", "invtrack.inverted"}
    assert exists("invtrack.redesign.prefilter")
    assert not exists("invtrack.inverted")
