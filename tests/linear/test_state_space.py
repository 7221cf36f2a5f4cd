"""Linear models: what they accept, what they refuse, and changes of coordinates."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import control
import numpy as np
import pytest
import scipy.signal

from invtrack.errors import ModelError
from invtrack.linear.state_space import OperatingPoint, StateSpace, as_state_space

RAGGED: Any = [[1.0, 2.0], [3.0]]
A, B, C = np.array([[0.0, 1.0], [-2.0, -3.0]]), np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]])


def response(system: Any, s: complex) -> Any:
    """C (s I - A)^-1 B + D."""
    return system.C @ np.linalg.solve(s * np.eye(len(system.A)) - system.A, system.B) + system.D


def point(u0: Any, y0: Any) -> OperatingPoint:
    return OperatingPoint(x0=np.zeros(2), u0=np.asarray(u0, dtype=float), y0=np.asarray(y0, dtype=float))


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: StateSpace(A[:1], B, C), r"A has shape \(1, 2\), expected \(1, 1\)"),
        (lambda: StateSpace(A, B[:1], C), r"B has shape \(1, 1\), expected \(2, 1\)"),
        (lambda: StateSpace(A, B, np.eye(3)), r"C has shape \(3, 3\), expected \(3, 2\) for 2 states, 1 inputs and 3 outputs"),
        (lambda: StateSpace(A, B, C, input_limits=[-1.0, 1.0]), r"input_limits must be \(1, 2\), lowest before highest"),
        (lambda: StateSpace(A, B, C, input_limits=[[1.0, -1.0]]), r"input_limits must be \(1, 2\), lowest before highest"),
        (lambda: StateSpace(A, B, C).with_outputs(["tip"]), r"expected some of the outputs \['y1'\], each once, got \['tip'\]"),
        (lambda: StateSpace(A, B, C, np.zeros((1, 2))), r"D has shape \(1, 2\), expected \(1, 1\)"),
        (lambda: StateSpace(A, [0.0, 1.0], C), "B must be a matrix, got an array with 1 dimension"),
        (lambda: StateSpace([[0.0, np.nan], [0.0, 0.0]], B, C), "A has entries that are not finite"),
        (lambda: StateSpace(A, B, [[np.inf, 0]]), "C has entries that are not finite"),
        (lambda: StateSpace(RAGGED, B, C), "A must be real numbers"),
        (lambda: StateSpace(A, [["a"], ["b"]], C), "B must be real numbers"),
        (lambda: StateSpace(A * 1j, B, C), "A must be real numbers"),
        (lambda: StateSpace(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), [[1.0]]), "at least one state"),
        (lambda: StateSpace(A, B, C, states=["a", "a"]), r"expected 2 distinct state names, got \['a', 'a'\]"),
        (lambda: StateSpace(A, B, C, inputs=["a", "b"]), "expected 1 distinct input names"),
        (lambda: StateSpace(A, B, C, outputs=[]), "expected 1 distinct output names"),
        (lambda: StateSpace(A, B, C, operating_point=point([1, 2], [0])), r"u0 of shape \(2,\).*expected \(1,\)"),
        (lambda: StateSpace(A, B, C, operating_point=point([np.nan], [0])), "not finite"),
        (lambda: StateSpace(A, B, C, rest=[1.0]), r"rest has shape \(1,\), expected \(2,\), one value for each state"),
        (lambda: StateSpace(A, B, C, rest=[np.inf, 0.0]), "rest has entries that are not finite"),
        (lambda: StateSpace(A, B, C).transformed(np.eye(3)), r"T has shape \(3, 3\), expected \(2, 2\)"),
        (lambda: StateSpace(A, B, C).transformed([[1, 1], [1, 1]]), "T is singular"),
        (lambda: as_state_space([A, B, C]), "list has no A, B, C, D"),
        (lambda: as_state_space(control.tf([1], [1, 1])), "convert a transfer function to state space first"),
        (lambda: as_state_space(control.ss(A, B, C, 0, 0.1)), "sampling time 0.1"),
        (lambda: as_state_space(scipy.signal.StateSpace(A, B, C, 0, dt=0.1)), "sampling time 0.1"),
    ],
)
def test_bad_input_is_refused(build: Callable[[], object], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        build()


def test_names_are_given_where_none_are() -> None:
    system = StateSpace(A, B, C, outputs=["tip"])
    assert (system.states.names, system.inputs.names, system.outputs.names) == (("x1", "x2"), ("u1",), ("tip",))
    assert (system.n_states, system.n_inputs, system.n_outputs) == (2, 1, 1)
    assert pytest.approx(np.zeros((1, 1))) == system.D


def test_matrices_are_copies_that_cannot_be_changed() -> None:
    mine = A.copy()
    system = StateSpace(mine, B, C)
    mine[0, 0] = 7.0
    assert system.A[0, 0] == pytest.approx(0.0)
    with pytest.raises(ValueError, match="read-only"):
        system.A[0, 0] = 1.0


@pytest.mark.parametrize("convert", [control.ss, scipy.signal.StateSpace])
def test_conversion_keeps_the_transfer_function(convert: Callable[..., Any]) -> None:
    D = np.array([[0.5]])
    system = as_state_space(convert(A, B, C, D))
    s = 0.3 + 0.7j
    assert response(system, s)[0, 0] == pytest.approx(1 / (s**2 + 3 * s + 2) + 0.5)
    assert as_state_space(system) is system


def test_change_of_coordinates_keeps_the_transfer_function_and_the_frame() -> None:
    operating_point = point([2.0], [3.0])
    system = StateSpace(A, B, C, [[0.1]], inputs=["force"], operating_point=operating_point)
    T = np.array([[1.0, 2.0], [-1.0, 1e3]])
    other = system.transformed(T, states=["a", "b"])
    s = -0.4 + 2j
    assert response(other, s) == pytest.approx(response(system, s))
    assert pytest.approx(T @ A) == other.A @ T
    assert other.states.names == ("a", "b")
    assert other.inputs.names == ("force",)
    assert other.operating_point is operating_point


def test_change_of_coordinates_takes_the_rest_along() -> None:
    system = StateSpace(A, B, C, operating_point=OperatingPoint([1.0, -3.0], [0.0], [0.0]), rest=[0.5, 2.0])
    T = np.array([[1.0, 2.0], [-1.0, 1e3]])
    assert system.transformed(T).rest == pytest.approx(T @ [0.5, 2.0])
    assert system.transformed(T).operating_point.x0 == pytest.approx(T @ [1.0, -3.0])
    configuration = OperatingPoint([1.0, 0.0, 0.0, 0.0], [0.0], [0.0])  # a mechanism's, longer than the state
    assert StateSpace(A, B, C, operating_point=configuration).transformed(T).operating_point is configuration


def test_change_of_coordinates_carries_error_estimates_along() -> None:
    """No entry of the transformed model may be further off than the estimate says."""
    rng = np.random.default_rng(4)
    T, error = rng.normal(size=(2, 2)), 1e-6
    model = StateSpace(A, B, C, error_estimates={"A": error, "B": error, "C": error}).transformed(T)
    exact = StateSpace(A, B, C).transformed(T)
    for _ in range(20):
        signs = [rng.choice([-error, error], size=M.shape) for M in (A, B, C)]
        off = StateSpace(A + signs[0], B + signs[1], C + signs[2]).transformed(T)
        for name in "ABC":
            assert np.all(np.abs(getattr(off, name) - getattr(exact, name)) <= 1.001 * model.error_estimates[name])


def test_operating_points_agree_up_to_rounding() -> None:
    first = point([1e6], [0.0])
    assert first.agrees_with(point([1e6 * (1 + 1e-12)], [1e-12]))
    assert not first.agrees_with(point([1e6], [1e-6]))
    assert not first.agrees_with(OperatingPoint(np.zeros(3), first.u0, first.y0))


@pytest.mark.parametrize("left_out", ["dry friction", [0.3], 1])
def test_what_is_left_out_is_a_list_of_texts(left_out: object) -> None:
    with pytest.raises(ModelError, match="left_out must be a list of texts"):
        StateSpace(A, B, C, left_out=left_out)  # type: ignore[arg-type]
