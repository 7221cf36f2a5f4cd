"""Plans, which every method returns: their values, certificate, preactuation, and what samples them and reads them back."""

from invtrack.plans.certificate import Certificate, certify
from invtrack.plans.dynamics import Derivatives, Dynamics, Mechanism, mechanism
from invtrack.plans.export import export_plan, read_plan, sampled_plan
from invtrack.plans.lifted import lifted
from invtrack.plans.linearizations import Linearizations
from invtrack.plans.plan import Plan, Samples
from invtrack.plans.preactuation import PreactuationBound, preactuation_bound
from invtrack.plans.ringing import Ringing
from invtrack.plans.sampled import SampledPlan
from invtrack.plans.tail import Tail
from invtrack.plans.trajectory import PolynomialSegments, Trajectory, TwoSidedSegments

__all__ = [
    "Certificate",
    "Derivatives",
    "Dynamics",
    "Linearizations",
    "Mechanism",
    "Plan",
    "PolynomialSegments",
    "PreactuationBound",
    "Ringing",
    "SampledPlan",
    "Samples",
    "Tail",
    "Trajectory",
    "TwoSidedSegments",
    "certify",
    "export_plan",
    "lifted",
    "mechanism",
    "preactuation_bound",
    "read_plan",
    "sampled_plan",
]
