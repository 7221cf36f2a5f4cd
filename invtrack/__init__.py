"""Inversion-based output tracking of flexible, nonminimum-phase mechanisms, validated in MuJoCo.

    plant -> linearize -> invert -> TrackingController -> simulate -> metrics, figures, recording

Method: S. Devasia, "Guidance of Nonlinear Nonminimum-Phase Dynamic Systems", NASA report, 1996, and the papers in it.
"""

from invtrack.control.gains import GainSchedule, lqr, place
from invtrack.control.observer import KalmanFilter, LuenbergerObserver
from invtrack.control.output_feedback import OutputFeedbackController
from invtrack.control.tracking import TrackingController
from invtrack.errors import InvtrackError
from invtrack.evaluation.metrics import (
    max_error,
    metrics,
    peak_input,
    preactuation_time,
    residual_vibration,
    rms_error,
    state_vibration,
)
from invtrack.evaluation.run_cost import run_cost
from invtrack.inversion.feasibility import feasibility
from invtrack.inversion.stable import invert
from invtrack.inversion.static_reference import static_reference
from invtrack.lti.normal_form import normal_form, relative_degree
from invtrack.lti.state_space import Measurement, OperatingPoint, StateSpace
from invtrack.lti.switched import SwitchedSystem
from invtrack.lti.zero_dynamics import zeros
from invtrack.lti.zero_report import zero_report
from invtrack.physics.linearize import linearize
from invtrack.physics.model_files import model_path
from invtrack.physics.parameters import BodyMass, JointDamping, JointStiffness, TendonDamping, TendonStiffness
from invtrack.physics.plant import Plant
from invtrack.physics.variants import with_coupling_scaled, with_input_limits
from invtrack.recording.read import load_recording
from invtrack.recording.write import save_recording
from invtrack.redesign.constrained import constrained_redesign
from invtrack.redesign.cost import cost
from invtrack.redesign.limits import Limits, StateLimit
from invtrack.redesign.prefilter import prefilter
from invtrack.redesign.quadratic import quadratic_redesign
from invtrack.redesign.trade_off import pareto_sweep
from invtrack.runs.result import Event, RunResult, Signal
from invtrack.signals.export import export_plan
from invtrack.signals.nominal import Certificate, NominalTrajectory
from invtrack.signals.piecewise import PiecewiseSignal, stack
from invtrack.signals.plan_file import Plan, read_plan
from invtrack.signals.profiles import autonomous, constant, piecewise_polynomial, rest_to_rest, versine
from invtrack.signals.reference_report import reference_report
from invtrack.signals.sampled import load_reference, sampled_reference
from invtrack.simulation.closed_loop import simulate
from invtrack.simulation.linear_plant import LinearPlant
from invtrack.simulation.schedule import Change
from invtrack.simulation.sensors import Sensor

__all__ = [
    "BodyMass",
    "Certificate",
    "Change",
    "Event",
    "GainSchedule",
    "InvtrackError",
    "JointDamping",
    "JointStiffness",
    "KalmanFilter",
    "Limits",
    "LinearPlant",
    "LuenbergerObserver",
    "Measurement",
    "NominalTrajectory",
    "OperatingPoint",
    "OutputFeedbackController",
    "PiecewiseSignal",
    "Plan",
    "Plant",
    "RunResult",
    "Sensor",
    "Signal",
    "StateLimit",
    "StateSpace",
    "SwitchedSystem",
    "TendonDamping",
    "TendonStiffness",
    "TrackingController",
    "autonomous",
    "constant",
    "constrained_redesign",
    "cost",
    "export_plan",
    "feasibility",
    "invert",
    "linearize",
    "load_recording",
    "load_reference",
    "lqr",
    "max_error",
    "metrics",
    "model_path",
    "normal_form",
    "pareto_sweep",
    "peak_input",
    "piecewise_polynomial",
    "place",
    "preactuation_time",
    "prefilter",
    "quadratic_redesign",
    "read_plan",
    "reference_report",
    "relative_degree",
    "residual_vibration",
    "rest_to_rest",
    "rms_error",
    "run_cost",
    "sampled_reference",
    "save_recording",
    "simulate",
    "stack",
    "state_vibration",
    "static_reference",
    "versine",
    "with_coupling_scaled",
    "with_input_limits",
    "zero_report",
    "zeros",
]
