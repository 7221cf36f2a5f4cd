"""Exact, modified and causal inversion, steady-state feedforward, and whether a reference can be followed."""

from invtrack.inversion.exact import invert
from invtrack.inversion.feasibility import feasibility
from invtrack.inversion.feasibility_report import BoundaryConditions, FeasibilityReport, IntervalReport, JumpReport
from invtrack.inversion.modified.design_problem import Candidate
from invtrack.inversion.modified.error_bound import error_bound
from invtrack.inversion.modified.modified_inversion import Modification, ModifiedTrajectory, modified_inversion
from invtrack.inversion.modified.modified_motion import ModifiedMotion
from invtrack.inversion.modified.modified_plan import ModifiedPlan
from invtrack.inversion.modified.preactuation_trade_off import preactuation_trade_off, tune_modified_inversion
from invtrack.inversion.modified.trade_off import TradeOff, TradeOffPoint
from invtrack.inversion.no_preactuation import causal_inverse, steady_state_feedforward
from invtrack.inversion.nonlinear.certificate import MotionChecks
from invtrack.inversion.nonlinear.newton import Iteration
from invtrack.inversion.nonlinear.stable_inversion import MotionPlan

__all__ = [
    "BoundaryConditions",
    "Candidate",
    "FeasibilityReport",
    "IntervalReport",
    "Iteration",
    "JumpReport",
    "Modification",
    "ModifiedMotion",
    "ModifiedPlan",
    "ModifiedTrajectory",
    "MotionChecks",
    "MotionPlan",
    "TradeOff",
    "TradeOffPoint",
    "causal_inverse",
    "error_bound",
    "feasibility",
    "invert",
    "modified_inversion",
    "preactuation_trade_off",
    "steady_state_feedforward",
    "tune_modified_inversion",
]
