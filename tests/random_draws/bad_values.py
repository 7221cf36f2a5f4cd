"""What people hand over by mistake: one table, and which of it no argument should take without a word."""

from __future__ import annotations

import datetime
import decimal
import fractions
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import control
import numpy as np
import scipy.signal
import scipy.sparse

import invtrack
from invtrack.inversion.exact import invert

A, B, C, D = np.array([[0.0, 1.0], [-2.0, -3.0]]), np.array([[0.0], [1.0]]), np.array([[1.0, 1.0]]), np.zeros((1, 1))

BAD_VALUES: dict[str, Callable[[], Any]] = {
    "None": lambda: None,
    "text": lambda: "much",
    "empty text": lambda: "",
    "number as text": lambda: "1.0",
    "bytes": lambda: b"1.0",
    "NaN": lambda: float("nan"),
    "infinity": lambda: float("inf"),
    "minus infinity": lambda: float("-inf"),
    "minus one": lambda: -1.0,
    "zero": lambda: 0.0,
    "huge": lambda: 1e300,
    "tiny": lambda: 1e-300,
    "half": lambda: 0.5,
    "negative whole number": lambda: -1,
    "large whole number": lambda: 10**9,
    "larger than any float": lambda: 10**400,
    "without a text": lambda: 10**5000,
    "True": lambda: True,
    "complex": lambda: 1.0 + 1.0j,
    "Decimal": lambda: decimal.Decimal("1.5"),
    "Fraction": lambda: fractions.Fraction(3, 2),
    "date": lambda: datetime.datetime(2020, 1, 1),
    "object": object,
    "function": lambda: lambda *a, **k: 1.0,
    "function of nothing": lambda: lambda: None,
    "class": lambda: dict,
    "ellipsis": lambda: ...,
    "slice": lambda: slice(None),
    "path": lambda: Path("nowhere/at all"),
    "folder": lambda: Path(),
    "empty list": list,
    "empty dict": dict,
    "set": lambda: {1.0, 2.0},
    "dict": lambda: {"a": 1.0},
    "dict of numbers": lambda: {1: 2},
    "dict of None": lambda: {"a": None},
    "generator": lambda: (x for x in (1.0, 2.0)),
    "range": lambda: range(3),
    "list of None": lambda: [None],
    "list of text": lambda: ["a", "b"],
    "list of repeated text": lambda: ["a", "a"],
    "list of objects": lambda: [object()],
    "list of a number": lambda: [1.0],
    "ragged list": lambda: [[1.0], [1.0, 2.0]],
    "nested list": lambda: [[[1.0]]],
    "decreasing": lambda: [2.0, 1.0],
    "pair": lambda: (1.0, 2.0),
    "pair of NaN": lambda: (float("nan"), float("nan")),
    "pair of text": lambda: ("low", "high"),
    "empty array": lambda: np.zeros(0),
    "empty matrix": lambda: np.zeros((0, 0)),
    "matrix without columns": lambda: np.zeros((2, 0)),
    "zero matrix": lambda: np.zeros((2, 2)),
    "row": lambda: np.ones((1, 5)),
    "cube": lambda: np.zeros((2, 2, 2)),
    "zero-dimensional array": lambda: np.array(1.5),
    "NaN vector": lambda: np.full(2, np.nan),
    "NaN matrix": lambda: np.full((2, 2), np.nan),
    "infinite matrix": lambda: np.full((2, 2), np.inf),
    "huge matrix": lambda: np.full((2, 2), 1e300),
    "complex matrix": lambda: np.eye(2) * 1j,
    "indefinite matrix": lambda: np.diag([1.0, -1.0]),
    "whole-number matrix": lambda: np.eye(2, dtype=int),
    "boolean array": lambda: np.array([True, False]),
    "text array": lambda: np.array(["1.0", "2.0"]),
    "object array": lambda: np.array([None, object()], dtype=object),
    "date array": lambda: np.array(["2020-01-01"], dtype="datetime64[D]"),
    "structured array": lambda: np.zeros(2, dtype=[("a", float)]),
    "masked array": lambda: np.ma.masked_array(np.ones((2, 2)), mask=np.eye(2, dtype=bool)),
    "masked vector": lambda: np.ma.masked_array([1.0, 2.0], mask=[False, True]),
    "list of a masked vector": lambda: [np.ma.masked_array([1.0, 2.0], mask=[False, True])],
    "sparse matrix": lambda: scipy.sparse.csr_matrix(np.eye(2)),
    "python-control system": lambda: control.ss(A, B, C, D),
    "python-control transfer function": lambda: control.tf([1.0], [1.0, 1.0]),
    "scipy system": lambda: scipy.signal.StateSpace(A, B, C, D),
    "scipy transfer function": lambda: scipy.signal.TransferFunction([1.0], [1.0, 1.0]),
    "discrete system": lambda: control.ss(A, B, C, D, 0.1),
    "scipy discrete system": lambda: scipy.signal.StateSpace(A, B, C, D, dt=0.1),
    "descriptor system": lambda: SimpleNamespace(A=A, B=B, C=C, D=D, E=np.diag([1.0, 0.0])),
    "descriptor system of text": lambda: SimpleNamespace(A=A, B=B, C=C, D=D, E="singular"),
    "system of None": lambda: SimpleNamespace(A=None, B=None, C=None, D=None),
    "system of NaN": lambda: SimpleNamespace(A=A * np.nan, B=B, C=C, D=D),
    "system of masked arrays": lambda: SimpleNamespace(A=np.ma.masked_array(A, mask=A > 0), B=B, C=C, D=D),
    "system with odd time": lambda: SimpleNamespace(A=A, B=B, C=C, D=D, dt="fast"),
    "model": lambda: invtrack.StateSpace(A, B, C, D),
    "model class": lambda: invtrack.StateSpace,
    "model of five states": lambda: invtrack.StateSpace(-np.eye(5), np.eye(5)[:, :2], np.eye(5)[:2]),
    "list of models": lambda: [invtrack.StateSpace(A, B, C, D), invtrack.StateSpace(-np.eye(1), [[1.0]], [[1.0]])],
    "switched model": lambda: invtrack.SwitchedSystem([invtrack.StateSpace(A, B, C, D)] * 2, [0.5]),
    "signal": lambda: invtrack.rest_to_rest(0.0, 1.0, 1.0),
    "signal of three channels": lambda: invtrack.rest_to_rest(np.zeros(3), np.ones(3), 1.0),
    "plan": lambda: invert(invtrack.StateSpace(A, B, C, D), invtrack.rest_to_rest(0.0, 1.0, 1.0)),
    "channels": lambda: invtrack.Channels(["a", "b"]),
    "limits": lambda: invtrack.Limits(input=1.0),
    "change": lambda: invtrack.Change(1.0, mass=2.0),
    "sensor": lambda: invtrack.Sensor(noise=1.0),
}

FUNCTIONS = {
    *("function", "function of nothing", "class", "model class"),
    *("python-control system", "python-control transfer function", "discrete system"),
}
"""What can be called; where a function is expected, an exception that it raises is its own."""

NEVER_RIGHT = {
    "NaN",
    "complex",
    "object",
    "date",
    "ellipsis",
    "slice",
    "list of objects",
    "ragged list",
    "NaN vector",
    "NaN matrix",
    "complex matrix",
    "object array",
    "date array",
    "structured array",
    "masked array",
    "masked vector",
    "list of a masked vector",
    "descriptor system",
    "system of NaN",
    "system of masked arrays",
    "discrete system",
}
"""To be refused wherever they stand, but for the few arguments that take them."""
