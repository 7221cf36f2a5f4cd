"""One run over time: states, outputs, tracking errors and inputs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from invtrack.arrays import Array
from invtrack.channels import Channels
from invtrack.figures.lines import draw_line, draw_magnitudes, draw_steps
from invtrack.figures.marks import mark_intervals, shown_window, within
from invtrack.figures.sheet import inches_with_legend, legend_above_lines, sheet, stacked
from invtrack.figures.style import WANTED, channel_looks, label, with_unit
from invtrack.results.result import RunResult, Signal, require_run

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from invtrack.figures.sheet import AxesGiven

PANEL_INCHES = 1.45  # of height for the lines of a panel
WIDTH_INCHES, COLUMN_INCHES = 9.5, 4.6
LABELS_INCHES = 0.8  # of width for the labels beside a panel


def tracking_figure(result: RunResult, *, window: tuple[float, float] | None = None, ax: AxesGiven | None = None) -> Figure:
    """States, outputs against references, tracking errors and inputs of one run, as in Figure 5 of the parameter-jump paper.

    One panel for each unit: states, with the planned ones pale beneath them; outputs, with the references pale beneath them; errors
    y - y_d; their sizes on a logarithmic axis; inputs as they were applied, where they were commanded otherwise with that pale
    beneath them. Parameter intervals are shaded and labelled, T_i and T_f dotted.

    Args:
        result: the run.
        window: (start, end) [s] that is shown; unless given what `invtrack.results` counts as preactuation, the manoeuvre, and what
            follows it.
        ax: panels to draw on in place of a figure of its own, one for each unit of states, outputs, errors, sizes of errors and
            inputs, in this order.

    Raises InvtrackError for a window outside the run, and another number of panels in `ax`. Source: Devasia, Paden and Rossi,
    Exact-output tracking theory for systems with parameter jumps (1996), Figure 5.
    """
    require_run(result)
    window = shown_window([result], window)
    states, outputs, inputs = (list(_by_unit(signal.channels)) for signal in (result.state, result.output, result.applied))
    left = [_Panel(_STATES, channels) for channels in states]
    right = [_Panel(_OUTPUTS, channels) for channels in outputs]
    errors = [_Panel(_ERRORS, channels) for channels in outputs]
    last = [_Panel(kind, channels) for kind, groups in ((_SIZES, outputs), (_INPUTS, inputs)) for channels in groups]
    beside = len(left) < len(right) + len(last)  # errors stand where there is more room
    columns = (left + errors, right + last) if beside else (left, right + errors + last)
    inner = WIDTH_INCHES / 2 - LABELS_INCHES
    heights = [[panel.inches(result, inner) for panel in column] for column in columns]

    def arranged(figure: Figure) -> list[Axes]:
        parts = figure.subfigures(1, 2, wspace=0.02, squeeze=False)[0]
        found = [stacked(part, len(shares), shares) for part, shares in zip(parts, heights, strict=True)]
        if beside:
            return [*found[0][: len(left)], *found[1][: len(right)], *found[0][len(left) :], *found[1][len(right) :]]
        return [*found[0], *found[1]]

    return _drawn(
        result,
        [*left, *right, *errors, *last],
        window,
        ax,
        title=f"{result.model}: {result.name}",
        size=(WIDTH_INCHES, 0.9 + max(map(sum, heights))),
        arranged=arranged,
    )


def column_figure(result: RunResult, *, window: tuple[float, float] | None = None, ax: AxesGiven | None = None) -> Figure:
    """Outputs against references, sizes of tracking errors and inputs of one run in one narrow column, for a page or a phone.

    `window` and the looks as for `tracking_figure`. ax: panels to draw on in place of a figure of its own, one for each unit of
    outputs, errors and inputs, in this order. Raises InvtrackError for a window outside the run, and another number of panels.
    """
    require_run(result)
    window = shown_window([result], window)
    shown = ((_OUTPUTS, result.output), (_SIZES, result.output), (_INPUTS, result.applied))
    panels = [_Panel(kind, channels) for kind, signal in shown for channels in _by_unit(signal.channels)]
    heights = [panel.inches(result, COLUMN_INCHES - LABELS_INCHES) + 0.3 for panel in panels]
    size = (COLUMN_INCHES, 0.7 + sum(heights))
    return _drawn(result, panels, window, ax, title="", size=size, arranged=lambda figure: stacked(figure, len(panels), heights))


@dataclass(frozen=True)
class _Kind:
    """What a panel shows: how it is drawn, of which signal of the run, and the text at its axis."""

    draw: Callable[[Axes, RunResult, list[int], tuple[float, float]], None]
    signal: str
    text: Callable[[Channels, list[int]], str]
    has_legend: bool = True


@dataclass(frozen=True)
class _Panel:
    """A panel, with the numbers of the channels of one unit that are drawn in it."""

    kind: _Kind
    channels: list[int]

    def title(self, result: RunResult) -> str:
        """What stands at its axis."""
        return self.kind.text(getattr(result, self.kind.signal).channels, self.channels)

    def inches(self, result: RunResult, width: float) -> float:
        """Its height, with room for a legend in a panel as wide as that [inches]."""
        names = getattr(result, self.kind.signal).channels.names
        entries = [*(names[i] for i in self.channels), "reference"] if self.kind.has_legend else []
        return inches_with_legend(entries, width=width, height=PANEL_INCHES)


def _drawn(
    result: RunResult,
    panels: Sequence[_Panel],
    window: tuple[float, float],
    ax: AxesGiven | None,
    *,
    title: str,
    size: tuple[float, float],
    arranged: Callable[[Figure], list[Axes]],
) -> Figure:
    """The panels on a sheet.

    Args:
        result: the run.
        panels: what is drawn.
        window: (start, end) [s].
        ax: panels that the caller hands in.
        title, size, arranged: of a figure of our own, as for `sheet`.
    """
    with sheet(title, [panel.title(result) for panel in panels], ax, size=size, arranged=arranged) as page:
        for axes, panel in zip(page.axes, panels, strict=True):
            panel.kind.draw(axes, result, panel.channels, window)
            axes.set_ylabel(panel.title(result))
            topmost = not any(axes.get_shared_x_axes().joined(axes, other) for other in page.axes[: page.axes.index(axes)])
            mark_intervals(axes, result, window, labelled=topmost)
    return page.figure


def _by_unit(channels: Channels) -> Iterator[list[int]]:
    """Numbers of the channels that have the same unit, unit by unit."""
    for unit in dict.fromkeys(channels.units):
        yield [i for i, its_unit in enumerate(channels.units) if its_unit == unit]


def _draw_states(axes: Axes, result: RunResult, channels: list[int], window: tuple[float, float]) -> None:
    _draw_beside(axes, result.time, (result.state, result.state_reference), channels, window, wanted="plan")


def _draw_outputs(axes: Axes, result: RunResult, channels: list[int], window: tuple[float, float]) -> None:
    _draw_beside(axes, result.time, (result.output, result.reference), channels, window, wanted="reference")


def _draw_inputs(axes: Axes, result: RunResult, channels: list[int], window: tuple[float, float]) -> None:
    changed = not np.array_equal(result.applied.values[:, channels], result.commanded.values[:, channels])
    signals = (result.applied, result.commanded if changed else None)
    _draw_beside(axes, result.time, signals, channels, window, wanted="commanded", draw=draw_steps)


def _draw_beside(
    axes: Axes,
    time: Array,
    signals: tuple[Signal, Signal | None],
    channels: list[int],
    window: tuple[float, float],
    *,
    wanted: str,
    draw: Callable[..., None] = draw_line,
) -> None:
    """Channels of a signal, each above the pale one that it should follow.

    Args:
        axes: the panel.
        time: of the samples [s].
        signals: what was, and what was wanted, if that is drawn.
        channels: numbers of those that are drawn.
        window: (start, end) [s].
        wanted: how what was wanted is called.
        draw: draws a line.
    """
    part, (actual, target) = within(time, window), signals
    for channel, look in zip(channels, channel_looks(len(channels)), strict=True):
        draw(axes, time[part], actual.values[part, channel], label=actual.channels.names[channel], **look)
        if target is not None and np.any(np.isfinite(target.values[part, channel])):
            draw(axes, time[part], target.values[part, channel], **{**WANTED, "color": look["color"]})
    handles, names = axes.get_legend_handles_labels()
    if target is not None and len(axes.get_lines()) > len(handles):
        from matplotlib.lines import Line2D

        color = handles[0].get_color() if len(handles) == 1 else WANTED["color"]  # type: ignore[attr-defined]
        handles, names = [*handles, Line2D([], [], **{**WANTED, "color": color})], [*names, wanted]
    legend_above_lines(axes, handles, names)


def _draw_errors(axes: Axes, result: RunResult, channels: list[int], window: tuple[float, float]) -> None:
    part = within(result.time, window)
    with np.errstate(invalid="ignore", over="ignore"):  # of a run that diverged
        error = result.error[part]
    for channel, look in zip(channels, channel_looks(len(channels)), strict=True):
        draw_line(axes, result.time[part], error[:, channel], **look)


def _draw_sizes(axes: Axes, result: RunResult, channels: list[int], window: tuple[float, float]) -> None:
    part = within(result.time, window)
    looks: list[dict[str, Any]] = channel_looks(len(channels))
    draw_magnitudes(
        axes, [(result.time[part], result.error[part, channel], look) for channel, look in zip(channels, looks, strict=True)]
    )


def _named(kind: str) -> Callable[[Channels, list[int]], str]:
    """What stands at an axis: the channel where it is one, else what kind of channels they are."""

    def text(channels: Channels, shown: list[int]) -> str:
        unit = channels.units[shown[0]]
        return label(channels.names[shown[0]], unit) if len(shown) == 1 else with_unit(kind, unit)

    return text


def _fixed(symbol: str) -> Callable[[Channels, list[int]], str]:
    return lambda channels, shown: with_unit(symbol, channels.units[shown[0]])


_STATES = _Kind(_draw_states, "state", _named("states"))
_OUTPUTS = _Kind(_draw_outputs, "output", _named("outputs"))
_ERRORS = _Kind(_draw_errors, "output", _fixed("$y - y_d$"), has_legend=False)
_SIZES = _Kind(_draw_sizes, "output", _fixed("$|y - y_d|$"), has_legend=False)
_INPUTS = _Kind(_draw_inputs, "applied", _named("inputs"))
