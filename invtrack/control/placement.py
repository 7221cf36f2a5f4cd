"""Feedback that places poles, of states and, transposed, of estimation errors; modes that nothing moves are kept or named."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import scipy  # loads scipy.optimize at its first use

from invtrack.arrays import Array, ComplexArray, as_divisor
from invtrack.errors import ControlError
from invtrack.linear.internal_dynamics import format_zeros
from invtrack.linear.mode_groups import ModeGroup, listed
from invtrack.linear.pole_placement import placing_gain

KEPT = 1e-3
"""A pole wanted is a mode that cannot be moved itself where it is within this share of it: as close as people write it down."""


def placed_gain(
    A: Array,
    B: Array,
    poles: ComplexArray,
    *,
    fixed: Array,
    modes: Sequence[ModeGroup],
    name: str,
    obstacle: str,
    remedy: str,
    mapped: Callable[[ComplexArray], ComplexArray] = np.asarray,
) -> Array:
    """K (p, n) for which the eigenvalues of A - B K are the `poles`, those of modes that cannot be moved among them.

    Args:
        A: (n, n), in units in which the states count alike.
        B: (n, p).
        poles: wanted (n,) [rad/s], complex ones in conjugate pairs.
        fixed: orthonormal basis (n, h) of what B does not reach: w'B = 0, and w'A stays in it.
        modes: the h modes of that part.
        name: what messages call the poles.
        obstacle: what messages say before the modes that stay: "the inputs ['u1'] do not move".
        remedy: what would help where they may not stay.
        mapped: from poles [rad/s] to eigenvalues of A.

    Raises ControlError where modes that cannot be moved are not among the poles, or rounding keeps the others from being met.
    """
    rest = _without_kept(poles, modes, name=name, obstacle=obstacle, remedy=remedy)
    n, h = fixed.shape
    reached = np.linalg.qr(fixed, mode="complete")[0][:, h:] if h else np.eye(n)
    if h == n:
        return np.zeros((B.shape[1], n))
    size = np.exp2(np.rint(np.log2(as_divisor(np.linalg.norm(B, axis=0)))))
    A_r, B_r = reached.T @ A @ reached, reached.T @ B / size
    gain = placing_gain(A_r, B_r, mapped(rest))
    if gain is None:
        hardest = _hardest(A, B / size)
        raise ControlError(
            f"{name} cannot be placed: rounding moves them further than they may be off, since hardly anything moves the mode with "
            f"the eigenvalue {format_zeros(hardest)}; choose poles nearer to those there are, or {remedy}"
        )
    return np.asarray(-(gain / size[:, None]) @ reached.T)


def _without_kept(poles: ComplexArray, modes: Sequence[ModeGroup], *, name: str, obstacle: str, remedy: str) -> ComplexArray:
    """The poles without those that are modes which cannot be moved."""
    values = np.array([value for group in modes for value in group.values], dtype=complex)
    distance = np.abs(values[:, None] - poles)
    which, chosen = scipy.optimize.linear_sum_assignment(distance)
    kept = distance[which, chosen] <= KEPT * np.abs(values)
    owner = np.repeat(np.arange(len(modes)), [len(group.values) for group in modes])
    missing = [group for number, group in enumerate(modes) if not np.all(kept[owner == number])]
    if missing:
        stays = all(group.side < 0 for group in missing)
        where = "" if stays else ", on or right of the imaginary axis"
        keep = f"keep {', '.join(group.eigenvalues for group in missing)} among the poles, or " if stays else ""
        raise ControlError(f"{name} cannot be placed: {obstacle} {listed(missing)}{where}; {keep}{remedy}")
    return np.delete(poles, chosen)


def _hardest(A: Array, B: Array) -> complex:
    """The eigenvalue of the mode that B moves least: where [A - s I, B] is nearest to losing rank."""
    values = np.linalg.eigvals(A)
    reach = [np.linalg.svd(np.hstack([A - s * np.eye(len(A)), B]), compute_uv=False)[-1] for s in values]
    return complex(values[int(np.argmin(reach))])
