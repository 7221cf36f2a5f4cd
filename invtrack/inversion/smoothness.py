"""Whether a reference is as smooth as an inverse needs it to be."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from invtrack.arrays import Array
from invtrack.errors import TrajectoryError
from invtrack.linear.internal_dynamics import InternalDynamics
from invtrack.linear.normal_form import NormalForm
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.junctions import SAME_ROW_TOLERANCE
from invtrack.references.signal import JUMP_TOLERANCE, PiecewiseSignal


def require_smooth(plant: SwitchedSystem, internals: Sequence[InternalDynamics], reference: PiecewiseSignal) -> None:
    """What the outputs prescribe of the state must be continuous within an interval; at a jump the conditions there decide.

    With a vector relative degree r this is y_d ... y_d^(r-1). The reference is the deviation from the outputs at rest, of which the
    absolute one must be continuous. Raises TrajectoryError.
    """
    edges = reference.breakpoints
    after, before = plant.interval(edges), np.searchsorted(plant.switch_times, edges, side="left")
    rest = plant.rest_outputs[after] - plant.rest_outputs[before]
    known: dict[int, Array] = {}

    def jump(order: int) -> Array:
        """Jump of a derivative of the wanted outputs at each breakpoint (p, m + 1)."""
        if order not in known:
            left, right = reference.sides(order)
            known[order] = (right - left + (rest if order == 0 else 0.0)).T
        return known[order]

    forms = list({id(internal.form): internal.form for internal in internals}.values())
    place = {id(form): number for number, form in enumerate(forms)}
    number = np.array([place[id(internal.form)] for internal in internals])
    shape = (len(forms), len(forms))
    pairs, which = np.unique(np.ravel_multi_index((number[before], number[after]), shape), return_inverse=True)
    faults: list[tuple[int, NormalForm]] = []
    for pair, (i, j) in enumerate(zip(*np.unravel_index(pairs, shape), strict=True)):
        form = forms[i]
        size = form.zeta.size(reference.size)
        shared = np.ones(len(size), dtype=bool) if i == j else _shared_rows(form, forms[j])
        broken = np.abs(form.zeta.rows(jump)) > JUMP_TOLERANCE * np.where(size > 0, size, 1.0)[:, None]
        broken &= shared[:, None] & (which == pair)
        if np.any(broken):
            faults.append((int(np.flatnonzero(np.any(broken, axis=0))[0]), form))
    if faults:
        at, form = min(faults, key=lambda fault: fault[0])
        raise TrajectoryError(_not_smooth(plant, form, reference, at, [jump(k) for k in range(len(form.zeta.coefficients))]))


def _not_smooth(plant: SwitchedSystem, form: NormalForm, reference: PiecewiseSignal, at: int, jumps: Sequence[Array]) -> str:
    """The sentence for a reference of which a derivative that the inverse prescribes jumps at a breakpoint.

    Args:
        plant, form: whose outputs these are, and its normal form there.
        reference: the deviation that is to be followed.
        at: number of the breakpoint.
        jumps: of each derivative (p, m + 1).
    """
    needed = [highest + 1 for highest in form.zeta.highest]
    shares = [np.abs(jump[:, at]) / np.where(reference.size(k) > 0, reference.size(k), 1.0) for k, jump in enumerate(jumps)]
    order, channel = next((k, i) for k, share in enumerate(shares) for i in np.flatnonzero(share > JUMP_TOLERANCE) if k < needed[i])
    r = needed[channel]
    return (
        f"the reference for {plant.outputs.names[channel]!r} is not smooth enough: its derivative of order {order} jumps at "
        f"t = {reference.breakpoints[at]:.6g} s, so it has {order} continuous derivatives (the value counted), but the "
        + ("plant's inverse, without relative degree," if form.combined else f"plant's relative degree {r}")
        + f" needs {r}; use a smoother profile, for instance rest_to_rest(..., smoothness={max(needed)})"
    )


def _shared_rows(left: NormalForm, right: NormalForm) -> NDArray[np.bool_]:
    """Which rows of zeta are, like those before them of the same output, the same functions of the state in both forms (rho,)."""
    shared, start, other = np.zeros(len(left.C_star), dtype=bool), 0, 0
    for ours, theirs in zip(left.orders, right.orders, strict=True):
        for k in range(min(ours, theirs)):
            same_row = _same(left.C_star[start + k], right.C_star[other + k])
            if not (same_row and _same(left.zeta.combination(start + k), right.zeta.combination(other + k))):
                break
            shared[start + k] = True
        start, other = start + ours, other + theirs
    return shared


def _same(a: Array, b: Array) -> bool:
    return a.shape == b.shape and bool(np.all(np.abs(a - b) <= SAME_ROW_TOLERANCE * np.maximum(np.abs(a), np.abs(b)).max()))
