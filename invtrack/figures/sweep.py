"""Quantities over a swept parameter: predicted and measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from invtrack.arguments import by_name, flag, require_text
from invtrack.arrays import Array
from invtrack.errors import InvtrackError
from invtrack.figures.panels import values_of
from invtrack.figures.sheet import sheet
from invtrack.figures.style import line_looks

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from invtrack.figures.sheet import AxesGiven


def sweep_figure(
    title: str,
    *,
    label: str,
    values: Sequence[float],
    predicted: Mapping[str, Sequence[float]],
    measured: Mapping[str, Sequence[float]],
    quantity: str,
    logarithmic: bool = False,
    ax: AxesGiven | None = None,
) -> Figure:
    """Lines for what is predicted, markers for what is measured, one colour per curve; what was only measured is joined up.

    Args:
        title: of the figure.
        label: of the swept parameter, with its unit.
        values: of the swept parameter (m,).
        predicted, measured: curves by name, one number per value (m,).
        quantity: label of the vertical axis, with its unit.
        logarithmic: whether both axes are.
        ax: a panel to draw on in place of a figure of its own.

    Raises InvtrackError where lengths differ, and for several panels.
    """
    points = values_of("values", values)
    lines, dots = _numbers("predicted", predicted), _numbers("measured", measured)
    for name, words in (("title", title), ("label", label), ("quantity", quantity)):
        require_text(name, words, error=InvtrackError)
    for name, curve in (*lines.items(), *dots.items()):
        if len(curve) != len(points):
            raise InvtrackError(f"curve {name!r} has {len(curve)} points for {len(points)} values of {label}")
    on_logarithms = flag("logarithmic", logarithmic, error=InvtrackError)
    with sheet(title, [quantity], ax, size=(8.0, 4.0), along=label) as page:
        (axes,) = page.axes
        names = list(dict.fromkeys([*lines, *dots]))
        for name, look in zip(names, line_looks(len(names)), strict=True):
            if name in lines:
                axes.plot(points, lines[name], label=f"{name}, predicted", **look)
            if name in dots:
                markers = {**look, "marker": "o", "markersize": 4.0, "linestyle": "none" if name in lines else look["linestyle"]}
                axes.plot(points, dots[name], label=f"{name}, measured", **markers)
        if on_logarithms:
            axes.set_xscale("log")
            axes.set_yscale("log")
        axes.set_ylabel(quantity)
        page.legend(*axes.get_legend_handles_labels())
    return page.figure


def _numbers(name: str, curves: object) -> dict[str, Array]:
    given = by_name(name, curves, expected="curves by their names", error=InvtrackError)
    return {key: values_of(f"curve {key!r}", curve) for key, curve in given.items()}
