"""The steady state of each wanted output: right where it stands still, no trajectory where it moves."""

from __future__ import annotations

import numpy as np
import pytest

from invtrack.errors import InversionError, TrajectoryError
from invtrack.inversion.no_preactuation import steady_state_feedforward
from invtrack.linear.state_space import OperatingPoint, StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.references.profiles import constant, raised_cosine, rest_to_rest
from tests.cited_plants import cantilever_paper

CANTILEVER = StateSpace(*cantilever_paper(0.0))
SPRING = StateSpace([[0.0, 1.0], [-4.0, -0.5]], [[0.0], [2.0]], [[1.0, 0.0]])  # held at y by u = 2 y


def test_state_and_input_would_hold_the_output() -> None:
    plan = steady_state_feedforward(SPRING, rest_to_rest(1.0, 3.0, 2.0))
    t = np.linspace(-3.0, 5.0, 50)
    at = plan(t)
    assert at.u[:, 0] == pytest.approx(2 * at.y_d[:, 0])
    assert at.x == pytest.approx(np.column_stack([at.y_d[:, 0], np.zeros(50)]), abs=1e-14)
    assert at.y == pytest.approx(at.y_d)


def test_the_whole_cantilever_moves_with_its_tip() -> None:
    """Nothing bends where nothing accelerates: base and tip together, no rotation, no force."""
    at = steady_state_feedforward(CANTILEVER, raised_cosine(2.0))([1.0, 4.0])
    assert at.x == pytest.approx(at.y_d * np.array([1.0, 1.0, 0.0, 0.0, 0.0, 0.0]), abs=1e-12)
    assert at.u == pytest.approx(np.zeros((2, 1)), abs=1e-11)


def test_it_starts_and_ends_with_the_motion() -> None:
    plan = steady_state_feedforward(CANTILEVER, raised_cosine(2.0))
    assert (plan.start, plan.end) == pytest.approx((0.0, 2 * np.pi))
    assert any("not a trajectory of the plant" in remark for remark in plan.remarks)


def test_its_certificate_shows_that_it_is_no_trajectory() -> None:
    assert steady_state_feedforward(SPRING, rest_to_rest(0.0, 1.0, 3.0)).certificate.dynamics_residual > 0.1
    assert steady_state_feedforward(CANTILEVER, raised_cosine(2.0)).certificate.dynamics_residual > 0.1
    assert steady_state_feedforward(SPRING, constant(2.0)).certificate.dynamics_residual < 1e-14
    assert steady_state_feedforward(CANTILEVER, raised_cosine(2.0)).certificate.output_error < 1e-12


def test_each_interval_has_its_own_steady_state() -> None:
    stiffer = StateSpace([[0.0, 1.0], [-8.0, -0.5]], [[0.0], [2.0]], [[1.0, 0.0]])
    plan = steady_state_feedforward(SwitchedSystem([SPRING, stiffer], [1.0]), constant(1.0, at=0.0))
    assert plan([0.5, 1.5]).u[:, 0] == pytest.approx([2.0, 4.0])


def test_operating_point() -> None:
    point = OperatingPoint(x0=np.zeros(2), u0=np.array([10.0]), y0=np.array([1.0]))
    plan = steady_state_feedforward(StateSpace(SPRING.A, SPRING.B, SPRING.C, operating_point=point), constant(4.0))
    assert plan(0.0).u[0, 0] == pytest.approx(10.0 + 2 * 3.0)
    assert plan(0.0).x[0] == pytest.approx([3.0, 0.0])
    assert plan(0.0).y[0] == pytest.approx([4.0])


@pytest.mark.parametrize("exponents", [(6, -6, 0, 6, -6, 0), (-6, 6, 6, -6, 6, 6)])
def test_units_do_not_decide_what_can_be_held(exponents: tuple[int, ...]) -> None:
    unit = 10.0 ** np.array(exponents)
    scaled = StateSpace(unit[:, None] * CANTILEVER.A / unit, unit[:, None] * CANTILEVER.B * 1e6, 1e-6 * CANTILEVER.C / unit)
    expected = steady_state_feedforward(CANTILEVER, raised_cosine(2.0))([2.0]).x * unit
    found = steady_state_feedforward(scaled, raised_cosine(2e-6))([2.0]).x
    assert found[0, :2] == pytest.approx(expected[0, :2], rel=1e-9)


def test_refusals() -> None:
    washout = StateSpace([[-1.0]], [[1.0]], [[-1.0]], [[1.0]])  # s / (s + 1)
    with pytest.raises(InversionError, match=r"outputs \['y1'\] cannot be held at constant values \(a zero at s = 0\)"):
        steady_state_feedforward(washout, constant(1.0))
    with pytest.raises(TrajectoryError, match="the reference has 2 channels, the plant 1 outputs"):
        steady_state_feedforward(SPRING, constant([1.0, 2.0]))
