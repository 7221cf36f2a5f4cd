"""Laws of the redesign prefilter, and its agreement with closed forms, brute force and a solution in the time domain."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
import scipy.linalg
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from invtrack.errors import RedesignError, TrajectoryError
from invtrack.linear.state_space import OperatingPoint, StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.redesign.prefilter.prefilter import Prefilter, prefilter
from invtrack.references.profiles import constant, raised_cosine, rest_to_rest
from invtrack.references.signal import stack
from tests.cited_plants import TWO_DISC_A, TWO_DISC_B, TWO_DISC_C

Array = NDArray[np.float64]

TWO_DISC = StateSpace(TWO_DISC_A, TWO_DISC_B, TWO_DISC_C)
TWIST = np.array([[1.0, 0.0, -1.0, 0.0]])
RIG_WEIGHTS = {"R": 1.0, "Q_x": 5000.0 * TWIST.T @ TWIST, "Q_y": 1.0}

# Two carts on one spring, each driven and each to follow its own motion; positions, then velocities.
_STIFFNESS = np.array([[2.0, -2.0], [-3.0, 3.0]])
TWO_CARTS = StateSpace(
    np.block([[np.zeros((2, 2)), np.eye(2)], [-_STIFFNESS, -0.1 * np.eye(2)]]),
    np.vstack([np.zeros((2, 2)), [[1.0, 0.3], [0.0, 2.0]]]),
    np.eye(2, 4),
)
CART_WEIGHTS = {"R": np.array([[0.3, 0.1], [0.1, 0.2]]), "Q_x": np.diag([0.0, 0.0, 0.5, 0.2]), "Q_y": np.diag([1.0, 4.0])}

# The integrator y' = u: with a^2 = Q_y / R the kernels are known, g_f = a/2 exp(-a|t|).
INTEGRATOR = StateSpace([[0.0]], [[1.0]], [[1.0]])
# An undamped oscillator at 2 rad/s.
OSCILLATOR = StateSpace([[0.0, 1.0], [-4.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]])


def rig() -> Prefilter:
    return prefilter(TWO_DISC, **RIG_WEIGHTS)


def plant_response(model: StateSpace, w: float) -> tuple[Array, Array]:
    G_x = np.linalg.solve(1j * w * np.eye(model.n_states) - model.A, model.B)
    return G_x, model.C @ G_x + model.D


def sweep(rate: Callable[[float, Array], Array], edges: list[float], start: Array) -> Callable[[float], Array]:
    """Solution of an initial value problem, integrated from edge to edge so that no step crosses a kink of the forcing."""
    stretches = []
    for a, b in pairwise(edges):
        solution = solve_ivp(rate, (a, b), start, method="DOP853", rtol=1e-11, atol=1e-13, dense_output=True, max_step=0.5)
        stretches.append((max(a, b), solution.sol))
        start = solution.y[:, -1]
    stretches.sort(key=lambda stretch: stretch[0])
    return lambda t: next(values for last, values in stretches if t <= last)(t)


def two_sweeps(
    model: StateSpace, y_d: Callable[[float], Array], edges: list[float], times: Array, *, R: Array, Q_x: Array, Q_y: Array
) -> tuple[Array, Array]:
    """u and x of the optimum from the Riccati equation: s backward from its rest at the last value, x forward from rest at zero."""
    X = scipy.linalg.solve_continuous_are(model.A, model.B, Q_x + model.C.T @ Q_y @ model.C, R)
    A_c = model.A - model.B @ np.linalg.solve(R, model.B.T @ X)
    drive, push = model.C.T @ Q_y, model.B @ np.linalg.solve(R, model.B.T)
    s_end = np.linalg.solve(A_c.T, drive @ y_d(edges[-1]))
    s = sweep(lambda t, s: -A_c.T @ s + drive @ y_d(t), edges[::-1], s_end)
    x = sweep(lambda t, x: A_c @ x - push @ s(t), edges, np.zeros(model.n_states))
    u = [-np.linalg.solve(R, model.B.T @ (X @ x(t) + s(t))) for t in times]
    return np.array(u), np.array([x(t) for t in times])


def minimum_jerk(share: float) -> float:
    s = min(max(share, 0.0), 1.0)
    return s**3 * (10 - 15 * s + 6 * s**2)


@pytest.mark.parametrize(
    ("model", "weights"),
    [(TWO_DISC, RIG_WEIGHTS), (TWO_CARTS, CART_WEIGHTS), (StateSpace([[-1.0]], [[2.0]], [[1.0]], [[0.5]]), {"R": 0.1, "Q_y": 2.0})],
    ids=["two discs", "two carts", "direct feedthrough"],
)
def test_response_is_the_lemma_away_from_poles(model: StateSpace, weights: dict) -> None:
    w = np.array([-3.0, 0.2, 1.0, 4.0, 30.0])
    found = prefilter(model, **weights)
    response, change = found.frequency_response(w), found.input_change(w)
    R, Q_y = (np.eye(model.n_outputs) * weights[name] if np.ndim(weights[name]) == 0 else weights[name] for name in ("R", "Q_y"))
    Q_x = weights.get("Q_x", np.zeros((model.n_states, model.n_states)))
    for k, frequency in enumerate(w):
        G_x, G_y = plant_response(model, frequency)
        effort = R + G_x.conj().T @ Q_x @ G_x
        both = effort + G_y.conj().T @ Q_y @ G_y
        G_u = np.linalg.inv(both) @ G_y.conj().T @ Q_y
        G_v = -np.linalg.inv(both) @ effort @ np.linalg.inv(G_y)
        assert response.G_u[k] == pytest.approx(G_u, rel=1e-8, abs=1e-12)
        assert response.G_xu[k] == pytest.approx(G_x @ G_u, rel=1e-8, abs=1e-12)
        assert response.G_f[k] == pytest.approx(G_y @ G_u, rel=1e-8, abs=1e-12)
        assert change[k] == pytest.approx(G_v, rel=1e-8, abs=1e-12)


def test_rigid_body_follows_at_zero_frequency_and_is_regular_near_its_poles() -> None:
    w = np.concatenate([[0.0], np.geomspace(1e-9, 1e-3, 60), [2e-5]])  # the printed matrices have a pole at 2e-5
    response = rig().frequency_response(w)
    assert response.G_f[0, 0, 0] == pytest.approx(1.0, abs=1e-12)
    assert response.G_u[0, 0, 0] == pytest.approx(0.0, abs=1e-12)
    # Expected of the integrator chain: 1 - G_f grows as w^2, with the same factor all the way down.
    assert np.all(np.abs(response.G_f[:, 0, 0] - 1.0) < 1e-12 + 50.0 * w**2)


def test_an_undamped_mode_is_followed_at_its_own_frequency_with_no_input() -> None:
    response = prefilter(OSCILLATOR, R=0.7, Q_y=3.0).frequency_response([2.0])
    assert response.G_f[0, 0, 0] == pytest.approx(1.0, abs=1e-12)
    assert response.G_u[0, 0, 0] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(("model", "weights"), [(TWO_DISC, RIG_WEIGHTS), (TWO_CARTS, CART_WEIGHTS)], ids=["discs", "carts"])
def test_optimum_does_not_depend_on_the_stabilizing_gain(model: StateSpace, weights: dict) -> None:
    w = np.concatenate([[0.0, 2e-5], np.geomspace(1e-3, 100.0, 40)])
    n, p = model.n_states, model.n_outputs
    gains = [
        np.linalg.solve(r * np.eye(p), model.B.T @ scipy.linalg.solve_continuous_are(model.A, model.B, np.eye(n), r * np.eye(p)))
        for r in (0.03, 30.0)
    ]
    first, second = (prefilter(model, stabilizing_gain=K, **weights).frequency_response(w).stacked for K in gains)
    assert np.all(np.abs(first - second) <= 1e-9 * np.max(np.abs(first), axis=0))


def test_no_weight_on_the_output_asks_for_nothing() -> None:
    idle = prefilter(OSCILLATOR, R=1.0, Q_y=0.0)  # the optimum's poles would lie on the axis
    assert not np.any(idle.frequency_response([0.0, 2.0, 5.0]).stacked)
    found = idle.apply(rest_to_rest(0.0, 1.0, 2.0))
    assert not np.any(found.u)
    assert not np.any(found.y)


def test_no_other_weight_gives_exact_inversion() -> None:
    w = np.array([0.0, 0.5, 3.0, 20.0])
    response = prefilter(TWO_DISC, R=0.0, Q_y=1.0).frequency_response(w)
    assert response.G_f[:, 0, 0] == pytest.approx(np.ones(4), abs=1e-9)
    for k in (1, 2, 3):
        assert response.G_u[k] * plant_response(TWO_DISC, w[k])[1] == pytest.approx(np.ones((1, 1)), rel=1e-9)


def test_cost_rises_under_perturbations_of_either_sign() -> None:
    rng = np.random.default_rng(0)
    w = np.linspace(0.05, 12.0, 200)
    u = prefilter(TWO_CARTS, **CART_WEIGHTS).frequency_response(w).G_u @ (y_d := np.array([1.0, -0.5j]))
    G = [plant_response(TWO_CARTS, frequency) for frequency in w]

    def cost(inputs: Array) -> float:
        """Parseval's integral, by quadrature."""
        density = []
        for v, (G_x, G_y) in zip(inputs, G, strict=True):
            parts = ((v, CART_WEIGHTS["R"]), (G_x @ v, CART_WEIGHTS["Q_x"]), (G_y @ v - y_d, CART_WEIGHTS["Q_y"]))
            density.append(sum((part.conj() @ weight @ part).real for part, weight in parts))
        return float(np.trapezoid(density, w))

    least = cost(u)
    for _ in range(5):
        shape = rng.normal(size=2) + 1j * rng.normal(size=2)
        bump = np.exp(-((w - rng.uniform(1, 10)) ** 2))[:, None] * shape
        rises = [cost(u + sign * 1e-3 * bump) - least for sign in (1, -1)]
        assert min(rises) > 0
        assert rises[0] == pytest.approx(rises[1], rel=1e-4)  # no slope: it is a stationary point


def test_kernels_of_the_integrator_are_the_known_ones() -> None:
    a, times = 1.5, np.array([-3.0, -1.0, -0.2, -0.01, 0.01, 0.4, 2.0])
    kernel = prefilter(INTEGRATOR, R=4.0, Q_y=4.0 * a**2).impulse_response(times)
    assert kernel.truncation_error <= 1e-4
    assert kernel.g_f[:, 0, 0] == pytest.approx(a / 2 * np.exp(-a * np.abs(times)), abs=2e-4 * a)
    assert kernel.g_u[:, 0, 0] == pytest.approx(-(a**2) / 2 * np.sign(times) * np.exp(-a * np.abs(times)), abs=2e-4 * a**2)
    assert prefilter(INTEGRATOR, R=4.0, Q_y=4.0 * a**2).preview_time(0.02) == pytest.approx(np.log(50.0) / a, rel=0.01)


def test_convolution_with_the_kernel_is_the_filter() -> None:
    kernel = rig().impulse_response()
    reference = raised_cosine(2.0, period=12.0, start_time=5.0)
    at = np.array([-3.0, 4.0, 11.0, 25.0])
    wanted = reference((at[:, None] - kernel.time).ravel())[:, 0].reshape(len(at), -1)
    y = np.trapezoid(wanted * kernel.g_f[:, 0, 0], kernel.time, axis=1)
    assert y == pytest.approx(rig().apply(reference, at).y[:, 0], abs=1e-4)


@pytest.mark.parametrize("kind", ["slew", "raised_cosine"])
def test_agrees_with_the_riccati_solution_on_the_rig(kind: str) -> None:
    duration = 20.0
    if kind == "slew":
        reference = rest_to_rest(0.0, 1.0, duration)
        times, y_d = np.linspace(-30.0, 60.0, 181), lambda t: np.array([minimum_jerk(t / duration)])
    else:
        reference = raised_cosine(2.0, period=duration)
        times, y_d = np.linspace(-30.0, 60.0, 181), lambda t: np.array([(1 - np.cos(np.pi * t / 10)) * (0 <= t <= duration)])
    found = rig().apply(reference, times)
    u, x = two_sweeps(TWO_DISC, y_d, [-110.0, 0.0, duration, 130.0], times, R=np.eye(1), Q_x=RIG_WEIGHTS["Q_x"], Q_y=np.eye(1))
    assert np.max(np.abs(found.u - u)) < 1e-6 * np.max(np.abs(u))
    assert np.max(np.abs(found.x - x)) < 1e-6 * np.max(np.abs(x))
    assert np.max(np.abs(found.y[:, 0] - x[:, 2])) < 1e-6 * np.max(np.abs(x[:, 2]))
    assert found.y_d == pytest.approx(np.array([y_d(t) for t in times]), abs=1e-12)


def test_agrees_with_the_riccati_solution_for_two_outputs() -> None:
    # Both carts travel together, so that the held end stretches no spring, but the second one makes a detour.
    first, second = rest_to_rest(0.0, 1.0, 4.0), rest_to_rest(0.0, 1.0, 4.0) + raised_cosine(0.4, period=3.0)
    times = np.linspace(-6.0, 12.0, 91)
    found = prefilter(TWO_CARTS, **CART_WEIGHTS).apply(stack([first, second]), times)

    def y_d(t: float) -> Array:
        detour = 0.2 * (1 - np.cos(2 * np.pi * t / 3)) * (0 <= t <= 3)
        return np.array([minimum_jerk(t / 4), minimum_jerk(t / 4) + detour])

    u, x = two_sweeps(TWO_CARTS, y_d, [-40.0, 0.0, 3.0, 4.0, 60.0], times, **CART_WEIGHTS)
    assert np.max(np.abs(found.u - u)) < 1e-6 * np.max(np.abs(u))
    assert np.max(np.abs(found.x - x)) < 1e-6 * np.max(np.abs(x))


def test_superposition_and_time_shift() -> None:
    times = np.linspace(-20.0, 60.0, 41)
    slew, hump = rest_to_rest(0.0, 1.0, 12.0), raised_cosine(2.0, period=9.0, start_time=3.0)
    found = rig()
    both = found.apply(slew.scaled(2.0) + hump, times)
    one, other = found.apply(slew, times), found.apply(hump, times)
    assert np.max(np.abs(both.u - 2 * one.u - other.u)) < 1e-7 * np.max(np.abs(both.u))
    assert np.max(np.abs(both.x - 2 * one.x - other.x)) < 1e-7 * np.max(np.abs(both.x))
    later = found.apply(slew.shifted(7.3), times + 7.3)
    assert np.max(np.abs(later.u - one.u)) < 1e-7 * np.max(np.abs(one.u))


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-6])
def test_truncation_error_is_honest(tolerance: float) -> None:
    times, reference = np.linspace(-30.0, 60.0, 301), rest_to_rest(0.0, 1.0, 6.0, smoothness=1)
    coarse, fine = (rig().apply(reference, times, tolerance=t) for t in (tolerance, 1e-9))
    assert coarse.truncation_error <= tolerance
    missed = max(np.max(np.abs(a - b) / np.max(np.abs(b), axis=0)) for a, b in ((coarse.u, fine.u), (coarse.y, fine.y)))
    assert missed <= 2 * coarse.truncation_error + 1e-8


def test_far_from_the_motion_it_is_at_rest_where_it_began_and_where_it_ends() -> None:
    found = rig().apply(rest_to_rest(0.5, 2.0, 6.0), [-1e4, 1e4])
    assert found.y[:, 0] == pytest.approx([0.5, 2.0], abs=1e-6)
    assert found.u[:, 0] == pytest.approx([0.0, 0.0], abs=1e-7)


@pytest.mark.parametrize("unit", [1e-300, 1e307])
def test_what_weights_are_counted_in_changes_nothing(unit: float) -> None:
    plain, other = (prefilter(INTEGRATOR, R=0.25 * each, Q_y=each) for each in (1.0, unit))
    w = np.array([0.0, 0.3, 4.0])
    assert other.decay_rate == pytest.approx(plain.decay_rate, rel=1e-12)
    assert other.bandwidth == pytest.approx(plain.bandwidth, rel=1e-12)
    assert np.max(np.abs(other.frequency_response(w).G_u - plain.frequency_response(w).G_u)) < 1e-12


@pytest.mark.parametrize("level", [1e-100, 5e-324])
def test_a_level_below_all_rounding_is_refused_for_that(level: float) -> None:
    with pytest.raises(RedesignError, match=r"the kernel is truncated by .* which hides when it stays below"):
        prefilter(INTEGRATOR, R=1.0, Q_y=1.0).preview_time(level)


def test_constant_functions_as_weights_equal_constants() -> None:
    reference, times = rest_to_rest(0.0, 1.0, 15.0), np.linspace(-20.0, 40.0, 61)
    functions = {name: (lambda w, value=value: value) for name, value in RIG_WEIGHTS.items()}
    varying, constant = (prefilter(TWO_DISC, **weights).apply(reference, times) for weights in (functions, RIG_WEIGHTS))
    assert np.max(np.abs(varying.u - constant.u)) < 1e-7 * np.max(np.abs(constant.u))


def test_weight_rising_with_frequency_is_a_weight_on_the_rate_of_the_input() -> None:
    shaped = prefilter(INTEGRATOR, R=lambda w: 0.5 + 0.2 * w**2, Q_y=2.0)
    # The same cost for the plant with u as a further state and its rate as the input.
    extended = StateSpace([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]])
    plain = prefilter(extended, R=0.2, Q_x=np.diag([0.0, 0.5]), Q_y=2.0)
    reference, times = rest_to_rest(0.0, 1.0, 2.0), np.linspace(-5.0, 8.0, 60)
    a, b = shaped.apply(reference, times), plain.apply(reference, times)
    assert np.max(np.abs(a.u[:, 0] - b.x[:, 1])) < 1e-7
    assert np.max(np.abs(a.y - b.y)) < 1e-7


def test_inputs_and_outputs_are_absolute() -> None:
    point = OperatingPoint(x0=np.zeros(1), u0=np.array([3.0]), y0=np.array([10.0]))
    moved = prefilter(StateSpace([[0.0]], [[1.0]], [[1.0]], operating_point=point), R=1.0, Q_y=1.0)
    here = prefilter(INTEGRATOR, R=1.0, Q_y=1.0)
    times = np.linspace(-3.0, 5.0, 20)
    a, b = moved.apply(rest_to_rest(10.0, 11.0, 2.0), times), here.apply(rest_to_rest(0.0, 1.0, 2.0), times)
    assert a.u == pytest.approx(b.u + 3.0, abs=1e-8)
    assert a.y == pytest.approx(b.y + 10.0, abs=1e-8)
    assert a.x == pytest.approx(b.x, abs=1e-8)


def test_holding_that_costs_for_ever_is_refused_but_passing_by_is_not() -> None:
    spring = prefilter(StateSpace([[0.0, 1.0], [-1.0, -0.4]], [[0.0], [1.0]], [[1.0, 0.0]]), R=1.0, Q_y=1.0)
    with pytest.raises(RedesignError, match=r"holding the reference's last value for ever costs 0\.5 per second"):
        spring.apply(rest_to_rest(0.0, 1.0, 2.0))
    assert spring.apply(raised_cosine(2.0, period=2.0), [0.0, 50.0]).y[1, 0] == pytest.approx(0.0, abs=1e-7)


def test_rounding_of_the_held_value_is_no_cost() -> None:
    point = OperatingPoint(x0=np.zeros(2), u0=np.zeros(1), y0=np.array([0.3]))
    spring = StateSpace([[0.0, 1.0], [-1.0, -0.4]], [[0.0], [1.0]], [[1.0, 0.0]], operating_point=point)
    found = prefilter(spring, R=1.0, Q_y=1.0).apply(raised_cosine(2.0, period=2.0) + constant(0.1 + 0.2), [50.0])
    assert found.y[0, 0] == pytest.approx(0.3, abs=1e-7)


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"R": 1.0, "Q_y": np.eye(2)}, r"Q_y must be .* \(1, 1\) matrix, got shape \(2, 2\)"),
        ({"R": -1.0, "Q_y": 1.0}, "R must be positive semidefinite, its smallest eigenvalue is -1"),
        ({"R": np.nan, "Q_y": 1.0}, "R has entries that are not finite"),
        ({"R": "much", "Q_y": 1.0}, "R must be numbers, got 'much'"),
        ({"R": 1.0, "Q_y": 1.0, "Q_x": [[1.0, 2.0], [0.0, 1.0]]}, "Q_x must be symmetric"),
        ({"R": 1.0, "Q_y": 1.0, "Q_x": [[1.0, 0.5j], [-0.5j, 1.0]]}, "a constant Q_x must be real"),
        ({"R": 1.0, "Q_y": 1.0, "Q_x": lambda w: [[1.0, 1j * w], [1j * w, 1.0]]}, r"Q_x must be Hermitian.* at w = 0\.\d+ rad/s"),
        ({"R": lambda w: 1.0 + (w > 0), "Q_y": 1.0}, "conjugate values at w and -w"),
        ({"R": lambda w: -1.0, "Q_y": 1.0}, "R must be .* at w = 0 rad/s"),
        ({"R": 1.0, "Q_y": 1.0, "stabilizing_gain": [[0.0, 0.0]]}, "does not stabilize"),
        (
            {"R": 1.0, "Q_y": 1.0, "stabilizing_gain": [1.0]},
            r"stabilizing_gain .* must be a \(1, 2\) matrix of finite real numbers",
        ),
    ],
)
def test_bad_weights_and_gains_are_refused(options: dict, match: str) -> None:
    with pytest.raises(RedesignError, match=match):
        prefilter(OSCILLATOR, **options)


def test_plants_without_an_optimum_are_refused() -> None:
    with pytest.raises(RedesignError, match="stays the same, this one has 2 intervals"):
        prefilter(SwitchedSystem([OSCILLATOR, OSCILLATOR], [1.0]), R=1.0, Q_y=1.0)
    with pytest.raises(RedesignError, match="cannot be stabilized"):
        prefilter(StateSpace(np.diag([1.0, -1.0]), [[0.0], [1.0]], [[0.0, 1.0]]), R=1.0, Q_y=1.0)
    unseen = StateSpace(np.array([[0.0, 1.0, 0], [-4.0, 0.0, 0], [0, 0, -1.0]]), [[0.0], [1.0], [1.0]], [[0.0, 0.0, 1.0]])
    with pytest.raises(RedesignError, match="poles on the imaginary axis"):
        prefilter(unseen, R=1.0, Q_y=1.0)


def test_change_of_input_against_an_inverse_that_does_not_exist_is_refused() -> None:
    notch = prefilter(StateSpace([[0.0, 1.0], [-4.0, -1.0]], [[0.0], [1.0]], [[-3.0, -1.0]], [[1.0]]), R=1.0, Q_y=1.0)  # zero at 1
    assert notch.frequency_response([1.0]).G_f[0, 0, 0] == pytest.approx(0.0, abs=1e-12)
    with pytest.raises(RedesignError, match="zero at w = 1 rad/s"):
        notch.input_change([0.5, 1.0])


def test_bad_calls_are_refused() -> None:
    found = prefilter(INTEGRATOR, R=1.0, Q_y=1.0)
    with pytest.raises(TrajectoryError, match="reference has 2 channels"):
        found.apply(stack([raised_cosine(2.0), raised_cosine(2.0)]))
    with pytest.raises(TrajectoryError, match="times must be finite"):
        found.apply(raised_cosine(2.0), [np.nan])
    with pytest.raises(RedesignError, match="tolerance must lie between 0 and 1"):
        found.apply(raised_cosine(2.0), tolerance=0.0)
    with pytest.raises(RedesignError, match="level must lie between 0 and 1"):
        found.preview_time(2.0)
    feedthrough = prefilter(StateSpace([[-1.0]], [[1.0]], [[1.0]], [[1.0]]), R=1.0, Q_y=1.0)
    with pytest.raises(RedesignError, match="kernel contains an impulse"):
        feedthrough.impulse_response()
