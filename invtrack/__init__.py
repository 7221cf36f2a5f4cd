"""Inversion-based output tracking of flexible, nonminimum-phase mechanisms, validated in MuJoCo.

    plant -> linearize -> invert -> TrackingController -> simulate -> metrics, figures, recording

Method: S. Devasia, "Guidance of Nonlinear Nonminimum-Phase Dynamic Systems", NASA report, 1996, and the papers in it.
"""

from invtrack.control.exosystem_law import ExosystemController
from invtrack.control.exosystem_observer import ExosystemObserver
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
from invtrack.inversion.causal import causal_inverse
from invtrack.inversion.exosystem_map import exosystem_map
from invtrack.inversion.feasibility import feasibility
from invtrack.inversion.francis_map import single_francis, switched_francis
from invtrack.inversion.modified import modified_inversion
from invtrack.inversion.regulator import francis
from invtrack.inversion.stable import invert
from invtrack.inversion.static_reference import static_reference
from invtrack.inversion.trade_off import plan_for, preactuation_trade_off
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
from invtrack.signals.exosystem import Exosystem, exosystem
from invtrack.signals.exosystem_families import (
    polynomial_exosystem,
    sinusoidal_exosystem,
    stack_exosystems,
    step_exosystem,
    sum_exosystems,
)
from invtrack.signals.export import export_plan
from invtrack.signals.nominal import Certificate, NominalTrajectory
from invtrack.signals.piecewise import PiecewiseSignal, stack
from invtrack.signals.plan_file import Plan, read_plan
from invtrack.signals.preactuation import preactuation_at, preactuation_bound
from invtrack.signals.profiles import autonomous, constant, piecewise_polynomial, rest_to_rest, versine
from invtrack.signals.reference_report import reference_report
from invtrack.signals.regulation import RegulationMap
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
    "Exosystem",
    "ExosystemController",
    "ExosystemObserver",
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
    "RegulationMap",
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
    "causal_inverse",
    "constant",
    "constrained_redesign",
    "cost",
    "exosystem",
    "exosystem_map",
    "export_plan",
    "feasibility",
    "francis",
    "invert",
    "linearize",
    "load_recording",
    "load_reference",
    "lqr",
    "max_error",
    "metrics",
    "model_path",
    "modified_inversion",
    "normal_form",
    "pareto_sweep",
    "peak_input",
    "piecewise_polynomial",
    "place",
    "plan_for",
    "polynomial_exosystem",
    "preactuation_at",
    "preactuation_bound",
    "preactuation_time",
    "preactuation_trade_off",
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
    "single_francis",
    "sinusoidal_exosystem",
    "stack",
    "stack_exosystems",
    "state_vibration",
    "static_reference",
    "step_exosystem",
    "sum_exosystems",
    "switched_francis",
    "versine",
    "with_coupling_scaled",
    "with_input_limits",
    "zero_report",
    "zeros",
]
