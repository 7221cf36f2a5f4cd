"""Arrays as signatures speak of them (shapes stand in the docstrings), and checks of what users hand in."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invtrack.errors import InvtrackError, TrajectoryError

Array = NDArray[np.float64]

ComplexArray = NDArray[np.complex128]

Indices = NDArray[np.intp]


Refusal = type[InvtrackError]

SYMMETRY_TOLERANCE = 1e-9
"""Largest share of a weight by which an entry may differ from the one across the diagonal."""

SEMIDEFINITE_TOLERANCE = 1e-12
"""An eigenvalue counts as zero where it is no larger than this share of its matrix, once the matrix's diagonal is scaled to one."""


SHOWN = 60
"""Characters of a value that a message shows at most."""


def as_divisor(size: ArrayLike) -> Array:
    """Sizes to divide by: 1 for those that are zero."""
    return np.where(np.asarray(size) > 0, size, 1.0)


def real_numbers(name: str, value: ArrayLike, *, error: Refusal = TrajectoryError) -> Array:
    """A copy as real numbers of any shape, infinite ones and NaN among them; raises `error` for anything else."""
    return _numbers(name, value, float, "real numbers", error)


def real_number(name: str, value: float, *, unit: str = "", error: Refusal = TrajectoryError) -> float:
    """One real number, which may be infinite or NaN; raises `error` for anything else."""
    number = real_numbers(name, value, error=error)
    if number.ndim:
        raise error(f"{name} must be one number{f' [{unit}]' if unit else ''}, got an array of shape {number.shape}")
    return float(number)


def finite_number(name: str, value: float, *, unit: str = "", error: Refusal = TrajectoryError) -> float:
    """One finite real number; raises `error` for anything else."""
    number = real_number(name, value, unit=unit, error=error)
    if not np.isfinite(number):
        raise error(f"{name} must be a finite number{f' [{unit}]' if unit else ''}, got {number}")
    return number


def whole_number(name: str, value: int, *, lowest: int = 0, highest: int | None = None, error: Refusal = TrajectoryError) -> int:
    """A whole number from `lowest` to `highest`, also as a numpy integer; raises `error` for anything else."""
    given = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    if not given or value < lowest or (highest is not None and value > highest):
        raise error(
            f"{name} must be a whole number from {lowest} {'on' if highest is None else f'to {highest}'}, got {shown(value)}"
        )
    return int(value)


def real_matrix(name: str, value: ArrayLike, *, shape: tuple[int, int] | None = None, error: Refusal = TrajectoryError) -> Array:
    """A copy as a matrix of finite real numbers, a vector as one of one row; raises `error` for anything else.

    shape: the one that it must have, any unless stated.
    """
    matrix = np.atleast_2d(real_numbers(name, value, error=error))
    if matrix.ndim != 2 or (shape is not None and matrix.shape != shape):
        kind = "a matrix" if shape is None else f"a {shape} matrix"
        raise error(f"{name} must be {kind} of finite real numbers, got shape {matrix.shape}")
    if not np.all(np.isfinite(matrix)):
        raise error(f"{name} must be a matrix of finite real numbers, it has entries that are not finite")
    return matrix


def real_vector(name: str, value: ArrayLike, entries: Sequence[str], *, error: Refusal = TrajectoryError) -> Array:
    """A copy as one finite real number for each of the named `entries`, (n,); raises `error` for anything else."""
    vector = real_numbers(name, value, error=error)
    if vector.shape != (len(entries),) or not np.all(np.isfinite(vector)):
        raise error(f"{name} must be finite, one number for each of {list(entries)}, got {shown(value)}")
    return vector


def increasing_times(name: str, value: ArrayLike, *, error: Refusal = TrajectoryError) -> Array:
    """A copy as times (m,) [s], finite and increasing, possibly none; raises `error` for anything else."""
    times = np.atleast_1d(real_numbers(name, value, error=error))
    if times.ndim != 1:
        raise error(f"{name} must be a list of times (m,) [s], got an array of shape {times.shape}")
    if not np.all(np.isfinite(times)) or np.any(times[1:] <= times[:-1]):
        shown = f"{times.tolist()}" if len(times) <= 8 else f"{times[:8].tolist()} and {len(times) - 8} more"
        raise error(f"{name} must be finite and increase, got {shown}")
    return times


def require_duration(name: str, value: float, *, error: Refusal = TrajectoryError) -> None:
    """Raises `error` unless `value` is a positive, finite number of seconds."""
    if not 0 < real_number(name, value, unit="s", error=error) < np.inf:
        raise error(f"{name} must be a positive number of seconds, got {value}")


def require_not_negative(name: str, value: float, *, error: Refusal) -> None:
    """Raises `error` unless `value` is a number, finite and zero or more."""
    if not 0 <= real_number(name, value, error=error) < np.inf:
        raise error(f"{name} must be finite and not negative, got {value}")


def require_share(name: str, value: float, *, error: Refusal) -> None:
    """Raises `error` unless `value` is a number between 0 and 1, neither of them included."""
    if not 0 < real_number(name, value, error=error) < 1:
        raise error(f"{name} must lie between 0 and 1, got {value}")


def complex_numbers(name: str, value: ArrayLike, *, error: Refusal) -> ComplexArray:
    """A copy as complex numbers of any shape, infinite ones and NaN among them; raises `error` for anything else."""
    return _numbers(name, value, complex, "numbers", error)


def _numbers(name: str, value: ArrayLike, kind: type, expected: str, error: Refusal) -> NDArray[Any]:
    """A copy as numbers of a kind, float or complex.

    Args:
        name, value: what the message calls it, and what came.
        kind: float or complex.
        expected: what the message calls such numbers.
        error: class of what is raised for anything else.
    """
    if masked(value):
        raise error(f"{name} must be {expected}, got a masked array; fill in or leave out what is masked")
    try:
        given: NDArray[Any] = np.array(value)
        numbers: NDArray[Any] = given.astype(kind, casting="same_kind")
    except (TypeError, ValueError, OverflowError) as reason:
        raise error(f"{name} must be {expected}, got {shown(value)}: {reason}") from reason
    if given.dtype == np.bool_:
        raise error(f"{name} must be {expected}, got {shown(value)}: no numbers, but true or false")
    return numbers


def stable_poles(name: str, value: ArrayLike, count: int, *, error: Refusal) -> ComplexArray:
    """Poles (count,) [rad/s] left of the imaginary axis, complex ones in conjugate pairs; raises `error` for anything else."""
    poles = complex_numbers(name, value, error=error)
    fits = poles.shape == (count,) and bool(np.all(np.isfinite(poles)) and np.all(poles.real < 0))
    if not fits or not closed_under_conjugation(poles):
        raise error(f"expected {count} {name} left of the imaginary axis, complex ones in conjugate pairs, got {poles.tolist()}")
    return poles


def closed_under_conjugation(poles: ComplexArray) -> bool:
    """Whether complex poles come in conjugate pairs."""
    return bool(np.allclose(np.sort_complex(poles), np.sort_complex(poles.conj()), rtol=1e-9, atol=0.0))


def hermitian_weight(name: str, value: ArrayLike, size: int, *, meaning: str = "", where: str = "", error: Refusal) -> ComplexArray:
    """A weight as Hermitian positive semidefinite matrix (size, size); a number stands for that multiple of the identity.

    Args:
        name: what the message calls it.
        value: a number or a matrix (size, size), real or complex.
        size: how many channels it weighs.
        meaning: which channels these are, for the message: "inputs ['u1']".
        where: at which frequency it holds, for the message: " at w = 3 rad/s".
        error: class of what is raised for a value that is no such weight.
    """
    matrix = complex_numbers(f"{name}{where}", value, error=error)
    matrix = matrix * np.eye(size) if matrix.ndim == 0 else matrix
    if matrix.shape != (size, size):
        expected = f"a number or a ({size}, {size}) matrix" + (f" for the {meaning}" if meaning else "")
        raise error(f"{name} must be {expected}, got shape {matrix.shape}{where}")
    if not np.all(np.isfinite(matrix)):
        raise error(f"{name} has entries that are not finite{where}")
    # Entry by entry against its own row and column: the units of the channels may differ by orders of magnitude.
    size_of, mirrored = np.sqrt(np.abs(np.diag(matrix))), matrix.conj().T
    allowed = SYMMETRY_TOLERANCE * np.outer(size_of, size_of) + SYMMETRY_TOLERANCE * np.abs(matrix)
    if np.any(np.abs(matrix - mirrored) > allowed):
        kind = "Hermitian" if np.any(matrix.imag) else "symmetric"
        raise error(f"{name} must be {kind}, its halves differ by up to {np.max(np.abs(matrix - mirrored)):.3g}{where}")
    matrix = matrix / 2 + mirrored / 2  # their sum may be beyond any float
    smallest = smallest_eigenvalue(matrix)
    if smallest < -SEMIDEFINITE_TOLERANCE * size:
        raise error(f"{name} must be positive semidefinite, its smallest eigenvalue is {smallest:.3g} of its size{where}")
    return matrix


def real_weight(name: str, value: ArrayLike, size: int, *, meaning: str = "", definite: bool = False, error: Refusal) -> Array:
    """The same for a weight that does not vary with frequency, which is real.

    Args:
        name: what the message calls it.
        value: a number or a matrix (size, size).
        size: how many channels it weighs.
        meaning: which channels these are, for the message: "inputs ['u1']".
        definite: whether it must be positive definite, not only semidefinite.
        error: class of what is raised for a value that is no such weight.
    """
    matrix = hermitian_weight(name, value, size, meaning=meaning, error=error)
    if np.any(np.abs(matrix.imag) > SYMMETRY_TOLERANCE * np.abs(matrix)):
        raise error(
            f"a constant {name} must be real, got imaginary parts of up to {np.max(np.abs(matrix.imag)):.3g}; only a weight that "
            f"is a function of frequency may be complex, with {name}(-w) = conj {name}(w), which invtrack.redesign.prefilter takes"
        )
    weight = np.ascontiguousarray(matrix.real)
    if definite and smallest_eigenvalue(weight) <= SEMIDEFINITE_TOLERANCE:
        raise error(
            f"{name} must be positive definite, its smallest eigenvalue is {smallest_eigenvalue(weight):.3g} of its size; weigh "
            f"every one of the {meaning or 'channels'}"
        )
    return weight


def smallest_eigenvalue(matrix: Array | ComplexArray) -> float:
    """That of a Hermitian matrix in units in which its diagonal is one, so that the units of its channels do not matter."""
    diagonal = np.abs(np.diag(matrix))
    scale = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    return float(np.linalg.eigvalsh(matrix / np.outer(scale, scale))[0])


def masked(value: object) -> bool:
    """Whether a value is a masked array, or a list that holds one somewhere: numpy would drop the mask without a word."""
    if isinstance(value, (list, tuple)):
        return any(map(masked, value))
    return isinstance(value, np.ma.MaskedArray)


def shown(value: object) -> str:
    """What a message says of a value that should not be there: itself, if it is short, or what it is."""
    shape = getattr(value, "shape", ())
    if isinstance(shape, tuple) and shape:
        return f"an array of shape {shape}"
    try:
        written = repr(value)
    except Exception:  # integers of thousands of digits have no text, and objects of users may have none
        written = ""
    return written if 0 < len(written) <= SHOWN and "\n" not in written else f"a {type(value).__name__}"
