"""Linear models: state-space systems that may switch, their normal form, their invariant zeros, and models of fewer states."""

from invtrack.linear.balanced_truncation import balanced_truncation
from invtrack.linear.exchange import to_control, to_scipy
from invtrack.linear.internal_dynamics import format_zeros
from invtrack.linear.modal_truncation import modal_truncation
from invtrack.linear.normal_form import NormalForm, normal_form, relative_degree
from invtrack.linear.oscillation import slowest_flexible_period
from invtrack.linear.reduction import Reduction
from invtrack.linear.state_space import Measurement, OperatingPoint, StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.linear.without_hidden_modes import without_hidden_modes
from invtrack.linear.zeros import Zero, ZeroReport, zero_report, zeros
from invtrack.linear.zeros_along import ZerosAlong, zeros_along

__all__ = [
    "Measurement",
    "NormalForm",
    "OperatingPoint",
    "Reduction",
    "StateSpace",
    "SwitchedSystem",
    "Zero",
    "ZeroReport",
    "ZerosAlong",
    "balanced_truncation",
    "format_zeros",
    "modal_truncation",
    "normal_form",
    "relative_degree",
    "slowest_flexible_period",
    "to_control",
    "to_scipy",
    "without_hidden_modes",
    "zero_report",
    "zeros",
    "zeros_along",
]
