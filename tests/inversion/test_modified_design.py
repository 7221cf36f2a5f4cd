"""The freedom in F and L: what is compared, that the better is kept, and that L is the best there is."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.integrate

from invtrack.inversion.modified.design_problem import DesignProblem
from invtrack.inversion.modified.modified_inversion import ModifiedTrajectory, modified_inversion
from invtrack.linear.normal_form import normal_form
from invtrack.linear.state_space import StateSpace
from invtrack.references.profiles import rest_to_rest
from invtrack.references.signal import stack
from tests.inversion.modified_cases import HE3, HE3_POLES, HOVER, PASSIVE_TWO_DISC, TWO_DISC, moved_pair
from tests.linear.random_plants import block, plant_with, rotation

SLEW = rest_to_rest(0.0, 1.0, 5.0, smoothness=3)


def integral_square(plan: ModifiedTrajectory, start: float, end: float) -> float:
    t = np.linspace(start, end, 20_001)
    return float(scipy.integrate.simpson(np.sum((plan.tracking_error(t) / plan.output_scale) ** 2, axis=1), x=t))


def test_several_choices_are_compared_and_the_best_kept() -> None:
    _, move = moved_pair(2.0)
    plan = modified_inversion(HE3, HOVER, move=move, error_poles=HE3_POLES)
    sizes = {candidate.name: candidate.integral_square_error for candidate in plan.candidates}
    assert set(sizes) == {f"{way}{L}" for way in ("robust placement", "optimized directions") for L in ("", " with L")}
    assert sizes[plan.design] == min(sizes.values())
    assert sizes["optimized directions with L"] < 0.7 * sizes["robust placement with L"] < 0.4 * sizes["robust placement"]
    assert integral_square(plan, -10.0, 30.0) == pytest.approx(sizes[plan.design], rel=1e-3)
    robust = modified_inversion(HE3, HOVER, move=move, error_poles=HE3_POLES, design="robust")
    assert integral_square(robust, -10.0, 30.0) == pytest.approx(sizes["robust placement"], rel=1e-3)
    assert any("optimized directions with L was taken" in remark for remark in plan.remarks)
    np.testing.assert_array_equal(robust.modification[0].L, 0.0)


def test_a_choice_that_rounding_spoils_is_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    accurate = iter([False, True])
    monkeypatch.setattr(DesignProblem, "is_accurate", lambda problem, solution: next(accurate))
    plan = modified_inversion(TWO_DISC, SLEW, axis_distance=0.5, real_part=1.0, error_poles=[-1.0, -2.0])
    assert plan.design == "placement"
    assert plan.candidates[1].integral_square_error < plan.candidates[0].integral_square_error
    assert plan.remarks[-1].endswith("placement was taken, since those with less are too ill-conditioned")


def test_feedforward_is_the_best_for_this_reference() -> None:
    """The error is orthogonal to what any other L would add, so it grows whichever way the reference's scale is divided."""
    plan = modified_inversion(TWO_DISC, SLEW, axis_distance=0.5, real_part=1.0, error_poles=[-1.0, -2.0])
    plain = modified_inversion(TWO_DISC, SLEW, axis_distance=0.5, real_part=1.0, error_poles=[-1.0, -2.0], design="robust")
    t = np.linspace(-12.0, 30.0, 20_001)
    best, change = plan.tracking_error(t)[:, 0], (plain.tracking_error(t) - plan.tracking_error(t))[:, 0]
    product = scipy.integrate.simpson(best * change, x=t)
    size = np.sqrt(scipy.integrate.simpson(best**2, x=t) * scipy.integrate.simpson(change**2, x=t))
    assert abs(product) < 1e-3 * size


def test_feedforward_acts_on_derivatives_alone() -> None:
    plant = plant_with(np.random.default_rng(2), (1, 2), block(0.1 + 2j, -0.7))
    reference = stack([rest_to_rest(0.0, 1.0, 3.0, smoothness=3), rest_to_rest(0.0, 2.0, 2.0, smoothness=3)])
    plan = modified_inversion(plant, reference, axis_distance=0.2, real_part=1.0, error_poles=[-1.0, -2.0, -3.0])
    L = plan.modification[0].L
    assert L.shape == (2, 3 + 2)
    np.testing.assert_array_equal(L[:, [0, 1]], 0.0)  # the columns of y_1 and y_2 themselves
    assert np.all(np.abs(L[:, [2, 3, 4]]).max(axis=0) > 0)


def test_references_that_are_nearly_the_same_share_their_terms() -> None:
    """What little tells them apart buys next to nothing, at the price of large opposite terms."""
    plant = plant_with(np.random.default_rng(2), (1, 2), block(0.1 + 2j, -0.7))
    same, nearly = (
        modified_inversion(
            plant,
            stack([SLEW, rest_to_rest(0.0, 1.0, duration, smoothness=3)]),
            axis_distance=0.2,
            real_part=1.0,
            error_poles=[-1.0, -2.0, -3.0],
        )
        for duration in (5.0, 5.001)
    )
    L = [plan.modification[0].L for plan in (same, nearly)]
    np.testing.assert_allclose(L[1], L[0], atol=0.02 * np.max(np.abs(L[0])))
    assert nearly.candidates[1].integral_square_error == pytest.approx(same.candidates[1].integral_square_error, rel=0.01)


def test_output_scale_weighs_the_outputs() -> None:
    _, move = moved_pair(2.0)
    even = modified_inversion(HE3, HOVER, move=move, error_poles=HE3_POLES)
    np.testing.assert_allclose(even.output_scale, 0.375, rtol=1e-9)  # the peak of W and V, given to U and R too
    strict = modified_inversion(HE3, HOVER, move=move, error_poles=HE3_POLES, output_scale=[0.375, 0.375, 0.0375, 0.375])
    assert strict.max_error[2] < 0.5 * even.max_error[2]


def test_units_of_inputs_outputs_and_states_do_not_matter() -> None:
    """Not for the search of directions either: it ends in the same plan, to what its steps resolve."""
    _, move = moved_pair(2.0)
    inputs, outputs = np.array([1e3, 1.0, 1e-4, 10.0]), np.array([1e-3, 57.3, 1e4, 1.0])
    rng = np.random.default_rng(1)
    other = StateSpace(HE3.A, HE3.B / inputs, outputs[:, None] * HE3.C).transformed(rotation(rng, 8))
    plain = modified_inversion(HE3, HOVER, move=move, error_poles=HE3_POLES, output_scale=0.4)
    scaled = modified_inversion(other, HOVER.scaled(np.diag(outputs)), move=move, error_poles=HE3_POLES, output_scale=0.4 * outputs)
    t = np.linspace(-2.0, 12.0, 200)
    np.testing.assert_allclose(scaled.tracking_error(t) / outputs, plain.tracking_error(t), atol=2e-2 * np.max(plain.max_error))
    sizes = [min(c.integral_square_error for c in plan.candidates) for plan in (plain, scaled)]
    assert sizes[0] == pytest.approx(sizes[1], rel=5e-3)


def test_passive_rig_is_made_invertible() -> None:
    for to in (1.0, -1.0):
        plan = modified_inversion(PASSIVE_TWO_DISC, SLEW, axis_distance=0.1, real_part=to, error_poles=[-1.0, -2.0])
        assert plan.certificate.dynamics_residual < 1e-12
        assert np.max(np.abs(plan.tracking_error([-80.0, 80.0]))) < 1e-12
        assert plan.max_error[0] < 0.01


def test_law_is_the_one_documented() -> None:
    """B_y u = y_d^(r) - A_x x + F [e; eta - eta_eq] + L [zeta_d; y_d^(r)] at every time; eta_eq by its own equilibrium equation."""
    plan = modified_inversion(TWO_DISC, SLEW, axis_distance=0.5, real_part=1.0, error_poles=[-1.0, -2.0])
    form, change = normal_form(TWO_DISC), plan.modification[0]
    t = np.linspace(-2.0, 9.0, 40)
    y = np.stack([SLEW(t, derivative=k)[:, 0] for k in range(3)], axis=1)
    x = plan(t).x
    # x follows y_d = 1 and y_d = t for ever at X_0 and X_0 t + X_1: A X_0 + B u_0 = 0, A X_1 + B u_1 = X_0, C X_0 = 1, C X_1 = 0.
    pencil = np.block([[TWO_DISC.A, TWO_DISC.B], [TWO_DISC.C, np.zeros((1, 1))]])
    X_0 = np.linalg.lstsq(pencil, np.array([0, 0, 0, 0, 1.0]))[0][:4]
    X_1 = np.linalg.lstsq(pencil, np.append(X_0, 0.0))[0][:4]
    eta_eq = np.outer(y[:, 0], form.N @ X_0) + np.outer(y[:, 1], form.N @ X_1)
    distance = np.hstack([x @ form.C_star.T - y[:, :2], x @ form.N.T - eta_eq])
    v = distance @ change.F.T + y @ change.L.T
    np.testing.assert_allclose(plan(t).u @ form.B_y.T, y[:, 2:] - x @ form.A_x.T + v, atol=1e-10)


def test_modification_prints_what_was_moved() -> None:
    plan = modified_inversion(TWO_DISC, SLEW, axis_distance=0.5, real_part=1.0, error_poles=[-1.0, -2.0])
    assert str(plan.modification[0]) == "interval 0: zeros moved: 0.22+-4.75j to 1+-4.75j; alpha = 1 rad/s"


def test_zeros_that_only_lower_derivatives_drive() -> None:
    """The textbook normal form eta' = 0.1 eta + y_1 + 2 y_2: no y^(r) in it, so v reaches eta through the outputs' errors alone."""
    plant = StateSpace([[0, 0, 0], [0, 0, 0], [1, 2, 0.1]], [[1.0, 0], [0, 1], [0, 0]], [[1.0, 0, 0], [0, 1, 0]])
    motion = rest_to_rest(0.0, 1.0, duration=6.0, smoothness=4)
    options = {"error_poles": [-3.0, -4.0], "axis_distance": 0.5, "real_part": 2.0}
    best = modified_inversion(plant, stack([motion, motion]), **options)
    robust = modified_inversion(plant, stack([motion, motion]), design="robust", **options)
    assert [c.name for c in best.candidates] == [
        "robust placement",
        "robust placement with L",
        "optimized directions",
        "optimized directions with L",
    ]
    assert min(c.integral_square_error for c in best.candidates) <= best.candidates[0].integral_square_error
    assert best.modification[0].zeros_after == pytest.approx([2.0])
    assert max(best.certificate.dynamics_residual, robust.certificate.dynamics_residual) < 1e-10
