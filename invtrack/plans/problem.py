"""What every method starts from and ends with: a plant, a reference, options; and the plan with its ends and its certificate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from invtrack.arrays import Array, Indices, real_number, require_share
from invtrack.errors import PlanError, TrajectoryError
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem, as_switched
from invtrack.plans.certificate import certify
from invtrack.plans.plan import Plan
from invtrack.plans.trajectory import Trajectory
from invtrack.references.profiles import constant
from invtrack.references.signal import PiecewiseSignal

PlanType = TypeVar("PlanType", bound=Plan)

LARGEST_DECAY = 3.0
"""Time constants that a mode of the reference may decay over within one piece: backward, its rounding errors grow by e^3."""

AT_REST = 1e-12
"""A reference that departs from the operating point by no more than this share of its values asks for no motion."""

SAMPLES = 2000
"""Points over the manoeuvre at which the peaks of a trajectory are looked for, beside its breakpoints."""


@dataclass(frozen=True, eq=False)
class PlanningProblem:
    """A plant, a reference and what counts as rest, checked to fit each other.

    Args:
        plant: with any number of switch times.
        reference: the wanted output, absolute.
        deviation: the reference as deviation from the operating point, with breakpoints at the jumps and wherever decaying modes
            need them.
        end_anchors: states of the deviation at the ends of its pieces (m + 2, q).
        tolerance: share of each peak that counts as rest.
        max_preactuation: longest preactuation [s], or None: unlimited.
    """

    plant: SwitchedSystem
    reference: PiecewiseSignal
    deviation: PiecewiseSignal
    end_anchors: Array
    tolerance: float
    max_preactuation: float | None

    @classmethod
    def of(
        cls, model: Any, reference: PiecewiseSignal, *, tolerance: float = 1e-10, max_preactuation: float | None = None
    ) -> PlanningProblem:
        """The problem for a model (StateSpace, SwitchedSystem, or anything with A, B, C, D) and a reference in absolute units.

        Raises PlanError for options out of range, TrajectoryError for a reference that is none or has another number of channels.
        """
        require_share("tolerance", tolerance, error=PlanError)
        if max_preactuation is not None and not real_number("max_preactuation", max_preactuation, unit="s", error=PlanError) >= 0:
            raise PlanError(f"max_preactuation must not be negative, got {max_preactuation}")
        plant = as_switched(model)
        require_reference(plant, reference)
        deviation = deviation_reference(plant, reference)
        return cls(plant, reference, deviation, deviation.end_anchors(), tolerance, max_preactuation)

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
        """Whether the reference ever leaves the operating point."""
        return bool(np.any(self.deviation.size(0) > AT_REST * self.reference.size(0)))

    def plan(
        self,
        method: str,
        trajectory: Trajectory,
        *,
        exact: bool | None,
        lasting: bool = False,
        remarks: Sequence[str] = (),
        kind: type[PlanType] = Plan,  # type: ignore[assignment]
        **particulars: Any,
    ) -> PlanType:
        """The plan for a trajectory, with its ends and its certificate.

        Args:
            method: its name.
            trajectory: [x; u; y] as deviations from the operating point.
            exact: whether y = y_d is one of its equations; None for what is no trajectory of the plant and is not to be judged.
            lasting: whether what is left after the manoeuvre is meant to ring on for ever; the plan then ends with the manoeuvre.
            remarks: what a user should know.
            kind: Plan, or a subclass that takes `particulars` besides.

        Raises PlanError where the plan misses its own equations.
        """
        start, end = self.manoeuvre
        preactuation, postactuation, limited = actuation_times(trajectory, (start, end), self.tolerance, self.max_preactuation)
        postactuation = 0.0 if lasting else postactuation
        certificate = certify(self.plant, trajectory, self.deviation, (start - preactuation, end + postactuation))
        if exact is not None and self.asks_for_motion:
            certificate.require(exact=exact, method=method)
        return kind(
            method=method,
            model=self.plant,
            reference=self.reference,
            trajectory=trajectory,
            manoeuvre=self.manoeuvre,
            preactuation=preactuation,
            postactuation=postactuation,
            tolerance=self.tolerance,
            certificate=certificate,
            remarks=(*limited, *remarks),
            **particulars,
        )


def actuation_times(
    trajectory: Trajectory, manoeuvre: tuple[float, float], tolerance: float, limit: float | None = None
) -> tuple[float, float, tuple[str, ...]]:
    """How long [s] a trajectory is away from rest before and after the manoeuvre, and a remark where `limit` [s] cuts it short.

    What lies between the trajectory's breakpoints counts as away from rest throughout; peaks are those of the values there.
    """
    edges = trajectory.breakpoints
    even = np.linspace(edges[0], edges[-1], SAMPLES + 1)
    # Apart, so that the even ones stay recognizable as such.
    peak = np.max([np.max(np.abs(trajectory(times, trajectory.locate(times))), axis=0) for times in (even, edges)], axis=0)
    preactuation = manoeuvre[0] - float(edges[0]) + trajectory.before.decay_time(peak, tolerance)
    postactuation = float(edges[-1]) - manoeuvre[1] + trajectory.after.decay_time(peak, tolerance)
    if limit is None or preactuation <= limit:
        return preactuation, postactuation, ()
    distance = float(edges[0]) - (manoeuvre[0] - limit)
    if distance >= 0:
        share = float(trajectory.before.shares(np.array([distance]), peak)[0])
    else:
        at = edges[:1] - distance
        away = np.abs(trajectory(at, trajectory.locate(at))[0] - trajectory.before.held)
        share = float(np.max(away / np.where(peak > 0, peak, 1.0)))
    return limit, postactuation, (f"preactuation limited to {limit} s: the plan starts {share:.1e} of its peak away from rest",)


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
    """The reference as deviation from the operating point, with breakpoints at the jumps and wherever decaying modes need them."""
    y_0 = plant.operating_point.y0
    deviation = reference + constant(-y_0, at=reference.manoeuvre[0]) if np.any(y_0) else reference
    return deviation.refined([*plant.switch_times, *decay_stops(deviation)])
