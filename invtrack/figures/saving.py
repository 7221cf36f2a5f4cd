"""Figures leave the program: as files, and as elements of pages."""

from __future__ import annotations

import io
import re
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

from invtrack.arguments import file_path, instance, require_text
from invtrack.errors import InvtrackError
from invtrack.figures.style import shared_style
from invtrack.files import replaced_when_complete

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI = 150

_REFERENCE = re.compile(r"#([^)\"]+)")
_numbers = count(1)
"""Figures of one page have ids of their own."""

for _prefix, _space in (("", "http://www.w3.org/2000/svg"), ("xlink", "http://www.w3.org/1999/xlink")):
    ElementTree.register_namespace(_prefix, _space)


def save_figure(figure: Figure, path: str | Path) -> Path:
    """Write a figure as PNG in one piece, at 150 dots per inch, and return its path.

    Raises InvtrackError for what is no figure, FileError where the file cannot be written.
    """
    from matplotlib.figure import Figure

    instance("figure", figure, Figure, expected="a figure, such as tracking_figure(result)", error=InvtrackError)
    target = file_path(path)
    with shared_style(), replaced_when_complete(target) as draft:
        figure.savefig(draft, format="png", dpi=DPI)
    return target


def svg_text(figure: Figure, *, title: str) -> str:
    """A figure as an <svg> element for a page: it takes the width that it is given, and `title` is read to who does not see it.

    Raises InvtrackError for what is no figure.
    """
    from matplotlib.figure import Figure

    instance("figure", figure, Figure, expected="a figure, such as tracking_figure(result)", error=InvtrackError)
    require_text("title", title, error=InvtrackError)
    drawn = io.StringIO()
    with shared_style():
        figure.savefig(drawn, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    element = ElementTree.fromstring(drawn.getvalue())
    for name in ("width", "height"):
        element.attrib.pop(name, None)
    prefix = f"f{next(_numbers)}-"
    ids = {each.attrib["id"] for each in element.iter() if "id" in each.attrib}
    element.attrib |= {"role": "img", "aria-label": title}
    for each in list(element):  # what matplotlib says of itself
        if each.tag.endswith("metadata"):
            element.remove(each)
    for each in element.iter():
        for name, value in each.attrib.items():
            named = value if name == "id" else ""
            each.attrib[name] = prefix + named if named else _REFERENCE.sub(lambda found: _renamed(found[1], ids, prefix), value)
    return ElementTree.tostring(element, encoding="unicode")


def _renamed(name: str, ids: set[str], prefix: str) -> str:
    """A reference to an element of the figure, if it is one."""
    return f"#{prefix}{name}" if name in ids else f"#{name}"
