"""Modified inversion through parameter jumps: the state is continuous, e stays zero until it is disturbed."""

from __future__ import annotations

import numpy as np
import pytest

from invtrack.errors import BoundednessError
from invtrack.inversion.exact import invert
from invtrack.inversion.modified.modified_inversion import modified_inversion
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.linear.zeros import zeros
from invtrack.references.exosystem import sinusoidal_exosystem
from invtrack.references.profiles import raised_cosine, rest_to_rest
from tests.cited_plants import CANTILEVER_M, CANTILEVER_S, cantilever_paper
from tests.inversion.modified_cases import PASSIVE_TWO_DISC, TWO_DISC
from tests.random_draws.plants import Matrices, Units
from tests.random_draws.shooting import contradiction

CANTILEVER = SwitchedSystem([StateSpace(*cantilever_paper(m)) for m in (0.0, 100.0, 10.0)], [1.5, 4.0])
SLOW = 0.234538
NEAR_AXIS = 0.02


def test_without_moved_zeros_it_is_the_exact_inverse() -> None:
    plan, exact = (
        modified_inversion(CANTILEVER, raised_cosine(2.0), move={}, error_poles=[-1.0, -2.0]),
        invert(CANTILEVER, raised_cosine(2.0)),
    )
    t = np.linspace(-20.0, 20.0, 201)
    assert np.max(np.abs(plan(t).u - exact(t).u)) < 1e-9 * np.max(np.abs(exact(t).u))
    assert plan.max_error[0] < 1e-11


@pytest.mark.parametrize("interval", [None, 0, 1, 2, [0, 2]])
def test_state_is_continuous_and_the_output_comes_to_rest(interval: int | list[int] | None) -> None:
    plan = modified_inversion(CANTILEVER, raised_cosine(2.0), move={SLOW: 1.0}, error_poles=[-1.0, -2.0], interval=interval)
    assert max(plan.certificate.dynamics_residual, plan.certificate.continuity) < 1e-12
    assert np.max(np.abs(plan.tracking_error([-150.0, 150.0]))) < 1e-10
    moved = [bool(np.any(change.zeros_after != change.zeros_before)) for change in plan.modification]
    named = range(3) if interval is None else np.atleast_1d(interval)
    assert moved == [k in named for k in range(3)]


def test_output_is_exact_until_it_is_disturbed() -> None:
    plan = modified_inversion(CANTILEVER, raised_cosine(2.0), move={SLOW: 1.0}, error_poles=[-1.0, -2.0], interval=2)
    before, after = np.linspace(-20.0, 4.0, 100), np.linspace(4.05, 6.2, 50)
    assert np.max(np.abs(plan.tracking_error(before, inside=before - 1e-9))) < 1e-11
    assert np.max(np.abs(plan.tracking_error(after))) > 1e-3


def test_moving_the_slow_zero_before_shortens_the_preactuation() -> None:
    exact = invert(CANTILEVER, raised_cosine(2.0))
    plan = modified_inversion(CANTILEVER, raised_cosine(2.0), move={SLOW: 1.0}, error_poles=[-1.0, -2.0], interval=0)
    assert plan.alpha == pytest.approx(1.0)
    assert plan.preactuation < 0.3 * exact.preactuation


def test_axis_zeros_of_an_end_can_be_moved_there_alone() -> None:
    model = SwitchedSystem([TWO_DISC, PASSIVE_TWO_DISC], [2.0])
    slew = rest_to_rest(0.0, 1.0, 5.0, smoothness=3)
    plan = modified_inversion(model, slew, axis_distance=0.1, real_part=0.8, error_poles=[-1.0, -2.0], interval=1)
    assert plan.modification[0].alpha == pytest.approx(0.21998, rel=1e-4)
    assert np.max(np.abs(plan.tracking_error([-120.0, 120.0]))) < 1e-10


def test_each_name_moves_the_zero_of_the_intervals_that_have_it() -> None:
    model = SwitchedSystem([TWO_DISC, PASSIVE_TWO_DISC, TWO_DISC], [1.5, 3.0])
    slew = rest_to_rest(2.0, 5.0, 5.0, smoothness=3)
    plan = modified_inversion(model, slew, move={0.22 + 4.75j: 1 + 4.5j, 4.755j: 2 + 5j}, error_poles=[-1.0, -2.0])
    after = [np.max(change.zeros_after.imag) * 1j + np.max(change.zeros_after.real) for change in plan.modification]
    np.testing.assert_allclose(after, [1 + 4.5j, 2 + 5j, 1 + 4.5j], rtol=1e-12)
    assert max(plan.certificate.dynamics_residual, plan.certificate.continuity) < 1e-12
    assert np.max(np.abs(plan.tracking_error([-80.0, 80.0]))) < 1e-10


def test_more_end_conditions_than_unknowns_is_refused() -> None:
    """Made stable before the jumps but not after them, the slow zero leaves one condition too many."""
    with pytest.raises(BoundednessError, match=r"give 1 unknown\(s\) for the 2 condition\(s\)"):
        modified_inversion(CANTILEVER, raised_cosine(2.0), move={SLOW: -1.0}, error_poles=[-1.0, -2.0], interval=0)


def soft_cantilever(m_t: float) -> Matrices:
    """The cantilever whose tip hardly resists rotation, S_33 = 3.006 instead of 4: zeros +-0.02, whatever the tip mass.

    They are those of the second and third equation with the output at rest, for forces from the base's place and the rotation.
    """
    M, S, square = CANTILEVER_M + np.diag([0.0, m_t, 0.0]), CANTILEVER_S.copy(), NEAR_AXIS**2
    held = S[1:, [0, 2]] + square * M[1:, [0, 2]]
    S[2, 2] = held[0, 1] * held[1, 0] / held[0, 0] - square * M[2, 2]
    A = np.block([[np.zeros((3, 3)), np.eye(3)], [-np.linalg.solve(M, S), np.zeros((3, 3))]])
    B = np.concatenate([np.zeros(3), np.linalg.solve(M, [1.0, 0.0, 0.0])])[:, None]
    return Matrices(A, B, np.eye(6)[[1]], np.zeros((1, 1)))


def test_jumps_zeros_near_the_axis_and_a_reference_that_goes_on() -> None:
    """y_d = 1 - cos t from t = 0 on, for ever, a tip mass that changes twice, and zeros at +-0.02: all in one problem."""
    plants, times = [soft_cantilever(m_t) for m_t in (0.0, 100.0, 10.0)], np.array([np.pi / 2, 3 * np.pi / 2])
    model = SwitchedSystem([StateSpace(plant.A, plant.B, plant.C) for plant in plants], times)
    sway = sinusoidal_exosystem([1.0], bias=True, start=0.0).reference([1.0, -1.0, 0.0])
    exact = invert(model, sway)
    plan = modified_inversion(model, sway, move={NEAR_AXIS: 0.5}, error_poles=[-1.0, -2.0])
    assert exact.preactuation == pytest.approx(np.log(1e10) / NEAR_AXIS, rel=0.05)
    assert plan.preactuation < 45.0
    assert plan.alpha == pytest.approx(0.5)
    for found in (exact, plan):
        assert found.certificate.worst(exact=False) < 1e-9
    units = Units(np.ones(6), np.ones(1), np.ones(1))
    independent = contradiction(plan, plants, times, units, zeros=zeros(model.systems[0]))
    assert max(independent.dynamics, independent.continuity) < 1e-9
    assert exact.certificate.output_error < 1e-12
    assert np.max(np.abs(plan.tracking_error(np.linspace(-40.0, 100.0, 2000)))) < 1.0
    # Long after, all that is left is the response to the sway.
    late = np.linspace(1000.0, 1000.0 + 2 * np.pi, 9)
    for found in (exact, plan):
        x = found.states(late)
        assert x[-1] == pytest.approx(x[0], abs=1e-6 * np.max(np.abs(x)))
