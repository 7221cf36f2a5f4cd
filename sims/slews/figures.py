"""The classic curves: vibration over the error of the frequency; and the beam's zeros over the place of the output."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from slews.measures import tried
from slews.methods import BEAM, INVERSE, PROFILE, REDESIGN, ROBUST, Slew

import invtrack
from invtrack import linear
from invtrack.figures import sweep_figure
from invtrack.mechanisms import Beam

CURVES = (PROFILE, "ZV", "ZVD", "EI", "two-hump EI", INVERSE, REDESIGN, ROBUST)
FREQUENCIES = (0.7, 0.8, 0.9, 0.95, 1.0, 1.05, 1.1, 1.2, 1.3)  # of the real beam, of those planned for
PLACES = 61


def over_frequency(slew: Slew, method: str, *, timestep: float) -> list[float]:
    """Residual vibration [m] of a slew with constant payload, the beam's frequencies off by known factors."""
    controller = slew.controller(method)
    errors = [{"stiffness": factor**2 - 1} for factor in FREQUENCIES]
    return [tried(slew, controller, timestep=timestep, error=error)["residual_vibration"] for error in errors]


def frequency_figure(curves: Mapping[str, Sequence[float]]) -> Any:
    """Residual vibration over the beam's frequencies."""
    return sweep_figure(
        "Vibration left where the beam's frequencies are others than planned",
        label="frequencies, real over planned",
        values=FREQUENCIES,
        predicted={},
        measured={name: [1e3 * value for value in values] for name, values in curves.items()},
        quantity="residual vibration [mm]",
    )


def zeros_figure() -> Any:
    """Time constants of the undamped beam's slowest zeros over the place of the output, those of oscillations below zero."""
    beam = Beam(segments=BEAM.segments, damping=0.0)
    plant = invtrack.Plant.from_xml(beam.mjcf(), inputs=["force"], outputs=beam.station_outputs)
    places = np.linspace(0.0, beam.length, PLACES)
    found = linear.zeros_along(invtrack.linearize(plant), beam.stations, places)
    squares = [np.real(1 / values**2) for values in found.zeros]  # -1 / w^2 of a pair +-jw, 1 / a^2 of a pair +-a
    return sweep_figure(
        "Slowest zeros from the base's force to a place along the beam",
        label="place along the beam [m]",
        values=places.tolist(),
        predicted={
            "oscillation +-jw, -1/w": [-1e3 * np.sqrt(-min(np.min(each), 0.0)) for each in squares],
            "real pair +-a, 1/a": [1e3 * np.sqrt(max(np.max(each), 0.0)) for each in squares],
        },
        measured={},
        quantity="time constant [ms]",
    )
