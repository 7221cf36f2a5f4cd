"""Points that small perturbations of a matrix make eigenvalues of it, against singular values and closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from invtrack.linear.pseudospectrum import Pseudospectrum
from tests.linear.random_plants import rotation


def smallest_singular_values(A: np.ndarray, z: np.ndarray) -> np.ndarray:
    return np.array([np.linalg.svd(A - point * np.eye(len(A)), compute_uv=False)[-1] for point in z])


@pytest.mark.parametrize("epsilon", [1e-12, 1e-6, 1e-3, 0.1, 3.0])
@pytest.mark.parametrize("seed", range(10))
def test_judges_as_the_singular_values_do(seed: int, epsilon: float) -> None:
    """From well apart eigenvalues to repeated defective ones; points within 2 % of the border are left out."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 14))
    blocks = np.diag(rng.choice([-1.0, 0.0, -1e-3, 0.5], size=n)) + np.diag(rng.choice([0.0, 1.0, 5.0], size=n - 1), 1)
    U = rotation(rng, n)
    A = U @ blocks @ U.T
    eigenvalues = np.linalg.eigvals(A).astype(complex)
    z = np.concatenate([eigenvalues, 1j * eigenvalues.imag, rng.normal(size=20) + 1j * rng.normal(size=20)])
    smallest = smallest_singular_values(A, z)
    clear = np.abs(smallest - epsilon) > 0.02 * epsilon
    assert np.array_equal(Pseudospectrum(A).contains(z, epsilon)[clear], smallest[clear] <= epsilon)


def test_of_a_normal_matrix_reaches_as_far_as_epsilon() -> None:
    rng = np.random.default_rng(3)
    U = rotation(rng, 4)
    A = U @ np.diag([-1.0, 2.0, 5.0, 5.0]) @ U.T
    z = np.array([-1.0 + 0.0099j, -1.0 + 0.0101j, 2.0099, 2.0101, 5.0 - 0.0099j, 5.0 - 0.0101j, 3.5])
    assert Pseudospectrum(A).contains(z, 0.01).tolist() == [True, False, True, False, True, False, False]


def test_a_chain_of_integrators_is_moved_far_by_little() -> None:
    """s^k = epsilon is the characteristic equation once the chain's end acts on its start: |s| = epsilon^(1/k) is reached."""
    k, epsilon = 8, 1e-8
    chain = np.diag(np.ones(k - 1), 1)
    reached = epsilon ** (1 / k) * np.exp(2j * np.pi * np.arange(k) / k)
    assert np.all(Pseudospectrum(chain).contains(reached, epsilon))
    # At twice the distance about 2^k times as much is needed.
    assert not np.any(Pseudospectrum(chain).contains(2 * reached, epsilon))


def test_eigenvalues_lie_in_every_pseudospectrum() -> None:
    A = np.array([[0.0, 1.0], [0.0, 0.0]])
    assert Pseudospectrum(A).contains(np.array([0j, 1e-3]), 0.0).tolist() == [True, False]


def test_the_empty_matrix_has_none() -> None:
    assert Pseudospectrum(np.zeros((0, 0))).contains(np.zeros(3, dtype=complex), 1.0).tolist() == [False] * 3
