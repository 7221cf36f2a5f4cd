"""Docstrings of this package are plain text: what Markdown would take for its own in them is shown as it stands."""

from __future__ import annotations

import re
from typing import Any

import griffe

MARKUP = re.compile(r"(`[^`]*`)|([\\*_\[\]<$])")


class PlainText(griffe.Extension):
    """Escapes asterisks, brackets and the like in all docstrings, but for code and for what is indented, which is shown as code."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Called with each object of the package once it is loaded."""
        if obj.docstring is not None:
            obj.docstring.value = escaped(obj.docstring.value)


def escaped(text: str) -> str:
    """The text, of which Markdown makes what a terminal shows."""
    blocks = re.split(r"(\n\s*\n)", text)
    return "".join(block if block.startswith("    ") else MARKUP.sub(_escape, block) for block in blocks)


def _escape(found: re.Match[str]) -> str:
    code, sign = found.groups()
    return code or ("&lt;" if sign == "<" else f"\\{sign}")
