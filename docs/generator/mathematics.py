"""Formulas as MathML, made when the site is built: browsers lay them out themselves, so no page needs a script or a network.

Sources write $...$ and $$...$$; \\tag{8} is the number that the source gives an equation.
"""

from __future__ import annotations

import html
import re
from typing import Any

from latex2mathml.converter import convert
from mkdocs.exceptions import PluginError

FORMULA = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>([,.;:)]?)', re.DOTALL)
TAG = re.compile(r"\\tag\{([^{}]*)\}")
NOT_CONVERTED = re.compile(r"<mi>(?:&amp;|&(?!#)|\\[a-zA-Z]*|[a-zA-Z]{2,}\\)")


def on_page_content(content: str, page: Any, **_: Any) -> str:
    """The page with its formulas as MathML. Raises PluginError where one holds what the converter does not know."""

    def replaced(match: re.Match[str]) -> str:
        element, _, source, sign = match.groups()
        formula = _formula(html.unescape(source), block=element == "div", place=page.file.src_uri)
        return f'<span class="unbroken">{formula}{sign}</span>' if sign else formula  # no line begins with a comma

    return FORMULA.sub(replaced, content)


def _formula(source: str, *, block: bool, place: str) -> str:
    number = TAG.search(source)
    latex = TAG.sub("", source).strip()
    try:
        formula = convert(latex, display="block" if block else "inline")
    except Exception as error:
        raise PluginError(f"{place}: expected LaTeX that latex2mathml knows, got {latex!r}: {error!r}") from error
    if NOT_CONVERTED.search(formula):
        raise PluginError(f"{place}: latex2mathml leaves a part of {latex!r} as it is; write it with other commands")
    if not block:
        return formula
    label = f'<span class="equation-number">({html.escape(number[1])})</span>' if number else ""
    return f'<div class="equation"><div class="formula">{formula}</div>{label}</div>'
