"""What every method starts from and ends with: a plant, a reference, options; and the plan with its ends and its certificate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from invtrack.arrays import Array, Indices, real_number, require_share
from invtrack.errors import PlanError, TrajectoryError
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem, as_switched
from invtrack.plans.actuation import ringing
from invtrack.plans.certificate import Certificate, certify
from invtrack.plans.plan import Plan
from invtrack.plans.trajectory import Trajectory, away_from_rest
from invtrack.references.generator import constant_generator
from invtrack.references.profiles import constant
from invtrack.references.signal import PiecewiseSignal

PlanType = TypeVar("PlanType", bound=Plan)

LARGEST_DECAY = 3.0
"""Time constants that a mode of the reference may decay over within one piece: backward, its rounding errors grow by e^3."""

AT_REST = 1e-12
"""A reference that departs from the operating point by no more than this share of its values asks for no motion."""


@dataclass(frozen=True, eq=False)
class PlanningProblem:
    """A plant, a reference and what counts as rest, checked to fit each other.

    Args:
        plant: with any number of switch times.
        reference: the wanted output, absolute.
        deviation: the reference as deviation from the output at which each interval is at rest, with breakpoints at the jumps and
            wherever decaying modes need them.
        end_anchors: states of the deviation at the ends of its pieces (m + 2, q).
        tolerance: share of each peak that counts as rest.
        max_preactuation, max_postactuation: longest preactuation and postactuation [s], or None: unlimited.
    """

    plant: SwitchedSystem
    reference: PiecewiseSignal
    deviation: PiecewiseSignal
    end_anchors: Array
    tolerance: float
    max_preactuation: float | None
    max_postactuation: float | None

    @classmethod
    def of(
        cls,
        model: Any,
        reference: PiecewiseSignal,
        *,
        tolerance: float = 1e-10,
        max_preactuation: float | None = None,
        max_postactuation: float | None = None,
    ) -> PlanningProblem:
        """The problem for a model (StateSpace, SwitchedSystem, or anything with A, B, C, D) and a reference in absolute units.

        Raises PlanError for options out of range, TrajectoryError for a reference that is none or has another number of channels.
        """
        require_share("tolerance", tolerance, error=PlanError)
        for name, limit in (("max_preactuation", max_preactuation), ("max_postactuation", max_postactuation)):
            if limit is not None and not real_number(name, limit, unit="s", error=PlanError) >= 0:
                raise PlanError(f"{name} must not be negative, got {limit}")
        plant = as_switched(model)
        require_reference(plant, reference)
        deviation = deviation_reference(plant, reference)
        return cls(plant, reference, deviation, deviation.end_anchors, tolerance, max_preactuation, max_postactuation)

    @property
    def manoeuvre(self) -> tuple[float, float]:
        """(T_i, T_f) [s]: the hull of the reference's breakpoints and of the plant's jumps."""
        return self.deviation.manoeuvre

    @cached_property
    def owner(self) -> Indices:
        """The interval of the plant in which each of the reference's m + 2 pieces lies."""
        return self.plant.interval(self.deviation.inner_times())

    @property
    def asks_for_motion(self) -> bool:
        """Whether the reference ever leaves the outputs at rest, or a jump the state at rest."""
        return bool(np.any(self.deviation.size(0) > AT_REST * self.reference.size(0)) or np.any(self.plant.shifts))

    def plan(
        self,
        method: str,
        trajectory: Trajectory,
        *,
        exact: bool | None,
        lasting: bool = False,
        remarks: Sequence[str] = (),
        certificate: Certificate | None = None,
        kind: type[PlanType] = Plan,  # type: ignore[assignment]
        **particulars: Any,
    ) -> PlanType:
        """The plan for a trajectory, with its ends and its certificate.

        Args:
            method: its name.
            trajectory: [x; u; y] as deviations from the rest of each interval.
            exact: whether y = y_d is one of its equations; None for what is no trajectory of the plant and is not to be judged.
            lasting: whether what is left after the manoeuvre is meant to ring on for ever; the plan then ends with the manoeuvre.
            remarks: what a user should know.
            certificate: of a trajectory that does not follow the plant's equations at all times, such as in between samples.
            kind: Plan, or a subclass that takes `particulars` besides.

        Raises PlanError where the plan misses its own equations.
        """
        start, end = self.manoeuvre
        preactuation, postactuation, limited = actuation_times(
            trajectory, (start, end), self.tolerance, (self.max_preactuation, None if lasting else self.max_postactuation)
        )
        postactuation = 0.0 if lasting else postactuation
        if not np.isfinite(preactuation + postactuation):
            raise PlanError(
                f"the plan by {method} does not come to rest: modes of it lie so close to the imaginary axis that rounding has put "
                "one on the side on which it does not die out; limit the preactuation and the postactuation (max_preactuation, "
                "max_postactuation), move such zeros (invtrack.modified_inversion), or damp what moves there"
            )
        if certificate is None:
            certificate = certify(self.plant, trajectory, self.deviation, (start - preactuation, end + postactuation))
        if exact is not None and self.asks_for_motion:
            certificate.require(exact=exact, method=method)
        plan = kind(
            method=method,
            model=self.plant,
            reference=self.reference,
            trajectory=trajectory,
            manoeuvre=self.manoeuvre,
            preactuation=preactuation,
            postactuation=postactuation,
            tolerance=self.tolerance,
            certificate=certificate,
            remarks=(*limited, *remarks, *left_out_of(self.plant)),
            **particulars,
        )
        rings = None if lasting else ringing(plan)
        return plan if rings is None else replace(plan, ringing=rings, remarks=(*plan.remarks, rings.remark))


def left_out_of(plant: SwitchedSystem) -> tuple[str, ...]:
    """A remark on what the plant's model leaves out and the plan therefore knows nothing of; none where that is nothing."""
    if not plant.left_out:
        return ()
    return (f"planned without what the linear model leaves out: {'; '.join(plant.left_out)}",)


def actuation_times(
    trajectory: Trajectory,
    manoeuvre: tuple[float, float],
    tolerance: float,
    limits: tuple[float | None, float | None] = (None, None),
) -> tuple[float, float, tuple[str, ...]]:
    """How long [s] a trajectory is away from rest before and after the manoeuvre, with remarks where `limits` [s] cut it short.

    What lies between the trajectory's breakpoints counts as away from rest throughout; peaks are those of the values there.
    """
    edges, remarks = trajectory.breakpoints, []
    outside = (manoeuvre[0] - float(edges[0]), float(edges[-1]) - manoeuvre[1])  # of the manoeuvre, though no part of a tail
    found = [
        away + tail.decay_time(trajectory.peaks, tolerance)
        for away, tail in zip(outside, (trajectory.before, trajectory.after), strict=True)
    ]
    if limits[0] is not None and found[0] > limits[0]:
        share = away_from_rest(trajectory, "before", manoeuvre[0] - limits[0])
        remarks.append(f"preactuation limited to {limits[0]} s: the plan starts {share:.1e} of its peak away from rest")
        found[0] = limits[0]
    if limits[1] is not None and found[1] > limits[1]:
        share = away_from_rest(trajectory, "after", manoeuvre[1] + limits[1])
        remarks.append(f"postactuation limited to {limits[1]} s: the plan ends {share:.1e} of its peak away from rest")
        found[1] = limits[1]
    return found[0], found[1], tuple(remarks)


def require_reference(plant: SwitchedSystem | StateSpace, reference: object) -> None:
    """Raises TrajectoryError unless `reference` is a signal with one channel per output of `plant`."""
    if not isinstance(reference, PiecewiseSignal):
        raise TrajectoryError(
            "expected a reference such as invtrack.rest_to_rest(0.0, 1.0, duration=2.0) or invtrack.sampled_reference(times, "
            f"values), got {type(reference).__name__}"
        )
    if reference.n_channels != plant.n_outputs:
        raise TrajectoryError(
            f"the reference has {reference.n_channels} channels, the plant {plant.n_outputs} outputs "
            f"{list(plant.outputs.names)}; stack one signal per output with invtrack.references.stack"
        )


def decay_stops(reference: PiecewiseSignal) -> Array:
    """Further breakpoints [s], none for references without decaying modes.

    The antistable internal dynamics are integrated backward over each piece together with the reference's generator w' = S w, whose
    stable modes grow in that direction: from a w that has all but decayed nothing of them could be recovered.
    """
    rates = np.array([max(0.0, -float(np.min(np.linalg.eigvals(g.S).real, initial=0.0))) for g in reference.generators])
    edges = reference.breakpoints
    decay = rates[reference.kind[1:-1]] * np.diff(edges)
    long = np.flatnonzero(decay > LARGEST_DECAY)
    stops = [np.linspace(edges[j], edges[j + 1], int(np.ceil(decay[j] / LARGEST_DECAY)) + 1)[1:-1] for j in long]
    return np.concatenate([np.zeros(0), *stops])


def deviation_reference(plant: SwitchedSystem, reference: PiecewiseSignal) -> PiecewiseSignal:
    """The reference as deviation from each interval's output at rest, with which a continuous one jumps.

    It has breakpoints at the jumps and wherever decaying modes need them.
    """
    y_0 = plant.rest_outputs
    deviation = reference
    if np.any(y_0 != y_0[0]):
        deviation = reference + steps(plant.switch_times, -y_0)
    elif np.any(y_0):
        deviation = reference + constant(-y_0[0], at=reference.manoeuvre[0])
    return deviation.refined([*plant.switch_times, *decay_stops(deviation)])


def steps(times: Array, values: Array) -> PiecewiseSignal:
    """Constant values (m + 1, p) before, between and after the times (m,) [s]."""
    generator = constant_generator(values.shape[1])
    return PiecewiseSignal(times, (generator,), np.zeros(len(values), dtype=np.intp), values)
