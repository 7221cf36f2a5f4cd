"""Bryson's rule: the largest deviations all cost the same, whatever the units."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import invtrack
from invtrack.channels import Channels
from invtrack.errors import ControlError
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem

A, B, C = [[0.0, 1.0], [-4.0, -0.2]], [[0.0], [2.0]], [[3.0, 0.0]]
NAMES = {
    "states": Channels(["angle", "speed"], ["rad", "rad/s"]),
    "inputs": Channels(["motor"], ["N m"]),
    "outputs": Channels(["tip"], ["m"]),
}
MODEL = StateSpace(A, B, C, **NAMES, input_limits=[[-1.0, 5.0]])
UNLIMITED = StateSpace(A, B, C, **NAMES)


def test_each_largest_deviation_costs_one() -> None:
    Q, R = invtrack.bryson(MODEL, states={"speed": 0.5}, outputs={"tip": 0.06}, inputs={"motor": 4.0})
    for x in ([0.0, 0.5], [0.02, 0.0]):  # the tip is three times the angle
        assert np.array(x) @ Q @ np.array(x) == pytest.approx(1.0)
    assert pytest.approx(np.array([[1 / 16]])) == R


def test_inputs_count_by_half_their_range_unless_named() -> None:
    _, R = invtrack.bryson(MODEL, outputs={"tip": 0.1})
    assert R[0, 0] == pytest.approx(1 / 9)


def test_the_gain_is_the_same_mechanism_in_any_units() -> None:
    """Millimetres, degrees and millinewton metres give the same closed loop, and a gain that is the same once converted."""
    T, unit = np.diag([180 / np.pi, 180 / np.pi]), 1e3
    other = StateSpace(
        T @ A @ np.linalg.inv(T), T @ B / unit, np.multiply(1e3, C) @ np.linalg.inv(T), **{k: v.names for k, v in NAMES.items()}
    )
    Q, R = invtrack.bryson(MODEL, states={"speed": 0.5}, outputs={"tip": 0.06}, inputs={"motor": 4.0})
    (K,) = invtrack.lqr(MODEL, Q=Q, R=R).gains
    degrees = 0.5 * 180 / np.pi
    Q, R = invtrack.bryson(other, states={"speed": degrees}, outputs={"tip": 60.0}, inputs={"motor": 4e3})
    (converted,) = invtrack.lqr(other, Q=Q, R=R).gains
    assert converted @ T / unit == pytest.approx(K, rel=1e-9)


def test_a_switched_plant_has_one_weight_as_long_as_its_output_reads_alike() -> None:
    heavy = StateSpace([[0.0, 1.0], [-1.0, -0.1]], B, C, **NAMES, input_limits=[[-2.0, 2.0]])
    _, R = invtrack.bryson(SwitchedSystem([MODEL, heavy], [1.0]), outputs={"tip": 0.1})
    assert R[0, 0] == pytest.approx(1 / 2.25)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: invtrack.bryson(MODEL), r"at least one state or output, such as outputs=\{'tip': 0.01\}; .* angle \[rad\]"),
        (lambda: invtrack.bryson(MODEL, states={"tip": 1.0}), "states has no 'tip'; expected some of the states angle, speed"),
        (lambda: invtrack.bryson(MODEL, outputs={"tip": 0.0}), r"deviation of tip \[m\] must be positive, .* got 0"),
        (lambda: invtrack.bryson(MODEL, outputs={"tip": np.nan}), r"deviation of tip \[m\] must be a finite number"),
        (lambda: invtrack.bryson(MODEL, outputs=[0.1]), "outputs must be a dict of largest"),  # type: ignore[arg-type]
        (
            lambda: invtrack.bryson(UNLIMITED, outputs={"tip": 0.1}),
            r"the inputs motor \[N m\], for which the model states no",
        ),
        (lambda: invtrack.bryson(StateSpace(A, B, C, [[1.0]]), outputs={"y1": 0.1}), "depends on the input at once"),
        (
            lambda: invtrack.bryson(SwitchedSystem([MODEL, StateSpace(A, B, [[2.0, 0.0]], **NAMES)], [1.0]), outputs={"tip": 0.1}),
            "reads the states differently from interval to interval",
        ),
    ],
)
def test_bad_input_is_refused(build: Callable[[], object], message: str) -> None:
    with pytest.raises(ControlError, match=message):
        build()
