"""Pages that are made from what stands elsewhere: the first page from README, the changelog, and the reference from the package.

Nothing is written twice: README and CHANGELOG are taken as they stand, with their links into docs/ mended, and each room of the
package has a page of the names that it exports, so that a new one shows up by itself.
"""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path
from typing import Any

import griffe
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

CHECKOUT = Path(__file__).parents[2]
TAKEN = {"index.md": "README.md", "changelog.md": "CHANGELOG.md"}
ON_THE_SITE = {"](docs/": "](", "](CHANGELOG.md)": "](changelog.md)"}
EXTENSION = str(Path(__file__).with_name("plain_text.py"))


def on_config(config: MkDocsConfig, **_: Any) -> MkDocsConfig:
    """A page of each room in the navigation, under Reference."""
    (reference,) = (section["Reference"] for section in config.nav or [] if "Reference" in section)
    reference.extend({f"invtrack.{name}": f"api/{name}.md"} for name in _rooms(_package()))
    return config


def on_files(files: Files, config: MkDocsConfig, **_: Any) -> Files:
    """All pages: those on the disk and the made ones."""
    for name, source in TAKEN.items():
        text = (CHECKOUT / source).read_text(encoding="utf-8")
        for link, there in ON_THE_SITE.items():
            text = text.replace(link, there)
        files.append(File.generated(config, name, content=text))
    package = _package()
    rooms = _rooms(package)
    files.append(File.generated(config, "api/index.md", content=_overview(package, rooms)))
    for name, room in rooms.items():
        files.append(File.generated(config, f"api/{name}.md", content=_reference(name, room)))
    return files


@cache
def _package() -> griffe.Module:
    """The package as its source stands, which is read and not run."""
    package = griffe.load("invtrack", search_paths=[CHECKOUT], extensions=griffe.load_extensions(EXTENSION), resolve_aliases=True)
    assert isinstance(package, griffe.Module)
    return package


def _rooms(package: griffe.Module) -> dict[str, griffe.Module]:
    """The rooms by name, as the package itself lists them, then its files with public names: channels and errors."""
    listed = [*_literal(package, "_ROOMS"), *_literal(package, "_FILES"), "errors"]
    return {name: package.modules[name] for name in listed}


def _names(room: griffe.Module) -> list[str]:
    """What a room exports; a file without __all__ exports its public classes and functions."""
    if room.exports is not None:
        return [str(name) for name in room.exports]
    return [name for name, each in room.members.items() if each.is_public and (each.is_class or each.is_function)]


def _reference(name: str, room: griffe.Module) -> str:
    text = room.docstring.value if room.docstring else ""
    entries = [f"::: {_path(room, each)}" for each in _names(room)]
    return "\n\n".join([f"# invtrack.{name}", text, *entries]) + "\n"


def _path(room: griffe.Module, name: str) -> str:
    """Where to find an exported name: in the room, unless a file of the room has the name, too."""
    return room.imports[name] if name in room.modules else f"{room.path}.{name}"


def _overview(package: griffe.Module, rooms: dict[str, griffe.Module]) -> str:
    """The names of every room, each with the first line of its docstring."""
    top = {name: room for room, names in {**_literal(package, "_ROOMS"), **_literal(package, "_FILES")}.items() for name in names}
    parts = ["# Reference", TOP, _table("invtrack", {name: rooms[top[name]] for name in sorted(top)})]
    for name, room in rooms.items():
        summary = room.docstring.value.split("\n\n")[0].replace("\n", " ") if room.docstring else ""
        parts += [f"## [invtrack.{name}]({name}.md)", summary, _table(name, dict.fromkeys(_names(room), room))]
    return "\n\n".join(parts) + "\n"


TOP = "The names that most programs need stand in `invtrack` itself; each room below holds these and more."


def _table(title: str, names: dict[str, griffe.Module]) -> str:
    rows = [f"| [`{name}`][{_path(room, name)}] | {_summary(room, name)} |" for name, room in names.items()]
    return "\n".join([f"| `{title}.` | |", "|---|---|", *rows])


def _summary(room: griffe.Module, name: str) -> str:
    """The first paragraph of a name's docstring, which is one line of the table."""
    docstring = _package()[room.imports.get(name, f"{room.path}.{name}").removeprefix("invtrack.")].docstring
    first = docstring.value.split("\n\n")[0] if docstring else ""
    return first.replace("\n", " ").replace("|", r"\|")


def _literal(package: griffe.Module, name: str) -> dict[str, tuple[str, ...]]:
    found: dict[str, tuple[str, ...]] = ast.literal_eval(str(package.attributes[name].value))
    return found
