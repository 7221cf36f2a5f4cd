from __future__ import annotations

import numpy as np
import pytest

from invtrack.errors import InvtrackError
from invtrack.figures.curves import sweep_figure


def test_each_curve_has_a_line_and_markers_of_one_colour() -> None:
    values = [1.0, 2.0, 4.0]
    curves = {"change": [0.3, 0.2, 0.1], "input": [0.9, 0.7, 0.4]}
    figure = sweep_figure("t", label="duration [s]", values=values, predicted=curves, measured=curves, quantity="share [1]")
    axes = figure.axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("duration [s]", "share [1]")
    predicted, measured = axes.lines[0], axes.lines[1]
    assert predicted.get_color() == measured.get_color()
    assert measured.get_linestyle() == "None"
    assert np.array_equal(np.asarray(measured.get_ydata()), [0.3, 0.2, 0.1])
    legend = axes.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()][:2] == ["change, predicted", "change, measured"]


def test_curves_of_another_length_are_refused() -> None:
    with pytest.raises(InvtrackError, match=r"curve 'change' has 2 points for 1 values of duration \[s\]"):
        sweep_figure("t", label="duration [s]", values=[1.0], predicted={"change": [1.0, 2.0]}, measured={}, quantity="share [1]")
