"""The weights of a redesign, checked where they enter."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from invtrack.errors import RedesignError
from invtrack.linear.switched import SwitchedSystem

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

SYMMETRY_TOLERANCE = 1e-9
"""Largest share of a weight by which an entry may differ from the one across the diagonal."""

SEMIDEFINITE_TOLERANCE = 1e-12
"""An eigenvalue counts as zero where it is no larger than this share of its weight, once the weight's diagonal is scaled to one."""

WeightLike = ArrayLike | Callable[[float], ArrayLike]

CONJUGATE_TOLERANCE = 1e-9
"""Largest departure from W(-w) = conj W(w), as a share of the weight's norm."""


@dataclass(frozen=True, eq=False)
class Weights:
    """u'R u + x'Q_x x + (y - y_d)'Q_y (y - y_d): R (p, p), Q_x (n, n), Q_y (p, p), symmetric and positive semidefinite."""

    R: Array
    Q_x: Array
    Q_y: Array

    def rate(self, x: Array, u: Array, error: Array) -> Array:
        """Cost per second (m,) of states (m, n), inputs (m, p) and output errors (m, p), all as deviations."""
        pairs = ((u, self.R), (x, self.Q_x), (error, self.Q_y))
        return np.asarray(sum(np.einsum("mi,ij,mj->m", value, weight, value) for value, weight in pairs))

    def terms(self, x: Array, u: Array, error: Array) -> Array:
        """Sum of the sizes of the terms that `rate` adds up, (m,): what its rounding is measured against."""
        pairs = ((u, self.R), (x, self.Q_x), (error, self.Q_y))
        return np.asarray(sum(np.einsum("mi,ij,mj->m", *map(np.abs, (value, weight, value))) for value, weight in pairs))

    def input_weight(self, D: Array) -> Array:
        """R + D'Q_y D (p, p): everything in the cost that is quadratic in the input itself."""
        return np.asarray(self.R + D.T @ self.Q_y @ D)


def as_weights(plant: SwitchedSystem, *, R: ArrayLike, Q_x: ArrayLike, Q_y: ArrayLike) -> Weights:
    """Weights for the states, inputs and outputs of `plant`; a number stands for that multiple of the identity.

    Raises RedesignError for a weight of the wrong shape, one that is not symmetric or not positive semidefinite, or R + D'Q_y D
    singular.
    """
    system = plant.systems[0]
    n, p = system.n_states, system.n_channels
    weights = Weights(
        R=real_weight("R", R, p, meaning=f"inputs {list(system.inputs.names)}"),
        Q_x=real_weight("Q_x", Q_x, n, meaning=f"states {list(system.states.names)}"),
        Q_y=real_weight("Q_y", Q_y, p, meaning=f"outputs {list(system.outputs.names)}"),
    )
    smallest = min(_smallest_eigenvalue(weights.input_weight(system.D)) for system in plant.systems)
    if smallest <= SEMIDEFINITE_TOLERANCE:
        raise RedesignError(
            "R must be positive definite (with a direct feedthrough: R + D'Q_y D), its smallest eigenvalue is "
            f"{smallest:.3g} of its size: an input that costs nothing may be unbounded; weigh every input, or, to follow the "
            "output exactly at whatever input it takes, use invtrack.invert"
        )
    return weights


def weight_matrix(name: str, value: ArrayLike, size: int, *, meaning: str = "", where: str = "") -> ComplexArray:
    """A weight as Hermitian positive semidefinite matrix (size, size); a number stands for that multiple of the identity.

    meaning, where: what it weighs and at which frequency, for messages. Raises RedesignError for a value that is none.
    """
    try:
        matrix: ComplexArray = np.asarray(value, dtype=complex)
    except (TypeError, ValueError) as error:
        raise RedesignError(f"{name} must be a number or a matrix of numbers{where}: {error}") from error
    matrix = matrix * np.eye(size) if matrix.ndim == 0 else matrix
    if matrix.shape != (size, size):
        expected = f"a number or a ({size}, {size}) matrix" + (f" for the {meaning}" if meaning else "")
        raise RedesignError(f"{name} must be {expected}, got shape {matrix.shape}{where}")
    if not np.all(np.isfinite(matrix)):
        raise RedesignError(f"{name} has entries that are not finite{where}")
    # Entry by entry against its own row and column: the units of the channels may differ by orders of magnitude.
    size_of, mirrored = np.sqrt(np.abs(np.diag(matrix))), matrix.conj().T
    if np.any(np.abs(matrix - mirrored) > SYMMETRY_TOLERANCE * (np.outer(size_of, size_of) + np.abs(matrix))):
        kind = "Hermitian" if np.any(matrix.imag) else "symmetric"
        raise RedesignError(f"{name} must be {kind}, its halves differ by up to {np.max(np.abs(matrix - mirrored)):.3g}{where}")
    matrix = (matrix + mirrored) / 2
    smallest = _smallest_eigenvalue(matrix)
    if smallest < -SEMIDEFINITE_TOLERANCE * size:
        raise RedesignError(f"{name} must be positive semidefinite, its smallest eigenvalue is {smallest:.3g} of its size{where}")
    return matrix


def real_weight(name: str, value: ArrayLike, size: int, *, meaning: str = "") -> Array:
    """The same of a weight that does not vary with frequency, which is real.

    Raises RedesignError where it is not, besides what `weight_matrix` does.
    """
    matrix = weight_matrix(name, value, size, meaning=meaning)
    if np.any(np.abs(matrix.imag) > SYMMETRY_TOLERANCE * np.abs(matrix)):
        raise RedesignError(
            f"a constant {name} must be real; a complex one has to be a function of frequency with {name}(-w) = conj {name}(w), "
            "which invtrack.prefilter takes"
        )
    return np.ascontiguousarray(matrix.real)


def _smallest_eigenvalue(matrix: Array | ComplexArray) -> float:
    """That of the matrix in units in which its diagonal is one, so that the units of the channels do not matter."""
    diagonal = np.abs(np.diag(matrix))
    scale = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    return float(scipy.linalg.eigvalsh(matrix / np.outer(scale, scale))[0])


def square_root(weight: Array) -> Array:
    """W (p, p) with W'W = weight."""
    diagonal = np.diag(weight)
    scale = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    values, vectors = scipy.linalg.eigh(weight / np.outer(scale, scale))
    return np.asarray(np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T * scale)


@dataclass(frozen=True, eq=False)
class FrequencyWeight:
    """A weight W(w) (k, k), Hermitian, positive semidefinite, W(-w) = conj W(w): a constant, or a function of w [rad/s]."""

    name: str
    size: int
    value: Array | Callable[[float], ArrayLike]

    @property
    def is_constant(self) -> bool:
        """Whether the weight is the same at all frequencies."""
        return not callable(self.value)

    @property
    def is_zero(self) -> bool:
        """Whether the weight is a constant without any entry."""
        return not callable(self.value) and not np.any(self.value)

    def at(self, w: float) -> ComplexArray:
        """W(w) (k, k). Raises RedesignError where it is malformed, not Hermitian or not positive semidefinite."""
        if callable(self.value):
            return weight_matrix(self.name, self.value(w), self.size, where=f" at w = {w:.6g} rad/s")
        return self.value.astype(complex)

    def factor(self, w: Array) -> ComplexArray:
        """F(w) with F*F = W at frequencies w (m,), not negative: (m, k, k)."""
        if not callable(self.value):
            return np.broadcast_to(_square_root(self.at(0.0)), (len(w), self.size, self.size))
        if len(w) == 0:
            return np.zeros((0, self.size, self.size), dtype=complex)
        return _square_root(np.stack([self.at(float(frequency)) for frequency in w]))


def frequency_weight(name: str, value: WeightLike, size: int, probes: Array) -> FrequencyWeight:
    """A weight, checked at the frequencies `probes` (m,) [rad/s]; a number stands for a multiple of the identity.

    Raises RedesignError for a wrong shape, a weight that is not Hermitian positive semidefinite, a constant that is not real, or a
    function whose values at w and -w are not conjugate (a real trajectory would then have a complex optimum).
    """
    if not callable(value):
        return FrequencyWeight(name, size, real_weight(name, value, size))
    weight = FrequencyWeight(name, size, value)
    for w in probes:
        here, mirrored = weight.at(float(w)), weight.at(-float(w))
        if np.max(np.abs(mirrored - here.conj())) > CONJUGATE_TOLERANCE * np.linalg.norm(here):
            raise RedesignError(
                f"{name} must have conjugate values at w and -w so that the redesign is real; at w = {w:.6g} rad/s it has not "
                "(use |w| in its formula)"
            )
    return weight


def _square_root(matrices: ComplexArray) -> ComplexArray:
    values, vectors = np.linalg.eigh(matrices)
    root: ComplexArray = np.sqrt(np.maximum(values, 0.0))[..., None] * np.swapaxes(vectors.conj(), -1, -2)
    return root
