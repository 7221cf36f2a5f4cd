"""Linear models for other libraries: deviations from the operating point, with the matrices as they are."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np

from invtrack.errors import ModelError
from invtrack.linear.state_space import as_state_space


def to_scipy(system: Any) -> Any:
    """The model as a scipy.signal.StateSpace, in deviations from its operating point and rest; names and units are left behind.

    system: StateSpace, or anything with A, B, C, D. Raises ModelError for a malformed model.
    """
    import scipy.signal  # nobody else needs it

    model = as_state_space(system)
    return scipy.signal.StateSpace(*(np.array(matrix) for matrix in (model.A, model.B, model.C, model.D)))


def to_control(system: Any) -> Any:
    """The model as a StateSpace of python-control, in deviations from its operating point and rest, with the names of its channels.

    system: StateSpace, or anything with A, B, C, D. Raises ModelError for a malformed model, and where python-control is not
    installed.
    """
    model = as_state_space(system)
    try:
        control = importlib.import_module("control")  # by its name, which one of our rooms has, too
    except ImportError as error:
        raise ModelError("a model for python-control needs that library, which is not installed: pip install control") from error
    matrices = (np.array(matrix) for matrix in (model.A, model.B, model.C, model.D))
    names = {kind: list(getattr(model, kind).names) for kind in ("states", "inputs", "outputs")}
    return control.ss(*matrices, **names)
