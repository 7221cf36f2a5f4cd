"""What an inverse is refused for: a reference too rough, conditions that cannot be met, a solution that cannot be trusted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from invtrack.errors import BoundednessError, CompatibilityError, InversionError, TrajectoryError
from invtrack.inversion.bounded_solution.assembly import Assembly
from invtrack.inversion.bounded_solution.junctions import SAME_ROW_TOLERANCE
from invtrack.linear.internal_dynamics import SplitDynamics
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.boundary_value import BoundaryValueSolution
from invtrack.plans.plan import Certificate
from invtrack.references.signal import PiecewiseSignal

Array = NDArray[np.float64]

ACCURACY = 1e-8
"""Largest residual of a plan, relative to its size, with which it is handed out."""

CONSISTENCY_TOLERANCE = 1e-7
"""Conditions without unknowns left must hold to this share of the size of their terms."""


def require_smooth(plant: SwitchedSystem, splits: list[SplitDynamics], reference: PiecewiseSignal) -> None:
    """Within an interval of relative degree r, y_d ... y_d^(r-1) must be continuous; at a jump the conditions there decide."""
    after = plant.interval(reference.breakpoints)
    before = np.searchsorted(plant.switch_times, reference.breakpoints, side="left")
    shape = (len(plant), len(plant))
    sides, which = np.unique(np.ravel_multi_index((before, after), shape), return_inverse=True)
    pairs = zip(*np.unravel_index(sides, shape), strict=True)
    needed = np.array([_shared_orders(splits[i], splits[j]) for i, j in pairs])[which]  # (breakpoints, p)
    for order in range(int(needed.max(initial=0))):
        discontinuous = (reference.jumps(order) > 1e-9) & (order < needed)
        if np.any(discontinuous):
            at, channel = np.argwhere(discontinuous)[0]
            name, r = plant.outputs.names[channel], int(needed[at, channel])
            raise TrajectoryError(
                f"the reference for {name!r} is not smooth enough: its derivative of order {order} jumps at "
                f"t = {reference.breakpoints[at]:.6g} s, so it has {order} continuous derivatives (the value counted), but the "
                f"plant's relative degree {r} needs {r}; use a smoother profile, for instance rest_to_rest(..., smoothness={r})"
            )


def _shared_orders(left: SplitDynamics, right: SplitDynamics) -> list[int]:
    """Per output, how many of y, y', ... are the same functions of the state in both intervals, so that they cannot jump."""
    rows = [_derivative_rows(split) for split in (left, right)]
    return [
        next((k for k, (a, b) in enumerate(zip(*pair, strict=False)) if not _same_row(a, b)), min(len(pair[0]), len(pair[1])))
        for pair in zip(*rows, strict=True)
    ]


def _derivative_rows(split: SplitDynamics) -> list[Array]:
    """The rows of C* of each output."""
    form = split.internal.form
    return np.split(form.C_star, np.cumsum(form.relative_degree)[:-1])


def _same_row(a: Array, b: Array) -> bool:
    return bool(np.all(np.abs(a - b) <= SAME_ROW_TOLERANCE * np.maximum(np.abs(a), np.abs(b)).max()))


def require_consistent(
    plant: SwitchedSystem, splits: Sequence[SplitDynamics], assembly: Assembly, solution: BoundaryValueSolution
) -> None:
    for k, (row, size) in enumerate(assembly.open_checks):
        if size > CONSISTENCY_TOLERANCE:
            raise CompatibilityError(
                f"at the jump at t = {plant.switch_times[k]:.6g} s the outputs and derivatives of the new plant (condition "
                f"{row + 1}) miss the wanted ones by {size:.1e} of their size whatever the internal state, so no bounded input "
                "keeps the output exact through it; let the reference there take the value that the state before gives"
            )
    scale = max(assembly.size, np.finfo(float).tiny)
    compatibility_rows = 0
    for k, miss in enumerate(solution.inconsistency[:-1]):
        compatibility_rows += len(assembly.junctions[k].rhs) - len(splits[k + 1].internal.A_eta)
        if miss > CONSISTENCY_TOLERANCE * scale and not compatibility_rows:
            raise BoundednessError(
                "no bounded inverse: the internal state that the past leaves at the jump at "
                f"t = {plant.switch_times[k]:.6g} s is off the one that stays bounded over the next interval by "
                f"{miss / scale:.1e} of the trajectory's size; change the reference, the parameters after the jump, or the output"
            )
        if miss > CONSISTENCY_TOLERANCE * scale:
            raise CompatibilityError(
                f"at the jump at t = {plant.switch_times[k]:.6g} s the state cannot be continuous and the output exact at "
                f"once: the compatibility conditions fail by {miss / scale:.1e} of the trajectory's size; change the reference "
                "around the jump, or keep C* (outputs and derivatives as functions of the state) the same on both sides"
            )
    if solution.inconsistency[-1] > CONSISTENCY_TOLERANCE * scale:
        n_u = [len(split.A_u) for split in (splits[0], splits[-1])]
        raise BoundednessError(
            f"no bounded inverse: {n_u[0]} antistable zero(s) before the manoeuvre give {n_u[0]} unknown(s) for the {n_u[1]} "
            "condition(s) that keep the internal state bounded after it, and these fail by "
            f"{solution.inconsistency[-1] / scale:.1e} of the trajectory's size; change the reference, the last interval's "
            "parameters, or the output"
        )


def require_accurate(certificate: Certificate, solution: BoundaryValueSolution, *, exact: bool = True) -> None:
    """The last guard: a plan that misses its own equations (if `exact`, y = y_d is one) is refused, whatever the reason."""
    worst = max(certificate.dynamics_residual, certificate.output_error if exact else 0.0, certificate.continuity)
    if not worst <= ACCURACY:
        raise InversionError(
            f"the inverse is too ill-conditioned to be trusted: the plan misses its own equations by {worst:.1e} of its size "
            f"({certificate}; smallest pivot of the boundary value problem {solution.conditioning:.1e}); look for inputs or states "
            "in badly chosen units, nearly dependent outputs, or a model in fewer states"
        )
