"""Inversion-based output tracking of flexible, nonminimum-phase mechanisms, validated in MuJoCo.

    plant -> linearize -> invert -> TrackingController -> simulate -> metrics, figures, recording

Method: S. Devasia, "Guidance of Nonlinear Nonminimum-Phase Dynamic Systems", NASA report, 1996, and the papers in it.
"""

from invtrack.channels import Channels
from invtrack.control.exosystem_controller import ExosystemController
from invtrack.control.exosystem_observer import ExosystemObserver
from invtrack.control.gains import GainSchedule, lqr, place
from invtrack.control.observer import KalmanFilter, LuenbergerObserver
from invtrack.control.output_feedback import OutputFeedbackController
from invtrack.control.tracking_controller import TrackingController
from invtrack.errors import InvtrackError
from invtrack.inversion.causal import causal_inverse
from invtrack.inversion.exact import invert
from invtrack.inversion.feasibility import feasibility
from invtrack.inversion.modified.modified_inversion import modified_inversion
from invtrack.inversion.modified.preactuation_trade_off import preactuation_trade_off, tune_modified_inversion
from invtrack.inversion.steady_state import steady_state_feedforward
from invtrack.linear.internal_dynamics import zeros
from invtrack.linear.normal_form import normal_form, relative_degree
from invtrack.linear.state_space import Measurement, OperatingPoint, StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.linear.zeros import zero_report
from invtrack.plans.export import export_plan
from invtrack.plans.plan import Certificate, Plan
from invtrack.plans.plan_file import SampledPlan, read_plan
from invtrack.plans.preactuation import preactuation_bound
from invtrack.plant.change import Change
from invtrack.plant.linearize import linearize
from invtrack.plant.loading import model_path
from invtrack.plant.parameters import BodyMass, JointDamping, JointStiffness, TendonDamping, TendonStiffness
from invtrack.plant.plant import Plant
from invtrack.plant.variants import with_coupling_scaled, with_input_limits
from invtrack.recording.read import load_recording
from invtrack.recording.write import save_recording
from invtrack.redesign.constrained import constrained_redesign
from invtrack.redesign.cost import cost
from invtrack.redesign.limits import Limits, StateLimit
from invtrack.redesign.pareto import pareto_sweep
from invtrack.redesign.prefilter.prefilter import prefilter
from invtrack.redesign.quadratic import quadratic_redesign
from invtrack.references.exosystem import (
    Exosystem,
    exosystem,
    polynomial_exosystem,
    sinusoidal_exosystem,
    stack_exosystems,
    step_exosystem,
    sum_exosystems,
)
from invtrack.references.profiles import autonomous, constant, piecewise_polynomial, raised_cosine, rest_to_rest
from invtrack.references.reference_report import reference_report
from invtrack.references.samples import load_reference, sampled_reference
from invtrack.references.signal import PiecewiseSignal, stack
from invtrack.regulation.exosystem_map import exosystem_map
from invtrack.regulation.francis import francis
from invtrack.regulation.francis_map import single_francis, switched_francis
from invtrack.regulation.regulation_map import RegulationMap
from invtrack.results.metrics import (
    max_error,
    metrics,
    peak_input,
    preactuation_time,
    residual_vibration,
    rms_error,
    state_vibration,
)
from invtrack.results.result import Event, RunResult, Signal
from invtrack.results.run_cost import run_cost
from invtrack.simulation.closed_loop import simulate
from invtrack.simulation.linear_plant import LinearPlant
from invtrack.simulation.sensors import Sensor

__all__ = [
    "BodyMass",
    "Certificate",
    "Change",
    "Channels",
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
    "OperatingPoint",
    "OutputFeedbackController",
    "PiecewiseSignal",
    "Plan",
    "Plant",
    "RegulationMap",
    "RunResult",
    "SampledPlan",
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
    "polynomial_exosystem",
    "preactuation_bound",
    "preactuation_time",
    "preactuation_trade_off",
    "prefilter",
    "quadratic_redesign",
    "raised_cosine",
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
    "steady_state_feedforward",
    "step_exosystem",
    "sum_exosystems",
    "switched_francis",
    "tune_modified_inversion",
    "with_coupling_scaled",
    "with_input_limits",
    "zero_report",
    "zeros",
]
