"""Inversion-based output tracking of flexible, nonminimum-phase mechanisms, validated in MuJoCo.

    plant -> linearize -> invert -> TrackingController -> simulate -> metrics, figures, recording

Here stand the names that most programs need; each room holds more: `invtrack.plant`, `linear`, `mechanisms`, `references`, `plans`,
`inversion`, `redesign`, `preview`, `regulation`, `baselines`, `learning`, `control`, `simulation`, `results`, `recording`,
`figures`, `advice`, `report`, `studies`, `sweeps`, `testing`, `command`.

Method: S. Devasia, "Guidance of Nonlinear Nonminimum-Phase Dynamic Systems", NASA report, 1996, and the papers in it.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from invtrack.errors import InvtrackError

if TYPE_CHECKING:  # what __getattr__ does, for type checkers and editors
    from invtrack import advice as advice
    from invtrack import baselines as baselines
    from invtrack import command as command
    from invtrack import control as control
    from invtrack import figures as figures
    from invtrack import inversion as inversion
    from invtrack import learning as learning
    from invtrack import linear as linear
    from invtrack import mechanisms as mechanisms
    from invtrack import plans as plans
    from invtrack import plant as plant
    from invtrack import preview as preview
    from invtrack import recording as recording
    from invtrack import redesign as redesign
    from invtrack import references as references
    from invtrack import regulation as regulation
    from invtrack import report as report
    from invtrack import results as results
    from invtrack import simulation as simulation
    from invtrack import studies as studies
    from invtrack import sweeps as sweeps
    from invtrack import testing as testing
    from invtrack.advice import Move, advise
    from invtrack.channels import Channels
    from invtrack.control import (
        ExosystemController,
        GainSchedule,
        KalmanFilter,
        LuenbergerObserver,
        OutputFeedbackController,
        TrackingController,
        bryson,
        lqr,
        place,
    )
    from invtrack.inversion import causal_inverse, invert, modified_inversion
    from invtrack.learning import iterate
    from invtrack.linear import StateSpace, SwitchedSystem
    from invtrack.plans import Plan, export_plan, read_plan
    from invtrack.plant import (
        Change,
        Plant,
        linearize,
        model_path,
        trim,
    )
    from invtrack.recording import load_recording, save_recording
    from invtrack.redesign import Limits, StateLimit, constrained_redesign, quadratic_redesign
    from invtrack.references import PiecewiseSignal, load_reference, raised_cosine, rest_to_rest, sampled_reference
    from invtrack.regulation import exosystem_map
    from invtrack.results import RunResult, max_error, metrics, read_log, residual_vibration
    from invtrack.simulation import LinearPlant, Sensor, simulate

__all__ = [
    "Change",
    "Channels",
    "ExosystemController",
    "GainSchedule",
    "InvtrackError",
    "KalmanFilter",
    "Limits",
    "LinearPlant",
    "LuenbergerObserver",
    "Move",
    "OutputFeedbackController",
    "PiecewiseSignal",
    "Plan",
    "Plant",
    "RunResult",
    "Sensor",
    "StateLimit",
    "StateSpace",
    "SwitchedSystem",
    "TrackingController",
    "advise",
    "bryson",
    "causal_inverse",
    "constrained_redesign",
    "exosystem_map",
    "export_plan",
    "invert",
    "iterate",
    "linearize",
    "load_recording",
    "load_reference",
    "lqr",
    "max_error",
    "metrics",
    "model_path",
    "modified_inversion",
    "place",
    "quadratic_redesign",
    "raised_cosine",
    "read_log",
    "read_plan",
    "residual_vibration",
    "rest_to_rest",
    "sampled_reference",
    "save_recording",
    "simulate",
    "trim",
]

# A room is loaded when it, or a name of it, is first used (PEP 562): who plans waits for neither MuJoCo nor Rerun nor matplotlib,
# and pytest, which imports the plugin in `invtrack.testing` wherever this package is installed, not even for NumPy.
_ROOMS: dict[str, tuple[str, ...]] = {
    "plant": (
        "Change",
        "Plant",
        "linearize",
        "model_path",
        "trim",
    ),
    "linear": ("StateSpace", "SwitchedSystem"),
    "references": ("PiecewiseSignal", "load_reference", "raised_cosine", "rest_to_rest", "sampled_reference"),
    "plans": ("Plan", "export_plan", "read_plan"),
    "inversion": ("causal_inverse", "invert", "modified_inversion"),
    "redesign": ("Limits", "StateLimit", "constrained_redesign", "quadratic_redesign"),
    "preview": (),
    "regulation": ("exosystem_map",),
    "control": (
        "ExosystemController",
        "GainSchedule",
        "KalmanFilter",
        "LuenbergerObserver",
        "OutputFeedbackController",
        "TrackingController",
        "bryson",
        "lqr",
        "place",
    ),
    "baselines": (),
    "mechanisms": (),
    "simulation": ("LinearPlant", "Sensor", "simulate"),
    "results": ("RunResult", "max_error", "metrics", "read_log", "residual_vibration"),
    "learning": ("iterate",),
    "recording": ("load_recording", "save_recording"),
    "figures": (),
    "advice": ("Move", "advise"),
    "report": (),
    "sweeps": (),
    "studies": (),
    "command": (),
    "testing": (),
}
_FILES: dict[str, tuple[str, ...]] = {"channels": ("Channels",)}


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version  # reads a file

        return version(__name__)
    for room, names in {**_ROOMS, **_FILES}.items():
        if name == room or name in names:
            module = importlib.import_module(f"{__name__}.{room}")
            globals()[name] = value = module if name == room else getattr(module, name)
            return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *_ROOMS, *__all__})
