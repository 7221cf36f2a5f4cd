"""Modified inversion on nonlinear motions: outputs bent, as little as need be, so that slow zeros rest outside of a window."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from types import SimpleNamespace

import numpy as np
import pytest

import invtrack
from invtrack.inversion import ModifiedMotion, modified_inversion, preactuation_trade_off, tune_modified_inversion
from invtrack.inversion.modified.tuned_motion import motion_within_error
from tests.inversion.nonlinear.mechanisms import cart_pole, link, pvtol, sideways
from tests.inversion.nonlinear.test_independent import pole_by_collocation
from tests.inversion.nonlinear.test_motions import PAYLOADS
from tests.inversion.nonlinear.test_refusals import CRANE

ZERO = 3.7801984  # [rad/s], unstable, of the cart-pole; the stable one is -3.8393772
WINDOW = 0.6  # [s]
TO = {ZERO: np.log(100) / WINDOW}


@lru_cache(maxsize=1)
def cart() -> invtrack.Plant:
    return cart_pole()


def slew(distance: float, smoothness: int = 2) -> invtrack.PiecewiseSignal:
    return invtrack.rest_to_rest(0.0, distance, duration=2.0, smoothness=smoothness)


@lru_cache(maxsize=4)
def moved(distance: float) -> ModifiedMotion:
    plan = modified_inversion(cart(), slew(distance), move=TO)
    assert isinstance(plan, ModifiedMotion)
    return plan


def transform(plan: invtrack.Plan, wanted: invtrack.PiecewiseSignal, start: float, zero: complex) -> complex:
    """Integral from `start` on of the wanted output less its first value, times exp(-zero (t - start)), piece by piece."""
    edges = np.unique(np.concatenate([[start], plan.breakpoints[plan.breakpoints > start], wanted.breakpoints]))
    nodes, weights = np.polynomial.legendre.leggauss(8)
    t = edges[:-1, None] + np.diff(edges)[:, None] * (nodes + 1) / 2
    values = (wanted(t.ravel()) - wanted(start - 1.0)).reshape(t.shape)
    inside = np.sum(values * np.exp(-zero * (t - start)) * weights * np.diff(edges)[:, None] / 2)
    last = (wanted(edges[-1] + 1.0) - wanted(start - 1.0))[0]
    return complex(inside + last * np.exp(-zero * (edges[-1] - start)) / zero)


def driven(plant: invtrack.Plant, plan: invtrack.Plan) -> float:
    """Largest distance of the outputs from those planned, in MuJoCo from rest, as a share of the largest motion."""
    gains = invtrack.lqr(invtrack.linearize(plant), Q=1.0, R=1.0)
    run = invtrack.simulate(plant, invtrack.TrackingController(plan, gains), timestep=1e-3, evaluate="stages")
    assert run.status == "completed"
    return invtrack.max_error(run, wanted="planned_output") / float(np.max(np.ptp(run.reference.values, axis=0)))


def test_small_motions_are_bent_as_the_linear_zero_asks() -> None:
    """Of a linear plant that rests until t_0 the integral of y exp(-z (t - t_0)) vanishes; turning adds the cube of the motion."""
    distances = [1.0, 3.0]
    left = []
    for distance in distances:
        plan = moved(distance)
        wanted, bent = plan.reference, plan.reference + plan.bend
        left.append(abs(transform(plan, bent, -WINDOW, ZERO) / transform(plan, wanted, -WINDOW, ZERO)))
    assert left[0] < 5e-3
    np.testing.assert_allclose(np.diff(np.log(left)) / np.diff(np.log(distances)), 2.0, atol=0.1)


def test_the_bend_is_nearly_the_least_of_all() -> None:
    """Of all e on a window with integral of e exp(-z s) = c the least is a combination of exp(-z s) and its conjugate."""
    plant = invtrack.Plant.from_xml(invtrack.model_path("two_disc"), inputs=["motor"], outputs=["disc2_angle"])
    plan = modified_inversion(plant, invtrack.rest_to_rest(0.0, 1.0, duration=5.0), axis_distance=0.5, real_part=2.0)
    assert isinstance(plan, ModifiedMotion)
    z, length = plan.moved[0], plan.window[1] - plan.window[0]
    c = -transform(plan, plan.reference, plan.window[0], z)
    assert transform(plan, plan.bend, plan.window[0], z) == pytest.approx(c, rel=1e-6)
    rates = np.array([z, z.conjugate()])
    sums = rates[:, None] + rates[None].conj()
    gram = -np.expm1(-sums * length) / sums  # of exp(-z s) and its conjugate
    constraint = np.array([c, c.conjugate()])
    least = (constraint.conj() @ np.linalg.solve(gram, constraint)).real
    t = np.linspace(*plan.window, 20001)
    squares = np.trapezoid(plan.bend(t)[:, 0] ** 2, t)
    assert least < squares < 1.2 * least  # what it takes to begin and end smoothly
    assert plan.optimality_gap < 1e-4


def test_from_rest_in_mujoco() -> None:
    plan = moved(3.0)
    assert plan.window == pytest.approx((-WINDOW, 2.0))
    assert plan.start == plan.window[0]
    assert plan.alpha == np.inf
    assert np.max(np.abs(plan.states(plan.window[0] - np.linspace(0.0, 1.0, 11)))) < 1e-8
    assert driven(cart(), plan) < 1e-8
    assert 1e-3 < plan.relative_error < 0.03
    # As much preactuation leaves the exact plan away from rest.
    cut = invtrack.invert(cart(), slew(3.0), max_preactuation=WINDOW)
    assert np.max(np.abs(cut.states(cut.start))) > 1e-2


def test_the_bent_outputs_against_collocation() -> None:
    """The bounded motion of the pole, found by other means for the bent outputs, is at rest until they are bent."""
    plan = moved(3.0)
    t, theta, force = pole_by_collocation(cart(), plan.reference + plan.bend)
    size = np.max(np.abs(theta))
    assert np.max(np.abs(theta[t <= plan.window[0]])) < 1e-6 * size
    samples = plan(t)
    np.testing.assert_allclose(samples.x[:, 1], theta, atol=1e-6 * size)
    np.testing.assert_allclose(samples.u[:, 0], force, atol=1e-5 * np.max(np.abs(force)))


def test_error_falls_towards_the_exact_plan_and_not_below_its_bound() -> None:
    trade = preactuation_trade_off(cart(), slew(1.0), real_parts=[2.0, 8.0], zeros=[ZERO])
    errors, bounds = trade.column("max_error"), trade.column("error_bound")
    assert np.all(np.diff(errors) > 0)
    assert errors[0] < 1e-4
    assert np.all(bounds < errors)
    assert np.all(errors < 4 * bounds)
    assert np.all(trade.column("error_after") < 1e-8)
    assert np.all(np.isinf(trade.column("alpha")))


def test_what_can_be_afforded() -> None:
    sooner = tune_modified_inversion(cart(), slew(1.0), preactuation=0.5, zeros=[ZERO])
    assert sooner.start == pytest.approx(-0.5)
    with pytest.raises(invtrack.errors.InversionError, match=r"error of 0.001 cannot be reached.*from 8 to 8.5.*slower reference"):
        tune_modified_inversion(cart(), slew(1.0), error=1e-3, zeros=[ZERO], real_parts=(8.0, 8.5))


@pytest.mark.parametrize("wish", [0.3, 1e-2, 1e-4])
@pytest.mark.parametrize("falls", [lambda time: np.exp(-3 * time), lambda time: 1 / (1 + 50 * time**2)], ids=["real", "complex"])
def test_few_plans_meet_an_error(falls: Callable[[float], float], wish: float) -> None:
    asked = []

    def plan(real_part: float) -> SimpleNamespace:
        asked.append(real_part)
        return SimpleNamespace(relative_error=falls(np.log(100) / real_part), real_part=real_part)

    found = motion_within_error(plan, (0.04, 40.0), wish)  # type: ignore[arg-type]
    assert 0.99 * wish <= found.relative_error <= wish
    assert len(asked) <= 9


def test_a_stable_zero_at_rest_after_the_manoeuvre() -> None:
    plan = modified_inversion(cart(), slew(1.0), axis_distance=4.0, real_part=-6.0)
    assert isinstance(plan, ModifiedMotion)
    assert len(plan.moved) == 2
    assert plan.window == pytest.approx((0.0, 2.0 + np.log(100) / 6))
    assert (plan.start, plan.end) == plan.window
    after = plan(plan.end + np.linspace(0.0, 1.0, 11))
    np.testing.assert_allclose(after.x, np.broadcast_to([1.0, 0, 0, 0], after.x.shape), atol=1e-8)
    assert driven(cart(), plan) < 1e-6


def test_zeros_on_the_axis() -> None:
    """The load of a crane swings for ever: no inverse is at rest on both sides, unless the trolley's way is bent for it."""
    crane = invtrack.Plant.from_xml(CRANE, inputs=["force"], outputs=["joint:trolley"])
    reference = invtrack.rest_to_rest(0.0, 2.0, duration=4.0)
    with pytest.raises(invtrack.errors.NonHyperbolicError):
        invtrack.invert(crane, reference)
    plan = modified_inversion(crane, reference, axis_distance=0.1, real_part=3.0)
    assert plan.relative_error < 0.01
    assert driven(crane, plan) < 1e-7


def test_other_zeros_keep_their_tails_through_a_change_of_the_payload() -> None:
    plant = link()
    reference = invtrack.rest_to_rest(0.0, np.pi / 2, duration=1.0)
    slow = min(zero.real for zero in invtrack.linear.zeros(invtrack.linearize(plant)) if zero.real > 0)
    plan = modified_inversion(plant, reference, move={slow: 10.0}, schedule=PAYLOADS[:1], accuracy=1e-6)
    assert isinstance(plan, ModifiedMotion)
    assert slow < 15 < plan.alpha < np.inf
    assert len(plan.schedule) == 1
    assert plan.certificate.worst(exact=True) <= 1e-5
    assert plan.relative_error < 1e-3


def test_outputs_bend_by_their_scales() -> None:
    """The PVTOL may give way in height, too, where that is said to cost little."""
    plans = [
        modified_inversion(pvtol(), sideways(0.3), axis_distance=20.0, real_part=8.0, output_scale=scale, accuracy=1e-6)
        for scale in ([1.0, 1.0], [1.0, 100.0])
    ]
    aside, up = np.array([plan.max_error for plan in plans]).T
    assert up[1] > up[0]
    assert aside[1] < aside[0]


REFUSED = {
    "another frequency": ({"move": {3.1305j: 2 + 5j}}, r"put to rest, not placed.*0\+-3.131j to 2\+-5j.*own imaginary part"),
    "poles of the error": ({"move": TO, "error_poles": [-1, -2]}, "error_poles is for linear models.*leave error_poles out"),
    "an interval": ({"move": TO, "interval": 0}, "interval is for linear models"),
    "another design": ({"move": TO, "design": "robust"}, "design is for linear models.*least one"),
    "no such zero": ({"move": {5.0: 6.0}}, "no zero at 5 to move"),
    "too short a limit": ({"move": TO, "max_preactuation": 0.5}, r"bent from 0.6 s before.*max_preactuation=0.5 s does not allow"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refusals(case: str) -> None:
    options, reason = REFUSED[case]
    plant = cart()
    if case == "another frequency":
        plant = invtrack.Plant.from_xml(CRANE, inputs=["force"], outputs=["joint:trolley"])
    with pytest.raises(invtrack.InvtrackError, match=reason):
        modified_inversion(plant, slew(1.0), **options)


def test_none_to_move_is_the_exact_plan() -> None:
    plan = modified_inversion(cart(), slew(1.0), axis_distance=0.1, real_part=6.0)
    assert any("no zeros were moved: within 0.1 rad/s" in remark for remark in plan.remarks)
    assert plan.relative_error < 1e-8
    assert plan.alpha == pytest.approx(ZERO)


def test_a_schedule_is_for_a_plant() -> None:
    with pytest.raises(invtrack.errors.PlanError, match="schedule is for a Plant"):
        modified_inversion(invtrack.linearize(cart()), slew(1.0), move=TO, schedule=[invtrack.Change(1.0, mass=1.0)])
