"""Modified inversion against transfer functions, Rosenbrock's pencil and its own promises: poles, rest on the target, e = 0."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.signal
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial import Polynomial

from invtrack.inversion.exact import invert
from invtrack.inversion.modified.modified_inversion import modified_inversion
from invtrack.linear.normal_form import normal_form
from invtrack.linear.state_space import OperatingPoint, StateSpace
from invtrack.linear.zeros import zeros
from invtrack.plans.actuation import plan_actuation_time
from invtrack.plans.plan import Plan
from invtrack.plans.preactuation import preactuation_bound
from invtrack.references.profiles import constant, rest_to_rest
from invtrack.references.signal import stack
from tests.cited_plants import HE3_A, HE3_B, HE3_C, TWO_DISC_A, TWO_DISC_B, TWO_DISC_C
from tests.inversion.modified_cases import HE3, HE3_POLES, HOVER, TWO_DISC, moved_pair
from tests.linear.random_plants import assert_same_set, block, pencil_zeros, plant_with, rotation

NODES, WEIGHTS = np.polynomial.legendre.leggauss(60)
SLEW = rest_to_rest(0.0, 1.0, 5.0, smoothness=3)


def modified_poles(
    A: np.ndarray, B: np.ndarray, C: np.ndarray, degrees: tuple[int, ...], F: np.ndarray, T: np.ndarray
) -> np.ndarray:
    """Eigenvalues of the plant under u = B_y^-1 (-A_x x + F T x), from the rows of A_x and B_y as the paper defines them."""
    A_x = np.array([C[i] @ np.linalg.matrix_power(A, r) for i, r in enumerate(degrees)])
    B_y = np.array([C[i] @ np.linalg.matrix_power(A, r - 1) @ B for i, r in enumerate(degrees)])
    return np.linalg.eigvals(A + B @ np.linalg.solve(B_y, F @ T - A_x))


def test_hover_zeros_are_those_of_the_pencil() -> None:
    found = zeros(HE3)
    assert_same_set(found, pencil_zeros(HE3_A, HE3_B, HE3_C, np.zeros((4, 4))), 1e-9)
    assert_same_set(found, [0.0465 + 4.3692j, 0.0465 - 4.3692j, -0.0543 + 2.2753j, -0.0543 - 2.2753j], 1e-4)


@pytest.mark.parametrize("design", ["robust", "least error"])
def test_hover_pair_is_moved_and_nothing_else(design: str) -> None:
    pair, move = moved_pair(2.0)
    plan = modified_inversion(HE3, HOVER, move=move, error_poles=HE3_POLES, design=design)  # type: ignore[arg-type]
    form = normal_form(HE3)
    T = np.vstack([form.C_star, form.N])
    found = modified_poles(HE3_A, HE3_B, HE3_C, (1, 1, 1, 1), plan.modification[0].F, T)
    stays = -0.0542764604 + 2.2753357271j
    stays = min(zeros(HE3), key=lambda s: abs(s - stays))
    wanted = [*HE3_POLES, 2 + 1j * pair.imag, 2 - 1j * pair.imag, stays, np.conj(stays)]
    assert_same_set(found, wanted, 1e-8)
    assert plan.alpha == pytest.approx(2.0)
    assert max(plan.certificate.dynamics_residual, plan.certificate.continuity) < 1e-12


def test_hover_trades_preactuation_for_error() -> None:
    _, move = moved_pair(2.0)
    exact, plan = invert(HE3, HOVER), modified_inversion(HE3, HOVER, move=move, error_poles=HE3_POLES)
    # 1 % of the peak: ln(100) / 0.0465 = 99 s and ln(100) / 2 = 2.3 s, up to the size at the start.
    assert plan_actuation_time(exact, "before") == pytest.approx(99.0, rel=0.05)
    assert plan_actuation_time(plan, "before") < 3.0
    assert 1e-3 < plan.relative_error < 0.06
    assert np.max(np.abs(plan.tracking_error(np.linspace(-2.0, -0.01, 100)))) > 1e-4  # before t = 0 too


def residues_of_error(r: int, offending: np.ndarray, poles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Residues and poles of H, E = H s^r Y_d: Y/Y_d = N q / P with the plant's zeros N, and q such that it is 1 + O(s^r)."""
    N, P = Polynomial(np.poly(offending)[::-1].real), Polynomial(np.poly(poles)[::-1].real)
    series = np.zeros(r)  # of P / N, low orders
    for k in range(r):
        series[k] = (P.coef[k] - sum(N.coef[j] * series[k - j] for j in range(1, min(k, len(N.coef) - 1) + 1))) / N.coef[0]
    rest = N * Polynomial([*series, 1.0]) - P
    assert np.max(np.abs(rest.coef[:r])) < 1e-9 * np.max(np.abs(P.coef))
    numerator = rest.coef[r:]
    found, at, direct = scipy.signal.residue(numerator[::-1], P.coef[::-1])
    assert not direct.size or np.max(np.abs(direct)) < 1e-12
    return found, at


def error_by_hand(r: int, offending: np.ndarray, poles: np.ndarray, t: float) -> float:
    """e(t) of the slew: sum of residues times the two-sided convolution of exp(p t) with y_d^(r)."""
    value = 0j
    for residue, pole in zip(*residues_of_error(r, offending, poles), strict=True):
        a, b = (0.0, min(max(t, 0.0), 5.0)) if pole.real < 0 else (min(max(t, 0.0), 5.0), 5.0)
        for start, end in zip(np.linspace(a, b, 13)[:-1], np.linspace(a, b, 13)[1:], strict=True):
            s = (start + end) / 2 + (end - start) / 2 * NODES
            y_r = SLEW(s, derivative=r)[:, 0]
            sign = 1.0 if pole.real < 0 else -1.0
            value += sign * residue * (end - start) / 2 * np.sum(WEIGHTS * np.exp(pole * (t - s)) * y_r)
    return value.real


@pytest.mark.parametrize("to", [1.0, -1.5])
def test_error_is_that_of_the_transfer_function(to: float) -> None:
    plan = modified_inversion(TWO_DISC, SLEW, axis_distance=0.5, real_part=to, error_poles=[-1.0, -2.0], design="robust")
    offending = pencil_zeros(TWO_DISC_A, TWO_DISC_B, TWO_DISC_C, np.zeros((1, 1)))
    poles = np.concatenate([to + 1j * offending.imag, [-1.0, -2.0]])
    times = np.array([-2.0, -0.4, 0.3, 1.7, 3.3, 4.9, 5.6, 8.0])
    expected = [error_by_hand(2, offending, poles, t) for t in times]
    assert np.max(np.abs(expected)) > 1e-3
    np.testing.assert_allclose(plan.tracking_error(times)[:, 0], expected, atol=1e-10)


@pytest.mark.parametrize("design", ["robust", "least error"])
@pytest.mark.parametrize("to", [1.0, -1.0])
def test_output_comes_to_rest_on_its_target(design: str, to: float) -> None:
    plan = modified_inversion(TWO_DISC, SLEW, axis_distance=0.5, real_part=to, error_poles=[-1.0, -2.0], design=design)  # type: ignore[arg-type]
    assert np.max(np.abs(plan.tracking_error([-80.0, 80.0]))) < 1e-12
    assert plan.max_error[0] > 1e-4


def test_largest_error_is_found() -> None:
    plan = modified_inversion(TWO_DISC, SLEW, axis_distance=0.5, real_part=1.0, error_poles=[-1.0, -2.0])
    t = np.linspace(-20.0, 40.0, 40_001)
    errors = np.abs(plan.tracking_error(t))[:, 0]
    assert plan.max_error[0] == pytest.approx(errors.max(), rel=1e-3)
    assert plan.max_error_after[0] == pytest.approx(errors[t >= 5.0].max(), rel=1e-3)
    assert plan.relative_error == pytest.approx(plan.max_error[0])


def test_chains_alone_leave_the_exact_inverse() -> None:
    plan, exact = (modified_inversion(TWO_DISC, SLEW, move={}, error_poles=[-1.0, -2.0]), invert(TWO_DISC, SLEW))
    t = np.linspace(-30.0, 30.0, 301)
    np.testing.assert_allclose(plan(t).u, exact(t).u, atol=1e-10)
    np.testing.assert_allclose(plan(t).x, exact(t).x, atol=1e-10)
    assert plan.max_error[0] < 1e-12
    assert plan.preactuation == pytest.approx(exact.preactuation)


def test_a_small_move_costs_little() -> None:
    """The error goes to zero with the distance that the zeros are moved."""
    alpha = zeros(TWO_DISC)[0].real
    errors = [
        modified_inversion(
            TWO_DISC, SLEW, axis_distance=0.5, real_part=alpha + d, error_poles=[-1.0, -2.0], design="robust"
        ).max_error[0]
        for d in (0.02, 0.01)
    ]
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.1)


def test_input_before_the_manoeuvre_decays_at_alpha() -> None:
    plan = modified_inversion(TWO_DISC, SLEW, axis_distance=0.5, real_part=1.3, error_poles=[-1.0, -2.0])
    period = 2 * np.pi / abs(zeros(TWO_DISC)[0].imag)
    t = -0.1 - period * np.arange(6)
    rate = np.polyfit(t, np.log(np.abs(plan.inputs(t)[:, 0])), 1)[0]
    assert rate == pytest.approx(plan.alpha, rel=0.01)
    bound = preactuation_bound(plan)
    assert bound.alpha == pytest.approx(plan.alpha, rel=1e-9)


def test_zeros_moved_to_the_left_need_no_preactuation() -> None:
    plan = modified_inversion(TWO_DISC, SLEW, axis_distance=0.5, real_part=-1.0, error_poles=[-1.0, -2.0])
    assert plan.preactuation == 0.0
    assert plan.alpha == np.inf
    assert np.all(plan(np.array([-5.0, -1e-9])).x == 0.0)


def assert_alike(found: Plan, expected: Plan, T: np.ndarray, tolerance: float) -> None:
    t = np.linspace(-3.0, 15.0, 61)
    x, u = expected(t).x @ T.T, expected(t).u
    assert np.max(np.abs(found(t).x - x)) < tolerance * np.max(np.abs(x))
    assert np.max(np.abs(found(t).u - u)) < tolerance * np.max(np.abs(u))


@pytest.mark.parametrize("design", ["robust", "least error"])
def test_coordinates_do_not_matter(design: str) -> None:
    """Neither those of the state, nor which internal ones they make the normal form choose: eta + N zeta is as good as eta."""
    rng = np.random.default_rng(5)
    T = rotation(rng, 4) @ np.diag([1.0, 3.0, 0.2, 1.0])
    options = {"axis_distance": 0.5, "real_part": 1.0, "error_poles": [-1.0, -2.0], "design": design}
    plan = modified_inversion(TWO_DISC, SLEW, **options)  # type: ignore[arg-type]
    assert_alike(modified_inversion(TWO_DISC.transformed(T), SLEW, **options), plan, T, 1e-8)  # type: ignore[arg-type]
    form = normal_form(TWO_DISC)
    mixed = rotation(rng, 4) @ (np.eye(4) + form.V @ np.array([[2.0, -1.0], [0.5, 3.0]]) @ form.C_star)
    other = normal_form(TWO_DISC.transformed(mixed))
    assert np.linalg.norm(other.N @ mixed @ form.P) > 0.1  # the internal coordinates differ by outputs
    assert_alike(modified_inversion(TWO_DISC.transformed(mixed), SLEW, **options), plan, mixed, 1e-8)  # type: ignore[arg-type]


def test_units_time_shift_and_superposition() -> None:
    options = {"axis_distance": 0.5, "real_part": 1.0, "error_poles": [-1.0, -2.0], "design": "robust"}
    plan = modified_inversion(TWO_DISC, SLEW, **options)  # type: ignore[arg-type]
    scaled = StateSpace(TWO_DISC_A, TWO_DISC_B * 1e-6, TWO_DISC_C * 1e3)
    small = modified_inversion(scaled, SLEW.scaled(1e3), **options)  # type: ignore[arg-type]
    t = np.linspace(-3.0, 15.0, 61)
    np.testing.assert_allclose(small(t).x, plan(t).x, atol=1e-9)
    np.testing.assert_allclose(small(t).u, plan(t).u * 1e6, rtol=1e-7, atol=1e-2)
    later = modified_inversion(TWO_DISC, SLEW.shifted(70.0), **options)  # type: ignore[arg-type]
    np.testing.assert_allclose(later(t + 70.0).u, plan(t).u, atol=1e-10)
    other = rest_to_rest(0.0, -2.0, 3.0, smoothness=3, start_time=1.0)
    both = modified_inversion(TWO_DISC, SLEW.scaled(2.0) + other, **options)  # type: ignore[arg-type]
    second = modified_inversion(TWO_DISC, other, **options)  # type: ignore[arg-type]
    np.testing.assert_allclose(both(t).x, 2 * plan(t).x + second(t).x, atol=1e-9)


def test_operating_point_is_added() -> None:
    point = OperatingPoint(x0=np.zeros(4), u0=np.array([3.0]), y0=np.array([-7.0]))
    moved = StateSpace(TWO_DISC_A, TWO_DISC_B, TWO_DISC_C, operating_point=point)
    options = {"axis_distance": 0.5, "real_part": 1.0, "error_poles": [-1.0, -2.0]}
    plan = modified_inversion(TWO_DISC, SLEW, **options)  # type: ignore[arg-type]
    about = modified_inversion(moved, SLEW + constant(-7.0), **options)  # type: ignore[arg-type]
    t = np.linspace(-3.0, 15.0, 61)
    np.testing.assert_allclose(about(t).u, plan(t).u + 3.0, atol=1e-10)
    np.testing.assert_allclose(about.tracking_error(t), plan.tracking_error(t), atol=1e-10)


def test_direct_feedthrough_holds_its_target() -> None:
    """An output of relative degree 0 has no chain of integrators; its error is v itself."""
    A = np.array([[-0.4, 1.0, 0.0], [-9.0, 0.3, 0.5], [0.2, 0.0, -1.0]])
    plant = StateSpace(A, [[0.0], [1.0], [0.0]], [[1.0, 0.5, 0.2]], [[0.7]])
    offending = zeros(plant)
    assert np.max(offending.real) < 0 < np.max(offending.imag)
    plan = modified_inversion(plant, SLEW, axis_distance=1.0, real_part=0.8, error_poles=[], design="robust")
    assert np.max(np.abs(plan.tracking_error([-60.0, 60.0]))) < 1e-12
    assert plan.certificate.dynamics_residual < 1e-12
    assert plan.alpha == pytest.approx(0.8)


@pytest.mark.parametrize("seed", [10, 30, 43])
def test_axis_zeros_beside_antistable_ones(seed: int) -> None:
    """Rounding puts the pair on the axis to either side of it, and elsewhere when its Schur form is reordered."""
    plant = plant_with(np.random.default_rng(seed), (2,), block(0.3j, -0.5, 2.0 + 1j))
    plan = modified_inversion(plant, SLEW, axis_distance=0.1, real_part=1.0, error_poles=[-1.0, -2.0], design="robust")
    assert_same_set(plan.modification[0].zeros_after, [1 + 0.3j, 1 - 0.3j, -0.5, 2 + 1j, 2 - 1j], 1e-8)
    assert plan.certificate.dynamics_residual < 1e-11


def test_placement_that_could_be_more_robust_is_taken_as_it_is() -> None:
    """Poles are in place long before robust placement has converged, which here it does not: no warning, no refusal."""
    plant = plant_with(np.random.default_rng(1), (3, 3), block(0.02 + 1.5j, 0.3j, -0.03 + 3j))
    chain = [-1 - k / 3 for k in range(6)]
    plan = modified_inversion(plant, stack([SLEW, SLEW]), axis_distance=0.2, real_part=1.3, error_poles=chain, design="robust")
    form = normal_form(plant)
    found = modified_poles(plant.A, plant.B, plant.C, (3, 3), plan.modification[0].F, np.vstack([form.C_star, form.N]))
    moved = [1.3 + sign * frequency * 1j for frequency in (0.3, 1.5, 3.0) for sign in (1, -1)]
    assert_same_set(found, [*chain, *moved], 1e-6)


def test_no_zero_near_enough_is_said() -> None:
    plan = modified_inversion(TWO_DISC, SLEW, axis_distance=0.1, real_part=1.0, error_poles=[-1.0, -2.0])
    assert "no zeros were moved: within 0.1 rad/s of the imaginary axis there are none" in plan.remarks[-1]
    assert plan.max_error[0] < 1e-12


@pytest.mark.parametrize("design", ["robust", "least error"])
@pytest.mark.parametrize("move", [{0.05 + 1.3j: 0.05 + 1.3j}, {1.5: 1.5}, {1.5: 1.5, 0.05 + 1.3j: 0.05 + 1.3j}])
def test_zeros_left_where_they_are_cost_nothing(move: dict[complex, complex], design: str) -> None:
    plant = plant_with(np.random.default_rng(1), (1, 2), block(0.05 + 1.3j, -0.4, 1.5))
    reference = stack([SLEW, SLEW.scaled(0.5)])
    plan = modified_inversion(plant, reference, move=move, error_poles=[-1.0, -2.0, -3.0], design=design)  # type: ignore[arg-type]
    assert plan.relative_error < 1e-10


def test_repeated_poles_and_targets() -> None:
    plant = plant_with(np.random.default_rng(3), (2,), block(0.1, -0.15, 0.6))
    plan = modified_inversion(plant, SLEW, axis_distance=0.2, real_part=1.0, error_poles=[-1.0, -1.0])
    assert_same_set(plan.modification[0].zeros_after, [1.0, 1.0, 0.6], 1e-9)
    assert np.max(np.abs(plan.tracking_error([-60.0, 60.0]))) < 1e-9
    assert plan.certificate.dynamics_residual < 1e-11


def test_zero_at_the_origin_is_moved_where_the_output_returns() -> None:
    plant = plant_with(np.random.default_rng(4), (1,), block(0.0, -1.0, 0.5))
    pulse = SLEW + rest_to_rest(0.0, -1.0, 5.0, smoothness=3, start_time=4.0)
    plan = modified_inversion(plant, pulse, move={0.0: 1.5}, error_poles=[-2.0])
    assert np.max(np.abs(plan.tracking_error([-80.0, 100.0]))) < 1e-12
    assert np.max(np.abs(plan(np.array([-80.0, 100.0])).x)) < 1e-8


@settings(max_examples=10, deadline=None, derandomize=True)
@given(
    degrees=st.sampled_from([(1,), (2,), (1, 2), (1, 1, 1), (3, 1), (2, 2)]),
    near=st.sampled_from([0.02 + 1.5j, 0.1 + 0j, -0.03 + 3j, 1.2j]),
    to=st.sampled_from([1.3, -0.9]),
    seed=st.integers(0, 1000),
)
def test_random_plants(degrees: tuple[int, ...], near: complex, to: float, seed: int) -> None:
    """Poles as asked, the plant's equations kept, the output at rest on its target, whatever the vector relative degree."""
    rng = np.random.default_rng(seed)
    plant = plant_with(rng, degrees, block(near, -0.8 + 1j, 0.9))
    chain = [-1.1 - 0.37 * k for k in range(sum(degrees))]
    reference = stack([rest_to_rest(0.0, rng.uniform(0.5, 2.0), rng.uniform(1.0, 4.0), smoothness=3) for _ in degrees])
    plan = modified_inversion(plant, reference, axis_distance=0.2, real_part=to, error_poles=chain, design="robust")
    form = normal_form(plant)
    found = modified_poles(plant.A, plant.B, plant.C, degrees, plan.modification[0].F, np.vstack([form.C_star, form.N]))
    moved = [complex(to, near.imag), complex(to, -near.imag)] if near.imag else [to]
    assert_same_set(found, [*chain, *moved, -0.8 + 1j, -0.8 - 1j, 0.9], 1e-6)
    assert max(plan.certificate.dynamics_residual, plan.certificate.continuity) < 1e-10
    assert np.max(np.abs(plan.tracking_error([-60.0, 100.0]))) < 1e-9
