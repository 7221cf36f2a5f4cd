"""Plans, which every method returns: their values, certificate, preactuation and export."""

from invtrack.plans.certificate import Certificate
from invtrack.plans.export import export_plan, read_plan, sampled_plan
from invtrack.plans.plan import Plan, Samples
from invtrack.plans.plan_file import SampledPlan
from invtrack.plans.preactuation import PreactuationBound, preactuation_bound

__all__ = [
    "Certificate",
    "Plan",
    "PreactuationBound",
    "SampledPlan",
    "Samples",
    "export_plan",
    "preactuation_bound",
    "read_plan",
    "sampled_plan",
]
