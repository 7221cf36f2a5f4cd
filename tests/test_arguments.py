"""What is no array is refused by its name, in the class of error that the room chooses, with what came instead."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from invtrack import arguments
from invtrack.errors import ControlError, FileError


@pytest.mark.parametrize(
    ("check", "message"),
    [
        (lambda: arguments.instance("plan", 3, str, expected="a text", error=ControlError), "plan must be a text, got 3"),
        (
            lambda: arguments.flag("phase", np.zeros(2), error=ControlError),
            "phase must be True or False, got an array",
        ),
        (
            lambda: arguments.one_of("inputs", "middle", ("a", "b"), error=ControlError),
            "must be one of 'a', 'b', got 'middle'",
        ),
        (lambda: arguments.one_of("inputs", ["a"], ("a", "b"), error=ControlError), "inputs must be one of"),
        (lambda: arguments.require_text("name", None, error=ControlError), "name must be a text, got None"),
        (lambda: arguments.items("gains", "abc", expected="a list", error=ControlError), "gains must be a list, got 'abc'"),
        (lambda: arguments.items("gains", {"a": 1}, expected="a list", error=ControlError), "gains must be a list"),
        (lambda: arguments.items("gains", np.array(1.0), expected="a list", error=ControlError), "gains must be a list"),
        (lambda: arguments.items("gains", np.ma.ones(2), expected="a list", error=ControlError), "gains must be a list"),
        (
            lambda: arguments.texts("names", ["a", 2], expected="a list of names", error=ControlError),
            "list of names, got 2 in it",
        ),
        (lambda: arguments.by_name("units", [], expected="units", error=ControlError), r"units must be a dict of units, got \[\]"),
        (lambda: arguments.by_name("units", {1: "m"}, expected="units", error=ControlError), "a dict of units, got 1 for a name"),
    ],
)
def test_refusals(check: Callable[[], object], message: str) -> None:
    with pytest.raises(ControlError, match=message):
        check()


@pytest.mark.parametrize("path", ["", "  ", b"run.rrd", None, 1.0, Path()])
def test_what_is_no_path_of_a_file_is_refused(path: object) -> None:
    with pytest.raises(FileError, match="expected the path of a file"):
        arguments.file_path(path)


def test_what_fits_comes_back() -> None:
    assert arguments.items("gains", (gain for gain in (1.0, 2.0)), expected="a list", error=ControlError) == [1.0, 2.0]
    assert arguments.texts("names", np.array(["a", "b"]), expected="a list", error=ControlError) == ("a", "b")
    assert arguments.flag("phase", np.True_, error=ControlError) is True
    assert arguments.file_path("runs/plan.csv") == Path("runs/plan.csv")
