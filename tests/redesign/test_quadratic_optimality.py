"""The plan is the optimum: against perturbations, against the frequency domain, and in the limits of the weights."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import scipy.signal
from numpy.typing import NDArray

from invtrack.inversion.exact import invert
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem, as_switched
from invtrack.redesign.cost import cost
from invtrack.redesign.quadratic import quadratic_redesign
from invtrack.references.profiles import rest_to_rest
from invtrack.references.signal import PiecewiseSignal
from tests.redesign.plants import (
    DIRECT,
    FULL,
    FULL_WEIGHTS,
    HEAVIER,
    MINIMUM,
    NONMINIMUM,
    TWO_DISC,
    TWO_DISC_WEIGHTS,
    UNSTABLE,
    WEIGHTS,
    simulated,
    there_and_back,
    two_channels,
)

Array = NDArray[np.float64]

JUMPING = SwitchedSystem([NONMINIMUM, HEAVIER, MINIMUM], [0.5, 3.0])
EARLY_AND_LATE = SwitchedSystem([HEAVIER, NONMINIMUM, HEAVIER], [-1.0, 8.0])


def bump(times: Array, centre: float, width: float) -> Array:
    """A smooth function that is zero outside centre +- width."""
    s = np.clip((times - centre) / width, -1 + 1e-9, 1 - 1e-9)
    return np.exp(1.0 - 1 / (1 - s**2))


def brute_force_cost(model: Any, reference: PiecewiseSignal, times: Array, u: Callable[[Array], Array]) -> float:
    """Simulated from rest at times[0], Simpson's rule step by step from both sides of each step's ends."""
    plant = as_switched(model)
    x, h = simulated(model, u, times), times[1] - times[0]
    middle = (times[:-1] + times[1:]) / 2
    interval = plant.interval(middle)
    # x at mid-step from both ends' values and slopes (Hermite), which is of the order of the steps themselves.
    C, D = (np.array([getattr(system, name)[0] for system in plant.systems])[interval] for name in "CD")
    A, B = (np.array([getattr(system, name) for system in plant.systems])[interval] for name in "AB")
    u_s, u_m, u_e = u(times[:-1] + 1e-9 * h), u(middle), u(times[1:] - 1e-9 * h)
    slope_s = np.einsum("mij,mj->mi", A, x[:-1]) + np.einsum("mij,mj->mi", B, u_s)
    slope_e = np.einsum("mij,mj->mi", A, x[1:]) + np.einsum("mij,mj->mi", B, u_e)
    x_m = (x[:-1] + x[1:]) / 2 + h / 8 * (slope_s - slope_e)

    def rate(x: Array, u: Array, t: Array) -> Array:
        miss = np.sum(C * x, axis=1) + np.sum(D * u, axis=1) - reference(t, inside=middle)[:, 0]
        return 0.2 * u[:, 0] ** 2 + 0.3 * x[:, 0] ** 2 + 0.1 * x[:, 2] ** 2 + 4.0 * miss**2

    return float(h / 6 * np.sum(rate(x[:-1], u_s, times[:-1]) + 4 * rate(x_m, u_m, middle) + rate(x[1:], u_e, times[1:])))


@pytest.mark.parametrize("model", [NONMINIMUM, DIRECT, JUMPING, EARLY_AND_LATE], ids=["plain", "direct", "jumps", "outer jumps"])
def test_any_other_input_costs_more(model: Any) -> None:
    reference = there_and_back()
    plan = quadratic_redesign(model, reference, **WEIGHTS)
    times = np.linspace(-24.0, 36.0, 3001)
    least = brute_force_cost(model, reference, times, plan.inputs)
    assert cost(plan, **WEIGHTS) == pytest.approx(least, rel=1e-6)

    def changed_by(size: float, centre: float, width: float) -> Callable[[Array], Array]:
        return lambda t: plan.inputs(t) + size * bump(t, centre, width)[:, None]

    for centre, width in ((-1.5, 1.0), (0.4, 0.9), (2.5, 2.0), (6.0, 3.0)):
        above = [brute_force_cost(model, reference, times, changed_by(size, centre, width)) - least for size in (0.3, -0.3)]
        assert min(above) > 0
        # Both alike: the cost is stationary. What is left of the difference is what the brute force cannot resolve.
        assert abs(above[0] - above[1]) < 1e-5 * sum(above)


def filtered(
    system: StateSpace, reference: PiecewiseSignal, weights: dict[str, Any], window: float, step: float
) -> tuple[Array, ...]:
    """times, u_opt = (R + Gx*Q_xGx + Gy*Q_yGy)^-1 Gy*Q_y y_d and y_opt, frequency by frequency on a periodic window."""
    n, p = system.n_states, system.n_outputs
    R, Q_x, Q_y = (
        weights[name] * np.eye(size) if np.ndim(weights[name]) == 0 else weights[name]
        for name, size in (("R", p), ("Q_x", n), ("Q_y", p))
    )
    count = int(window / step)
    times = (np.arange(count) - count // 2) * step
    Y_d = np.fft.rfft(reference(times), axis=0)
    jw = 2j * np.pi * np.fft.rfftfreq(count, step)
    G_x = np.linalg.solve(jw[:, None, None] * np.eye(n) - system.A, np.broadcast_to(system.B, (len(jw), n, p)))
    G_y = system.C @ G_x + system.D
    H_x, H_y = (np.conj(np.swapaxes(G, 1, 2)) for G in (G_x, G_y))
    U = np.linalg.solve(R + H_x @ Q_x @ G_x + H_y @ Q_y @ G_y, (H_y @ Q_y @ Y_d[:, :, None]))
    return times, np.fft.irfft(U[:, :, 0], count, axis=0), np.fft.irfft((G_y @ U)[:, :, 0], count, axis=0)


@pytest.mark.parametrize(
    ("system", "reference", "weights"),
    [
        (NONMINIMUM, there_and_back(), WEIGHTS),
        (DIRECT, there_and_back(), WEIGHTS),
        (UNSTABLE, there_and_back(), WEIGHTS),
        (FULL, two_channels(), FULL_WEIGHTS),
    ],
    ids=["nonminimum-phase", "direct", "unstable", "two channels"],
)
def test_frequency_domain(system: StateSpace, reference: PiecewiseSignal, weights: dict[str, Any]) -> None:
    """The window is doubled until it no longer matters; then both ways agree."""
    plan = quadratic_redesign(system, reference, **weights)
    window, previous = 64.0, np.inf
    for _ in range(4):
        times, u, y = filtered(system, reference, weights, window, 1 / 64)
        inner = np.abs(times) < 30.0
        at = plan(times[inner])
        pairs = ((at.u, u), (at.y, y))
        miss = max(float(np.max(np.abs(mine - full[inner])) / np.max(np.abs(full))) for mine, full in pairs)
        if abs(previous - miss) < 1e-7:
            break
        window, previous = 2 * window, miss
    assert miss < 1e-6


@pytest.mark.parametrize("poles", [(-1.0, -1.5, -2.0, -2.5), (-0.3 + 2j, -0.3 - 2j, -0.6 + 1j, -0.6 - 1j)])
def test_rigid_body_in_the_frequency_domain_whatever_the_stabilizing_feedback(poles: tuple[complex, ...]) -> None:
    """u = v - K_0 x removes the poles from the axis; the optimum over v gives the same u for each K_0, that of the plan."""
    reference = there_and_back(duration=8.0)
    plan = quadratic_redesign(TWO_DISC, reference, **TWO_DISC_WEIGHTS)
    K_0 = scipy.signal.place_poles(TWO_DISC.A, TWO_DISC.B, poles).gain_matrix
    step, count = 1 / 32, 2**15
    times = (np.arange(count) - count // 2) * step
    jw = 2j * np.pi * np.fft.rfftfreq(count, step)[:, None, None]
    G_x = np.linalg.solve(jw * np.eye(4) - TWO_DISC.A + TWO_DISC.B @ K_0, np.broadcast_to(TWO_DISC.B, (len(jw), 4, 1)))[:, :, 0]
    G_y, G_u = G_x @ TWO_DISC.C[0], 1.0 - G_x @ K_0[0]  # from v to y and to u
    twist = G_x[:, 0] - G_x[:, 2]
    price = np.abs(G_u) ** 2 + 5000.0 * np.abs(twist) ** 2 + np.abs(G_y) ** 2
    V = np.conj(G_y) * np.fft.rfft(reference(times)[:, 0]) / price
    u, y = np.fft.irfft(G_u * V, count), np.fft.irfft(G_y * V, count)
    inner = np.abs(times) < 200.0
    at = plan(times[inner])
    assert np.max(np.abs(at.u[:, 0] - u[inner])) < 1e-6 * np.max(np.abs(u))
    assert np.max(np.abs(at.y[:, 0] - y[inner])) < 1e-6 * np.max(np.abs(y))


def test_a_stabilizing_feedback_around_the_plant_changes_nothing() -> None:
    """Input v = u + K_0 x; u = v - K_0 x becomes a second output that is wanted to be zero and carries R, v itself costs nothing.

    A second input that does nothing but cost makes the plant square.
    """
    K_0 = np.array([[3.0, 1.0, 2.0]])
    A, B, C = UNSTABLE.A, UNSTABLE.B, UNSTABLE.C
    looped = StateSpace(A - B @ K_0, np.hstack([B, np.zeros((3, 1))]), np.vstack([C, -K_0]), [[0.0, 0.0], [1.0, 0.0]])
    pair = there_and_back().scaled([[1.0], [0.0]])
    plain = quadratic_redesign(UNSTABLE, there_and_back(), **WEIGHTS)
    other = quadratic_redesign(looped, pair, R=np.diag([0.0, 1.0]), Q_x=WEIGHTS["Q_x"], Q_y=np.diag([WEIGHTS["Q_y"], WEIGHTS["R"]]))
    times = np.linspace(-5.0, 12.0, 400)
    assert np.max(np.abs(other(times).x - plain(times).x)) < 1e-10
    assert np.max(np.abs(other(times).y[:, 1] - plain(times).u[:, 0])) < 1e-10


@pytest.mark.parametrize("system", [MINIMUM, NONMINIMUM, JUMPING], ids=["minimum-phase", "nonminimum-phase", "jumps"])
def test_a_dear_output_error_leads_to_exact_inversion(system: Any) -> None:
    reference = there_and_back() if system is not JUMPING else there_and_back(start_time=-2.0)
    if system is JUMPING:
        system = SwitchedSystem([NONMINIMUM, StateSpace(HEAVIER.A, HEAVIER.B, NONMINIMUM.C)], [0.5])
    times = np.concatenate([np.linspace(-6.0, 0.49, 200), np.linspace(0.51, 12.0, 400)])
    exact = invert(system, reference)(times)
    errors, distances = [], []
    for Q_y in (1e2, 1e5, 1e8, 1e11):
        at = quadratic_redesign(system, reference, R=1.0, Q_y=Q_y)(times)
        errors.append(np.max(np.abs(at.y - at.y_d)))
        distances.append(np.max(np.abs(at.x - exact.x)) / np.max(np.abs(exact.x)))
    assert all(b < 0.5 * a for a, b in itertools.pairwise(errors))
    assert errors[-1] < 1e-3
    assert distances[-1] < 2e-3


def test_an_output_error_that_costs_nothing_leaves_everything_at_rest() -> None:
    plan = quadratic_redesign(TWO_DISC, rest_to_rest(0.0, 1.0, 5.0), R=1.0, Q_x=TWO_DISC_WEIGHTS["Q_x"], Q_y=0.0)
    at = plan(np.linspace(-10.0, 20.0, 50))
    assert not np.any(at.x)
    assert not np.any(at.u)
    assert not np.any(at.y)
    assert (plan.preactuation, plan.postactuation) == (0.0, 0.0)
    assert cost(plan, R=1.0, Q_y=0.0) == pytest.approx(0.0)
    nearly = quadratic_redesign(TWO_DISC, there_and_back(), R=1.0, Q_x=TWO_DISC_WEIGHTS["Q_x"], Q_y=1e-6)
    assert np.max(np.abs(nearly(np.linspace(-10.0, 20.0, 50)).y)) < 1e-2


def test_each_weight_buys_what_it_weighs() -> None:
    """Compared by cost(): each of two optima is better than the other under its own weights."""
    reference = there_and_back()
    sets: list[dict[str, Any]] = [{"R": 1.0, "Q_y": 1.0}, {"R": 0.01, "Q_y": 1.0}, WEIGHTS]
    plans = [quadratic_redesign(NONMINIMUM, reference, **weights) for weights in sets]
    for weights, plan in zip(sets, plans, strict=True):
        costs = [cost(other, **weights) for other in plans]
        assert min(costs) == cost(plan, **weights)
        assert sorted(costs)[1] > 1.001 * min(costs)
        assert cost(invert(NONMINIMUM, reference), **weights) > min(costs)
