"""Where numbers come from: the command that made them, versions, and what a plan says of itself."""

from __future__ import annotations

import platform
import shlex
import sys
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from invtrack.plans.plan import Plan

LIBRARIES = ("invtrack", "mujoco", "numpy", "scipy", "numba", "rerun-sdk")


def made_by() -> dict[str, Any]:
    """The command line of this process, to repeat it, and the versions of what it ran on."""
    words = list(sys.orig_argv[1:])
    script = bool(words) and Path(words[0]).suffix != ".py" and Path(words[0]).is_file()  # an installed program
    command = [Path(words[0]).name, *words[1:]] if script else ["python", *words]
    versions = {name: version(name) for name in LIBRARIES}
    return {"command": shlex.join(command), "versions": {"Python": platform.python_version(), **versions}}


def plan_in_words(plan: Plan) -> dict[str, Any]:
    """What a plan says of itself: method, manoeuvre and what lies around it [s], lowest and highest inputs, certificate, remarks.

    None where a number is not finite.
    """
    ranges = zip(plan.model.inputs.names, *plan.input_range, strict=True)
    return {
        "method": plan.method,
        "manoeuvre": [_finite(time) for time in plan.manoeuvre],
        "preactuation": _finite(plan.preactuation),
        "postactuation": _finite(plan.postactuation),
        "input_range": {name: [_finite(low), _finite(high)] for name, low, high in ranges},
        "certificate": {name: _finite(value) for name, value in asdict(plan.certificate).items()},
        "remarks": [*plan.remarks],
    }


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
