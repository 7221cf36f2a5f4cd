"""The causal inverse: exact from rest, without preactuation, where the internal dynamics do not grow."""

from __future__ import annotations

import numpy as np
import pytest

from invtrack.errors import NonHyperbolicError, PlanError
from invtrack.inversion.exact import invert
from invtrack.inversion.no_preactuation import causal_inverse
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.linear.zeros import zeros
from invtrack.references.profiles import rest_to_rest
from tests.inversion.modified_cases import PASSIVE_TWO_DISC, TWO_DISC
from tests.linear.random_plants import block, plant_with

SLEW = rest_to_rest(0.0, 1.0, 5.0, smoothness=3)


def test_minimum_phase_plants_have_one_inverse() -> None:
    plant = plant_with(np.random.default_rng(1), (2,), block(-0.4 + 1j, -2.0))
    causal, exact = causal_inverse(plant, SLEW), invert(plant, SLEW)
    t = np.linspace(-3.0, 30.0, 200)
    np.testing.assert_allclose(causal(t).u, exact(t).u, atol=1e-12)
    assert causal.postactuation == pytest.approx(exact.postactuation)
    assert causal.remarks == ()


def test_passive_rig_rings_on_for_ever() -> None:
    plan = causal_inverse(PASSIVE_TWO_DISC, SLEW)
    assert (plan.preactuation, plan.postactuation) == (0.0, 0.0)
    assert "rings on for ever" in plan.remarks[0]
    assert max(plan.certificate.dynamics_residual, plan.certificate.output_error, plan.certificate.continuity) < 1e-12
    before = plan(np.array([-10.0, -0.1]))
    assert np.all(before.x == 0)
    assert np.all(before.u == 0)
    frequency = np.max(zeros(PASSIVE_TWO_DISC).imag)
    t = np.linspace(5.0, 6.5, 40)
    now, much_later = plan(t), plan(t + 200 * 2 * np.pi / frequency)
    assert np.max(np.abs(now.u)) > 1e-3
    np.testing.assert_allclose(much_later.u, now.u, atol=1e-9)
    np.testing.assert_allclose(much_later.y, 1.0, atol=1e-10)


def test_residue_of_the_ringing() -> None:
    """For a bump y_d the ringing left is what the transform of y_d'' at the zero says: u = 2 Re(c exp(jwt)), c from the residue."""
    w = float(np.max(zeros(PASSIVE_TWO_DISC).imag))
    A, B, C = PASSIVE_TWO_DISC.A, PASSIVE_TWO_DISC.B, PASSIVE_TWO_DISC.C
    gain = 1 / (C @ A @ B)[0, 0]  # u = gain (s^2 + a)(s^2 + ...) / (s^2 + w^2) y_d; poles of the plant: 0, 0, +-j sqrt(k)
    k = 3.1555 + 2.8956
    nodes, weights = np.polynomial.legendre.leggauss(80)
    s = 2.5 + 2.5 * nodes
    transform = 2.5 * np.sum(weights * SLEW(s, derivative=2)[:, 0] * np.exp(-1j * w * s))
    # 1/G = gain s^2 (s^2 + k) / (s^2 + w^2): acting on y_d'' it has the residue gain (k - w^2) / (2jw) at jw.
    c = gain * (k - w**2) / (2j * w) * transform
    t = np.linspace(5.5, 20.0, 30)
    expected = 2 * np.real(c * np.exp(1j * w * t))
    np.testing.assert_allclose(causal_inverse(PASSIVE_TWO_DISC, SLEW).inputs(t)[:, 0], expected, atol=1e-10)


def test_starts_from_the_equilibrium_of_a_held_output() -> None:
    plant = plant_with(np.random.default_rng(1), (2,), block(-0.4 + 1j, -2.0))
    plan = causal_inverse(plant, rest_to_rest(2.0, 3.0, 4.0, smoothness=3))
    before = plan(np.array([-9.0, 0.0]))
    np.testing.assert_allclose(before.x[0], before.x[1], atol=1e-12)
    np.testing.assert_allclose(plant.A @ before.x[0] + plant.B @ before.u[0], 0.0, atol=1e-12)


def test_through_a_jump() -> None:
    first = plant_with(np.random.default_rng(1), (1,), block(-0.4 + 1j), mixed=False)
    second = StateSpace(first.A + np.diag([0.0, -0.3, -0.1]), first.B, first.C)
    plan = causal_inverse(SwitchedSystem([first, second], [2.0]), SLEW)
    assert max(plan.certificate.dynamics_residual, plan.certificate.output_error, plan.certificate.continuity) < 1e-12
    assert np.all(plan(np.array([-1.0])).u == 0)


@pytest.mark.parametrize(
    ("internal", "message"),
    [
        (block(0.3, -1.0), "antistable zeros at 0.3; use invert, .* or modified_inversion"),
        (block(0.0, -1.0), "a zero at the origin"),
        (np.block([[block(2j), np.eye(2)], [np.zeros((2, 2)), block(2j)]]), r"repeated zeros on the imaginary axis at 0\+-2j"),
    ],
)
def test_refusals(internal: np.ndarray, message: str) -> None:
    plant = plant_with(np.random.default_rng(8), (1,), internal, mixed=False)
    with pytest.raises(NonHyperbolicError, match=message):
        causal_inverse(plant, SLEW)


def test_nonminimum_phase_rig_and_options_are_refused() -> None:
    with pytest.raises(NonHyperbolicError, match=r"antistable zeros at 0.22\+-4.75j"):
        causal_inverse(TWO_DISC, SLEW)
    with pytest.raises(PlanError, match="tolerance must lie between 0 and 1"):
        causal_inverse(PASSIVE_TWO_DISC, SLEW, tolerance=0.0)
