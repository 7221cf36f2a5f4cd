"""Plants built from their normal form, so that relative degree and zeros are known by construction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from invtrack.linear.state_space import StateSpace

Array = NDArray[np.float64]


def plant_with(rng: np.random.Generator, degrees: Sequence[int], internal: ArrayLike, *, mixed: bool = True) -> StateSpace:
    """Outputs with relative degrees r_i and internal dynamics eta' = internal eta + (random) zeta, in any coordinates if `mixed`.

    The zeros are the eigenvalues of `internal`. The matrix that takes the inputs to y^(r) has condition number 3 at most.
    """
    Q = np.asarray(internal, dtype=float).reshape(len(internal), len(internal))  # type: ignore[arg-type]
    p, rho, n_z = len(degrees), sum(degrees), len(Q)
    n = rho + n_z
    A, B, C = np.zeros((n, n)), np.zeros((n, p)), np.zeros((p, n))
    gain = rotation(rng, p) @ np.diag(rng.uniform(1.0, 3.0, p)) @ rotation(rng, p)
    first = 0
    for i, r in enumerate(degrees):
        C[i, first] = 1.0
        A[range(first, first + r - 1), range(first + 1, first + r)] = 1.0
        A[first + r - 1] = rng.normal(size=n) / np.sqrt(n)
        B[first + r - 1] = gain[i]
        first += r
    A[rho:, :rho], A[rho:, rho:] = rng.normal(size=(n_z, rho)) / np.sqrt(n), Q
    system = StateSpace(A, B, C)
    return system.transformed(rotation(rng, n) @ np.diag(rng.uniform(0.5, 2.0, n)) @ rotation(rng, n)) if mixed else system


def rotation(rng: np.random.Generator, n: int) -> Array:
    """A random orthogonal matrix (n, n)."""
    return np.linalg.qr(rng.normal(size=(n, n)))[0]


def block(*zeros: complex) -> Array:
    """Block-diagonal real matrix with these eigenvalues; a complex one stands for its conjugate too."""
    result = np.zeros((0, 0))
    for zero in zeros:
        s = complex(zero)
        part = np.array([[s.real]]) if s.imag == 0 else np.array([[s.real, s.imag], [-s.imag, s.real]])
        n, m = len(result), len(part)
        result = np.block([[result, np.zeros((n, m))], [np.zeros((m, n)), part]])
    return result


def pencil_zeros(A: Array, B: Array, C: Array, D: Array, *, largest: float = 1e4) -> NDArray[np.complex128]:
    """Finite generalized eigenvalues of the Rosenbrock pencil [A - s I, B; C, D]."""
    n = len(A)
    pencil = np.block([[A, B], [C, D]])
    mass = np.zeros_like(pencil)
    mass[:n, :n] = np.eye(n)
    values = scipy.linalg.eigvals(pencil, mass)
    return np.asarray(values[np.isfinite(values) & (np.abs(values) < largest)])


def assert_same_set(found: ArrayLike, expected: ArrayLike, tolerance: float) -> None:
    """Both hold the same complex numbers, in any order, to within `tolerance`."""
    left = list(np.asarray(expected, dtype=complex))
    for value in np.asarray(found, dtype=complex):
        assert left, f"{value} has no partner in {expected!r}"
        nearest = int(np.argmin(np.abs(np.array(left) - value)))
        assert abs(left[nearest] - value) <= tolerance, f"{value} against {left[nearest]}"
        left.pop(nearest)
    assert not left, f"missing: {left}"
