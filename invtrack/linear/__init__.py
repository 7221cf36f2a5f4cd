"""Linear models: state-space systems that may switch, their normal form, and their invariant zeros."""

from invtrack.linear.exchange import to_control, to_scipy
from invtrack.linear.internal_dynamics import format_zeros
from invtrack.linear.normal_form import NormalForm, normal_form, relative_degree
from invtrack.linear.oscillation import slowest_flexible_period
from invtrack.linear.state_space import Measurement, OperatingPoint, StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.linear.without_hidden_modes import without_hidden_modes
from invtrack.linear.zeros import Zero, ZeroReport, zero_report, zeros

__all__ = [
    "Measurement",
    "NormalForm",
    "OperatingPoint",
    "StateSpace",
    "SwitchedSystem",
    "Zero",
    "ZeroReport",
    "format_zeros",
    "normal_form",
    "relative_degree",
    "slowest_flexible_period",
    "to_control",
    "to_scipy",
    "without_hidden_modes",
    "zero_report",
    "zeros",
]
