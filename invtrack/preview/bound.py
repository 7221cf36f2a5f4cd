"""How far a loop around a plan with preview can miss the output, over all references with bounded y^(r)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arguments import instance
from invtrack.arrays import Array, whole_number
from invtrack.control.gains import GainSchedule
from invtrack.errors import PlanError, TrajectoryError
from invtrack.preview.closed_loop import Loop, gains_by_interval
from invtrack.preview.kernel import Kernel
from invtrack.preview.planner import PreviewPlanner
from invtrack.preview.worst_reference import WorstReference, worst_reference
from invtrack.references.signal import PiecewiseSignal, require_signal


@dataclass(frozen=True, eq=False)
class PreviewBound:
    """|y_i - wanted_i| <= sum over j of gain[i, j] max |y_d,j^(r_j)|, at all times, for every reference from rest.

    For inversion what is wanted is y_d, for redesign the output of the plan that knows the whole reference. The gain falls with the
    preview T as exp(-alpha T), alpha [rad/s] the slowest antistable zero of the plant, of a redesign its slowest closed-loop pole:
    gain = constant exp(-alpha T). Nothing smaller holds for all references: `worst_reference` attains it.

    Args:
        method: of the planner.
        preview, period: of the planner [s].
        orders: r_j of each output (p,).
        alpha: see above; infinite where nothing lies ahead.
        gain: (p, p).
        state_change, input_change: most by which all that is not known at an instant can change x_ref (n,) and u (m,) there, for
            |y_d,j^(r_j)| <= 1.
        worst: of each output, the reference with |y_d,j^(r_j)| <= 1 that misses most, and when.
    """

    method: str
    preview: float
    period: float
    orders: tuple[int, ...]
    alpha: float
    gain: Array
    state_change: Array
    input_change: Array
    worst: Sequence[WorstReference]

    def __repr__(self) -> str:
        largest = ", ".join(f"{value:.3g}" for value in self.output)
        return f"<bound of {self.method}, {self.preview:g} s ahead: {largest} for |y^(r)| <= 1, alpha = {self.alpha:.4g} rad/s>"

    @property
    def output(self) -> Array:
        """Largest error of each output (p,) for |y_d,j^(r_j)| <= 1, in its unit."""
        return np.asarray(self.gain.sum(axis=1))

    @property
    def constant(self) -> Array:
        """`output` = constant exp(-alpha preview) (p,)."""
        return np.asarray(self.output * math.exp(self.alpha * self.preview)) if math.isfinite(self.alpha) else self.output

    def of(self, reference: PiecewiseSignal) -> Array:
        """Largest error of each output (p,) for a reference, from the sizes of its derivatives alone.

        Raises TrajectoryError for what is no reference with as many channels.
        """
        require_signal("reference", reference)
        if reference.n_channels != len(self.orders):
            raise TrajectoryError(
                f"the reference has {reference.n_channels} channels, expected one for each of {len(self.orders)} outputs"
            )
        rates = np.array([reference.size(order)[j] for j, order in enumerate(self.orders)])
        return np.asarray(self.gain @ rates)

    def worst_reference(self, output: int = 0) -> WorstReference:
        """The reference, from rest to rest, with |y_d,j^(r_j)| <= 1 for which the error of an output comes up to the bound.

        Raises PlanError for an output that is not there.
        """
        return self.worst[whole_number("output", output, highest=len(self.orders) - 1, error=PlanError)]


def preview_bound(planner: PreviewPlanner, gains: GainSchedule | ArrayLike | None = None) -> PreviewBound:
    """How far a loop that follows a planner misses the output at most, over all references with |y_d^(r)| <= 1.

    Inversion: u = u_ff - K (x - x_ref). What is new at update k, which knows y_d^(r) up to t_k + T_p, moves x_ref by
    V W_u dz_u, dz_u = -integral of e^(-A_u (s - t_k)) G chi(s) over what is new; the loop A - B K takes it in. The largest error is
    the L1 norm of that kernel,

        max over t of sum over k of integral of |C e^((A - B K)(t - t_k)) V W_u e^(-A_u (s - t_k)) G| ds,

    through jumps of the plant with what they make of its parts. Redesign: the plan is a motion of the plant, and what is bounded
    is its distance from the optimum that knows everything; besides what the optimum does ahead of what is known counts.

    Args:
        planner: of `inversion_planner` or `redesign_planner`; what it has been told does not matter.
        gains: K (m, n) or a GainSchedule that switches where the plant does; for inversion only, which needs them.

    Raises PlanError where the loop is not stable, for gains that are missing or not needed, for a redesign on a plant that
    switches, and where the period is too short beside the loop's memory; ControlError for gains that do not fit.
    """
    instance("planner", planner, PreviewPlanner, expected="a planner of inversion_planner or redesign_planner", error=PlanError)
    law = planner.law
    if law.keeps_state:
        if gains is not None:
            raise PlanError("a redesign with preview is a motion of the plant, whatever the gains around it; leave gains out")
        if len(law.plant.switch_times):
            raise PlanError("the bound of a redesign is for plants that do not switch; compare with invtrack.quadratic_redesign")
        loop = Loop.of_optimum(law)
    else:
        if gains is None:
            raise PlanError("the bound of an inversion depends on the loop around it, which takes in what is new; state gains")
        loop = Loop.of_feedback(law, gains_by_interval(law, gains))
    kernel = Kernel(law, loop, planner.time, planner.period, planner.preview)
    found = [kernel.largest(i) for i in range(law.plant.n_outputs)]
    change = kernel.changes()
    n, m = law.plant.n_states, law.plant.n_inputs
    return PreviewBound(
        method=law.method,
        preview=planner.preview,
        period=planner.period,
        orders=law.chain.orders,
        alpha=kernel.alpha,
        gain=np.array([missed.gain for missed in found]),
        state_change=change[:n],
        input_change=change[n : n + m],
        worst=[worst_reference(law.chain, missed) for missed in found],
    )
