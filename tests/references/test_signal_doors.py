"""Arithmetic of signals, and what is refused where it enters."""

from __future__ import annotations

import types
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import invtrack
from invtrack.errors import ModelError, TrajectoryError
from invtrack.references import constant, stack

MOVE, BACK = invtrack.rest_to_rest(0.0, 1.0, duration=2.0), invtrack.rest_to_rest(0.0, 3.0, duration=1.0, start_time=0.5)
TIMES = np.linspace(-1.0, 3.0, 81)
PLANT = invtrack.StateSpace([[0.0, 1.0], [-2.0, -3.0]], [[0.0], [1.0]], [[-1.0, 1.0]])


def test_arithmetic() -> None:
    assert (-MOVE)(TIMES) == pytest.approx(-MOVE(TIMES))
    assert (MOVE - BACK)(TIMES) == pytest.approx(MOVE(TIMES) - BACK(TIMES))
    assert (2 * MOVE)(TIMES) == pytest.approx(2 * MOVE(TIMES))
    assert (MOVE * np.float64(0.5))(TIMES) == pytest.approx(0.5 * MOVE(TIMES))
    assert (np.float64(0.5) * MOVE)(TIMES) == pytest.approx(0.5 * MOVE(TIMES))
    assert (MOVE * 2)(TIMES) == pytest.approx(2 * MOVE(TIMES))
    assert (MOVE / 4)(TIMES) == pytest.approx(MOVE(TIMES) / 4)
    assert (MOVE + 0.5)(TIMES) == pytest.approx(MOVE(TIMES) + 0.5)
    assert (1.0 - MOVE)(TIMES) == pytest.approx(1.0 - MOVE(TIMES))
    assert (MOVE - np.float64(2.0))(TIMES) == pytest.approx(MOVE(TIMES) - 2.0)
    assert sum([MOVE, BACK, MOVE])(TIMES) == pytest.approx(2 * MOVE(TIMES) + BACK(TIMES))
    pair = stack([MOVE, BACK])
    assert (pair + np.array([1.0, -2.0]))(TIMES) == pytest.approx(pair(TIMES) + np.array([1.0, -2.0]))
    assert (pair / [2.0, 5.0])(TIMES) == pytest.approx(pair(TIMES) / [2.0, 5.0])
    assert ([2.0, 3.0] * pair)(TIMES) == pytest.approx(pair(TIMES) * [2.0, 3.0])
    assert ([[1.0, 1.0]] * pair)(TIMES)[:, 0] == pytest.approx(np.sum(pair(TIMES), axis=1))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: MOVE(np.nan), r"expected finite times .* got nan"),
        (lambda: MOVE([0.0, np.inf]), r"expected finite times"),
        (lambda: MOVE("now"), r"times \[s\] must be real numbers"),
        (lambda: MOVE(None), r"times \[s\] must be real numbers"),
        (lambda: MOVE(1j), r"times \[s\] must be real numbers"),
        (lambda: MOVE(1.0, derivative=-1), r"derivative must be a whole number from 0 to 1000, got -1"),
        (lambda: MOVE(1.0, derivative=0.5), r"derivative must be a whole number"),
        (lambda: MOVE.scaled(np.nan), r"expected finite numbers to multiply"),
        (lambda: MOVE.scaled([1.0, 2.0]), r"one for each of its 1 channels"),
        (lambda: MOVE + np.array([1.0, 2.0]), r"one for each of the 1 channels; got \[1.0, 2.0\]"),
        (lambda: MOVE - None, r"what is subtracted from a signal must be real numbers, got None"),
        (lambda: MOVE / 0.0, r"finite numbers other than zero to divide"),
        (lambda: constant([[1.0]]), r"value must be one finite value, or one for each channel"),
        (lambda: constant([]), r"value must be one finite value"),
        (lambda: stack([]), r"list of signals to stack, at least one, got none"),
        (lambda: stack(MOVE), r"must be a list of signals to stack, .* got <signal of 1 channel"),
        (lambda: stack([MOVE, 1.0]), r"signal 1 of those to stack must be a signal.* got 1.0"),
        (lambda: invtrack.invert(PLANT, MOVE).inputs([np.nan]), r"expected finite times"),
        (lambda: invtrack.invert(PLANT, MOVE)(1.0, inside=np.inf), r"expected finite times"),
    ],
)
def test_what_is_no_time_no_signal_and_no_number(call: Callable[[], Any], message: str) -> None:
    with pytest.raises(TrajectoryError, match=message):
        call()


def test_descriptor_systems_are_not_taken_for_plain_ones() -> None:
    matrices = {name: getattr(PLANT, name) for name in "ABCD"}
    with pytest.raises(ModelError, match="got a descriptor system"):
        invtrack.invert(types.SimpleNamespace(**matrices, E=np.diag([1.0, 0.0])), MOVE)
    assert invtrack.invert(types.SimpleNamespace(**matrices, E=np.eye(2)), MOVE).method == "stable inversion"
