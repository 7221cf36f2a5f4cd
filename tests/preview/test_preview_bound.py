"""The bound of a loop around a plan with preview: attained by its worst reference on the linear plant, and by nothing passed."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg

import invtrack
from invtrack.control.gains import GainSchedule
from invtrack.errors import ControlError, PlanError, TrajectoryError
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.preview import (
    PreviewBound,
    PreviewPlanner,
    inversion_planner,
    preview_bound,
    preview_inversion,
    preview_redesign,
    redesign_planner,
)
from invtrack.references.profiles import raised_cosine, rest_to_rest
from invtrack.references.signal import PiecewiseSignal
from tests.cited_plants import CANTILEVER_TIP_MASSES, TWO_DISC_A, TWO_DISC_B, TWO_DISC_C, cantilever_paper

TWIST = np.array([1.0, 0.0, -1.0, 0.0])
WEIGHTS = {"R": 1.0, "Q_x": 5000.0 * np.outer(TWIST, TWIST), "Q_y": 1.0}


def two_disc() -> StateSpace:
    return StateSpace(TWO_DISC_A, TWO_DISC_B, TWO_DISC_C)


def cantilever() -> SwitchedSystem:
    return SwitchedSystem([StateSpace(*cantilever_paper(mass)) for mass in CANTILEVER_TIP_MASSES], np.array([0.5, 1.5]) * np.pi)


def two_outputs() -> StateSpace:
    """Relative degree (1, 1), zeros 1.5 and 0.8 +- 2j: eta' = N eta + M y, y' = L eta + u - y."""
    N = scipy.linalg.block_diag(1.5, [[0.8, 2.0], [-2.0, 0.8]])
    M, L = np.array([[1.0, 0.5], [0.3, -1.0], [0.0, 2.0]]), np.array([[1.0, 0.0, 1.0], [-0.5, 1.0, 0.2]])
    A = np.block([[-np.eye(2), L], [M, N]])
    return StateSpace(A, np.eye(5)[:, :2], np.eye(5)[:2])


def missed(
    model: SwitchedSystem | StateSpace, gains: GainSchedule, planner: PreviewPlanner, reference: PiecewiseSignal, end: float
) -> np.ndarray:
    """Largest error of each output on the linear model, the plan's input evaluated at every stage."""
    plan = preview_inversion(model, reference, preview=planner.preview, period=planner.period)
    run = invtrack.simulate(
        invtrack.LinearPlant(model), invtrack.TrackingController(plan, gains), timestep=0.02, evaluate="stages", end=end
    )
    return np.max(np.abs(run.error[:-1]), axis=0)  # at the last instant a feedthrough has no input to show


def test_the_worst_reference_comes_up_to_the_bound() -> None:
    model = two_disc()
    gains, planner = invtrack.lqr(model, Q=1.0, R=1.0), inversion_planner(model, preview=2.0, period=0.25)
    bound = preview_bound(planner, gains)
    worst = bound.worst_reference()
    assert bound.output[0] == pytest.approx(worst.error)
    reached = missed(model, gains, planner, worst.reference, worst.time + 1.0)[0]
    assert 0.98 * bound.output[0] < reached < 1.001 * bound.output[0]
    assert np.max(np.abs(worst.reference(np.linspace(-60.0, 60.0, 5001), derivative=2))) < 1 + 1e-9


@pytest.mark.parametrize("output", [0, 1])
def test_with_several_outputs_each_has_its_own(output: int) -> None:
    model = two_outputs()
    gains, planner = invtrack.lqr(model, Q=1.0, R=1.0), inversion_planner(model, preview=1.0, period=0.1)
    bound = preview_bound(planner, gains)
    worst = bound.worst_reference(output)
    reached = missed(model, gains, planner, worst.reference, worst.time + 0.5)
    assert 0.98 * bound.output[output] < reached[output]
    assert np.all(reached < 1.001 * bound.output)


def test_through_jumps_of_the_plant_too() -> None:
    model = cantilever()
    gains, planner = invtrack.lqr(model, Q=100.0, R=0.01), inversion_planner(model, preview=4.0, period=0.5)
    bound = preview_bound(planner, gains)
    worst = bound.worst_reference()
    assert np.any((model.switch_times > worst.time - 10.0) & (model.switch_times < worst.time + 10.0))
    reached = missed(model, gains, planner, worst.reference, worst.time + 1.0)[0]
    assert bound.output[0] / 3 < reached < 1.001 * bound.output[0]
    assert missed(model, gains, planner, raised_cosine(2.0), 12.0)[0] < bound.of(raised_cosine(2.0))[0]


def test_the_gain_is_the_integral_that_the_method_says() -> None:
    """A plant with one zero a: |C e^(A_c tau) V| e^(-a T) / (a h) (e^(a h) - 1) |G|, summed over the updates before t, period h.

    y' = eta + u - y, eta' = a eta + y: V = (0, 1), and y' moves eta's distance from its steady state -y / a by 1 / a.
    """
    a, T, h = 1.5, 2.0, 0.2
    model = StateSpace([[-1.0, 1.0], [1.0, a]], [[1.0], [0.0]], [[1.0, 0.0]])
    K = np.array([[6.0, 15.0]])
    A_c = model.A - model.B @ K
    news = np.exp(-a * T) * (np.exp(a * h) - 1) / a / a
    instants = np.arange(0.0, h, 1e-3)
    sums = [sum(abs(scipy.linalg.expm(A_c * (t + k * h))[0, 1]) for k in range(60)) for t in instants]
    bound = preview_bound(inversion_planner(model, preview=T, period=h), K)
    assert bound.gain[0, 0] == pytest.approx(news * max(sums), rel=5e-3)
    assert bound.state_change == pytest.approx([0.0, np.exp(-a * (T - h)) / a / a], rel=1e-6)
    assert bound.input_change == pytest.approx([np.exp(-a * (T - h)) / a / a], rel=1e-6)
    assert bound.alpha == pytest.approx(a)


@pytest.mark.parametrize("method", ["inversion", "redesign"])
def test_it_falls_as_the_slowest_mode_ahead_does(method: str) -> None:
    """The slowest modes are a pair: over half turns of it the gain falls by the rate alone."""
    modes = np.array([0.21998 + 4.74976j]) if method == "inversion" else -np.linalg.eigvals(_optimal_loop())
    slowest = modes[np.argmin(modes.real)]
    half_turn = np.pi / abs(slowest.imag)

    def bound(half_turns: int) -> PreviewBound:
        times = {"preview": half_turns * half_turn, "period": half_turn / 2}
        if method == "redesign":
            return preview_bound(redesign_planner(two_disc(), **times, **WEIGHTS))
        return preview_bound(inversion_planner(two_disc(), **times), invtrack.lqr(two_disc(), Q=1.0, R=1.0))

    near, far = bound(24), bound(28)
    assert near.alpha == pytest.approx(slowest.real, rel=1e-4)
    assert far.output / near.output == pytest.approx(np.exp(-slowest.real * 4 * half_turn), rel=1e-3)
    assert far.constant == pytest.approx(near.constant, rel=1e-3)


def _optimal_loop() -> np.ndarray:
    P = scipy.linalg.solve_continuous_are(TWO_DISC_A, TWO_DISC_B, WEIGHTS["Q_x"] + TWO_DISC_C.T @ TWO_DISC_C, np.eye(1))
    return TWO_DISC_A - TWO_DISC_B @ TWO_DISC_B.T @ P


def test_a_redesign_is_bounded_against_the_one_that_knows_everything() -> None:
    model = two_disc()
    bound = preview_bound(redesign_planner(model, preview=5.0, period=0.25, **WEIGHTS))
    worst = bound.worst_reference()
    with_preview = preview_redesign(model, worst.reference, preview=5.0, period=0.25, **WEIGHTS)
    optimum = invtrack.quadratic_redesign(model, worst.reference, **WEIGHTS)
    t = worst.time + np.linspace(-30.0, 10.0, 2001)
    distance = np.abs(with_preview(t).y - optimum(t).y)
    assert 0.999 * bound.output[0] < np.max(distance) < 1.001 * bound.output[0]
    slew = rest_to_rest(0.0, 1.0, 5.0)
    t = np.linspace(-10.0, 30.0, 401)
    short = preview_redesign(model, slew, preview=5.0, period=0.25, **WEIGHTS)
    full = invtrack.quadratic_redesign(model, slew, **WEIGHTS)
    assert np.max(np.abs(short(t).y - full(t).y)) < bound.of(slew)[0]


def test_where_nothing_lies_ahead_nothing_is_missed() -> None:
    """A zero at -3, and a feedthrough with zeros left of the axis."""
    for C, D in (([[3.0, 1.0]], [[0.0]]), ([[2.0, -1.0]], [[0.5]])):
        model = StateSpace([[0.0, 1.0], [-2.0, -3.0]], [[0.0], [1.0]], C, D)
        planner = inversion_planner(model, preview=0.2, period=0.1)
        bound = preview_bound(planner, np.array([[1.0, 1.0]]))
        assert (bound.output[0], bound.input_change[0]) == (0.0, 0.0)
        assert bound.alpha == np.inf
        assert missed(model, GainSchedule([[[1.0, 1.0]]]), planner, rest_to_rest(0.0, 1.0, 2.0), 4.0)[0] < 1e-6


def test_a_feedthrough_is_seen() -> None:
    """Zeros -5.37 and 0.372: what is new moves the output at once."""
    model = StateSpace([[0.0, 1.0], [-2.0, -3.0]], [[0.0], [1.0]], [[2.0, -1.0]], [[-0.5]])
    gains, planner = GainSchedule([[[1.0, 1.0]]]), inversion_planner(model, preview=1.0, period=0.1)
    bound = preview_bound(planner, gains)
    worst = bound.worst_reference()
    assert 0.95 * bound.output[0] < missed(model, gains, planner, worst.reference, worst.time + 1.0)[0] < 1.001 * bound.output[0]


def test_units_scale_it() -> None:
    """Output in 1e6, time in milliseconds: chi = y'' changes by 1e-6, so the gain by 1e6."""
    model = two_disc()
    bound = preview_bound(inversion_planner(model, preview=4.0, period=0.25), invtrack.lqr(model, Q=1.0, R=1.0))
    scaled = StateSpace(1e-3 * model.A, 1e-3 * model.B, 1e6 * model.C)
    gains = invtrack.lqr(model, Q=1.0, R=1.0)
    other = preview_bound(inversion_planner(scaled, preview=4e3, period=250.0), gains)
    assert other.gain == pytest.approx(bound.gain * 1e6, rel=1e-6)


def test_zeros_too_near_the_axis_are_refused() -> None:
    """y' = eta_1 + eta_2 - y + u, eta' = N eta + y with the zeros 1e-6 +- 2j: what lies ahead counts for months."""
    A = np.array([[-1.0, 1.0, 1.0], [1.0, 1e-6, 2.0], [1.0, -2.0, 1e-6]])
    model = StateSpace(A, np.eye(3)[:, :1], np.eye(3)[:1])
    with pytest.raises(PlanError, match="what lies ahead fades at 1e-06 1/s only"):
        preview_bound(inversion_planner(model, preview=1.0, period=0.1), invtrack.lqr(model, Q=1.0, R=1.0))


def test_what_does_not_fit_is_refused() -> None:
    model = two_disc()
    inversion, redesign = (
        inversion_planner(model, preview=1.0, period=0.1),
        redesign_planner(model, preview=1.0, period=0.1, **WEIGHTS),
    )
    K = invtrack.lqr(model, Q=1.0, R=1.0)
    with pytest.raises(PlanError, match="state gains"):
        preview_bound(inversion)
    with pytest.raises(PlanError, match="leave gains out"):
        preview_bound(redesign, K)
    with pytest.raises(PlanError, match="do not stabilize the plant"):
        preview_bound(inversion, np.zeros((1, 4)))
    with pytest.raises(ControlError, match=r"gains have shape \(1, 2\), expected \(1, 4\)"):
        preview_bound(inversion, np.zeros((1, 2)))
    with pytest.raises(ControlError, match="gains must switch where the plant does"):
        preview_bound(inversion, GainSchedule([K.gains[0], K.gains[0]], [1.0]))
    with pytest.raises(PlanError, match="plants that do not switch"):
        preview_bound(redesign_planner(cantilever(), preview=1.0, period=0.1, R=1.0, Q_y=1.0))
    with pytest.raises(TrajectoryError, match="has 2 channels, expected one for each of 1 outputs"):
        preview_bound(inversion, K).of(rest_to_rest([0.0, 0.0], [1.0, 1.0], 1.0))
