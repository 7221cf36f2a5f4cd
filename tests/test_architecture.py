"""The order of the rooms: theory knows nothing of MuJoCo, outside libraries have one place each, no import goes backwards."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import invtrack

PACKAGE = Path(invtrack.__file__).parent
CHECKOUT = Path(__file__).parents[1]

# Room: the rooms and the libraries that it may import. All may import errors, numpy and the standard library.
THEORY = {"scipy"}
ROOMS: dict[str, set[str]] = {
    "errors": set(),
    "files": set(),
    "arrays": set(),
    "arguments": set(),
    "channels": set(),
    "layout": set(),
    "frames": {"pandas"},
    "linear": {*THEORY},
    "references": {"linear", *THEORY},
    "plans": {"linear", "references", *THEORY},
    "inversion": {"linear", "references", "plans", *THEORY},
    "redesign": {"linear", "references", "plans", "inversion", "clarabel", *THEORY},
    "preview": {"linear", "references", "plans", "inversion", "redesign", "control", *THEORY},
    "regulation": {"linear", "references", "plans", "inversion", *THEORY},
    "control": {"linear", "references", "plans", "regulation", *THEORY},
    "baselines": {"linear", "references", "plans", "inversion", "control", *THEORY},
    "plant": {"linear", "plans", "mujoco", "numba", "llvmlite", *THEORY},
    "mechanisms": {"mujoco", *THEORY},
    "results": {"linear", "references", "plans"},
    "learning": {"references", "plans", "results"},
    "simulation": {"linear", "plans", "control", "plant", "results", "mujoco", *THEORY},
    "recording": {"results", "mujoco", "rerun", "pyarrow", "PIL"},
    "figures": {"results", "plans", "matplotlib", "cycler"},  # cycler is a part of matplotlib with a name of its own
    "advice": {
        "linear",
        "references",
        "plans",
        "inversion",
        "redesign",
        "control",
        "baselines",
        "plant",
        "results",
        "simulation",
        "studies",
        "mujoco",
        "rich",
    },
    "report": {"plans", "results", "recording", "figures", "studies", "advice"},
    "sweeps": {"results", "recording", "studies", "pyarrow", *THEORY},
    "studies": {"plans", "plant", "control", "results", "simulation", "recording", "figures", "rich", "tyro"},
    "testing": {
        "linear",
        "references",
        "plans",
        "control",
        "plant",
        "results",
        "simulation",
        "recording",
        "figures",
        "mujoco",
        "pytest",
    },
}
ROOMS["command"] = {*ROOMS, "mujoco", "tyro", "matplotlib", "numba", "rerun", "scipy"}  # `doctor` names their versions
ROOMS["__main__"] = {"command"}
EVERYWHERE = {"arguments", "arrays", "channels", "errors", "files", "frames", "layout", "numpy"}
VAGUE_NAMES = {"utils", "util", "helpers", "helper", "common", "misc"}

SHIPPED = PACKAGE / "sims"  # a wheel carries the simulations, too, which are users of the rooms and none of them
SOURCES = sorted(path for path in PACKAGE.rglob("*.py") if path != PACKAGE / "__init__.py" and SHIPPED not in path.parents)


def room_of(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imported(source: str, package: str) -> Iterator[str]:
    """Every room and outside library that a module of `package` ("invtrack.linear") imports, wherever in the file."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = package.split(".")[: len(package.split(".")) + 1 - node.level] if node.level else []
            module = ".".join([*base, *([node.module] if node.module else [])])
            # `from invtrack import linear` names the room in its second half.
            names = [f"{module}.{alias.name}" for alias in node.names] if module == "invtrack" else [module]
        else:
            continue
        for name in names:
            top, _, rest = name.partition(".")
            if top == "invtrack":
                yield rest.partition(".")[0] or "invtrack itself"
            elif top not in sys.stdlib_module_names:
                yield top


def trespasses(source: str, room: str) -> set[str]:
    return set(imported(source, f"invtrack.{room}")) - ROOMS[room] - EVERYWHERE - {room}


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.relative_to(PACKAGE).as_posix())
def test_imports_follow_the_order_of_the_rooms(path: Path) -> None:
    room = room_of(path)
    assert room in ROOMS, f"{room} is a new room: say in ROOMS what it may import"
    found = trespasses(path.read_text(), room)
    assert not found, f"{path.relative_to(PACKAGE)} imports {', '.join(sorted(found))}; {room} may import {sorted(ROOMS[room])}"


def test_the_order_has_no_way_back() -> None:
    seen: list[str] = []
    remaining = {room: allowed & ROOMS.keys() for room, allowed in ROOMS.items()}
    while remaining:
        free = [room for room, needs in remaining.items() if needs <= set(seen)]
        assert free, f"rooms that need each other: {sorted(remaining)}"
        seen += free
        remaining = {room: needs for room, needs in remaining.items() if room not in free}


@pytest.mark.parametrize(
    ("room", "source", "found"),
    [
        ("linear", "import mujoco", {"mujoco"}),
        ("linear", "from invtrack.references.signal import PiecewiseSignal", {"references"}),
        ("linear", "from invtrack import references, errors", {"references"}),
        ("linear", "from ..plant import plant", {"plant"}),
        ("linear", "from . import state_space", set()),
        ("linear", "import invtrack", {"invtrack itself"}),
        ("linear", "def f():\n    import mujoco.rollout", {"mujoco"}),
        ("plant", "import mujoco, json\nfrom invtrack.linear.state_space import StateSpace", set()),
        ("plant", "from invtrack.inversion import exact", {"inversion"}),
        ("simulation", "import rerun as rr", {"rerun"}),
        ("results", "import matplotlib.pyplot as plt", {"matplotlib"}),
    ],
)
def test_a_trespass_is_seen(room: str, source: str, found: set[str]) -> None:
    assert trespasses(source, room) == found


def test_no_file_has_a_name_that_says_nothing() -> None:
    places = [PACKAGE, *(CHECKOUT / name for name in ("sims", "tests"))]
    vague = [path for place in places for path in place.rglob("*") if path.stem in VAGUE_NAMES]
    assert not vague
