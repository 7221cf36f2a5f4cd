"""Exact inversion through zeros on the imaginary axis: served where the reference leaves their motion at rest, else refused."""

from __future__ import annotations

import itertools
import re

import numpy as np
import pytest
import scipy.integrate

from invtrack.errors import BoundednessError, InvtrackError, NonHyperbolicError
from invtrack.inversion.exact import invert
from invtrack.inversion.feasibility import feasibility
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.linear.zeros import zeros
from invtrack.plans.plan import Plan
from invtrack.references.profiles import autonomous, constant, raised_cosine, rest_to_rest
from invtrack.references.signal import PiecewiseSignal, stack
from tests.inversion.modified_cases import PASSIVE_TWO_DISC
from tests.linear.random_plants import block, plant_with
from tests.linear_motion import states

SLEW = rest_to_rest(0.0, 1.0, 5.0, smoothness=4)


def halves(reference: PiecewiseSignal, w: float, times: int = 1) -> PiecewiseSignal:
    """Two halves of a motion, half a period of w apart: the second takes away what the first leaves in an oscillator."""
    for _ in range(times):
        reference = 0.5 * (reference + reference.shifted(np.pi / w))
    return reference


def simulated(plant: StateSpace, plan: Plan, span: tuple[float, float]) -> np.ndarray:
    """Output at the plan's input from the plan's own first state, minus the wanted one, by an independent integrator."""
    t, errors, x = np.unique(np.concatenate([np.linspace(*span, 9), plan.breakpoints])), [], plan(span[0]).x[0]
    t = t[(t >= span[0]) & (t <= span[1])]
    for a, b in itertools.pairwise(t):
        inside = (a + b) / 2

        def forces(times: np.ndarray, inside: float = inside) -> np.ndarray:
            return plan.inputs(times, inside=np.full(len(times), inside)) @ plant.B.T

        x = states(plant.A, x, forces, np.array([a, b]), longest=0.05)[-1]
        u = plan.inputs([b], inside=[inside])[0]
        errors.append(plant.C @ x + plant.D @ u - plan.reference([b], inside=[inside])[0])
    return np.array(errors)


@pytest.mark.parametrize(
    ("degrees", "internal", "frequencies"),
    [
        ((2,), block(4.4j), [4.4]),
        ((1,), block(3j, -0.7), [3.0]),
        ((2,), block(3j, 1.2, -0.7), [3.0]),  # with preactuation besides
        ((2,), block(2j, 5j), [2.0, 5.0]),
        ((1,), np.block([[block(3j), np.eye(2)], [np.zeros((2, 2)), block(3j)]]), [3.0, 3.0]),  # a chain of two
        ((1, 2), block(3j, 0.4), [3.0]),
    ],
)
def test_a_reference_without_content_at_the_zeros(degrees: tuple[int, ...], internal: np.ndarray, frequencies: list[float]) -> None:
    plant = plant_with(np.random.default_rng(2), degrees, internal)
    motion = stack([(1.0 + i) * SLEW for i in range(len(degrees))])
    with pytest.raises(NonHyperbolicError, match="on the imaginary axis"):
        invert(plant, motion)
    for w in frequencies:
        motion = halves(motion, w)
    plan = invert(plant, motion)
    assert max(plan.certificate.dynamics_residual, plan.certificate.output_error) < 1e-10
    assert "this reference leaves nothing in them" in plan.remarks[-1]
    end = plan.manoeuvre[1] + 2.0
    assert np.max(np.abs(simulated(plant, plan, (max(plan.start, -3.0), end)))) < 1e-6
    later = plan(end + np.array([50.0, 51.3]))
    np.testing.assert_allclose(later.x[0], later.x[1], atol=1e-9 * np.max(np.abs(later.x)))
    np.testing.assert_allclose(plant.A @ later.x[0] + plant.B @ later.u[0], 0.0, atol=1e-8 * np.max(np.abs(later.x)))
    assert feasibility(plant, motion).solvable


def test_whole_periods_of_a_cosine_leave_nothing() -> None:
    """(1 - cos t) over 2 pi has no content at the frequencies 2, 3, ...; over 4 pi none at 1/2 either, but at 1 it resonates."""
    for w, cycles, served in ((2.0, 1, True), (3.0, 1, True), (0.5, 2, True), (0.5, 1, False), (1.0, 1, False), (2.2, 1, False)):
        plant = plant_with(np.random.default_rng(0), (2,), block(1j * w, 1.0, -1.0))
        reference = raised_cosine(2.0, cycles=cycles)
        assert feasibility(plant, reference).solvable == served
        if served:
            assert invert(plant, reference).certificate.dynamics_residual < 1e-11
        else:
            with pytest.raises(NonHyperbolicError, match=r"leaves .* of its peak"):
                invert(plant, reference)


def test_the_figure_is_what_an_oscillator_driven_from_rest_is_left_with() -> None:
    """x_1'' = w^2 (y - x_1), driven by y_d from rest, is left with the amplitude w |integral of y_d e^(-jwt)|."""
    w = 3.0
    plant = StateSpace([[0, 1, 0, 0], [-(w**2), 0, w**2, 0], [0, 0, 0, 1], [0, 0, 0, 0]], [[0.0], [0], [0], [1]], [[0.0, 0, 1, 0]])
    reference = raised_cosine(1.0, period=2.6)
    with pytest.raises(NonHyperbolicError) as caught:
        invert(plant, reference)
    share = float(re.search(r"leaves (\S+) of its peak", str(caught.value)).group(1))  # type: ignore[union-attr]
    t = np.linspace(0.0, 2.6, 4001)
    y = 0.5 * (1 - np.cos(2 * np.pi * t / 2.6))
    found = scipy.integrate.cumulative_simpson(w**2 * y * np.exp(-1j * w * t), x=t, initial=0)
    motion = found * np.exp(1j * w * t) / w  # x_1 = Im
    assert share == pytest.approx(abs(found[-1]) / w / np.max(np.abs(motion)), rel=0.5)  # peak at thirds of pieces
    assert "unobservable mode of the plant" in str(caught.value)


def test_the_advice_given_in_a_refusal_works() -> None:
    with pytest.raises(NonHyperbolicError) as caught:
        invert(PASSIVE_TWO_DISC, SLEW)
    shift = float(re.search(r"r\.shifted\(([\d.]+)\)", str(caught.value)).group(1))  # type: ignore[union-attr]
    assert shift == pytest.approx(np.pi / np.max(zeros(PASSIVE_TWO_DISC).imag), rel=1e-12)
    plan = invert(PASSIVE_TWO_DISC, 0.5 * (SLEW + SLEW.shifted(shift)))
    assert plan.preactuation == plan.postactuation == 0.0
    assert np.max(np.abs(simulated(PASSIVE_TWO_DISC, plan, (0.0, 8.0)))) < 1e-8


def test_a_tenth_of_a_percent_beside_the_period_is_told() -> None:
    w = float(np.max(zeros(PASSIVE_TWO_DISC).imag))
    with pytest.raises(NonHyperbolicError, match=r"leaves \d.\de-0\d of its peak"):
        invert(PASSIVE_TWO_DISC, halves(SLEW, 1.001 * w))


SPRUNG = StateSpace([[0.0, 1.0], [-4.0, -0.5]], [[0.0], [1.0]], [[0.0, 1.0]])
"""A mass on a spring with its velocity for output: a zero at the origin."""


def test_a_zero_at_the_origin_rests_anywhere() -> None:
    """A velocity of 1 - cos over a second and a mean of 1/2 moves the mass by 1/2; a force of 4 times that holds it there."""
    plan = invert(SPRUNG, raised_cosine(1.0, period=1.0))
    after = plan([1.0, 30.0])
    np.testing.assert_allclose(after.x, [[0.5, 0.0], [0.5, 0.0]], atol=1e-12)
    np.testing.assert_allclose(after.u, 2.0, atol=1e-12)
    assert plan.preactuation == plan.postactuation == 0.0
    assert "comes to rest where the manoeuvre leaves it" in plan.remarks[-1]


def test_a_held_velocity_never_rests() -> None:
    with pytest.raises(NonHyperbolicError, match=r"zeros at 0 lie .* outputs held at \[1.0\] after the manoeuvre"):
        invert(SPRUNG, SLEW)
    with pytest.raises(NonHyperbolicError, match=r"outputs held at \[-1.0\] before the manoeuvre"):
        invert(SPRUNG, SLEW + constant(-1.0))


@pytest.mark.parametrize("served", [True, False])
def test_a_double_zero_at_the_origin(served: bool) -> None:
    """An acceleration that adds up to nothing leaves a position, one that does not a velocity."""
    plant = StateSpace([[0.0, 1, 0], [0, 0, 1], [-1, -2, -3]], [[0.0], [0], [1]], [[0.0, 0, 1]])
    push = raised_cosine(1.0, period=2.0)
    if not served:
        with pytest.raises(NonHyperbolicError, match="one whose drive of it adds up to nothing"):
            invert(plant, push)
        return
    plan = invert(plant, push - push.shifted(2.0))
    np.testing.assert_allclose(plan([4.0, 40.0]).x, [[2.0, 0.0, 0.0]] * 2, atol=1e-12)  # 1 m/s for 2 s, up and down evenly
    np.testing.assert_allclose(plan([40.0]).u, 2.0, atol=1e-12)


def test_an_oscillation_that_runs_for_ever_elsewhere() -> None:
    """A sinusoid of another frequency before, during and after; at the zero's own it has no bounded answer."""
    plant = plant_with(np.random.default_rng(5), (1,), block(3j, -1.0))
    for w, served in ((2.0, True), (3.0, False)):
        S = np.array([[0.0, w], [-w, 0.0]])
        running = autonomous(S, [[1.0, 0.0]], [1.0, 0.0], start=0.0, end=1.0)
        endless = PiecewiseSignal(
            np.zeros(1), (running.generators[1],), np.zeros(2, dtype=np.intp), np.array([[1.0, 0.0], [1.0, 0.0]])
        )
        if served:
            assert invert(plant, endless).certificate.output_error < 1e-11
        else:
            with pytest.raises(InvtrackError, match="a mode of the reference coincides with a zero"):
                invert(plant, endless)


def test_units_do_not_matter() -> None:
    """Neither of the states nor of time: the same references are served and refused."""
    rng = np.random.default_rng(1)
    plant = plant_with(rng, (2,), block(3j, -0.5))
    for time in (1e-3, 1.0, 1e4):
        d = 10.0 ** rng.uniform(-6, 6, plant.n_states)
        scaled = StateSpace(plant.A / time * d / d[:, None], plant.B / time / d[:, None], plant.C * d)
        motion = rest_to_rest(0.0, 1.0, 5.0 * time, smoothness=4)
        assert invert(scaled, halves(motion, 3.0 / time)).certificate.dynamics_residual < 1e-9
        with pytest.raises(NonHyperbolicError):
            invert(scaled, motion)


def system(internal: np.ndarray, seed: int = 7) -> StateSpace:
    return plant_with(np.random.default_rng(seed), (2,), internal, mixed=False)


def test_through_a_jump() -> None:
    """The zeros are damped before the jump and on the axis after it: what is left at rest then is one condition in two."""
    w, jump = 3.0, 1.0
    model = SwitchedSystem([system(block(-0.2 + 3j)), system(block(3j))], [jump])
    early = rest_to_rest(0.0, 1.0, 0.5, smoothness=4)
    with pytest.raises(NonHyperbolicError, match=r"leaves .* of its peak"):
        invert(model, early)
    late = halves(rest_to_rest(0.0, 1.0, 2.0, start_time=1.5, smoothness=4), w)  # all of it after the jump
    plan = invert(model, late)
    assert plan.certificate.dynamics_residual < 1e-11
    assert feasibility(model, late).solvable
    assert not feasibility(model, early).solvable


def test_unknowns_before_bring_the_zeros_after_to_rest() -> None:
    """A pair of antistable zeros before the jump, the same pair on the axis after it: two unknowns for two conditions."""
    before, after = system(block(0.5 + 2j)), system(block(3j))
    model = SwitchedSystem([before, after], [1.0])
    plan = invert(model, rest_to_rest(0.0, 1.0, 2.0, smoothness=4))
    assert plan.certificate.dynamics_residual < 1e-10
    np.testing.assert_allclose(plan([60.0]).x, plan([61.0]).x, atol=1e-9)
    assert plan.preactuation > 5.0
    fewer = SwitchedSystem([system(block(0.5, -2.0)), after], [1.0])
    with pytest.raises(BoundednessError, match=r"1 antistable zero\(s\) before .* at rest in zeros on the axis"):
        invert(fewer, rest_to_rest(0.0, 1.0, 2.0, smoothness=4))
