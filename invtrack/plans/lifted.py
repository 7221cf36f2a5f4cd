"""A plan made on a reduced model, in the states of the full one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from invtrack.arguments import instance
from invtrack.errors import PlanError
from invtrack.linear.reduction import Reduction
from invtrack.plans.certificate import certify
from invtrack.plans.plan import Plan, require_plan
from invtrack.plans.problem import PlanningProblem


def lifted(plan: Plan, reduction: Reduction) -> Plan:
    """The plan with the states x_ref = V z_ref + N u of the full model, to be followed on the full plant.

    Input, output, preactuation and postactuation are those of the plan. What is approximate: the input also moves what was cut,
    which x_ref knows nothing of (or, with residual stiffness, only as if it followed at once), so the full model driven by the
    input is off the planned output by the share that `reduction.lost` bounds within the band.
    `certificate.dynamics_residual` says by how much the states miss the full model's equations. Follow it with
    `invtrack.control.lifted_gains`, which look at z = W x alone: they do not fight what was cut for not being in the plan.

    plan: made for `reduction.reduced`. reduction: as `modal_truncation` and `balanced_truncation` make it. Raises PlanError for
    other things, and a plan for another model.
    """
    require_plan(plan)
    expected = "a Reduction, such as invtrack.linear.modal_truncation(model, band=30.0)"
    instance("reduction", reduction, Reduction, expected=expected, error=PlanError)
    small, full = reduction.reduced, reduction.full
    same = len(plan.model) == len(small) and all(
        np.array_equal(getattr(a, name), getattr(b, name))
        for a, b in zip(plan.model.systems, small.systems, strict=True)
        for name in ("A", "B", "C", "D")
    )
    if not same:
        raise PlanError(
            f"the plan by {plan.method} was made for another model than this reduction's; make it for reduction.reduced"
        )
    n, k, m, p = full.n_states, small.n_states, full.n_inputs, full.n_outputs
    M = np.zeros((n + m + p, k + m + p))
    M[:n, :k], M[:n, k : k + m] = reduction.V, reduction.N
    M[n:, k:] = np.eye(m + p)
    trajectory = plan.trajectory.mapped(M)
    problem = PlanningProblem.of(full, plan.reference, tolerance=plan.tolerance)
    certificate = certify(full, trajectory, problem.deviation, (plan.start, plan.end))
    remark = (
        f"planned on {k} of {n} states ({reduction.method}): the full model's output is off by up to {reduction.lost:.2g} of it"
        f" at each frequency up to {reduction.band:.4g} rad/s"
    )
    return replace(plan, model=full, trajectory=trajectory, certificate=certificate, remarks=(remark, *plan.remarks))
