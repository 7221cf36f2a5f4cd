"""What a program sees of the package: names at the top, faces of the rooms, and what an import loads."""

from __future__ import annotations

import importlib
import inspect
import subprocess
import sys
import types
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib.axes
import matplotlib.figure
import pytest
import rich.console

import invtrack

PACKAGE = Path(invtrack.__file__).parent
ROOMS = sorted(path.parent.name for path in PACKAGE.glob("*/__init__.py") if path.stat().st_size)
SIMS = Path(__file__).parents[1] / "sims"
LATE = (  # what takes long to load, and nobody waits for who has not come to use it
    "rerun", "matplotlib", "rich", "numba", "pyarrow", "dask", "distributed",
    "scipy.signal", "scipy.optimize", "scipy.interpolate", "scipy.sparse",
)  # fmt: skip
HEAVY = (*LATE, "numpy", "scipy", "mujoco", "clarabel", "tyro")


def face(room: str) -> types.ModuleType:
    return importlib.import_module(f"invtrack.{room}")


def loaded_by(program: str) -> set[str]:
    """Those of the heavy libraries that a fresh interpreter has loaded at the end of a program."""
    finished = subprocess.run(
        [sys.executable, "-c", f"{program}\nimport sys\nprint(*(name for name in {HEAVY} if name in sys.modules))"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert finished.returncode == 0, finished.stderr
    return set(finished.stdout.split())


def test_importing_the_package_or_its_plugin_loads_no_library_that_takes_long() -> None:
    assert loaded_by("import invtrack, invtrack.testing.plugin") == set()


def test_planning_and_simulating_load_what_they_use_and_no_more() -> None:
    plan = """
import invtrack
model = invtrack.StateSpace([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]])
plan = invtrack.invert(model, invtrack.rest_to_rest(0.0, 1.0, duration=1.0))
"""
    run = """
controller = invtrack.TrackingController(plan, invtrack.lqr(model, Q=1.0, R=1.0))
print(end="" if invtrack.simulate(invtrack.LinearPlant(model), controller, timestep=1e-2).status == "completed" else "diverged")
"""
    assert not loaded_by(plan) & {"rerun", "matplotlib", "mujoco", "tyro", "rich", "clarabel", "scipy.signal"}
    assert not loaded_by(plan + run) & {"rerun", "matplotlib", "tyro", "rich", "scipy.signal"}


def test_the_rooms_load_no_library_that_takes_long_before_it_is_used() -> None:
    rooms = [f"invtrack.{room}" for room in ROOMS if room != "recording"]
    assert not loaded_by(f"import {', '.join(rooms)}") & set(LATE)


def test_a_study_reads_its_options_with_nothing_loaded_that_it_may_not_need() -> None:
    program = f"""
import contextlib, io, runpy, sys
sys.path.insert(0, {str(SIMS)!r})
sys.argv[1:] = ["--help"]
for script in sorted(__import__("pathlib").Path({str(SIMS)!r}).glob("*.py")):
    shown = io.StringIO()
    with contextlib.redirect_stdout(shown), contextlib.suppress(SystemExit):
        runpy.run_path(str(script), run_name="__main__")
    assert "--timestep" in shown.getvalue(), script
"""
    assert not loaded_by(program) & set(LATE)


def test_the_names_at_the_top_are_those_of_the_rooms() -> None:
    promised = [name for names in (*invtrack._ROOMS.values(), *invtrack._FILES.values()) for name in names]
    assert sorted([*promised, "InvtrackError"]) == sorted(invtrack.__all__)
    assert invtrack.Channels is importlib.import_module("invtrack.channels").Channels
    assert {path.parent.name for path in PACKAGE.glob("*/__init__.py")} == set(invtrack._ROOMS)
    for room, names in invtrack._ROOMS.items():
        assert getattr(invtrack, room) is face(room)
        for name in names:
            assert getattr(invtrack, name) is getattr(face(room), name)
            assert name in face(room).__all__
    assert {*ROOMS, *invtrack.__all__} <= set(dir(invtrack))
    assert len(invtrack.__all__) <= 47


def test_a_name_that_is_not_there_is_an_error() -> None:
    with pytest.raises(AttributeError, match="module 'invtrack' has no attribute 'inverse'"):
        invtrack.inverse  # noqa: B018


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_says_what_it_is_and_exports_what_it_names(room: str) -> None:
    module = face(room)
    assert module.__doc__, "a face begins with a line that says what the room holds"
    assert module.__all__
    for name in module.__all__:
        member = getattr(module, name)
        assert not isinstance(member, types.ModuleType)
        if inspect.isclass(member) or inspect.isfunction(member):
            assert member.__doc__, f"{room}.{name} says nothing of itself"


def public_members() -> Iterator[tuple[str, Any]]:
    """Every class and function at the top and in every face, by where it is found."""
    for name in invtrack.__all__:
        yield name, getattr(invtrack, name)
    for room in ROOMS:
        for name in face(room).__all__:
            yield f"{room}.{name}", getattr(face(room), name)


def returned(function: Any) -> Iterator[type]:
    """The classes of this package in a function's return annotation, inside tuples, lists and unions too."""
    # Names of matplotlib and rich are known to type checkers alone: who imports the room does not load these.
    late = {"Figure": matplotlib.figure.Figure, "AxesGiven": matplotlib.axes.Axes, "Console": rich.console.Console}
    waiting = [typing.get_type_hints(function, localns=late).get("return")]
    while waiting:
        annotation = waiting.pop()
        waiting.extend(typing.get_args(annotation))
        if inspect.isclass(annotation) and annotation.__module__.startswith("invtrack."):
            yield annotation


def callables(member: Any) -> Iterator[Any]:
    """A function itself; of a class its public methods and properties."""
    if inspect.isfunction(member):
        yield member
        return
    for name, attribute in inspect.getmembers(member):
        if name.startswith("_"):
            continue
        if isinstance(attribute, property):
            yield attribute.fget
        elif hasattr(attribute, "func") and not inspect.ismethod(attribute):  # a cached property
            yield attribute.func
        elif inspect.isfunction(attribute) or inspect.ismethod(attribute):
            yield attribute


def test_every_type_that_is_returned_can_be_imported_from_the_top_or_a_face() -> None:
    exported = {member for _, member in public_members() if inspect.isclass(member)}
    missing = {
        f"{found.__module__}.{found.__qualname__}, which {where} returns"
        for where, member in public_members()
        if inspect.isfunction(member) or inspect.isclass(member)
        for function in callables(member)
        for found in returned(function)
        if found not in exported
    }
    assert not missing, "\n".join(sorted(missing))
