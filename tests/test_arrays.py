"""What a user hands over is refused by its name, in the class of error that the room chooses, with what came instead."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from invtrack import arrays
from invtrack.errors import ControlError


@pytest.mark.parametrize(
    ("check", "message"),
    [
        (lambda: arrays.real_numbers("gain", "much", error=ControlError), "gain must be real numbers, got 'much'"),
        (lambda: arrays.real_numbers("gain", [1.0, 2j], error=ControlError), "gain must be real numbers"),
        (lambda: arrays.real_numbers("gain", [[1.0], [1.0, 2.0]], error=ControlError), "gain must be real numbers"),
        (lambda: arrays.real_numbers("gain", np.ma.ones(2), error=ControlError), "got a masked array; fill in or leave out"),
        (lambda: arrays.real_numbers("gain", [True], error=ControlError), "no numbers, but true or false"),
        (lambda: arrays.real_numbers("gain", 10**400, error=ControlError), "gain must be real numbers"),
        (lambda: arrays.real_numbers("gain", 10**5000, error=ControlError), "gain must be real numbers, got a int"),
        (lambda: arrays.whole_number("seed", -(10**5000), error=ControlError), "a whole number from 0 on, got a int"),
        (
            lambda: arrays.real_numbers("gain", [[np.ma.ones(2)]], error=ControlError),
            "gain must be real numbers, got a masked array",
        ),
        (lambda: arrays.real_weight("R", [np.ma.ones(1)], 1, error=ControlError), "R must be numbers, got a masked array"),
        (lambda: arrays.complex_numbers("poles", ["fast"], error=ControlError), "poles must be numbers"),
        (lambda: arrays.complex_numbers("poles", np.ma.ones(2), error=ControlError), "poles must be numbers, got a masked array"),
        (lambda: arrays.real_number("rate", [1.0], unit="Hz", error=ControlError), r"rate must be one number \[Hz\], got an array"),
        (lambda: arrays.finite_number("rate", np.inf, error=ControlError), "rate must be a finite number, got inf"),
        (lambda: arrays.whole_number("seed", True, error=ControlError), "seed must be a whole number from 0 on, got True"),
        (lambda: arrays.whole_number("seed", 3, highest=2, error=ControlError), "seed must be a whole number from 0 to 2, got 3"),
        (lambda: arrays.require_duration("period", "1 s", error=ControlError), "period must be real numbers, got '1 s'"),
        (lambda: arrays.real_matrix("K", np.zeros((1, 1, 1)), error=ControlError), "K must be a matrix of finite real numbers"),
        (lambda: arrays.real_matrix("K", [[np.nan]], error=ControlError), "K must be a matrix .* entries that are not finite"),
        (lambda: arrays.real_matrix("K", [[1.0]], shape=(1, 2), error=ControlError), r"a \(1, 2\) matrix .* got shape \(1, 1\)"),
        (
            lambda: arrays.real_vector("x", [1.0], ["th1", "th2"], error=ControlError),
            r"one number for each of \['th1', 'th2'\], got",
        ),
        (lambda: arrays.real_vector("x", [np.inf], ["th1"], error=ControlError), "x must be finite, one number for each"),
        (lambda: arrays.increasing_times("switch times", [1.0, 1.0], error=ControlError), r"finite and increase, got \[1.0, 1.0\]"),
        (lambda: arrays.increasing_times("switch times", [np.nan], error=ControlError), "finite and increase"),
        (lambda: arrays.increasing_times("switch times", np.zeros(10), error=ControlError), "and 2 more"),
        (lambda: arrays.require_duration("period", 0.0, error=ControlError), "period must be a positive number of seconds, got 0"),
        (lambda: arrays.require_duration("period", np.inf, error=ControlError), "period must be a positive number of seconds"),
        (lambda: arrays.require_not_negative("noise", -1.0, error=ControlError), "noise must be finite and not negative, got -1"),
        (lambda: arrays.require_share("tolerance", 1.0, error=ControlError), "tolerance must lie between 0 and 1, got 1"),
        (
            lambda: arrays.stable_poles("poles", [-1.0, np.nan], 2, error=ControlError),
            "expected 2 poles left of the imaginary axis",
        ),
        (lambda: arrays.real_weight("Q", 1j, 1, error=ControlError), "Q must be Hermitian"),
        (lambda: arrays.real_weight("Q", [[1.0, 0.5], [0.5, 0.25]], 2, definite=True, error=ControlError), "positive definite"),
    ],
)
def test_refusals(check: Callable[[], object], message: str) -> None:
    with pytest.raises(ControlError, match=message):
        check()


@pytest.mark.parametrize("unit", [2.0**-1000, 1.0, 2.0**1022])
def test_a_weight_may_have_any_unit(unit: float) -> None:
    weight = np.array([[1.5, 0.5], [0.5, 1.0]])
    assert np.array_equal(arrays.real_weight("Q", weight * unit, 2, error=ControlError), weight * unit)


def test_what_is_handed_over_is_copied() -> None:
    times = np.array([1.0, 2.0])
    arrays.increasing_times("switch times", times)[0] = 5.0
    assert times[0] == 1.0


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_a_weight_is_judged_in_units_of_its_own_channels(unit: float) -> None:
    """diag(1, unit) W diag(1, unit) is as definite as W, however far the units of the channels lie apart."""
    scale = np.array([1.0, unit])
    definite, indefinite = np.array([[1.0, 0.9], [0.9, 1.0]]), np.array([[1.0, 1.1], [1.1, 1.0]])
    weight = scale[:, None] * definite * scale
    assert np.array_equal(arrays.real_weight("Q", weight, 2, definite=True, error=ControlError), weight)
    with pytest.raises(ControlError, match=r"positive semidefinite, its smallest eigenvalue is -0\.1 of its size"):
        arrays.real_weight("Q", scale[:, None] * indefinite * scale, 2, error=ControlError)


class Untold:
    """An object without a text."""

    def __repr__(self) -> str:
        raise RuntimeError("not to be told")


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        ("much", "'much'"),
        (list(range(100)), "a list"),
        (np.ones((2, 3)), "an array of shape (2, 3)"),
        pytest.param(10**5000, "a int", id="integer of 5001 digits"),
        (Untold(), "a Untold"),
    ],
)
def test_what_a_message_shows_of_a_value(value: object, expected: str) -> None:
    assert arrays.shown(value) == expected
