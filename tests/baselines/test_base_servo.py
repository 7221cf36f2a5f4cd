"""Servos of the base and the modes of the loop: their poles, and what they refuse."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import invtrack
from invtrack.baselines import base_servo, flexible_modes
from invtrack.errors import ControlError
from tests.baselines.plants import carrier


def test_a_base_that_carries_nothing_gets_the_poles_asked_for() -> None:
    cart = invtrack.StateSpace([[0, 1.0], [0.0, 0.0]], [[0], [0.25]], [[1.0, 0]], states=["place", "speed"])
    K = base_servo(cart, position="place", frequency=5.0, damping=0.6).gains[0]
    assert np.poly(cart.A - cart.B @ K) == pytest.approx([1.0, 2 * 0.6 * 5.0, 25.0])


def test_it_feeds_back_the_base_alone() -> None:
    K = base_servo(carrier(), position="cart", frequency=5.0).gains[0]
    assert np.flatnonzero(K[0]).tolist() == [0, 3]
    assert K[0, [0, 3]] == pytest.approx([2 * 25.0, 2 * 10.0])  # for the 2 kg of the cart


def test_the_other_coordinates_do_not_matter() -> None:
    """The loads' places measured from what carries them."""
    T = np.kron(np.eye(2), np.array([[1.0, 0.0, 0.0], [-1.0, 1.0, 0.0], [0.0, -1.0, 1.0]]))
    relative = carrier().transformed(T, states=carrier().states)
    plain, found = (base_servo(model, position="cart", frequency=5.0).gains[0] for model in (carrier(), relative))
    assert found @ T == pytest.approx(plain)


def test_a_stiff_servo_leaves_the_modes_of_the_mechanism_on_a_fixed_base() -> None:
    model = carrier(damping=0.0)
    fixed = np.sqrt(np.linalg.eigvals(np.array([[130.0 / 0.5, -90.0 / 0.5], [-90.0 / 0.4, 90.0 / 0.4]])))
    gains = base_servo(model, position="cart", frequency=3000.0)
    found = flexible_modes(model, gains=gains)
    assert [mode.frequency for mode in found] == pytest.approx(sorted(fixed), rel=1e-3)
    assert all(0 <= mode.damping < 1e-3 for mode in found)


def test_each_interval_has_the_gains_of_its_own_model() -> None:
    heavy = replace(carrier((10.0, 90.0)), B=carrier().B / 2)
    model = invtrack.SwitchedSystem([carrier(), heavy], [1.0])
    gains = base_servo(model, position="cart", frequency=5.0)
    assert gains.gains[1] == pytest.approx(2 * gains.gains[0])
    assert flexible_modes(model, gains=gains, interval=1) == flexible_modes(heavy, gains=gains.gains[1])
    assert flexible_modes(model, interval=0) != flexible_modes(model, interval=1)


def test_modes_of_a_plant_alone() -> None:
    """Free, with a rigid-body mode, which is none of them."""
    found = flexible_modes(carrier(damping=0.0), most_damping=0.3)
    links = np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0]])
    squares = np.linalg.eigvals(np.diag([1 / 2.0, 1 / 0.5, 1 / 0.4]) @ links.T @ np.diag([40.0, 90.0]) @ links)
    assert [mode.frequency for mode in found] == pytest.approx(np.sqrt(np.sort(squares.real)[1:]), rel=1e-3)
    assert found[0].damped_period == pytest.approx(2 * np.pi / found[0].frequency, rel=1e-3)


@pytest.mark.parametrize("exponents", [(6, -6, 3, 0, -3, 5), (-6, 6, 6, -6, 6, 6)])
def test_units_of_states_do_not_matter(exponents: tuple[int, ...]) -> None:
    T = np.diag(10.0 ** np.array(exponents))
    plain = base_servo(carrier(), position="cart", frequency=5.0).gains[0]
    scaled = base_servo(carrier().transformed(T, states=carrier().states), position="cart", frequency=5.0).gains[0]
    assert scaled @ T == pytest.approx(plain)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"position": "carts"}, r"position must be one of \['cart', 'load 1'"),
        ({"position": "cart speed"}, "no state is the rate of 'cart speed'"),
        ({"position": "load 1"}, "the input 'push' does not drive the position 'load 1'"),
        ({"position": "cart", "frequency": 0.0}, "must be positive, got 0.0"),
        ({"position": "cart", "input": "pull"}, r"input must be one of \['push'\]"),
    ],
)
def test_servos_that_there_are_none_of(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ControlError, match=message):
        base_servo(carrier(), **{"frequency": 5.0, **options})


def test_which_input_must_be_said() -> None:
    two = invtrack.StateSpace(np.diag([1.0], k=1), [[0, 0], [1.0, 2.0]], np.eye(2), inputs=["left", "right"])
    with pytest.raises(ControlError, match=r"say which input drives the position: input= one of \['left', 'right'\]"):
        base_servo(two, position="x1", frequency=1.0)
    assert base_servo(two, position="x1", frequency=1.0, input="right").gains[0] == pytest.approx(np.array([[0, 0], [0.5, 1.0]]))


def test_modes_that_grow_and_calls_that_do_not_fit() -> None:
    with pytest.raises(ControlError, match=r"a mode at .*rad/s grows"):
        flexible_modes(invtrack.StateSpace([[0, 1.0], [-4.0, 0.1]], [[0], [1.0]], [[1.0, 0]]))
    with pytest.raises(ControlError, match="gains have shape"):
        flexible_modes(carrier(), gains=[[1.0]])
    with pytest.raises(ControlError, match="interval must be a whole number from 0 to 0"):
        flexible_modes(carrier(), interval=1)
