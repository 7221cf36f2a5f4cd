"""What must not change an inverse, or must change it in one known way."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.signal

from invtrack.inversion.exact import invert
from invtrack.linear.state_space import OperatingPoint, StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.plan import Plan
from invtrack.references.profiles import autonomous, constant, raised_cosine, rest_to_rest
from invtrack.references.signal import PiecewiseSignal, stack
from tests.cited_plants import cantilever_paper
from tests.linear.random_plants import block, plant_with

CANTILEVER = [StateSpace(*cantilever_paper(m)) for m in (0.0, 100.0)]
CANTILEVER_MODEL = SwitchedSystem(CANTILEVER, [2.0])
# Two channels of relative degrees 1 and 2; at the jump the internal dynamics change, the outputs as functions of the state do not.
FIRST = plant_with(np.random.default_rng(0), (1, 2), block(0.7, -1.0 + 2j), mixed=False)
SECOND = StateSpace(FIRST.A + np.pad(0.3 * np.eye(3), ((3, 0), (3, 0))) @ np.diag([0, 0, 0, 1, -1, -1]), FIRST.B, FIRST.C)
TWO_CHANNELS = SwitchedSystem([FIRST, SECOND], [1.0])
PAIR = stack([rest_to_rest(0.0, 1.0, 2.0), rest_to_rest(0.5, -1.0, 1.5, start_time=0.2)])
TIMES = np.concatenate([np.linspace(-15.0, 0.0, 40), np.linspace(0.001, 6.3, 80), np.linspace(6.4, 20.0, 40)])

CASES = {"cantilever": (CANTILEVER_MODEL, raised_cosine(2.0)), "two channels": (TWO_CHANNELS, PAIR)}


def mapped(model: SwitchedSystem, change: object) -> SwitchedSystem:
    return SwitchedSystem([change(system) for system in model.systems], model.switch_times)  # type: ignore[operator]


def assert_close(found: np.ndarray, expected: np.ndarray, tolerance: float = 1e-9) -> None:
    """To within a share of each column's peak."""
    size = np.max(np.abs(expected), axis=0)
    assert np.max(np.abs(found - expected) / np.where(size > 0, size, 1.0)) < tolerance


@pytest.mark.parametrize("case", CASES)
def test_superposition(case: str) -> None:
    model, reference = CASES[case]
    other = rest_to_rest(np.zeros(reference.n_channels), np.linspace(1.0, 2.0, reference.n_channels), 3.0, start_time=1.3)
    both = invert(model, reference.scaled(2.0) + other.scaled(-0.5))(TIMES)
    first, second = invert(model, reference)(TIMES), invert(model, other)(TIMES)
    assert_close(both.x, 2 * first.x - 0.5 * second.x)
    assert_close(both.u, 2 * first.u - 0.5 * second.u)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("delay", [3.7, -1e3])
def test_time_shift(case: str, delay: float) -> None:
    model, reference = CASES[case]
    later = SwitchedSystem(model.systems, model.switch_times + delay)
    moved, plain = invert(later, reference.shifted(delay)), invert(model, reference)
    assert_close(moved(TIMES + delay, inside=TIMES + delay + 1e-6).u, plain(TIMES, inside=TIMES + 1e-6).u)
    assert moved.preactuation == pytest.approx(plain.preactuation)


@pytest.mark.parametrize("case", CASES)
def test_similarity(case: str) -> None:
    model, reference = CASES[case]
    T = np.random.default_rng(3).normal(size=(6, 6))
    plain, turned = invert(model, reference)(TIMES), invert(mapped(model, lambda s: s.transformed(T)), reference)(TIMES)
    assert_close(turned.x, plain.x @ T.T)
    assert_close(turned.u, plain.u)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("seed", range(3))
def test_units_of_states_inputs_and_outputs(case: str, seed: int) -> None:
    model, reference = CASES[case]
    rng = np.random.default_rng(seed)
    p = reference.n_channels
    state, inputs, outputs = (10.0 ** rng.choice([-6, 0, 6], size=size) for size in (6, p, p))

    def change(s: StateSpace) -> StateSpace:
        return StateSpace(state[:, None] * s.A / state, state[:, None] * s.B / inputs, outputs[:, None] * s.C / state)

    plain, scaled = invert(model, reference), invert(mapped(model, change), reference.scaled(np.diag(outputs)))
    assert_close(scaled(TIMES).x, plain(TIMES).x * state)
    assert_close(scaled(TIMES).u, plain(TIMES).u * inputs)
    assert scaled.certificate.dynamics_residual < 1e-10
    assert scaled.certificate.output_error < 1e-10
    assert scaled.preactuation == pytest.approx(plain.preactuation, rel=1e-2)


@pytest.mark.parametrize("unit", [1e-6, 1e-3, 1e6])
def test_unit_of_time(unit: float) -> None:
    def change(s: StateSpace) -> StateSpace:
        return StateSpace(s.A / unit, s.B / unit, s.C)

    slower = SwitchedSystem([change(s) for s in CANTILEVER], [2.0 * unit])
    plan, plain = invert(slower, raised_cosine(2.0, period=2 * np.pi * unit)), invert(CANTILEVER_MODEL, raised_cosine(2.0))
    assert_close(plan(TIMES * unit).x, plain(TIMES).x)
    assert_close(plan(TIMES * unit).u, plain(TIMES).u)
    assert plan.certificate.dynamics_residual < 1e-10
    assert plan.preactuation == pytest.approx(plain.preactuation * unit, rel=1e-2)


def test_permuted_channels() -> None:
    swap = np.array([[0.0, 1.0], [1.0, 0.0]])
    plain = invert(TWO_CHANNELS, PAIR)(TIMES)
    swapped = invert(mapped(TWO_CHANNELS, lambda s: StateSpace(s.A, s.B @ swap, swap @ s.C)), PAIR.scaled(swap))(TIMES)
    assert_close(swapped.x, plain.x)
    assert_close(swapped.u, plain.u @ swap)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("time", [-4.0, 0.7, 3.0, 30.0])
def test_splitting_an_interval_into_two_identical_ones(case: str, time: float) -> None:
    model, reference = CASES[case]
    cut = int(model.interval(time))
    systems = [*model.systems[: cut + 1], *model.systems[cut:]]
    split = invert(SwitchedSystem(systems, np.sort([*model.switch_times, time])), reference)
    assert_close(split(TIMES).x, invert(model, reference)(TIMES).x)


def test_operating_point() -> None:
    """An absolute reference about (u0, y0): the same deviations as about zero, and the same certificate."""
    point = OperatingPoint(x0=np.zeros(6), u0=np.array([5.0, -3.0]), y0=np.array([1e3, 2.0]))
    there = mapped(TWO_CHANNELS, lambda s: StateSpace(s.A, s.B, s.C, operating_point=point))
    plain, moved = invert(TWO_CHANNELS, PAIR), invert(there, PAIR + constant(point.y0))
    assert_close(moved(TIMES).x, plain(TIMES).x)
    assert_close(moved(TIMES).u - point.u0, plain(TIMES).u)
    assert moved(TIMES).y == pytest.approx(plain(TIMES).y + point.y0)
    assert moved.certificate.output_error < 1e-11


def test_held_outputs_leave_the_state_at_their_equilibrium() -> None:
    """Before and after, A x + B u = 0 and C x = y: the preactuation starts from the equilibrium of y_0, not from zero."""
    plan: Plan = invert(FIRST, PAIR)
    for t, y in ((-200.0, [0.0, 0.5]), (200.0, [1.0, -1.0])):
        at = plan(t)
        assert FIRST.A @ at.x[0] + FIRST.B @ at.u[0] == pytest.approx(np.zeros(6), abs=1e-10)
        assert at.y[0] == pytest.approx(y, abs=1e-12)
    early = plan([-20.0, -10.0]).x - plan(-200.0).x
    rate = np.log(np.linalg.norm(early[1]) / np.linalg.norm(early[0])) / 10
    assert rate == pytest.approx(0.7, rel=1e-3)


def test_a_reference_in_other_coordinates_of_its_generator() -> None:
    """1 - e^-4t (cos 3t + sin t) over 20 s, its decaying modes mixed with the others: backward in time they must not blow up."""
    S = np.zeros((5, 5))
    S[1:3, 1:3], S[3:, 3:] = [[-4.0, 3.0], [-3.0, -4.0]], [[-4.0, 1.0], [-1.0, -4.0]]
    R, w_0 = np.array([[1.0, 1.0, 0.0, 0.0, 1.0]]), np.array([1.0, -1.0, 0.0, 1.0, 0.0])
    T = np.random.default_rng(6).normal(size=(5, 5))
    signals: list[PiecewiseSignal] = [
        autonomous(S, R, w_0, start=0.0, end=20.0),
        autonomous(T @ S @ np.linalg.inv(T), R @ np.linalg.inv(T), T @ w_0, start=0.0, end=20.0),
    ]
    system = StateSpace([[-2.0]], [[1.0]], [[-3.0]], [[1.0]])  # (s - 1)/(s + 2)
    plans = [invert(system, signal) for signal in signals]
    times = np.linspace(-5.0, 25.0, 100)
    assert_close(plans[1](times).u, plans[0](times).u, 1e-9)
    assert max(plan.certificate.dynamics_residual for plan in plans) < 1e-11


@pytest.mark.parametrize("degree", [6, 12])
@pytest.mark.parametrize("second", [2.0**-10, 2.0**5, 2.0**10])
def test_the_unit_of_time_does_not_matter_for_long_chains(degree: int, second: float) -> None:
    """Three zeros behind many integrators: the plan is the same whatever time is measured in."""
    numerator, denominator = np.poly([2.0, -1.5, 0.5]), np.polymul(np.poly([-1.0, -1.2, -1.4]), [1.0] + [0.0] * degree)
    A, B, C, D = scipy.signal.tf2ss(numerator, denominator)
    t = np.linspace(-2.0, 10.0, 25)
    plans = [
        invert(StateSpace(A / unit, B / unit, C, D), rest_to_rest(0.0, 1.0, 8.0 * unit, smoothness=degree))
        for unit in (1.0, second)
    ]
    for values in (lambda plan, times: plan.inputs(times), lambda plan, times: plan.states(times)):
        expected = values(plans[0], t)
        np.testing.assert_allclose(values(plans[1], t * second), expected, rtol=0, atol=1e-9 * np.max(np.abs(expected)))
