"""What a refusal says of a jump at which no continuous state keeps the output exact: which derivative would jump, and how far."""

from __future__ import annotations

from functools import partial

import numpy as np

from invtrack.arrays import Array
from invtrack.inversion.redesign_call import REDESIGN_ERROR, redesign_call
from invtrack.linear.normal_form import NormalForm
from invtrack.plans.problem import PlanningProblem
from invtrack.plans.trajectory import Trajectory
from invtrack.references.signal import PiecewiseSignal

CONSISTENCY_TOLERANCE = 1e-7
"""Conditions without unknowns left must hold to this share of the size of their terms."""


def missing_derivative(problem: PlanningProblem, form: NormalForm, trajectory: Trajectory, k: int, share: float) -> str:
    """The sentence for a jump at which the state before decides what a derivative of an output is after it, and decides otherwise.

    Args:
        problem: plant and reference.
        form: normal form of the plant after the jump.
        trajectory: of the inverse, exact up to the jump.
        k: number of the jump.
        share: by how much of its size the condition fails that fails worst.
    """
    plant, reference = problem.plant, problem.deviation
    t, n = plant.switch_times[k], plant.n_states
    at = int(np.searchsorted(reference.breakpoints, t))
    before, after = reference.inner_times()[at : at + 2]
    x = trajectory.at(t, before)[0, :n] + plant.shifts[k]
    owners = [(i, order) for i, r in enumerate(form.orders) for order in range(r)]
    found, terms = form.C_star @ x, np.abs(form.C_star) @ (np.abs(x) + np.abs(plant.shifts[k]))
    wanted, left = (form.zeta.rows(partial(_columns, reference, t, inside=side))[:, 0] for side in (after, before))
    sizes = form.zeta.size(reference.size)
    missed = np.flatnonzero(np.abs(found - wanted) > CONSISTENCY_TOLERANCE * np.maximum(np.maximum(terms, sizes), np.abs(wanted)))
    row = min(missed.tolist() or range(len(owners)), key=lambda row: owners[row][1])
    i, order = owners[row]
    times = np.linspace(reference.breakpoints[0], t, 100)
    inputs = np.max(np.abs(trajectory.at(times, np.minimum(times, before))[:, n : n + plant.n_inputs]), axis=0)
    held = trajectory.after.held[n : n + plant.n_inputs]
    call = redesign_call(reference.size(0), inputs, held=held, error=REDESIGN_ERROR)
    name, less = plant.outputs.names[i], ", less multiples of others," if form.combined and order else ""
    at_rest = plant.rest_outputs[k : k + 2, i] if order == 0 else np.zeros(2)
    return (
        f"at the jump at t = {t:.6g} s no continuous state keeps the output exact: {_derivative(order, name)}{less} would jump "
        f"from {left[row] + at_rest[0]:.4g} to {found[row] + at_rest[1]:.4g}, what the state before the jump makes of it, where "
        f"the reference asks for {wanted[row] + at_rest[1]:.4g} (missed by {share:.1e} of the size of its terms, whatever the "
        f"internal state); let the reference there take the value that the state before gives, or use {call} which gives up as "
        "little of the output as it must"
    )


def _columns(reference: PiecewiseSignal, t: float, order: int, *, inside: float) -> Array:
    """A derivative of the reference at a time within the piece that holds `inside`, as a column (p, 1)."""
    return np.asarray(reference(t, derivative=order, inside=inside))[:, None]


def _derivative(order: int, name: str) -> str:
    """A derivative of an output in words."""
    words = ("output", "the first derivative of output", "the second derivative of output", "the third derivative of output")
    return f"{words[order] if order < len(words) else f'the derivative of order {order} of output'} {name!r}"
