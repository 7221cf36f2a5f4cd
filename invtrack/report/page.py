"""The page that all reports are: sections of escaped text, tables and figures, with its style inside and nothing fetched."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any, Literal

from invtrack.studies.table import Column, Rows, short_number

STYLE = Path(__file__).with_name("page.css")

POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
"""What a browser may fetch for the page: nothing."""


@dataclass(frozen=True)
class Verdict:
    """What a reader sees first.

    Args:
        good: True, False, or None where there is nothing to judge.
        headline: in a few words.
        why: in a sentence or two.
    """

    good: bool | None
    headline: str
    why: str


def page(title: str, kicker: str, verdict: Verdict, sections: Iterable[str]) -> str:
    """The whole page. `kicker`: small, above the title. Sections are HTML, everything else is text."""
    kind = {True: " good", False: " bad", None: ""}[verdict.good]
    return f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{escape(POLICY)}">
<link rel="icon" href="data:,">
<title>{escape(title)}</title>
<style>
{STYLE.read_text(encoding="utf-8")}</style>
</head>
<body>
<main>
<header><p>{escape(kicker)}</p><h1>{escape(title)}</h1></header>
<section class="verdict{kind}"><strong>{escape(verdict.headline)}</strong><p>{escape(verdict.why)}</p></section>
{"".join(sections)}
</main>
</body>
</html>
"""


def numbers(entries: Mapping[str, tuple[float | None, str]]) -> str:
    """A row of large numbers: value and unit by their names; a dash for one that is not defined."""
    cells = "".join(
        f"<div><dt>{escape(name)}</dt><dd>{escape(cell(value))} <small>{escape(unit)}</small></dd></div>"
        for name, (value, unit) in entries.items()
    )
    return f'<dl class="numbers">{cells}</dl>'


def table(columns: Sequence[Column], rows: Rows, *, row_header: str, marked: Mapping[str, str] | None = None) -> str:
    """A table; `marked`: classes of rows by their names. On a narrow screen each row becomes a card."""
    texts = [any(isinstance((row or {}).get(column.key), str) for row in rows.values()) for column in columns]
    kinds = [' class="text"' if text else "" for text in texts]
    heads = "".join(f"<th{kind}>{escape(header(column))}</th>" for kind, column in zip(kinds, columns, strict=True))
    body = ""
    for name, row in rows.items():
        cells = "".join(
            f'<td data-label="{escape(header(column))}"{kind}><span>{escape(cell((row or {}).get(column.key)))}</span></td>'
            for kind, column in zip(kinds, columns, strict=True)
        )
        mark = (marked or {}).get(name, "")
        body += f"<tr{f' class={mark!r}' if mark else ''}><td>{escape(name.strip())}</td>{cells}</tr>"
    heading = f"<thead><tr><th>{escape(row_header)}</th>{heads}</tr></thead>"
    return f'<div class="sheet"><table>{heading}<tbody>{body}</tbody></table></div>'


def figure(caption: str, svg: str, *, screen: Literal["", "desk", "phone"] = "") -> str:
    """A figure with its caption, for wide or narrow screens alone where that is said."""
    return f"<figure{f' class={screen}' if screen else ''}><figcaption>{escape(caption)}</figcaption>{svg}</figure>"


def heading(text: str) -> str:
    """The heading of a section."""
    return f"<h2>{escape(text)}</h2>"


def listed(texts: Iterable[str]) -> str:
    """A list of sentences; nothing where there are none."""
    entries = "".join(f"<li>{escape(text)}</li>" for text in texts)
    return f"<ul>{entries}</ul>" if entries else ""


def folded(summary: str, content: str) -> str:
    """Content, HTML, that a reader opens."""
    return f"<details><summary>{escape(summary)}</summary>{content}</details>"


def facts(entries: Mapping[str, Any]) -> str:
    """Names and what they are."""
    rows = "".join(f"<dt>{escape(name)}</dt><dd>{escape(cell(value))}</dd>" for name, value in entries.items())
    return f'<dl class="facts">{rows}</dl>'


def program(text: str) -> str:
    """Lines of a program, or commands."""
    return f"<pre>{escape(text)}</pre>"


def header(column: Column) -> str:
    """A column's name and unit."""
    return f"{column.name} [{column.unit}]" if column.unit else column.name


def cell(value: Any) -> str:
    """A value as text: numbers to three digits, a dash for None."""
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {cell(each)}" for name, each in value.items()) or "none"
    if isinstance(value, list | tuple):
        return ", ".join(map(cell, value)) or "none"
    return "-" if value is None else short_number(value) if isinstance(value, float) else str(value)
