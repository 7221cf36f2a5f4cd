"""What figures are handed: runs, curves in panels, a window of time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from invtrack.arguments import by_name, items, require_text
from invtrack.arrays import Array, real_numbers, real_vector, shown
from invtrack.errors import InvtrackError
from invtrack.results.result import RunResult, require_run


def runs_of(results: object) -> list[RunResult]:
    """The runs in a list, at least one. Raises InvtrackError for anything else."""
    runs = items("results", results, expected="a list of results of runs", error=InvtrackError)
    if not runs:
        raise InvtrackError("expected at least one run to compare, got none")
    for run in runs:
        require_run(run)
    return runs


def window_of(window: object) -> tuple[float, float]:
    """(start, end) [s], finite and in order. Raises InvtrackError for anything else."""
    start, end = real_vector("window [s]", window, ["start", "end"], error=InvtrackError)  # type: ignore[arg-type]
    if not start < end:
        raise InvtrackError(f"window must be (start, end) [s], the start before the end, got {start} and {end}")
    return float(start), float(end)


def ends_of(manoeuvre: object) -> tuple[float, float]:
    """(T_i, T_f) [s], finite and in order. Raises InvtrackError for anything else."""
    start, end = real_vector("manoeuvre [s]", manoeuvre, ["start", "end"], error=InvtrackError)  # type: ignore[arg-type]
    if not start <= end:
        raise InvtrackError(f"manoeuvre must be (start, end) [s], the start before the end, got {start} and {end}")
    return float(start), float(end)


def panels_of(panels: object) -> list[tuple[str, Mapping[str, Any]]]:
    """(label, curves by name) of each panel. Raises InvtrackError for anything else."""
    expected = "a list of panels (label, {curve: values})"
    found = []
    for panel in items("panels", panels, expected=expected, error=InvtrackError):
        if not isinstance(panel, (tuple, list)) or len(panel) != 2:
            raise InvtrackError(f"panels must be {expected}, got {shown(panel)} in it")
        label = require_text("the label of a panel", panel[0], error=InvtrackError)
        found.append((label, by_name(f"panel {label!r}", panel[1], expected="curves by their names", error=InvtrackError)))
    return found


def values_of(name: str, values: object) -> Array:
    """Numbers (m,), NaN among them where there is no point. Raises InvtrackError for anything else."""
    numbers = real_numbers(name, values, error=InvtrackError)  # type: ignore[arg-type]
    if numbers.ndim != 1:
        raise InvtrackError(f"{name} must be a list of numbers (m,), got an array of shape {numbers.shape}")
    return numbers


def line_of(name: str, line: object) -> tuple[Array, Array]:
    """Times [s] and as many values (m,). Raises InvtrackError for anything else."""
    if not isinstance(line, (tuple, list)) or len(line) != 2:
        raise InvtrackError(f"{name} must be (times, values), got {shown(line)}")
    time, values = values_of(f"times of {name}", line[0]), values_of(f"values of {name}", line[1])
    if len(time) != len(values):
        raise InvtrackError(f"{name} has {len(values)} values at {len(time)} times")
    return time, values
