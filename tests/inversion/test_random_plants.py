"""Any plant: an exact inverse with a certificate that says so, or a refusal that says why."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from invtrack.errors import BoundednessError, NonHyperbolicError
from invtrack.inversion.exact import invert
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.plan import Certificate
from invtrack.references.profiles import rest_to_rest
from tests.linear.random_plants import pencil_zeros, plant_with

SEEDS = st.integers(0, 10**6)


def worst(certificate: Certificate) -> float:
    return max(certificate.dynamics_residual, certificate.output_error, certificate.continuity)


@settings(deadline=None, max_examples=80, derandomize=True)
@given(st.integers(2, 20), st.integers(1, 4), SEEDS)
def test_dense_plants(n: int, p: int, seed: int) -> None:
    """A certificate of 1e-8, or a refusal for a zero that an independent computation finds next to the axis; nothing else."""
    rng = np.random.default_rng(seed)
    p = min(n, p)
    D = np.zeros((p, p)) if seed % 3 else np.diag(rng.integers(0, 2, p)).astype(float)
    plant = StateSpace(rng.normal(size=(n, n)), rng.normal(size=(n, p)), rng.normal(size=(p, n)), D)
    target = rng.normal(size=p) * (rng.random(p) < 0.7)  # some channels are to stay still
    try:
        plan = invert(plant, rest_to_rest(np.zeros(p), target, 2.0, smoothness=1))
    except NonHyperbolicError:
        zeros = pencil_zeros(plant.A, plant.B, plant.C, plant.D)
        assert np.min(np.abs(zeros.real) / np.abs(zeros)) < 1e-6
        return
    assert worst(plan.certificate) <= 1e-8
    assert plan.certificate.rest_residual <= 1e-8


@settings(deadline=None, max_examples=50, derandomize=True)
@given(st.lists(st.integers(1, 4), min_size=1, max_size=3), st.integers(0, 4), SEEDS)
def test_plants_of_any_relative_degree(degrees: list[int], n_z: int, seed: int) -> None:
    """These have no zeros near the axis, so nothing is refused."""
    rng = np.random.default_rng(seed)
    internal = rng.normal(size=(n_z, n_z))
    if n_z and np.min(np.abs(np.linalg.eigvals(internal).real)) < 0.05:
        return
    p = len(degrees)
    plan = invert(plant_with(rng, degrees, internal), rest_to_rest(np.zeros(p), rng.normal(size=p), 2.0, smoothness=max(degrees)))
    assert worst(plan.certificate) <= 1e-8
    assert plan.certificate.rest_residual <= 1e-8


@settings(deadline=None, max_examples=40, derandomize=True)
@given(st.integers(3, 8), st.integers(1, 2), st.integers(1, 3), SEEDS)
def test_plants_that_jump(n: int, p: int, jumps: int, seed: int) -> None:
    """The dynamics change, the outputs do not; where zeros cross the axis a jump may have no solution, or many."""
    rng = np.random.default_rng(seed)
    B, C = rng.normal(size=(n, p)), rng.normal(size=(p, n))
    systems = [StateSpace(rng.normal(size=(n, n)), B, C) for _ in range(jumps + 1)]
    times = np.sort(rng.uniform(-1.0, 3.0, jumps))
    try:
        plan = invert(SwitchedSystem(systems, times), rest_to_rest(np.zeros(p), rng.normal(size=p), 2.0))
    except (BoundednessError, NonHyperbolicError):
        return
    assert worst(plan.certificate) <= 1e-8


@pytest.mark.parametrize("seed", range(3))
def test_a_slow_zero_behind_high_derivatives(seed: int) -> None:
    """A zero at -0.004 and derivatives up to the fourth: the inverse has large entries and small ones that count."""
    plant = plant_with(np.random.default_rng(seed), (2, 4, 2), [[-0.004]])
    certificate = invert(plant, rest_to_rest(np.zeros(3), [1.0, -1.0, 0.5], 2.0, smoothness=4)).certificate
    assert worst(certificate) < 1e-11
