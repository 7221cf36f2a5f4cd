"""Figures drawn on panels that the caller hands in: there and nowhere else, as many as they need, in the caller's own figure."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import matplotlib
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import invtrack
from invtrack.errors import InvtrackError
from invtrack.figures import (
    Decay,
    around_figure,
    bands_figure,
    column_figure,
    comparison_figure,
    decay_figure,
    frequency_response_figure,
    histogram_figure,
    overlay_figure,
    plan_figure,
    preactuation_figure,
    sweep_figure,
    tornado_figure,
    tracking_figure,
    trade_off_figure,
)
from tests.figures.drawn import points, texts
from tests.synthetic_runs import JUMP, two_mode_run

TIMES = np.linspace(0.0, 4.0, 81)
RUN = two_mode_run()
MODEL = invtrack.StateSpace([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]])
PLAN = invtrack.invert(MODEL, invtrack.rest_to_rest(0.0, 1.0, duration=1.0))
LINES = {"a": (TIMES, np.cos(TIMES)), "b": (TIMES, np.sin(TIMES))}


def _sweep(**at: Any) -> Figure:
    return sweep_figure("t", label="p", values=[1, 2], predicted={"a": [1, 2]}, measured={}, quantity="q", **at)


def _frequency_response(**at: Any) -> Figure:
    return frequency_response_figure("t", w=TIMES + 1, curves={"G": 1 / (1j + TIMES)}, magnitude="|G|", **at)


def _trade_off(**at: Any) -> Figure:
    return trade_off_figure("t", horizontal=("e", [1, 2]), panels=[("u", {"a": [1, 2]}), ("v", {"a": [2, 1]})], **at)


DRAWN: dict[str, tuple[int, Callable[..., Figure]]] = {
    "tracking": (6, lambda **at: tracking_figure(RUN, **at)),
    "column": (3, lambda **at: column_figure(RUN, **at)),
    "preactuation": (1, lambda **at: preactuation_figure(RUN, **at)),
    "comparison": (3, lambda **at: comparison_figure([RUN, two_mode_run("two")], **at)),
    "around": (4, lambda **at: around_figure([RUN], times={"start": 0.0, "jump": JUMP}, before=0.2, after=0.2, **at)),
    "overlay": (2, lambda **at: overlay_figure("t", panels=[("y", LINES), ("u", LINES)], manoeuvre=(1.0, 2.0), **at)),
    "plan": (3, lambda **at: plan_figure(PLAN, states=["x2"], **at)),
    "sweep": (1, _sweep),
    "decay": (2, lambda **at: decay_figure("t", [Decay(name, TIMES, np.exp(-TIMES), 1.0) for name in "ab"], **at)),
    "frequency": (2, _frequency_response),
    "bands": (1, lambda **at: bands_figure("t", time=TIMES, values=np.outer([1, 2, 3], TIMES), quantity="q", **at)),
    "tornado": (1, lambda **at: tornado_figure("t", correlations={"a": 0.4, "b": -0.2}, samples=20, quantity="q", **at)),
    "histogram": (1, lambda **at: histogram_figure("t", values=TIMES, quantity="q", **at)),
    "trade-off": (2, _trade_off),
}


def lines_of(axes: Axes) -> list[tuple[list[float], list[float]]]:
    return [tuple(np.nan_to_num(side, nan=-1.0).tolist() for side in points(line)) for line in axes.get_lines()]  # type: ignore[misc]


@pytest.mark.parametrize("name", DRAWN)
def test_panels_that_are_handed_in_hold_what_a_figure_of_its_own_would(name: str) -> None:
    count, draw = DRAWN[name]
    own = draw()
    assert len(own.axes) == count
    theirs = Figure(figsize=(5.0, 4.0))
    panels = theirs.subplots(count + 1, 1, squeeze=False)[:, 0]
    before = dict(matplotlib.rcParams)
    assert draw(ax=panels[:count] if count > 1 else panels[0]) is theirs
    assert dict(matplotlib.rcParams) == before
    assert sorted(map(lines_of, own.axes)) == sorted(map(lines_of, panels[:count]))
    assert {axes.get_ylabel() for axes in panels[:count]} >= {axes.get_ylabel() for axes in own.axes} - {""}
    assert lines_of(panels[count]) == []  # nothing outside of what was handed in
    assert (theirs.axes, theirs.legends, tuple(theirs.get_size_inches())) == (panels.tolist(), [], (5.0, 4.0))
    assert not theirs.get_suptitle()
    theirs.draw_without_rendering()


@pytest.mark.parametrize("name", DRAWN)
def test_another_number_of_panels_is_refused(name: str) -> None:
    count, draw = DRAWN[name]
    panels = Figure().subplots(count + 1, 1)
    with pytest.raises(InvtrackError, match=rf"ax must hold {count} Axes, one for each of .*; got {count + 1}"):
        draw(ax=panels)
    assert all(lines_of(axes) == [] for axes in panels)


@pytest.mark.parametrize("ax", ["panel", 3, Figure(), {}, [1.0, 2.0, 3.0]])
def test_what_is_no_panel_is_refused(ax: Any) -> None:
    with pytest.raises(InvtrackError, match=r"ax must (be|hold) matplotlib's Axes"):
        column_figure(RUN, ax=ax)


def test_a_panel_that_is_handed_in_twice_is_refused() -> None:
    axes = Figure().subplots()
    with pytest.raises(InvtrackError, match=r"ax must hold 3 Axes, one for each of .*; got some of them twice"):
        column_figure(RUN, ax=[axes, axes, axes])


def test_the_title_stands_above_the_first_panel_unless_that_has_one() -> None:
    first, second = Figure().subplots(1, 2)
    histogram_figure("spread", values=TIMES, quantity="q", ax=first)
    second.set_title("mine")
    histogram_figure("spread", values=TIMES, quantity="q", ax=second)
    assert (first.get_title(), second.get_title()) == ("spread", "mine")
    assert texts(first.figure).count("spread") == 1  # type: ignore[arg-type]
