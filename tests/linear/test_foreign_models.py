"""Whatever has A, B, C, D is a model: every function that takes one gives for it what it gives for the StateSpace."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import control
import numpy as np
import pytest
import scipy.signal

from invtrack.control import lqr, place
from invtrack.errors import ModelError
from invtrack.inversion import (
    causal_inverse,
    feasibility,
    invert,
    modified_inversion,
    preactuation_trade_off,
    steady_state_feedforward,
    tune_modified_inversion,
)
from invtrack.linear import StateSpace, SwitchedSystem, normal_form, relative_degree, zero_report, zeros
from invtrack.redesign import Limits, constrained_redesign, pareto_sweep, prefilter, quadratic_redesign
from invtrack.references import raised_cosine, rest_to_rest, sinusoidal_exosystem
from invtrack.regulation import exosystem_map, francis, single_francis, switched_francis
from invtrack.simulation import LinearPlant

# A damped oscillator with a lag beside it, seen with an unstable zero.
A = np.array([[0.0, 1.0, 0.0], [-2.0, -0.6, 0.5], [0.3, 0.0, -1.0]])
B = np.array([[0.0], [1.0], [0.0]])
C = np.array([[2.0, -1.0, 0.3]])
D = np.zeros((1, 1))

REFERENCE = rest_to_rest(0.0, 1.0, duration=4.0)
THERE_AND_BACK = raised_cosine(1.0, period=4.0)
TIMES = np.linspace(-3.0, 8.0, 23)
WEIGHTS = {"R": 1.0, "Q_y": 10.0}
MODIFIED = {"axis_distance": 100.0, "error_poles": [-3.0]}
SWAY = sinusoidal_exosystem([1.0], start=0.0, end=2 * np.pi)


def inputs(plan: Any) -> Any:
    return plan.inputs(TIMES)


METHODS: dict[str, Callable[[Any], Any]] = {
    "zeros": zeros,
    "relative_degree": relative_degree,
    "normal_form": lambda model: normal_form(model).A_x,
    "zero_report": lambda model: str(zero_report(model)),
    "feasibility": lambda model: str(feasibility(model, REFERENCE)),
    "invert": lambda model: inputs(invert(model, REFERENCE)),
    "modified_inversion": lambda model: inputs(modified_inversion(model, REFERENCE, real_part=4.0, **MODIFIED)),
    "tune_modified_inversion": lambda model: inputs(tune_modified_inversion(model, REFERENCE, preactuation=1.5, **MODIFIED)),
    "preactuation_trade_off": lambda model: str(preactuation_trade_off(model, REFERENCE, real_parts=[3.0, 4.0], **MODIFIED)),
    "causal_inverse": lambda model: inputs(causal_inverse(minimum_phase(model), REFERENCE)),
    "steady_state_feedforward": lambda model: inputs(steady_state_feedforward(model, REFERENCE)),
    "quadratic_redesign": lambda model: inputs(quadratic_redesign(model, THERE_AND_BACK, **WEIGHTS)),
    "constrained_redesign": lambda model: inputs(constrained_redesign(model, THERE_AND_BACK, **WEIGHTS, limits=Limits(input=50.0))),
    "pareto_sweep": lambda model: pareto_sweep(model, THERE_AND_BACK, weights=[WEIGHTS]).values("max_error"),
    "prefilter": lambda model: prefilter(model, **WEIGHTS).frequency_response(np.array([0.5, 2.0])).G_f,
    "exosystem_map": lambda model: exosystem_map(model, SWAY).admissible,
    "francis": lambda model: francis(model, SWAY.A[1], SWAY.C[1]).Pi,
    "switched_francis": lambda model: switched_francis(model, SWAY).admissible,
    "single_francis": lambda model: single_francis(model, SWAY).admissible,
    "lqr": lambda model: lqr(model, Q=1.0, R=1.0).gains[0],
    "place": lambda model: place(model, [-1.0, -2.0, -3.0]).gains[0],
    "SwitchedSystem": lambda model: SwitchedSystem([model]).systems[0].A,
    "LinearPlant": lambda model: LinearPlant(model).model.systems[0].A,
}


def minimum_phase(model: Any) -> Any:
    """A model of the same kind whose output has no unstable zero."""
    flipped = np.array([[2.0, 1.0, 0.3]])
    return type(model)(model.A, model.B, flipped, model.D) if not isinstance(model, SimpleNamespace) else bare(flipped)


def bare(output: Any = C) -> SimpleNamespace:
    return SimpleNamespace(A=A, B=B, C=output, D=D)


@pytest.mark.parametrize("name", METHODS)
def test_any_kind_of_model_gives_the_same(name: str) -> None:
    kinds = {"control": control.ss(A, B, C, D), "scipy": scipy.signal.StateSpace(A, B, C, D), "bare": bare()}
    expected = METHODS[name](StateSpace(A, B, C, D))
    for kind, model in kinds.items():
        got = METHODS[name](model)
        if isinstance(expected, str):
            assert got == expected, kind
        else:
            np.testing.assert_array_equal(got, expected, err_msg=kind)


@pytest.mark.parametrize("function", [zeros, relative_degree, normal_form, zero_report])
@pytest.mark.parametrize(
    ("model", "message"),
    [
        (control.tf([1.0], [1.0, 1.0]), "TransferFunction has no A, B, C, D"),
        (control.ss(A, B, C, D, 0.1), "sampling time 0.1; convert it to continuous time"),
        (SwitchedSystem([StateSpace(A, B, C, D)]), "SwitchedSystem has no A, B, C, D"),
    ],
)
def test_what_is_no_model_is_refused_with_the_reason(function: Callable[[Any], Any], model: Any, message: str) -> None:
    with pytest.raises(ModelError, match=message):
        function(model)
