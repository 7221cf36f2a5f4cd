"""Elements of time: what they do to the slow zeros and to errors, and mutants of the points and of the ends."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.integrate
import scipy.linalg

import invtrack
from invtrack.inversion.nonlinear import choice as choosing
from invtrack.inversion.nonlinear import ends
from invtrack.inversion.nonlinear.bend import Bumps
from invtrack.inversion.nonlinear.boundary_value import TwoPointProblem
from invtrack.inversion.nonlinear.elements import Scheme, element_maps, map_at_rest
from invtrack.inversion.nonlinear.ends import End
from invtrack.inversion.nonlinear.mesh import Mesh
from invtrack.inversion.nonlinear.rest import Rest, rest_with
from invtrack.plans.dynamics import Dynamics, mechanism
from invtrack.plans.tail import Side
from tests.inversion.nonlinear.mechanisms import cart_pole, flexible_joint, link, pvtol


def at_rest(plant: invtrack.Plant) -> tuple[Dynamics, Rest]:
    moving = mechanism(plant)
    assert moving is not None
    return moving.dynamics({}), Rest(*moving.operating_point, 0.0)


def multipliers(plant: invtrack.Plant, scheme: Scheme, length: float) -> np.ndarray:
    dynamics, rest = at_rest(plant)
    return np.linalg.eigvals(map_at_rest(dynamics, rest, scheme, length).exact[0])


@pytest.mark.parametrize("count", [1, 2, 4])
def test_slow_zeros_show_as_their_exponentials(count: int) -> None:
    plant, length = cart_pole(), 0.02
    found = multipliers(plant, Scheme(count, (False,)), length)
    for zero in invtrack.linear.zeros(invtrack.linearize(plant)):
        assert np.min(np.abs(found - np.exp(zero * length))) < 1e-4 * length


@pytest.mark.parametrize("scheme", [Scheme(1, (False, True)), Scheme(4, (True, False), refinement=3)])
def test_an_element_at_rest_is_one_along_a_motion_that_does_not_move(scheme: Scheme) -> None:
    dynamics, rest = at_rest(pvtol())
    found = dynamics.derivatives(*(np.repeat(a[None], len(scheme.knots), axis=0) for a in (rest.point, rest.inputs)))
    along, still = element_maps(found, scheme, np.array([0.03])), map_at_rest(dynamics, rest, scheme, 0.03)
    for name in ("end_x", "end_c", "out_x", "out_c"):
        wanted = getattr(along, name)
        np.testing.assert_allclose(getattr(still, name), wanted, rtol=0, atol=1e-13 * np.max(np.abs(wanted)))


@pytest.mark.parametrize("count", [1, 4])
@pytest.mark.parametrize("side", ["before", "after"])
def test_small_motions_leave_rest_and_return_along_the_slow_zeros(side: Side, count: int) -> None:
    """With the cart held a pole falls away, and comes back to rest, as exp(z t) at the rates of its two zeros."""
    plant, length = cart_pole(), 0.02
    dynamics, rest = at_rest(plant)
    zeros = invtrack.linear.zeros(invtrack.linearize(plant))
    found = End.of(dynamics, rest, Scheme(count, (False,)), length, zeros).departure(side)
    growing, decaying = np.max(zeros.real), np.min(zeros.real)
    own, other = (growing, decaying) if side == "before" else (decaying, growing)
    np.testing.assert_allclose(found.A, [[own]], rtol=2e-4)
    falling, not_so = (np.array([0.0, 1.0, 0.0, z]) for z in (own, other))  # cart, pole and their rates
    np.testing.assert_allclose(found.X @ (found.V @ falling), falling, atol=3e-3)
    np.testing.assert_allclose(found.V @ not_so, 0.0, atol=3e-3 * abs(float((found.V @ falling)[0])))


@pytest.mark.parametrize("count", [1, 4])
def test_small_motions_about_rest_are_those_of_the_elements(count: int) -> None:
    """An element that starts on one, with the mean of its input (held: its middle), ends on it, the output met in between."""
    plant, length, small = link(), 0.005, 1e-5
    dynamics, rest = at_rest(plant)
    scheme = Scheme(count, (False,))
    end = End.of(dynamics, rest, scheme, length, invtrack.linear.zeros(invtrack.linearize(plant)))
    found = end.departure("after")
    assert found.A.shape[0] >= 1
    v = small * np.ones(found.A.shape[0])
    times = np.linspace(0.0, length, 2001)
    u = np.array([found.U @ scipy.linalg.expm(found.A * t) @ v for t in times])
    mean = u[1000] if count == 1 else scipy.integrate.simpson(u, x=times, axis=0) / length
    x_0, x_1 = found.X @ v, found.X @ scipy.linalg.expm(found.A * length) @ v
    coefficients = (end.inputs @ x_0).reshape(1, count, -1)
    np.testing.assert_allclose(coefficients[0, 0], mean, rtol=1e-9)
    coefficients[0, 0] += rest.inputs
    start = dynamics.retract(rest.point[None], x_0[None])
    nodes = dynamics.motion(start, coefficients, scheme.integration, np.array([length]))
    reached = dynamics.difference(nodes[0, -1:], rest.point[None])[0]
    np.testing.assert_allclose(reached, x_1, atol=1e-4 * np.max(np.abs(x_1)) + 10 * small**2)


def test_sampling_zeros_of_a_double_integrator() -> None:
    """Of two matched points, symmetric inside: r = 2 has one mode that decays and one that grows, by 12.6 per element."""
    sizes = np.sort(np.abs(multipliers(cart_pole(), Scheme(2, (False,)), 0.02)))
    assert sizes[0] == pytest.approx(0.079, abs=1e-3)
    assert sizes[-1] == pytest.approx(12.6, abs=0.05)


def test_the_wrong_points_put_a_multiplier_on_the_unit_circle() -> None:
    sizes = np.abs(multipliers(pvtol(), Scheme(4, (True, True)), 0.02))
    assert np.min(np.abs(sizes - 1)) < 1e-6


@pytest.mark.parametrize(("make", "at_end"), [(cart_pole, (False,)), (pvtol, (False, False)), (flexible_joint, (False,))])
def test_points_are_chosen_by_the_gap(make: object, at_end: tuple[bool, ...]) -> None:
    plan = invtrack.invert(make(), _reference(make()))  # type: ignore[operator]
    assert plan.checks.gap > 1.0


def _reference(plant: invtrack.Plant) -> invtrack.PiecewiseSignal:
    motions = [invtrack.rest_to_rest(0.0, 0.1, duration=1.0, smoothness=5) for _ in plant.outputs.names]
    return invtrack.references.stack(motions)


def test_equilibria_are_found_with_what_is_open_left_alone() -> None:
    dynamics, rest = at_rest(pvtol())
    found = rest_with(dynamics, np.array([2.0, 1.0]), rest)
    assert found is not None
    np.testing.assert_allclose(found.point, [2.0, 1.0, 0, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(found.inputs, [9.81, 0.0], atol=1e-12)


def test_no_equilibrium_is_none() -> None:
    hinge = """<mujoco><worldbody><body><joint name="q" type="hinge" axis="0 -1 0"/><geom type="capsule" fromto="0 0 0 1 0 0"
    size=".02" mass="1"/><site name="tip" pos="1 0 0"/></body></worldbody>
    <actuator><motor name="u" joint="q"/></actuator></mujoco>"""
    plant = invtrack.Plant.from_xml(hinge, inputs=["u"], outputs=["site:tip:z"])
    dynamics, rest = at_rest(plant)
    assert rest_with(dynamics, np.array([1.5]), rest) is None


def test_block_bidiagonal_problem_against_a_dense_solve() -> None:
    rng = np.random.default_rng(0)
    n, N, first = 5, 40, 3
    decaying, growing = np.diag([0.2, 0.5, 0.9]), np.diag([3.0, 20.0])
    M = np.array(
        [basis @ scipy.linalg.block_diag(decaying, growing) @ np.linalg.inv(basis) for basis in rng.normal(size=(N, n, n))]
    )
    b, scale = rng.normal(size=(N, n)), 10.0 ** rng.uniform(-6, 6, n)
    M, b = M * scale[:, None] / scale, b * scale
    L, R = rng.normal(size=(first, n)) / scale, rng.normal(size=(n - first, n)) / scale
    left, right = rng.normal(size=first), rng.normal(size=n - first)
    problem = TwoPointProblem.of(M, L, R, scale)
    found = problem.solve(b, left, right)
    np.testing.assert_allclose(L @ found[0], left, atol=1e-8)
    np.testing.assert_allclose(R @ found[-1], right, atol=1e-8)
    misses = (found[1:] - np.einsum("kij,kj->ki", M, found[:-1]) - b) / scale
    assert np.max(np.abs(misses)) < 1e-9 * np.max(np.abs(found / scale))
    rows, more = rng.normal(size=(3, n)) / scale, rng.normal(size=(N, n)) * scale
    change = problem.solve(b + more, left, right) - found
    seen = np.einsum("rkn,kn->r", problem.influence(rows[:2], rows[2:]), more)
    np.testing.assert_allclose(seen, np.append(rows[:2] @ change[0], rows[2:] @ change[-1]), rtol=1e-9)
    with pytest.raises(np.linalg.LinAlgError, match="singular"):
        TwoPointProblem.of(M, np.zeros_like(L), R, scale)


def test_bumps_against_quadrature() -> None:
    bumps = Bumps(np.linspace(-1.0, 3.0, 21), 4, np.array([1.0, 2.0]))
    assert bumps.count == 16
    t = np.linspace(-1.5, 3.5, 10_001)
    phi = bumps.at(t).toarray()
    gram = np.trapezoid(phi[:, :, None] * phi[:, None], t, axis=0)
    for k, row in enumerate(bumps.gram):
        np.testing.assert_allclose(np.diag(gram, k), row[: bumps.count - k], rtol=1e-8)
    weights = np.random.default_rng(0).normal(size=(16, 2))
    bend = bumps.signal(weights)
    np.testing.assert_allclose(bend(t), phi @ weights, atol=1e-13)
    squares = np.trapezoid((bend(t) / bumps.scale) ** 2, t, axis=0).sum()
    assert bumps.size(weights) == pytest.approx(np.sqrt(squares), rel=1e-8)
    for order in range(4):  # all derivatives but the highest
        left, right = bend.sides(order)
        assert np.max(np.abs(right - left)) < 1e-10 * np.max(np.abs(bend(t, derivative=order)))


def test_elements_are_split_where_they_were() -> None:
    mesh = Mesh.even(np.array([0.0, 1.0, 3.0]), np.array([1.0]), 0.5)
    finer = mesh.split(np.array([1, 2, 1, 4, 1, 3]))
    np.testing.assert_allclose(np.diff(finer.edges), finer.lengths)
    assert set(mesh.edges) <= set(finer.edges)
    np.testing.assert_allclose(finer.lengths, [0.5, 0.25, 0.25, 0.5, *[0.125] * 4, 0.5, *[1 / 6] * 3])
    np.testing.assert_array_equal(finer.interval, [0, 0, 0, *[1] * 9])


def moved(distance: float = 1.0) -> invtrack.Plan:
    return invtrack.invert(cart_pole(), invtrack.rest_to_rest(0.0, distance, duration=2.0))


def test_mutant_points_of_the_wrong_parity_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(choosing, "candidate_schemes", lambda count, outputs: [Scheme(count, (True,) * outputs)])
    with pytest.raises(invtrack.InvtrackError, match="unit circle"):
        moved()


def test_mutant_rows_of_the_other_end_do_not_come_to_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(End, "start_rows", End.end_rows, raising=True)
    with pytest.raises(invtrack.InvtrackError):
        moved()


def test_mutant_that_misses_a_zero_does_not_come_to_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that runs the slow unstable zero forward from rest, like the stable ones, leaves it growing."""
    monkeypatch.setattr(ends, "NEUTRAL", 0.2)  # exp(3.8 H) is below 1.2 for elements of 40 ms
    with pytest.raises(invtrack.InvtrackError):
        moved()
