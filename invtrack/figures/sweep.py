"""Quantities over a swept parameter, predicted by the linear model and measured in physics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from matplotlib.figure import Figure

from invtrack.errors import InvtrackError
from invtrack.figures.style import line_looks, new_figure, shared_style


def sweep_figure(
    title: str,
    *,
    label: str,
    values: Sequence[float],
    predicted: Mapping[str, Sequence[float]],
    measured: Mapping[str, Sequence[float]],
    quantity: str,
) -> Figure:
    """Lines for what is predicted, markers for what is measured, one colour per curve.

    label: of the swept parameter, with its unit; values: its values; predicted, measured: curve by name, one number per value;
    quantity: label of the vertical axis, with its unit. Raises InvtrackError where lengths differ.
    """
    for name, curve in (*predicted.items(), *measured.items()):
        if len(curve) != len(values):
            raise InvtrackError(f"curve {name!r} has {len(curve)} points for {len(values)} values of {label}")
    with shared_style():
        figure = new_figure(title, width=8.0, height=4.0)
        axes = figure.add_subplot()
        for (name, curve), look in zip(predicted.items(), line_looks(len(predicted)), strict=True):
            axes.plot(values, curve, label=f"{name}, predicted", color=look["color"], linestyle=look["linestyle"])
            if name in measured:
                markers = {"linestyle": "none", "marker": "o", "markersize": 4.0}
                axes.plot(values, measured[name], label=f"{name}, measured", color=look["color"], **markers)  # type: ignore[arg-type]
        axes.set_xlabel(label)
        axes.set_ylabel(quantity)
        axes.legend(loc="best", frameon=True, framealpha=0.75, edgecolor="none")
    return figure
