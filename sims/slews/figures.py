"""The classic curves: vibration over the error of the frequency; and the beam's zeros over the place of the output."""

from __future__ import annotations

from collections.abc import Sequence
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


def frequency_figure(curves: dict[str, Sequence[float]]) -> Any:
    """Residual vibration over the beam's frequencies."""
    return sweep_figure(
        "Vibration left where the beam's frequencies are not those planned for, payload known and constant",
        label="frequencies, real over planned",
        values=FREQUENCIES,
        predicted={},
        measured={name: [1e3 * value for value in values] for name, values in curves.items()},
        quantity="residual vibration [mm]",
    )


def zeros_figure() -> Any:
    """1 / zero^2 of the undamped beam over the place of the output: it passes through 0 where a pair goes through infinity."""
    beam = Beam(segments=BEAM.segments, damping=0.0)
    plant = invtrack.Plant.from_xml(beam.mjcf(), inputs=["force"], outputs=beam.station_outputs)
    places = np.linspace(0.0, beam.length, PLACES)
    found = linear.zeros_along(invtrack.linearize(plant), beam.stations, places)
    squares = [np.sort((1 / values[np.imag(values) + 1e-9 * np.real(values) > 0] ** 2).real) for values in found.zeros]
    pairs = min(map(len, squares))
    curves = {f"{name} pair": [1e4 * value for value in column] for name, column in _extremes(squares, pairs).items()}
    return sweep_figure(
        "Zeros from the base's force to a place along the beam: below 0 an oscillation, above it +-a",
        label="place along the beam [m]",
        values=places.tolist(),
        predicted=curves,
        measured={},
        quantity="1 / zero^2 [1e-4 s^2/rad^2]",
    )


def _extremes(squares: Sequence[Any], pairs: int) -> dict[str, list[float]]:
    """The slowest oscillating and real pairs."""
    names = {"slowest oscillating": lambda s: min(s[0], 0.0), "slowest real": lambda s: max(s[-1], 0.0)}
    return {name: [float(pick(values)) for values in squares] for name, pick in names.items()} if pairs else {}
