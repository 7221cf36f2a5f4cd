"""The smallest study there is: an oscillator, moved by one unit in one second."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

import invtrack
from invtrack.studies import Case, Column, Setup, Study, StudyOptions, Table

COLUMNS = [Column("max error"), Column("peak input")]


def oscillator() -> invtrack.StateSpace:
    return invtrack.StateSpace([[0.0, 1.0], [-40.0, -0.4]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]])


def controller(gain: float = 0.0) -> invtrack.TrackingController:
    """Exact inversion with state feedback; a negative gain is the wrong sign."""
    model = oscillator()
    plan = invtrack.invert(model, invtrack.rest_to_rest(0.0, 1.0, duration=1.0))
    return invtrack.TrackingController(plan, invtrack.GainSchedule((np.array([[gain, gain]]),), np.zeros(0)))


def case(name: str, law: Any = None, **options: Any) -> Case:
    settings = {"end": 6.0, **options.pop("settings", {})}
    return Case(name, invtrack.LinearPlant(oscillator()), law or controller(), settings=settings, **options)


def diverging(name: str = "diverging") -> Case:
    """A gain of the wrong sign, so large that the state overflows in a few steps."""
    return case(name, controller(gain=-1e9), settings={"evaluate": "stages"})


def study(build: Callable[[StudyOptions], Setup] | None = None, **parts: Any) -> Study[StudyOptions]:
    """A study named tiny with these parts of a setup, a table among them."""

    def setup(options: StudyOptions) -> Setup:
        return Setup(**{"cases": [case("first"), case("second")], "report": [Table("Oscillator", COLUMNS)], **parts})

    return Study("tiny", build or setup, description="What it claims.", defaults=StudyOptions(timestep=0.02))
