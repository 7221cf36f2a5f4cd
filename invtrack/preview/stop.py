"""Stop now: the quadratic redesign from the state that a planner has reached, or that was measured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arguments import instance
from invtrack.arrays import Array, real_vector
from invtrack.errors import PlanError
from invtrack.linear.propagation import Propagator
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.plan import Plan
from invtrack.plans.problem import PlanningProblem
from invtrack.plans.tail import Tail
from invtrack.plans.two_sided_problem import Pieces, two_sided_trajectory
from invtrack.preview.law import PreviewLaw
from invtrack.preview.output_chain import held_outputs
from invtrack.preview.planner import PreviewPlanner
from invtrack.preview.redesign import redesign_law
from invtrack.references.generator import constant_generator
from invtrack.references.profiles import constant

METHOD = "stop"


def stop(
    planner: PreviewPlanner,
    *,
    R: ArrayLike,
    Q_x: ArrayLike = 0.0,
    Q_y: ArrayLike,
    at: ArrayLike | None = None,
    state: ArrayLike | None = None,
    tolerance: float = 1e-10,
) -> Plan:
    """The plan of least cost that brings the plant to rest from where it is at `planner.time`, whatever was planned before.

    It minimises the integral from now on of (u - u0)'R (u - u0) + x'Q_x x + (y - y_s)'Q_y (y - y_s), through the jumps to come, for
    the outputs y_s at which it is to stop. Nothing is known ahead and nothing acts ahead; before now, where the plan does not
    matter, it is the free motion that leads to the present state. Where holding y_s costs input for ever, the outputs come to rest
    at the best compromise.

    Args:
        planner: of `inversion_planner` or `redesign_planner`; it may go on with updates as if nothing had been asked.
        R, Q_x, Q_y: weights as for `quadratic_redesign`.
        at: y_s (p,), absolute; where the plan is now unless stated.
        state: x (n,) now, as deviation from the operating point's x0; the planned one unless stated.
        tolerance: as for `invert`.

    Raises PlanError for a state or outputs that do not fit, RedesignError as `quadratic_redesign` does.
    """
    instance("planner", planner, PreviewPlanner, expected="a planner of inversion_planner or redesign_planner", error=PlanError)
    whole, time, present = planner.law.plant, planner.time, planner.present()
    now = int(whole.interval(time))
    plant = SwitchedSystem(whole.systems[now:], whole.switch_times[now:])
    x = present.x[0] if state is None else real_vector("state", state, list(plant.states.names), error=PlanError)
    y_s = present.y[0] if at is None else held_outputs("at", at, plant)
    problem = PlanningProblem.of(plant, constant(y_s, at=time), tolerance=tolerance)
    law = redesign_law(plant, R=R, Q_x=Q_x, Q_y=Q_y)
    pieces, z_f, z_b = _motion(law, x, y_s, time, planner.period)
    trajectory = two_sided_trajectory(pieces, z_f[:-1], z_b, np.zeros(z_b.shape[1]), z_f[-1])
    return problem.plan(METHOD, replace(trajectory, before=_free_motion(plant, x - plant.systems[0].rest)), exact=False)


def _motion(law: PreviewLaw, x: Array, y_s: Array, time: float, period: float) -> tuple[Pieces, Array, Array]:
    """Pieces from now on, z_f at their starts and at the end, and z_b at their ends, in the method's own coordinates."""
    zeta = np.append(law.chain.at_rest(y_s), 1.0)
    edges = [time, *law.plant.switch_times.tolist()]
    edges.append(edges[-1] + period)
    z_f = law.forward_state(0, law.slope(0, time), x, law.phi_of(0, time) @ zeta, zeta[:-1])
    still = constant_generator(len(y_s))
    starts, ends = [], []
    for k, each in enumerate(law.intervals):
        steady = law.chain.at_rest(y_s) - each.rest
        starts.append(z_f + each.Pi_f @ steady)
        z_f = each.decays(edges[k + 1] - edges[k])[0] @ z_f
        last = k == len(law.intervals) - 1
        z_b = np.zeros(len(each.G_b)) if last else law.junctions[k].ahead @ z_f + law.junctions[k].held @ zeta
        ends.append(z_b + each.Pi_b @ steady)
        if not last:
            z_f = law.junctions[k].forward @ np.concatenate([z_f, z_b, zeta])
    starts.append(z_f + each.Pi_f @ steady)
    which = [*range(len(law.intervals))]
    w = np.array([y_s - each.plant.operating_point.y0 for each in law.intervals])[[0, *which, -1]]
    driven = [each.driven_by(still) for each in law.intervals]
    return Pieces(np.array(edges), driven, np.array([0, *which, which[-1]]), w, w), np.array(starts), np.array(ends)


def _free_motion(plant: SwitchedSystem, x: Array) -> Tail:
    """The motion with the input at rest that leads to a state (n,), as deviation from rest."""
    system = plant.systems[0]
    none = Propagator(np.zeros((0, 0)))
    rows = np.vstack([np.eye(plant.n_states), np.zeros((plant.n_inputs, plant.n_states)), system.C])
    return Tail(-1, none, np.zeros((len(rows), 0)), np.zeros(0), system.A, rows, x)
