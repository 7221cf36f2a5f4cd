"""Models in other libraries, and how they show themselves."""

from __future__ import annotations

import sys

import control
import numpy as np
import pytest

import invtrack
from invtrack.errors import ModelError
from invtrack.linear import to_control, to_scipy

RIG = invtrack.StateSpace(
    [[0.0, 1.0, 0.0], [-3.0, -0.2, 1.0], [0.0, 0.0, -5.0]],
    [[0.0, 0.0], [2.0e-9, 0.0], [0.0, 1.0]],
    [[1.0, 0.0, 0.0]],
    [[0.0, 0.5]],
    states=invtrack.Channels(["turn", "speed", "valve"], ["rad", "rad/s", "1"]),
    inputs=["torque", "current"],
    outputs=["angle"],
    parameters={"mass": 2.0},
)


def test_other_libraries_have_the_same_transfer_matrix() -> None:
    theirs, ours = to_control(RIG), to_scipy(RIG)
    for w in (0.1, 1.7, 30.0):
        expected = RIG.C @ np.linalg.solve(1j * w * np.eye(3) - RIG.A, RIG.B) + RIG.D
        assert np.asarray(theirs(1j * w)) == pytest.approx(expected)
        assert ours.C @ np.linalg.solve(1j * w * np.eye(3) - ours.A, ours.B) + ours.D == pytest.approx(expected)
    assert (theirs.state_labels, theirs.input_labels, theirs.output_labels) == (
        ["turn", "speed", "valve"],
        ["torque", "current"],
        ["angle"],
    )


def test_there_and_back_is_the_same_model() -> None:
    system = control.ss([[0.0, 1.0], [-2.0, -3.0]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]])
    assert np.array_equal(to_control(system).A, system.A)
    reference = invtrack.rest_to_rest(0.0, 1.0, duration=1.0)
    assert invtrack.invert(to_scipy(system), reference).certificate.output_error < 1e-9


def test_without_python_control_it_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(ModelError, match="pip install control"):
        to_control(RIG)


def test_a_model_shows_what_it_is_in_a_line_and_its_matrices_in_a_notebook() -> None:
    assert repr(RIG) == "<StateSpace: 3 states, inputs torque, current, output angle; mass=2>"
    switched = repr(invtrack.SwitchedSystem([RIG, RIG], [1.5]))
    assert (
        switched
        == "<SwitchedSystem that switches at 1.5 s, from StateSpace: 3 states, inputs torque, current, output angle; mass=2>"
    )
    shown = RIG._repr_html_()
    assert r"\begin{bmatrix}0 & 1 & 0 \\ -3 & -0.2 & 1 \\ 0 & 0 & -5\end{bmatrix}\,x" in shown
    assert r"2 \cdot 10^{-9}" in shown
    assert "turn [rad], speed [rad/s], valve [1]" in shown


def test_of_a_large_matrix_its_corners_are_shown() -> None:
    n = 30
    model = invtrack.StateSpace(-np.diag(np.arange(1.0, n + 1)), np.ones((n, 1)), np.ones((1, n)))
    shown = model._repr_html_()
    assert shown.count(r"\cdots") == 10 + 1  # of each row that is shown of A, and of C
    assert shown.count(r"\ddots") == 1
    assert "-30" in shown
    assert "-15" not in shown
