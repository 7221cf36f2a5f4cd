"""Exosystems by what they generate: sinusoids, polynomials, steps; and several side by side."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from invtrack.errors import TrajectoryError
from invtrack.signals.exosystem import Exosystem, Outside, exosystem
from invtrack.signals.real_arrays import real_numbers

Array = NDArray[np.float64]


def sinusoidal_exosystem(
    frequencies: ArrayLike, *, bias: bool = True, start: float | None = None, end: float | None = None, outside: Outside = "zero"
) -> Exosystem:
    """y_d = b + sum_i x_i, x_i' = w_i x_i^+, x_i^+' = -w_i x_i: sinusoids of any amplitude and phase, and a constant if `bias`.

    frequencies: w_i > 0 [rad/s]. States: "bias" first, then for each frequency x_i, "cos w", and x_i^+, "sin w": the signal that
    each makes of 1 at t = 0. start, end, outside: see `exosystem`. Raises TrajectoryError for frequencies that are not positive and
    distinct.
    """
    omegas = np.atleast_1d(real_numbers("frequencies", frequencies))
    if omegas.ndim != 1 or not np.all(np.isfinite(omegas) & (omegas > 0)) or len(np.unique(omegas)) != len(omegas):
        raise TrajectoryError(f"frequencies must be positive and distinct [rad/s], got {frequencies!r}")
    blocks = [np.zeros((1, 1))] * bias + [np.array([[0.0, omega], [-omega, 0.0]]) for omega in omegas.tolist()]
    if not blocks:
        raise TrajectoryError("expected at least one frequency, or a bias")
    rows = [np.ones(1)] * bias + [np.array([1.0, 0.0])] * len(omegas)
    names = ["bias"] * bias + [f"{kind} {omega:.12g}" for omega in omegas.tolist() for kind in ("cos", "sin")]
    return exosystem(scipy.linalg.block_diag(*blocks), np.concatenate(rows), start=start, end=end, outside=outside, names=names)


def polynomial_exosystem(
    degree: int, *, start: float | None = None, end: float | None = None, outside: Outside = "zero"
) -> Exosystem:
    """y_d a polynomial of time of the degree stated: its states are y_d, y_d', ..., y_d^(degree).

    start, end, outside: see `exosystem`. Raises TrajectoryError for a degree that is no whole number from 0 on.
    """
    if not (isinstance(degree, (int, float, np.number)) and degree >= 0 and float(degree).is_integer()):
        raise TrajectoryError(f"the degree must be a whole number from 0 on, got {degree!r}")
    names = ["value", *(f"derivative {k}" for k in range(1, int(degree) + 1))]
    first = np.eye(1, int(degree) + 1)
    return exosystem(np.eye(int(degree) + 1, k=1), first, start=start, end=end, outside=outside, names=names)


def step_exosystem(*, start: float | None = None, end: float | None = None, outside: Outside = "zero") -> Exosystem:
    """y_d constant, of any value: `polynomial_exosystem` of degree 0."""
    return polynomial_exosystem(0, start=start, end=end, outside=outside)


def sum_exosystems(parts: Sequence[Exosystem]) -> Exosystem:
    """One exosystem whose states are those of all `parts` and whose output is the sum of theirs.

    Names that occur twice are told apart by the number of their part ("2: bias"). Raises TrajectoryError where the numbers of
    outputs differ, or for no parts.
    """
    _require_exosystems(parts)
    if len({part.n_outputs for part in parts}) > 1:
        raise TrajectoryError(f"cannot add exosystems with {[part.n_outputs for part in parts]} outputs")
    return _side_by_side(parts, lambda *rows: np.hstack(rows))


def stack_exosystems(parts: Sequence[Exosystem]) -> Exosystem:
    """One exosystem whose states and outputs are those of all `parts`: for a plant with several outputs. See `sum_exosystems`."""
    _require_exosystems(parts)
    return _side_by_side(parts, scipy.linalg.block_diag)


def _side_by_side(parts: Sequence[Exosystem], join_rows: Callable[..., Array]) -> Exosystem:
    times = np.unique(np.concatenate([part.switch_times for part in parts]))
    aligned = [part.resampled(times) for part in parts]
    names = [name for part in parts for name in part.names]
    if len(set(names)) < len(names):
        names = [f"{i}: {name}" for i, part in enumerate(parts, start=1) for name in part.names]
    A = [scipy.linalg.block_diag(*(part.A[k] for part in aligned)) for k in range(len(times) + 1)]
    C = [join_rows(*(part.C[k] for part in aligned)) for k in range(len(times) + 1)]
    return Exosystem(A, C, times, names=names)


def _require_exosystems(parts: Sequence[Exosystem]) -> None:
    strangers = [type(part).__name__ for part in parts if not isinstance(part, Exosystem)]
    if not parts or strangers:
        raise TrajectoryError(f"expected at least one exosystem and nothing else, got {strangers or 'none'}")
