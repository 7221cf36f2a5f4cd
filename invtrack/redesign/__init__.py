"""Output redesign: the motion that trades tracking for input and vibration, also within hard limits."""

from invtrack.redesign.constrained import constrained_redesign
from invtrack.redesign.constrained_trajectory import ConstrainedTrajectory
from invtrack.redesign.cost import cost
from invtrack.redesign.limited.active_limits import ActiveLimit, ActiveStretch
from invtrack.redesign.limited.optimality import Optimality
from invtrack.redesign.limits import Limits, StateLimit
from invtrack.redesign.nonlinear.gauss_newton import GaussNewtonStep
from invtrack.redesign.nonlinear.limited_redesign import ConstrainedMotion
from invtrack.redesign.nonlinear.motion_redesign import OptimalMotion
from invtrack.redesign.optimal_trajectory import OptimalTrajectory
from invtrack.redesign.pareto import Outcome, TradeOff, outcome, pareto_sweep
from invtrack.redesign.prefilter.frequency_response import FrequencyResponse
from invtrack.redesign.prefilter.prefilter import ImpulseResponse, Prefilter, PrefilteredTrajectory, prefilter
from invtrack.redesign.quadratic import quadratic_redesign

__all__ = [
    "ActiveLimit",
    "ActiveStretch",
    "ConstrainedMotion",
    "ConstrainedTrajectory",
    "FrequencyResponse",
    "GaussNewtonStep",
    "ImpulseResponse",
    "Limits",
    "OptimalMotion",
    "OptimalTrajectory",
    "Optimality",
    "Outcome",
    "Prefilter",
    "PrefilteredTrajectory",
    "StateLimit",
    "TradeOff",
    "constrained_redesign",
    "cost",
    "outcome",
    "pareto_sweep",
    "prefilter",
    "quadratic_redesign",
]
