"""Wanted outputs: profiles, splines through samples, exosystems, and a report of what a reference asks for."""

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
from invtrack.references.reference_file import load_reference
from invtrack.references.reference_report import ReferenceReport, reference_report
from invtrack.references.s_curve import s_curve
from invtrack.references.samples import sampled_reference
from invtrack.references.signal import PiecewiseSignal, stack
from invtrack.references.smoothing import smoothed_reference

__all__ = [
    "Exosystem",
    "PiecewiseSignal",
    "ReferenceReport",
    "autonomous",
    "constant",
    "exosystem",
    "load_reference",
    "piecewise_polynomial",
    "polynomial_exosystem",
    "raised_cosine",
    "reference_report",
    "rest_to_rest",
    "s_curve",
    "sampled_reference",
    "sinusoidal_exosystem",
    "smoothed_reference",
    "stack",
    "stack_exosystems",
    "step_exosystem",
    "sum_exosystems",
]
