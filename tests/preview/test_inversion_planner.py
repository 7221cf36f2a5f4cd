"""Inversion with preview, against quadratures of its definition and against plans that know everything."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from invtrack.errors import BoundednessError, PlanError, TrajectoryError
from invtrack.inversion.exact import invert
from invtrack.linear.state_space import OperatingPoint, StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.problem import steps
from invtrack.preview import inversion_planner, preview_inversion
from invtrack.references.profiles import constant, piecewise_polynomial, raised_cosine, rest_to_rest
from invtrack.references.signal import PiecewiseSignal
from tests.cited_plants import CANTILEVER_TIP_MASSES, TWO_DISC_A, TWO_DISC_B, TWO_DISC_C, cantilever_paper

ZERO = 1.5  # [rad/s]
JUMPS = np.array([0.5, 1.5]) * np.pi  # [s]


def unstable_zero(a: float = ZERO, y_0: float = 0.0) -> StateSpace:
    """y' = eta + u - y, eta' = a eta + y: with the output at y the zero a is the internal dynamics' own."""
    point = OperatingPoint(np.zeros(2), np.array([3.0]), np.array([y_0]))
    return StateSpace([[-1.0, 1.0], [1.0, a]], [[1.0], [0.0]], [[1.0, 0.0]], operating_point=point)


def two_disc() -> StateSpace:
    return StateSpace(TWO_DISC_A, TWO_DISC_B, TWO_DISC_C)


def cantilever() -> SwitchedSystem:
    return SwitchedSystem([StateSpace(*cantilever_paper(mass)) for mass in CANTILEVER_TIP_MASSES], JUMPS)


def test_the_internal_state_is_the_integral_over_what_is_known() -> None:
    """eta(t) = -integral of e^(-a (s - t)) y_d(s), with y_d held from t + T_p on, and u = y_d' + y_d - eta."""
    preview, reference = 0.8, rest_to_rest(0.0, 2.0, 1.0)
    nodes, shares = np.polynomial.legendre.leggauss(24)
    planner = inversion_planner(unstable_zero(), preview=preview, period=0.1, start=-1.0)
    for _ in range(20):
        piece = planner.update(reference)
        t, known = piece.start, piece.start + preview
        integral = np.exp(-ZERO * preview) / ZERO * reference(known)[0]
        edges = [t, *(edge for edge in (0.0, 1.0) if t < edge < known), known]
        for a, b in itertools.pairwise(edges):
            s = a + (b - a) * (nodes + 1) / 2
            integral += (b - a) / 2 * shares @ (np.exp(-ZERO * (s - t)) * reference(s)[:, 0])
        assert piece.x == pytest.approx([reference(t)[0], -integral], abs=1e-12)
        assert piece.u - 3.0 == pytest.approx([reference(t, derivative=1)[0] + reference(t)[0] + integral], abs=1e-12)
        assert piece([t]).x[0] == pytest.approx(piece.x, abs=1e-12)


@pytest.mark.parametrize("y_0", [0.0, 5.0])
def test_a_long_preview_is_as_good_as_knowing_everything(y_0: float) -> None:
    reference = rest_to_rest(y_0, y_0 + 1.0, 1.0)
    model = unstable_zero(y_0=y_0)
    exact, plan = invert(model, reference), preview_inversion(model, reference, preview=16.0, period=0.25)
    t = np.linspace(-3.0, 3.0, 301)
    assert plan.states(t) == pytest.approx(exact.states(t), abs=1e-9)
    assert plan.inputs(t) == pytest.approx(exact.inputs(t), abs=1e-9)


def test_through_jumps_of_the_plant_too() -> None:
    """After 60 s the slow zero, 0.2345, is down to 8e-7 of its share in the peak."""
    exact = invert(cantilever(), raised_cosine(2.0))
    plan = preview_inversion(cantilever(), raised_cosine(2.0), preview=60.0, period=0.5)
    t = np.linspace(-20.0, 15.0, 701)
    peaks = np.max(np.abs(exact.states(t)), axis=0)
    assert np.max(np.abs(plan.states(t) - exact.states(t)) / peaks) < 3e-6
    assert np.max(np.abs(plan.inputs(t) - exact.inputs(t))) < 3e-6 * np.max(np.abs(exact.inputs(t)))
    assert plan.certificate.output_error < 1e-12


@pytest.mark.parametrize("seam", [0.3, 2.0, 5.5])
def test_beyond_what_is_known_the_outputs_count_as_going_straight_on(seam: float) -> None:
    """A first update that knows the motion up to the seam, jumps before and after it, plans the exact inverse of the straight line.

    That line, stopped 150 s later, is inverted as a whole; of the slow zero e^(-35) is then left.
    """
    hidden, straight = _stopped(seam, seam + 0.1), _stopped(seam, seam + 150.0)
    planner = inversion_planner(cantilever(), preview=seam + 4.0, period=seam + 4.0, start=-4.0)
    piece, exact = planner.update(hidden), invert(cantilever(), straight)
    t = np.linspace(piece.start, seam, 60)[1:-1]
    assert piece(t).x == pytest.approx(exact.states(t), abs=1e-9 * np.max(np.abs(exact.states(t))))
    assert piece(t).u == pytest.approx(exact.inputs(t), abs=1e-9 * np.max(np.abs(exact.inputs(t))))


def _stopped(seam: float, later: float) -> PiecewiseSignal:
    """t^2 up to the seam, straight on until later, and a slowing down to rest."""
    y, slope = seam**2, 2 * seam
    end = y + slope * (later - seam)
    return piecewise_polynomial([0.0, seam, later, later + seam], [[0.0, 0.0, 1.0], [y, slope, 0.0], [end, slope, -1.0]])


def test_what_is_new_changes_the_plan_at_the_rate_of_the_slowest_unstable_zero() -> None:
    def change(preview: float) -> float:
        planner = inversion_planner(unstable_zero(), preview=preview, period=0.1)
        planner.update()
        piece = planner.update(rest_to_rest(0.0, 1.0, 1.0, start_time=planner.known_until))
        return float(np.abs(piece.input_change[0]))

    assert change(3.0) / change(2.0) == pytest.approx(np.exp(-ZERO), rel=1e-9)


def test_without_news_the_plan_goes_on_as_it_was_foreseen() -> None:
    planner = inversion_planner(cantilever(), preview=6.0, period=0.25, start=-6.0)
    reference = raised_cosine(2.0)
    for _ in range(24):
        planner.update(reference)
    for _ in range(40):  # through the second jump and beyond the motion's end
        last, piece = planner.time, planner.update(reference)
        if last + 5.75 > 2 * np.pi:
            assert np.max(np.abs(piece.input_change)) < 1e-9
            assert np.max(np.abs(piece.state_change)) < 1e-9


def test_a_plan_does_not_depend_on_how_often_a_settled_future_is_told() -> None:
    """One signal told at every update, or its samples' signal anew each time."""
    reference = rest_to_rest(0.0, 1.0, 2.0, smoothness=3, start_time=3.0)
    planners = [inversion_planner(two_disc(), preview=3.0, period=0.2) for _ in range(2)]
    for number in range(30):
        same = planners[0].update(reference)
        anew = planners[1].update(rest_to_rest(0.0, 1.0, 2.0, smoothness=3, start_time=3.0) if number % 3 else reference)
        assert anew.u == pytest.approx(same.u, rel=1e-10)


@pytest.mark.parametrize("delay", [-1e4, 1e4])
def test_a_shift_in_time_shifts_the_plan(delay: float) -> None:
    reference = rest_to_rest(0.0, 1.0, 2.0)
    plans = [preview_inversion(two_disc(), r, preview=4.0, period=0.25) for r in (reference, reference.shifted(delay))]
    t = np.linspace(-3.9, 5.0, 97)
    assert plans[1].inputs(t + delay) == pytest.approx(plans[0].inputs(t), abs=1e-9)


def test_units_change_nothing() -> None:
    """Outputs in 1e6, inputs in 1e-3, states in their own units, time in milliseconds."""
    model, reference = two_disc(), rest_to_rest(0.0, 1.0, 2.0)
    T, fast = np.diag([1e3, 1e-4, 7.0, 1e5]), 1e-3
    other = StateSpace(fast * T @ model.A @ np.linalg.inv(T), fast * T @ model.B / 1e3, 1e6 * model.C @ np.linalg.inv(T))
    plan = preview_inversion(model, reference, preview=4.0, period=0.25)
    scaled = preview_inversion(other, rest_to_rest(0.0, 1e6, 2e3), preview=4e3, period=250.0)
    t = np.linspace(-3.9, 5.0, 97)
    assert scaled.inputs(t * 1e3) / 1e3 == pytest.approx(plan.inputs(t), abs=1e-8)


def test_a_plan_over_all_of_time_is_what_the_planner_drives() -> None:
    reference = raised_cosine(2.0)
    plan = preview_inversion(cantilever(), reference, preview=3.0, period=0.25)
    planner = inversion_planner(cantilever(), preview=3.0, period=0.25, start=-3.0)
    for _ in range(36):
        piece = planner.update(reference)
        t = np.linspace(piece.start, piece.end, 7)[1:-1]
        driven, planned = piece(t), plan(t)
        for name in ("x", "u", "y", "y_d"):
            assert getattr(driven, name) == pytest.approx(getattr(planned, name), rel=1e-9, abs=1e-9)


def test_times_that_do_not_fit_are_refused() -> None:
    with pytest.raises(PlanError, match=r"preview must be a whole number of periods.* take for instance 0\.9 s"):
        inversion_planner(unstable_zero(), preview=1.0, period=0.3)
    with pytest.raises(PlanError, match="period must be positive"):
        inversion_planner(unstable_zero(), preview=1.0, period=0.0)


def test_a_reference_that_does_not_go_on_is_refused() -> None:
    planner = inversion_planner(unstable_zero(), preview=1.0, period=0.1)
    with pytest.raises(TrajectoryError, match=r"must go on at 0\.9 s from where it was known to"):
        planner.update(constant(1.0))
    with pytest.raises(TrajectoryError, match="continuous derivatives up to order 0"):
        planner.update(steps(np.array([5.0]), np.array([[0.0], [1.0]])))
    piece = planner.update()
    with pytest.raises(TrajectoryError, match=r"holds from 0 to 0\.1 s"):
        piece([0.2])


def test_more_unstable_zeros_on_one_side_of_a_jump_are_refused() -> None:
    with pytest.raises(BoundednessError, match="as many antistable zeros before a jump as after it, got 1 before and 0 after"):
        inversion_planner(SwitchedSystem([unstable_zero(), unstable_zero(-1.0)], [1.0]), preview=1.0, period=0.1)
