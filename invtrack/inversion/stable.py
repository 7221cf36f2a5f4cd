"""Exact output tracking with bounded input and state: stable inversion, through parameter jumps at known times."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from invtrack.errors import BoundednessError, CompatibilityError, InversionError, TrajectoryError
from invtrack.inversion.assembly import Assembly, assemble
from invtrack.inversion.boundary_value import BoundaryValueSolution, solve
from invtrack.inversion.decay import decay_time
from invtrack.inversion.decay_stops import decay_stops
from invtrack.inversion.junctions import SAME_ROW_TOLERANCE
from invtrack.lti.switched import SwitchedSystem, as_switched
from invtrack.lti.zero_dynamics import SplitDynamics, split_dynamics
from invtrack.signals.certificate import certify
from invtrack.signals.nominal import Certificate, NominalTrajectory, TwoSidedTrajectory
from invtrack.signals.piecewise import PiecewiseSignal
from invtrack.signals.profiles import constant

Array = NDArray[np.float64]

ACCURACY = 1e-8
"""Largest residual of a plan, relative to its size, with which it is handed out."""

CONSISTENCY_TOLERANCE = 1e-7
"""Conditions without unknowns left must hold to this share of the size of their terms."""


def invert(
    model: Any,
    reference: PiecewiseSignal,
    *,
    tolerance: float = 1e-10,
    max_preactuation: float | None = None,
) -> NominalTrajectory:
    """The bounded input and state with which the output of `model` follows `reference` exactly.

    x' = A_k x + B_k u, C_k x = y_d on all of time, x continuous through the jumps. Internal dynamics: stable part forward from
    rest, antistable part backward from rest, so the input acts before the manoeuvre (preactuation) and rings down after it.

    model: StateSpace, SwitchedSystem, or anything with A, B, C, D. reference: absolute, in the units of the outputs. tolerance:
    what counts as rest at the two ends, as a share of each state's and input's peak; it sets how early the plan starts.
    max_preactuation [s] limits that, at the price of a start that is not quite at rest, which `remarks` states.

    Raises TrajectoryError (reference not smooth enough, wrong number of channels), InversionError (options out of range),
    RelativeDegreeError, NonHyperbolicError (zeros on the imaginary axis, in any interval), CompatibilityError (a jump at which no
    continuous state keeps the output exact), BoundednessError (no bounded solution), InversionError (too ill-conditioned). Sources:
    Devasia, Chen, Paden 1996; Devasia, Paden, Rossi 1996, Lemma 1.
    """
    if not 0 < tolerance < 1 or (max_preactuation is not None and not max_preactuation >= 0):
        raise InversionError(
            f"tolerance must lie between 0 and 1 and max_preactuation must not be negative, got {tolerance} and {max_preactuation}"
        )
    plant = as_switched(model)
    point = plant.systems[0].operating_point
    if reference.n_channels != plant.systems[0].n_channels:
        names = list(plant.systems[0].output_names)
        raise TrajectoryError(f"the reference has {reference.n_channels} channels, the plant {len(names)} outputs {names}")
    deviation = reference + constant(-point.y0, at=reference.support[0]) if np.any(point.y0) else reference
    splits = _split_each(plant)
    _require_smooth(plant, splits, reference)
    assembly = assemble(plant, splits, deviation.refined([*plant.switch_times, *decay_stops(deviation)]))
    solution = solve(assembly.first, assembly.junctions, assembly.last)
    _require_consistent(plant, splits, assembly, solution)
    trajectory = assembly.trajectory(solution.values)
    support = (float(trajectory.breakpoints[0]), float(trajectory.breakpoints[-1]))
    preactuation, postactuation, truncation = _actuation_times(assembly, trajectory, tolerance, max_preactuation)
    certificate = certify(plant, trajectory, deviation, (support[0] - preactuation, support[1] + postactuation))
    _require_accurate(certificate, solution)
    return NominalTrajectory(
        method="stable inversion",
        model=plant,
        reference=reference,
        trajectory=trajectory,
        support=support,
        preactuation=preactuation,
        postactuation=postactuation,
        tolerance=tolerance,
        certificate=certificate,
        remarks=_remarks(solution, preactuation, truncation, max_preactuation),
    )


def _split_each(plant: SwitchedSystem) -> list[SplitDynamics]:
    """Split internal dynamics of each interval; models that recur are worked out once."""
    known: dict[int, SplitDynamics] = {}
    for system in plant.systems:
        if id(system) not in known:
            known[id(system)] = split_dynamics(system)
    return [known[id(system)] for system in plant.systems]


def _require_smooth(plant: SwitchedSystem, splits: list[SplitDynamics], reference: PiecewiseSignal) -> None:
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
            name, r = plant.systems[0].output_names[channel], int(needed[at, channel])
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


def _require_consistent(
    plant: SwitchedSystem, splits: list[SplitDynamics], assembly: Assembly, solution: BoundaryValueSolution
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


def _require_accurate(certificate: Certificate, solution: BoundaryValueSolution) -> None:
    """The last guard: a plan that misses its own equations is refused, whatever the reason."""
    worst = max(certificate.dynamics_residual, certificate.output_error, certificate.continuity)
    if not worst <= ACCURACY:
        raise InversionError(
            f"the inverse is too ill-conditioned to be trusted: the plan misses its own equations by {worst:.1e} of its size "
            f"({certificate}; smallest pivot of the boundary value problem {solution.conditioning:.1e}); look for inputs or states "
            "in badly chosen units, nearly dependent outputs, or a model in fewer states"
        )


def _actuation_times(
    assembly: Assembly, trajectory: TwoSidedTrajectory, tolerance: float, limit: float | None
) -> tuple[float, float, float]:
    """Preactuation and postactuation [s], and the share of the peak that is cut off where preactuation is limited."""
    start, end = trajectory.breakpoints[0], trajectory.breakpoints[-1]
    times = np.concatenate([np.linspace(start, end, 2001), trajectory.breakpoints]) if end > start else trajectory.breakpoints
    peak = np.max(np.abs(trajectory(times, trajectory.locate(times))), axis=0)
    before, after = assembly.departures(trajectory)
    preactuation = decay_time(before, peak, tolerance)
    postactuation = decay_time(after, peak, tolerance)
    if limit is None or preactuation <= limit:
        return preactuation, postactuation, 0.0
    return limit, postactuation, before.share_left(limit, peak)


def _remarks(solution: BoundaryValueSolution, preactuation: float, truncation: float, limit: float | None) -> tuple[str, ...]:
    remarks = []
    if solution.freedom:
        remarks.append(f"the bounded inverse is not unique ({solution.freedom} free direction(s)); the one of least norm was taken")
    if truncation:
        remarks.append(f"preactuation limited to {limit} s: the plan starts {truncation:.1e} of its peak away from rest")
    return tuple(remarks)
