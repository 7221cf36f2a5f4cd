"""What a figure is drawn on: panels in a figure of its own, or those that the caller hands in."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from invtrack.arrays import shown
from invtrack.errors import InvtrackError
from invtrack.figures.style import inches, shared_style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    AxesGiven = Axes | Sequence[Axes] | NDArray[np.object_]
    """One panel, or several in a sequence or in an array, such as that of `matplotlib.pyplot.subplots`."""

PADDING = 0.06  # inches around each panel with its labels
LEGEND_COLUMNS, ENTRY_INCHES = 3, 0.55  # entries in a row of a panel's own legend at most; an entry's width without its text
ROW_INCHES = 0.18  # a row of a legend
LINE_SPACING = 1.2


@dataclass(frozen=True, eq=False)
class Sheet:
    """The panels of a figure, in their order. own: whether the figure is ours, to be laid out and to get a legend of its own."""

    figure: Figure
    axes: list[Axes]
    own: bool

    def legend(self, handles: Sequence[Any], labels: Sequence[str], *, columns: int = 5) -> None:
        """One legend for all panels: below them in a figure of our own, else in the first of the panels, above its lines."""
        if not self.own:
            legend_above_lines(self.axes[0], handles, labels)
            return
        for number in range(columns, 0, -1):
            legend = self.figure.legend(handles, labels, loc="outside lower left", ncols=number)
            if number == 1 or legend.get_window_extent().width <= self.figure.bbox.width:
                return
            legend.remove()


@contextmanager
def sheet(
    title: str,
    panels: Sequence[str],
    ax: object,
    *,
    size: tuple[float, float],
    arranged: Callable[[Figure], list[Axes]] | None = None,
    shares: Sequence[float] | None = None,
    along: str = "time [s]",
) -> Iterator[Sheet]:
    """The panels to draw on. A figure of our own has our style; panels that are handed in keep that of their owner.

    Args:
        title: of the figure; it stands above the first panel where panels are handed in, if that has none.
        panels: what each shows.
        ax: panels that are handed in, as many; None for a figure of our own.
        size: (width, height) of a figure of our own [inches].
        arranged: makes the panels of such a figure; they stand above each other unless given.
        shares: of the height, of each of the panels that stand above each other.
        along: label of the horizontal axis of the lowest panel of those that share it; "" for none.

    Raises InvtrackError where `ax` is neither, or has another number of panels.
    """
    if ax is None:
        with shared_style():
            figure = _new_figure(title, *size)
            axes = arranged(figure) if arranged else stacked(figure, len(panels), shares)
            yield Sheet(figure, axes, own=True)
            _label_lowest(axes, along)
            for part in (figure, *figure.subfigs):
                part.align_ylabels()
        return
    axes = _axes_of(ax, panels)
    theirs = axes[0].get_figure(root=True)
    assert theirs is not None
    yield Sheet(theirs, axes, own=False)
    _label_lowest(axes, along)
    if title and not any(axes[0].get_title(place) for place in ("left", "center", "right")):
        axes[0].set_title(title, pad=_height_of_marks(axes[0]) + 6.0)


def stacked(figure: Any, count: int, shares: Sequence[float] | None = None) -> list[Axes]:
    """Panels above each other that share their horizontal axis, in a figure or a part of one."""
    panels = figure.subplots(count, 1, sharex=True, squeeze=False, height_ratios=shares)
    return list(panels[:, 0])


def _new_figure(title: str, width: float, height: float) -> Figure:
    """An empty figure whose panels keep clear of each other, of its title and of its edges."""
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    figure = Figure(figsize=(width, height), layout=ConstrainedLayoutEngine(w_pad=PADDING, h_pad=PADDING))
    if title:
        figure.suptitle(title, x=0.01, ha="left", fontweight="bold")
    return figure


def _axes_of(ax: object, panels: Sequence[str]) -> list[Axes]:
    from matplotlib.axes import Axes

    if isinstance(ax, Axes):
        given: list[Any] = [ax]
    elif isinstance(ax, (list, tuple)) or (isinstance(ax, np.ndarray) and ax.dtype == object):
        given = list(np.asarray(ax, dtype=object).ravel())
    else:
        raise InvtrackError(f"ax must be matplotlib's Axes, or several in a list or an array, got {shown(ax)}")
    strange = [each for each in given if not isinstance(each, Axes)]
    if strange:
        raise InvtrackError(f"ax must hold matplotlib's Axes alone, got {shown(strange[0])} in it")
    if len(given) != len(panels) or len(set(given)) != len(given):
        found = len(given) if len(given) != len(panels) else "some of them twice"
        raise InvtrackError(f"ax must hold {len(panels)} Axes, one for each of {', '.join(panels)}; got {found}")
    return given


def _label_lowest(axes: Sequence[Axes], text: str) -> None:
    for i, panel in enumerate(axes):
        if text and not any(panel.get_shared_x_axes().joined(panel, later) for later in axes[i + 1 :]):
            panel.set_xlabel(text)


def _height_of_marks(axes: Axes) -> float:
    """How far what is written above a panel, such as T_i, reaches up [points]."""
    from matplotlib.text import Annotation

    above = [
        text for text in axes.texts if isinstance(text, Annotation) and text.get_verticalalignment() == "bottom" and text.xy[1] == 1
    ]
    lines = [text.get_text().count("\n") + 1 for text in above]
    heights = [text.xyann[1] + LINE_SPACING * float(text.get_fontsize()) * n for text, n in zip(above, lines, strict=True)]
    return float(max(heights, default=0.0))


def legend_above_lines(axes: Axes, handles: Sequence[Any], names: Sequence[str]) -> None:
    """A legend in rows at the top of a panel, whose axis is made longer for it: no line lies below it."""
    if len(handles) < 2:
        return
    columns = _legend_columns(axes, names)
    rows = -(-len(handles) // columns)
    height = _inches_of(axes).height
    share = min(ROW_INCHES * rows / max(height, ROW_INCHES), 0.6)
    scale = axes.yaxis.get_transform()
    low, high = scale.transform(np.array(axes.get_ylim()))
    top = scale.inverted().transform(np.array([low + (high - low) / (1 - share)]))[0]
    axes.set_ylim(top=float(top))
    legend = axes.legend(
        handles,
        names,
        loc="upper left",
        ncols=columns,
        borderaxespad=0.1,
        borderpad=0.15,
        columnspacing=1.2,
        labelspacing=0.3,
        frameon=True,  # so that no mark of a time crosses a name
        framealpha=0.9,
        facecolor="white",
        edgecolor="none",
        fancybox=False,
    )
    legend.set_zorder(4)
    legend.set_in_layout(False)  # a name wider than the panel is cut off; it does not push the panel away


def inches_with_legend(names: Sequence[str], *, width: float, height: float) -> float:
    """The height [inches] of a panel of that width in which a legend finds room above lines that have `height` to themselves."""
    if len(names) < 2:
        return height
    return height + ROW_INCHES * -(-len(names) // _columns_in(width, names))


def _legend_columns(axes: Axes, names: Sequence[str]) -> int:
    return _columns_in(_inches_of(axes).width, names)


def _columns_in(width: float, names: Sequence[str]) -> int:
    """How many entries stand side by side, up to three: as many as are no wider together than `width` [inches]."""
    return min(LEGEND_COLUMNS, len(names), max(1, int(width / (max(map(inches, names)) + ENTRY_INCHES))))


def _inches_of(axes: Axes) -> Any:
    """The panel's box [inches], as it stands before the layout makes room for labels: a little too large."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    return axes.get_window_extent().transformed(figure.dpi_scale_trans.inverted())
