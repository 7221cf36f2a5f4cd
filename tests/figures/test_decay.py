"""The dashed exponential has the stated rate and lies on an error that falls at it."""

from __future__ import annotations

import matplotlib
import numpy as np
import pytest

from invtrack.errors import InvtrackError
from invtrack.figures.curves import Decay, decay_figure

TIME = np.linspace(1.0, 9.0, 801)


def test_the_exponential_touches_the_error_from_above() -> None:
    values = np.exp(-0.7 * TIME) * np.cos(5 * TIME) + np.exp(-4 * TIME)
    expected = Decay("error [m]", TIME, values, rate=0.7).expected()
    late = TIME >= 5.0
    assert np.all(expected[late] >= np.abs(values)[late] * (1 - 1e-12))
    assert np.min(expected[late] / np.abs(values)[late]) == pytest.approx(1.0)
    assert np.polyfit(TIME, np.log(expected), 1)[0] == pytest.approx(-0.7)


def test_a_panel_for_each_error_with_its_unit_and_rate() -> None:
    decays = [Decay("estimate [1]", TIME, np.exp(-3 * TIME), 3.0), Decay("output [m]", TIME, np.exp(-0.1 * TIME), 0.1)]
    figure = decay_figure("decay", decays)
    assert [axes.get_ylabel() for axes in figure.axes] == ["estimate [1]", "output [m]"]
    shown = "\n".join(artist.get_text() for artist in figure.findobj(matplotlib.text.Text))
    for text in ("exp(-3 t)", "exp(-0.1 t)", "time [s]"):
        assert text in shown


@pytest.mark.parametrize(
    ("decays", "message"),
    [([], "at least one error"), ([Decay("output [m]", TIME, TIME[1:], 1.0)], "801 times and 800 values, expected two or more")],
)
def test_what_cannot_be_drawn_is_refused(decays: list[Decay], message: str) -> None:
    with pytest.raises(InvtrackError, match=message):
        decay_figure("decay", decays)
