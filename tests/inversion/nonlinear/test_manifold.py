"""Tails beyond small motions: polynomials, and the manifold along which a mechanism leaves rest and comes to it."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg
import scipy.optimize

import invtrack
from invtrack.arrays import Array
from invtrack.inversion.nonlinear import manifold
from invtrack.inversion.nonlinear.elements import Scheme
from invtrack.inversion.nonlinear.ends import Departure, End, zeros_at
from invtrack.inversion.nonlinear.manifold import curved
from invtrack.inversion.nonlinear.powers import Powers
from invtrack.inversion.nonlinear.rest import Rest
from invtrack.plans.dynamics import Dynamics, mechanism
from invtrack.plans.tail import Side
from tests.inversion.nonlinear.mechanisms import CART_POLE, cart_pole, link, pvtol


def at_rest(plant: invtrack.Plant, scheme: Scheme, length: float) -> tuple[Dynamics, End]:
    moving = mechanism(plant)
    assert moving is not None
    dynamics, rest = moving.dynamics({}), Rest(*moving.operating_point, 0.0)
    return dynamics, End.of(dynamics, rest, scheme, length, zeros_at(dynamics, rest))


def slopes_by_differences(work: object, x: Array, step: float) -> Array:
    assert callable(work)
    return np.column_stack([(work(x + step * e) - work(x - step * e)) / (2 * step) for e in np.eye(len(x))])


POWERS = Powers(2, 4, plain=1)


def test_monomials_are_counted_once() -> None:
    assert len(POWERS) == 3 + 3 + 4 + 5
    assert len(Powers.most(1, 36, 7)) == 7
    assert Powers.most(3, 36, 7).degree == 4
    assert Powers.most(40, 36, 7).degree == 1
    assert len(Powers(0, 1)) == 0


def test_slopes_of_monomials() -> None:
    w = np.array([0.7, -0.4, 0.3])
    np.testing.assert_allclose(POWERS.slopes(w), slopes_by_differences(POWERS.values, w, 1e-6), atol=1e-9)


def test_polynomials_are_recovered_from_their_values() -> None:
    powers = Powers(3, 4)
    wanted = np.random.default_rng(1).standard_normal((2, len(powers)))
    np.testing.assert_allclose(powers.fitted(powers.values(powers.samples) @ wanted.T), wanted, atol=1e-10)


def test_powers_follow_a_map_up_to_their_degree() -> None:
    N = np.random.default_rng(2).standard_normal((3, len(POWERS)))
    N[2, :2], N[2, 3:] = 0.0, 0.0  # the plain one by itself
    N[:2, 2] = 0.0
    P, w = POWERS.carried(N), np.array([0.8, -0.5, 0.6])
    errors = [np.max(np.abs(POWERS.values(N @ POWERS.values(s * w)) - P @ POWERS.values(s * w))) for s in (1e-2, 5e-3)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(POWERS.degree + 1, abs=0.2)


@pytest.mark.parametrize("angle", [0.1, 0.5, 1.0])
def test_a_pole_falls_and_rises_along_the_separatrix_of_the_pendulum(angle: float) -> None:
    """Without friction the upright pole on a cart that is held has the speed 2 w sin(angle / 2), w its growing zero."""
    text = CART_POLE.replace(' damping="0.1"', "").replace(' damping="0.002"', "")
    plant = invtrack.Plant.from_xml(text, inputs=["force"], outputs=["joint:cart"])
    scheme = Scheme(4, (False,))
    dynamics, end = at_rest(plant, scheme, 0.02)
    rate = np.max(end.zeros.real)
    sides: list[tuple[Side, float]] = [("before", 1.0), ("after", -1.0)]
    for side, sign in sides:
        speed = sign * 2 * rate * np.sin(angle / 2)
        found = curved(dynamics, end, scheme, side, np.array([0.0, angle, 0.0, sign * rate * angle]))
        on_it = found.X @ found.powers.values(ratio_for(found, angle))
        # The degree of the polynomials, and the cart that is held at four points of an element, leave this.
        np.testing.assert_allclose(on_it, [0.0, angle, 0.0, speed], atol=1e-6 + 1e-6 * angle**9)
        later = found.X @ scipy.linalg.expm(sign * -0.3 * found.A) @ found.powers.values(ratio_for(found, angle))
        quarter = 4 * np.arctan(np.tan(angle / 4) * np.exp(-0.3 * rate))
        assert later[1] == pytest.approx(quarter, abs=1e-6 + 1e-5 * angle**9)


def ratio_for(found: Departure, angle: float) -> Array:
    """The coordinate at which the pole has that angle."""
    reach = 1.0 / manifold.ROOM
    sign = np.sign(found.X[1, 0])
    at = scipy.optimize.brentq(lambda w: found.X[1] @ found.powers.values(np.array([sign * w])) - angle, 0.3 * reach, 1.5 * reach)
    return np.array([sign * at])


@pytest.mark.parametrize("degree", [1, 3, 5])
def test_tails_are_off_by_the_power_above_their_degree(degree: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The pole's motion is odd, so that the even powers between have no part in it."""
    monkeypatch.setattr(manifold, "DEGREE", degree)
    scheme, length, gaps = Scheme(1, (False,)), 5e-3, []
    dynamics, end = at_rest(cart_pole(), scheme, length)
    angles = np.array([0.4, 0.6])
    for angle in angles:
        away = np.array([0.0, angle, 0.0, angle * np.max(end.zeros.real)])
        found = curved(dynamics, end, scheme, "before", away)
        assert found.powers.degree == degree
        gaps.append(gap(dynamics, end, scheme, found, away))
    assert np.log(gaps[1] / gaps[0]) / np.log(angles[1] / angles[0]) == pytest.approx(degree + 2, abs=0.5)


def gap(dynamics: Dynamics, end: End, scheme: Scheme, found: Departure, away: Array) -> float:
    """By how much an element for a held input, driven by a tail's, ends off the tail."""
    phi = found.start(away)
    held = end.rest.inputs + found.U @ scipy.linalg.expm(found.A * end.length / 2) @ phi
    start = dynamics.retract(end.rest.point[None], (found.X @ phi)[None])
    nodes = dynamics.motion(start, held[None, None], scheme.integration, np.array([end.length]))
    reached = dynamics.difference(nodes[:, -1], end.rest.point[None])[0]
    return float(np.max(np.abs(reached - found.X @ scipy.linalg.expm(found.A * end.length) @ phi)))


@pytest.mark.parametrize(("make", "size"), [(lambda: link(hanging=True), 0.02), (pvtol, 0.1)])
@pytest.mark.parametrize("side", ["before", "after"])
def test_fast_motions_stay_linear_beside_powers_of_the_slow_ones(make: object, size: float, side: Side) -> None:
    assert callable(make)
    scheme, length = Scheme(1, (False,) * (2 if make is pvtol else 1)), 1e-3
    dynamics, end = at_rest(make(), scheme, length)
    linear = end.departure(side)
    slowest = np.real(np.linalg.eig(linear.A)[1][:, np.argmin(np.abs(np.linalg.eigvals(linear.A)))])
    away = linear.X @ slowest
    away *= size / np.max(np.abs(away[: len(away) // 2]))  # radians and metres
    found = curved(dynamics, end, scheme, side, away)
    assert found.powers.degree > 1
    on_it = found.part(away)
    np.testing.assert_allclose(found.part(on_it), on_it, rtol=0, atol=1e-12 * np.max(np.abs(on_it)))
    by_differences = slopes_by_differences(found.part, away, 1e-6)
    np.testing.assert_allclose(found.slopes(away), by_differences, atol=1e-4 * np.max(np.abs(by_differences)))
    assert gap(dynamics, end, scheme, found, away) <= 1e-2 * gap(dynamics, end, scheme, linear, away)


def test_what_does_not_depart_has_no_powers() -> None:
    scheme = Scheme(1, (False,))
    dynamics, end = at_rest(cart_pole(), scheme, 1e-3)
    assert curved(dynamics, end, scheme, "before", np.zeros(4)).powers.degree == 1


def test_a_window_of_a_tenth_costs_nothing() -> None:
    """Nodes over 0.4 s before and after, where a fifth of the pole's motion is left, in place of 4 s."""
    plant, reference = cart_pole(), invtrack.rest_to_rest(0.0, 10.0, duration=2.0)
    plan = invtrack.invert(plant, reference, hold=1e-3, max_preactuation=0.4, max_postactuation=0.4)
    assert plan.breakpoints[0] >= -0.45
    assert plan.breakpoints[-1] <= 2.45
    controller = invtrack.TrackingController(plan, invtrack.lqr(plan, Q=1.0, R=1.0))
    run = invtrack.simulate(plant, controller, timestep=1e-3, start=-8.0, end=10.0, vibration_period=0.1)
    assert invtrack.max_error(run) <= 1e-9 * 10.0
