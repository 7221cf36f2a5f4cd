"""Zeros that repeat, as those of a hovering vehicle do along x and y, moved by modified inversion; and the placement behind it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from invtrack.inversion.modified.modified_inversion import modified_inversion
from invtrack.inversion.modified.target_chains import TargetChains
from invtrack.linear.schur_placement import schur_gain
from invtrack.linear.state_space import StateSpace
from invtrack.linear.zeros import zero_report
from invtrack.references.profiles import rest_to_rest
from tests.linear.random_plants import block, plant_with, rotation

GRAVITY, LEVER, INERTIA = 9.81, 0.05, 0.02
HOVER_ZERO = np.sqrt(GRAVITY / LEVER)
"""Held at a point LEVER below its centre of mass, a vehicle that tilts is an inverted pendulum on that point."""

CHAINS = [-4.0, -5.0, -4.0, -5.0]


def hovering(turn: float = 0.0) -> StateSpace:
    """x'' = g pitch, y'' = -g roll, torques for inputs; positions of a point below the centre of mass, axes turned by `turn`."""
    A = np.zeros((8, 8))
    A[:4, 4:] = np.eye(4)
    A[4, 1], A[6, 3] = GRAVITY, -GRAVITY
    B = np.zeros((8, 2))
    B[5, 0] = B[7, 1] = 1 / INERTIA
    C = np.zeros((2, 8))
    C[0, [0, 1]], C[1, [2, 3]] = (1.0, -LEVER), (1.0, LEVER)
    c, s = np.cos(turn), np.sin(turn)
    return StateSpace(A, B, np.array([[c, s], [-s, c]]) @ C)


@pytest.mark.parametrize("turn", [0.0, 0.4])
@pytest.mark.parametrize("design", ["least error", "robust"])
@pytest.mark.parametrize(
    "options",
    [
        {"axis_distance": 20.0, "real_part": 30.0},  # four equal targets, for which the two torques have two eigenvectors each
        {"move": {HOVER_ZERO: 30.0}},
        {"move": {HOVER_ZERO: 30.0}, "error_poles": [-4.0] * 4},
        {"move": {HOVER_ZERO: 30.0}, "error_poles": [-3 + 2j, -4.0, -3 - 2j, -4.0]},  # a pair shared by two outputs
    ],
)
def test_a_hovering_vehicle(turn: float, design: Any, options: dict[str, Any]) -> None:
    plant = hovering(turn)
    report = zero_report(plant)
    assert sorted(z.value.real for z in report.zeros) == pytest.approx([-HOVER_ZERO] * 2 + [HOVER_ZERO] * 2, rel=1e-9)
    assert all(z.kind == "transmission zero" for z in report.zeros)
    reference = rest_to_rest([0.0, 0.0], [1.0, -0.5], duration=3.0, smoothness=3)
    plan = modified_inversion(plant, reference, design=design, **{"error_poles": CHAINS, **options})
    assert plan.alpha == pytest.approx(30.0)
    assert plan.certificate.dynamics_residual < 1e-11
    assert plan.relative_error < (0.02 if design == "least error" else 0.2)  # a robust placement does not look at the error
    t = np.linspace(plan.start, 0.0, 4001)
    size = np.max(np.abs(plan(t).u), axis=1)
    early = (t < -0.3) & (t > -0.5)
    rate = np.polyfit(t[early], np.log(size[early]), 1)[0]
    assert 30 - 3 / 0.4 < rate < 30.5  # chains of k equal poles grow as t^(k - 1) exp(30 t), k <= 4; unmoved, as exp(14 t)
    np.testing.assert_allclose(plan.tracking_error([plan.end])[0], 0.0, atol=1e-9)


def test_what_turned_axes_ask_for_is_the_same_motion() -> None:
    reference = rest_to_rest([0.0, 0.0], [1.0, -0.5], duration=3.0, smoothness=3)
    turn = 0.4
    R = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    options: dict[str, Any] = {"move": {HOVER_ZERO: 30.0}, "error_poles": CHAINS, "output_scale": 1.0, "design": "robust"}
    plain = modified_inversion(hovering(), reference, **options)
    turned = modified_inversion(hovering(turn), reference.scaled(R), **options)
    t = np.linspace(-0.5, 4.0, 50)
    np.testing.assert_allclose(turned(t).u, plain(t).u, atol=1e-6 * np.max(np.abs(plain.input_range)))


@pytest.mark.parametrize("seed", range(2))
def test_repeated_pairs_move_to_one_place(seed: int) -> None:
    """Rounding splits the pair 0.1 +- 3j, which two outputs have in common; both of it go to one place."""
    pairs = [0.1 + 3j] * 2
    plant = plant_with(np.random.default_rng(seed), (1, 2), block(*pairs, -2.0))
    reference = rest_to_rest([0.0, 0.0], [1.0, 0.5], duration=4.0, smoothness=4)
    plan = modified_inversion(plant, reference, axis_distance=0.5, real_part=1.5, error_poles=[-2.0, -3.0, -4.0])
    after = plan.modification[0].zeros_after
    np.testing.assert_allclose(np.sort(after.real), [-2.0] + [1.5] * (2 * len(pairs)), rtol=1e-4)
    assert len(set(after[after.imag > 0])) == 1
    assert plan.certificate.dynamics_residual < 1e-9


def test_one_output_with_all_its_poles_equal() -> None:
    """Six times -2: the sixth root of rounding splits what is placed, as it does any matrix with such a Jordan block."""
    plant = plant_with(np.random.default_rng(3), (6,), block(0.1 + 2j), mixed=False)
    plan = modified_inversion(
        plant, rest_to_rest(0.0, 1.0, 4.0, smoothness=6), axis_distance=0.5, real_part=1.0, error_poles=[-2.0] * 6
    )
    assert plan.certificate.dynamics_residual < 1e-8
    assert plan.alpha == pytest.approx(1.0)


@pytest.mark.parametrize("seed", range(40))
def test_schur_placement_places_any_poles(seed: int) -> None:
    """Poles from a few values, so that most repeat; plants at random and chains of integrators, from one input on."""
    rng = np.random.default_rng(seed)
    n, p = int(rng.integers(1, 9)), int(rng.integers(1, 4))
    A, B = rng.normal(size=(n, n)), rng.normal(size=(n, p))
    if seed % 2:
        A, B = np.eye(n, k=1), np.vstack([np.zeros((n - 1, p)), rng.normal(size=(1, p))])
    poles: list[complex] = []
    while len(poles) < n:
        pair = n - len(poles) >= 2 and rng.random() < 0.5
        s = complex(-rng.integers(1, 3), rng.integers(1, 3) if pair else 0)
        poles += [s, s.conjugate()] if pair else [s]
    gain = schur_gain(A, B, np.array(poles, dtype=complex))
    assert gain is not None
    wanted = np.real(np.poly(poles))  # coefficients, which do not split as the roots do
    np.testing.assert_allclose(np.poly(A + B @ gain), wanted, atol=1e-9 * np.max(np.abs(wanted)))


def test_schur_placement_says_what_it_cannot_reach() -> None:
    turned = rotation(np.random.default_rng(0), 2)
    assert schur_gain(turned @ np.diag([1.0, -1.0]) @ turned.T, turned[:, :1], np.array([-2.0, -3.0 + 0j])) is None


def test_chains_share_out_equal_poles() -> None:
    poles = np.array([2.0, 2.0, 2.0, 1 + 1j, 1 - 1j, 1 + 1j, 1 - 1j, 5.0])
    assert [len(chain) for chain in TargetChains.of(poles, 2).chains] == [2, 1, 1, 1, 1]
    for count in (1, 2, 3):
        chains = TargetChains.of(poles, count)
        np.testing.assert_allclose(np.poly(chains.matrix), np.real(np.poly(poles)), rtol=1e-12, atol=1e-9)
        apart = chains.poles * (1 + 1e-3 * np.array([0, 1, 2, 0, 3, 3, 4, 4]))
        vectors = chains.eigenvectors(apart)
        # The matrix with its poles drawn apart: the same steps between them, other poles on its diagonal.
        difference = chains.matrix @ vectors - vectors * apart
        assert np.max(np.abs(difference)) < 0.02 * 5.0
