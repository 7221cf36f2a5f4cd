"""Fast and slow modes taken apart: coordinates right to twice the precision, and what optima with cheap inputs gain by them."""

from __future__ import annotations

import numpy as np
import pytest

from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.redesign.double_double import DoubleDouble
from invtrack.redesign.paces import SETTLED, by_pace
from invtrack.redesign.quadratic import quadratic_redesign
from invtrack.redesign.schur_form import SchurForm
from invtrack.references.profiles import rest_to_rest
from invtrack.references.signal import PiecewiseSignal, stack
from tests.redesign.exact import exact, largest

SLOW = np.array([[-1.0, 2.0, 0.0], [-2.0, -1.0, 1.0], [0.0, 0.0, -3.0]])
FAST = 2.0**12 * np.array([[-1.0, 5.0], [0.0, -2.0]])
FASTEST = -(2.0**30) * np.ones((1, 1))


def mixed() -> np.ndarray:
    """Blocks whose modes are known, in coordinates that mix them by whole numbers, so that nothing is rounded."""
    blocks = np.zeros((6, 6))
    blocks[:3, :3], blocks[3:5, 3:5], blocks[5:, 5:] = SLOW, FAST, FASTEST
    rng = np.random.default_rng(3)
    lower = np.eye(6) + np.tril(rng.integers(-1, 2, size=(6, 6)), -1)
    upper = np.eye(6) + np.triu(rng.integers(-1, 2, size=(6, 6)), 1)
    mixing, unmixing = lower @ upper, np.rint(np.linalg.solve(lower @ upper, np.eye(6)))
    assert np.array_equal(mixing @ unmixing, np.eye(6))
    return mixing @ blocks @ unmixing


def test_coordinates_in_rational_arithmetic() -> None:
    M = mixed()
    at = by_pace(DoubleDouble.of(M), SchurForm(M))
    V, U = exact(at.V), exact(at.U)
    # The last correction is worked out in doubles.
    missing = SETTLED * np.finfo(float).eps * np.linalg.cond(at.V.rounded)
    assert largest(U.T @ V - exact(np.eye(6))) < missing
    apart = U.T @ exact(M) @ V
    for block, size in ((slice(0, 3), 4.0), (slice(3, 5), 2.0**15), (slice(5, 6), 2.0**30)):
        assert largest(apart[block, block] - exact(at.A[block, block])) < 1e-14 * size
        apart[block, block] -= apart[block, block]
    assert largest(apart) < missing * np.max(np.abs(M))


def test_slow_modes_keep_their_digits_beside_fast_ones() -> None:
    M = mixed()
    at = by_pace(DoubleDouble.of(M), SchurForm(M))
    slow = np.linalg.eigvals(at.A[:3, :3])
    assert np.sort_complex(slow) == pytest.approx(np.array([-3.0, -1.0 - 2.0j, -1.0 + 2.0j]), rel=1e-13)
    assert np.sort(np.linalg.eigvals(at.A[3:5, 3:5])) == pytest.approx(2.0**12 * np.array([-2.0, -1.0]), rel=1e-13)
    assert at.A[5, 5] == pytest.approx(-(2.0**30), rel=1e-15)
    blocks = np.array([0, 0, 0, 1, 1, 2])
    assert not np.any(at.A[blocks[:, None] != blocks])


@pytest.mark.parametrize(
    "M",
    [
        pytest.param(np.array([[-1.0, 4.0], [0.0, -10.0]]), id="alike"),
        pytest.param(np.array([[-1.0, 1e6], [0.0, -100.0]]), id="leaning on each other"),
    ],
)
def test_what_is_not_worth_taking_apart_stays_whole(M: np.ndarray) -> None:
    at = by_pace(DoubleDouble.of(M), SchurForm(M))
    assert at.whole
    assert np.array_equal(at.A, M)
    assert at.of_states(DoubleDouble.of(M)).high is M


def random_plant() -> StateSpace:
    rng = np.random.default_rng(0)
    A = rng.normal(size=(24, 24)) / np.sqrt(24) - 1.3 * np.eye(24)
    return StateSpace(A, rng.normal(size=(24, 2)), rng.normal(size=(2, 24)))


def there_and_back() -> PiecewiseSignal:
    one = rest_to_rest(0.0, 1.0, 5.0, smoothness=6) + rest_to_rest(0.0, -1.0, 5.0, smoothness=6, start_time=5.0)
    return stack([one] * 2)


@pytest.mark.parametrize("R", [1e-4, 1e-6])
def test_the_costate_of_cheap_inputs_is_certified_beside_modes_a_thousand_times_as_fast(R: float) -> None:
    """Two outputs with as many fast modes, whose rounding once hid the costate of the 22 slow ones, which is as small as R."""
    plan = quadratic_redesign(random_plant(), there_and_back(), R=R, Q_y=1.0)
    assert plan.optimality_gap < 1e-9
    assert not any("certified" in remark for remark in plan.remarks)


def test_inputs_of_unlike_cost_through_jumps() -> None:
    """Three paces apart; the jumps of the costate at the fastest one's rounding once had this refused."""
    one = random_plant()
    other = StateSpace(1.05 * one.A, one.B * np.array([1.1, 0.9]), one.C)
    plant = SwitchedSystem([one, other, one], [3.0, 7.0])
    plan = quadratic_redesign(plant, there_and_back(), R=np.diag([1e-8, 1e-4]), Q_y=1.0)
    assert plan.optimality_gap < 1e-7
    assert plan.certificate.worst(exact=False) < 1e-10
