"""Every public function and method of references, each argument in turn replaced with what it cannot take: only our errors come."""

from __future__ import annotations

import contextlib
import datetime
import decimal
import fractions
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from invtrack.errors import InvtrackError
from invtrack.references import (
    Exosystem,
    PiecewiseSignal,
    autonomous,
    constant,
    exosystem,
    load_reference,
    piecewise_polynomial,
    polynomial_exosystem,
    raised_cosine,
    reference_report,
    rest_to_rest,
    sampled_reference,
    sinusoidal_exosystem,
    stack,
    stack_exosystems,
    step_exosystem,
    sum_exosystems,
)
from invtrack.references.generator import Generator, constant_generator

MOVE, PAIR = rest_to_rest(0.0, 1.0, 2.0), rest_to_rest([0.0, 1.0], [1.0, -1.0], 2.0, smoothness=5)
WAVE = autonomous([[0.0, 3.0], [-3.0, 0.0]], [[1.0, 0.0]], [0.0, 1.0], start=0.0, end=2.0)
SWITCHED = exosystem([[0.0, 1.0], [-1.0, 0.5]], [[1.0, 0.0]], start=0.0, end=2.0)

NEVER_RIGHT: dict[str, Any] = {
    "NaN": float("nan"),
    "infinity": float("inf"),
    "text": "much",
    "bytes": b"1.0",
    "True": True,
    "complex": 1.0 + 1.0j,
    "Decimal": decimal.Decimal("1.5"),
    "Fraction": fractions.Fraction(3, 2),
    "date": datetime.date(2020, 1, 1),
    "object": object(),
    "function": abs,
    "class": dict,
    "ellipsis": ...,
    "slice": slice(None),
    "dict": {"a": 1.0},
    "set": {1.0, 2.0},
    "larger than any float": 10**400,
    "list of None": [None, None],
    "ragged list": [[1.0], [1.0, 2.0]],
    "cube": np.zeros((2, 2, 2)),
    "vector of NaN": np.full(2, np.nan),
    "matrix of NaN": np.full((2, 2), np.nan),
    "matrix of infinity": np.full((2, 2), np.inf),
    "complex matrix": 1j * np.eye(2),
    "boolean array": np.array([True, False]),
    "text array": np.array(["1.0", "2.0"]),
    "object array": np.array([None, 1.0], dtype=object),
    "date array": np.array(["2020-01-01"], dtype="datetime64[D]"),
    "structured array": np.zeros(2, dtype=[("a", float)]),
    "masked vector": np.ma.masked_array([1.0, 2.0], mask=[False, True]),
    "masked matrix": np.ma.masked_array(np.eye(2), mask=np.eye(2) > 0),
    "masked": np.ma.masked,
}
"""No argument takes these, but for those named in TAKEN."""

SOMETIMES_RIGHT: dict[str, Any] = {
    "None": None,
    "empty list": [],
    "empty array": np.zeros(0),
    "empty matrix": np.zeros((0, 2)),
    "matrix without columns": np.zeros((2, 0)),
    "minus one": -1,
    "zero": 0,
    "half": 0.5,
    "huge": 1e300,
    "largest": np.finfo(float).max,
    "tiny": 1e-300,
    "smallest": 5e-324,
    "huge matrix": np.full((2, 2), 1e300),
    "huge vector": np.array([1e300, 1.1e300]),
    "large whole number": 10**9,
    "zero-dimensional array": np.array(1.5),
    "numpy number": np.float64(0.25),
    "numpy whole number": np.int64(3),
    "decreasing": [2.0, 1.0],
    "repeated": [1.0, 1.0],
    "vector": [0.25, 0.5],
    "vector of three": [0.25, 0.5, 0.75],
    "matrix": np.eye(2),
    "row": np.ones((1, 5)),
    "list of text": ["a", "b"],
    "repeated text": ["a", "a"],
    "signal": MOVE,
    "signal of two channels": PAIR,
    "list of signals": [MOVE, PAIR],
    "exosystem": SWITCHED,
    "path": Path("nowhere/at all"),
    "generator of numbers": (x for x in (1.0, 2.0)),
}
"""Right for one argument and wrong for another: either a result or one of our errors, and no warning."""


def signal_of(breakpoints: Any, generators: Any, kind: Any, anchors: Any) -> PiecewiseSignal:
    return PiecewiseSignal(breakpoints, generators, kind, anchors)


CALLS: dict[str, tuple[Callable[..., Any], dict[str, Any]]] = {
    "rest_to_rest": (rest_to_rest, {"start": 0.0, "end": 1.0, "duration": 2.0, "smoothness": 2, "start_time": 0.0}),
    "piecewise_polynomial": (
        piecewise_polynomial,
        {"breakpoints": [0.0, 1.0], "coefficients": [[1.0, 2.0]], "basis": "power", "time_scale": 1.0, "held": (1.0, 3.0)},
    ),
    "Bezier curves": (
        lambda **options: piecewise_polynomial(**options, basis="bernstein"),
        {"breakpoints": [0.0, 1.0], "coefficients": [np.ones((1, 12))], "held": (1.0, 3.0)},
    ),
    "autonomous": (autonomous, {"S": np.eye(2), "R": [[1.0, 0.0]], "w_0": [0.0, 1.0], "start": 0.0, "end": 1.0}),
    "raised_cosine": (raised_cosine, {"peak": 1.0, "period": 2.0, "cycles": 1, "start_time": 0.0}),
    "constant": (constant, {"value": 1.0, "at": 0.0}),
    "sampled_reference": (
        sampled_reference,
        {"times": np.arange(5.0), "values": np.arange(5.0) ** 2, "degree": 5, "smoothness": 1},
    ),
    "reference_report": (reference_report, {"reference": MOVE, "highest": 3, "channels": ["y"]}),
    "stack": (stack, {"signals": [MOVE, PAIR]}),
    "Generator": (Generator, {"S": np.eye(2), "R": [[1.0, 0.0]]}),
    "PiecewiseSignal": (
        signal_of,
        {"breakpoints": [0.0], "generators": [constant_generator(1)], "kind": [0, 0], "anchors": [[0.0], [1.0]]},
    ),
    "a value": (WAVE, {"t": [0.0, 0.5], "derivative": 1, "inside": [0.25, 0.5]}),
    "a value of a polynomial": (PAIR, {"t": 0.5, "derivative": 1, "inside": 0.5}),
    "locate": (MOVE.locate, {"t": [0.0, 1.0]}),
    "jumps": (WAVE.jumps, {"order": 1}),
    "size": (WAVE.size, {"order": 1}),
    "smoothness": (WAVE.smoothness, {"channel": 0, "highest": 3}),
    "shifted": (PAIR.shifted, {"delay": 1.0}),
    "scaled": (PAIR.scaled, {"gain": [1.0, 2.0]}),
    "refined": (PAIR.refined, {"times": [0.5]}),
    "sum": (lambda other: PAIR + other, {"other": PAIR}),
    "sum from the left": (lambda other: PAIR.__radd__(other), {"other": 1.0}),
    "difference": (lambda other: PAIR - other, {"other": PAIR}),
    "difference from the left": (lambda other: PAIR.__rsub__(other), {"other": 1.0}),
    "product": (lambda gain: PAIR * gain, {"gain": 2.0}),
    "quotient": (lambda divisor: PAIR / divisor, {"divisor": 2.0}),
    "Exosystem": (
        Exosystem,
        {"A": [np.eye(1)] * 2, "C": [np.eye(1)] * 2, "switch_times": [1.0], "names": ["a"]},
    ),
    "exosystem": (
        exosystem,
        {"A_e": np.eye(2), "C_e": [1.0, 0.0], "start": 0.0, "end": 1.0, "outside": "held", "names": ["a", "b"]},
    ),
    "sinusoidal_exosystem": (
        sinusoidal_exosystem,
        {"frequencies": [1.0, 2.0], "bias": True, "start": 0.0, "end": 1.0, "outside": "zero"},
    ),
    "polynomial_exosystem": (polynomial_exosystem, {"degree": 2, "start": 0.0, "end": 1.0, "outside": "zero"}),
    "step_exosystem": (step_exosystem, {"start": 0.0, "end": 1.0, "outside": "zero"}),
    "sum_exosystems": (sum_exosystems, {"parts": [SWITCHED, SWITCHED]}),
    "stack_exosystems": (stack_exosystems, {"parts": [SWITCHED, SWITCHED]}),
    "reference": (SWITCHED.reference, {"x_e": [1.0, 0.0], "at": 0.5}),
    "states": (SWITCHED.states, {"x_e": [1.0, 0.0], "at": 0.5, "t": [0.0, 1.0], "inside": [0.0, 1.0]}),
    "transition": (SWITCHED.transition, {"start": -1.0, "end": 3.0}),
    "interval": (SWITCHED.interval, {"t": [0.0, 1.0]}),
    "resampled": (SWITCHED.resampled, {"switch_times": [0.0, 1.0, 2.0]}),
    "transformed": (SWITCHED.transformed, {"T": np.diag([1.0, 2.0]), "names": ["a", "b"]}),
    "weighted": (SWITCHED.weighted, {"weights": [1.0, 2.0]}),
    "shifted exosystem": (SWITCHED.shifted, {"delay": 1.0}),
}

TAKEN = {
    ("sinusoidal_exosystem", "bias", "True"),
    ("locate", "t", "infinity"),
    ("locate", "t", "matrix of infinity"),
    ("locate", "t", "cube"),
    ("interval", "t", "infinity"),
    ("interval", "t", "matrix of infinity"),
    ("interval", "t", "cube"),
    ("smoothness", "highest", "larger than any float"),
    ("exosystem", "names", "text array"),
    ("transformed", "names", "text array"),
}
"""What is right for an argument after all: times without end lie in a piece as well."""


@pytest.mark.parametrize("name", CALLS)
def test_only_our_errors_come(name: str) -> None:
    call, arguments = CALLS[name]
    call(**arguments)
    for argument in arguments:
        for kind, value in NEVER_RIGHT.items():
            if (name, argument, kind) in TAKEN:
                call(**{**arguments, argument: value})
                continue
            with pytest.raises(InvtrackError):
                pytest.fail(f"{name}: {argument} takes {kind}: {call(**{**arguments, argument: value})!r}")
        for value in SOMETIMES_RIGHT.values():
            with contextlib.suppress(InvtrackError):
                call(**{**arguments, argument: value})


def test_files_too(tmp_path: Path) -> None:
    path = tmp_path / "motion.csv"
    path.write_text("time,tip\n" + "".join(f"{t},{t * t}\n" for t in range(6)), encoding="utf-8")
    arguments = {"path": path, "time": "time", "channels": ["tip"], "degree": 5, "smoothness": 1}
    load_reference(**arguments)
    for argument in arguments:
        for kind, value in NEVER_RIGHT.items():
            if (argument, kind) != ("path", "text"):
                with pytest.raises(InvtrackError):
                    pytest.fail(f"{argument} takes {kind}: {load_reference(**{**arguments, argument: value})!r}")
        for value in SOMETIMES_RIGHT.values():
            with contextlib.suppress(InvtrackError):
                load_reference(**{**arguments, argument: value})
