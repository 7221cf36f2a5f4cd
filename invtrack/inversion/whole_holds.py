"""What plans for a zero-order hold have in common: whole holds from start to end, and what they say of themselves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from invtrack.plans.certificate import Certificate
from invtrack.plans.problem import PlanType

SPARE = 1e-9
"""A time that is longer than whole holds by no more than this share of one is as long as these."""


def in_whole_holds(plan: PlanType, hold: float) -> PlanType:
    """The plan with whole holds [s] before the manoeuvre and after it, so that those of a run are its own."""
    before, after = (hold * float(np.ceil(time / hold - SPARE)) for time in (plan.preactuation, plan.postactuation))
    return replace(plan, preactuation=before, postactuation=after)


def held_remark(hold: float, certificate: Certificate) -> str:
    """What a user should know of a plan for holds [s]: the certificate's output error is what is left between its points."""
    return (
        f"planned for a zero-order hold of {hold:g} s: inputs are constant over each, with which the outputs stay within "
        f"{certificate.output_error:.1e} of their motion"
    )
