"""Zeros over the place at which an output is measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arrays import Array, ComplexArray, real_numbers, real_vector
from invtrack.errors import ModelError
from invtrack.linear.normal_form import normal_form
from invtrack.linear.state_space import OperatingPoint, StateSpace, as_state_space
from invtrack.linear.zeros import zeros


@dataclass(frozen=True, eq=False)
class ZerosAlong:
    """Zeros of an output over its place.

    Args:
        places: where the output is (k,), in the unit in which the stations were given.
        zeros: of each place, as many as are finite [rad/s].
        through_infinity: places at which a pair of zeros goes through infinity: those of an oscillation on the one side come back
            real on the other, one of them to the right of the axis.
    """

    places: Array
    zeros: tuple[ComplexArray, ...]
    through_infinity: Array


def zeros_along(model: Any, stations: ArrayLike, places: ArrayLike) -> ZerosAlong:
    """The zeros from one input to an output that is moved along a structure, such as a beam.

    Between two stations the output is their linear interpolation; on a chain of rigid segments with a station at each joint this is
    exact. The gain C A^(r-1) B by which the input enters, r the lowest relative degree of all stations, is then linear between
    them, too, and where it changes its sign r of the zeros go through infinity (for r = 2 and little damping +-jw on the one side,
    +-a on the other).

    Args:
        model: StateSpace, or anything with A, B, C, D, with one input, and one output for each station.
        stations: where the outputs are (p,), increasing.
        places: where the output is to be looked at (k,), within the stations.

    Raises ModelError for more than one input, stations that do not fit the outputs or increase, and places beyond them;
    RelativeDegreeError where the input reaches no output. Source: D. Miu, "Physical interpretation of transfer function zeros for
    simple control systems with mechanical flexibilities", ASME Journal of Dynamic Systems, Measurement, and Control 113(3), 1991.
    """
    plant = as_state_space(model)
    if plant.n_inputs != 1:
        raise ModelError(f"zeros along a structure are those of one input, got {plant.n_inputs}; choose one with with_inputs")
    at = real_vector("stations", stations, plant.outputs.names, error=ModelError)
    if np.any(np.diff(at) <= 0):
        raise ModelError(f"stations must increase, got {at.tolist()}")
    wanted = np.atleast_1d(real_numbers("places", places, error=ModelError))
    if wanted.ndim != 1 or not np.all((wanted >= at[0]) & (wanted <= at[-1])):
        raise ModelError(f"places must lie within the stations, {at[0]:.6g} to {at[-1]:.6g}, got {wanted.tolist()}")
    return ZerosAlong(wanted, tuple(zeros(_at(plant, at, place)) for place in wanted.tolist()), _through_infinity(plant, at))


def _at(plant: StateSpace, stations: Array, place: float) -> StateSpace:
    """The plant with one output, at a place between the stations."""
    weights = np.array([np.interp(place, stations, unit) for unit in np.eye(len(stations))])
    point = plant.operating_point
    errors = {name: np.abs(weights) @ plant.errors(name) for name in ("C", "D")}
    return StateSpace(
        plant.A,
        plant.B,
        (weights @ plant.C)[np.newaxis],
        (weights @ plant.D)[np.newaxis],
        operating_point=OperatingPoint(point.x0, point.u0, np.atleast_1d(weights @ point.y0)),
        rest=plant.rest,
        error_estimates={**plant.error_estimates, **{name: error[np.newaxis] for name, error in errors.items()}},
    )


def _through_infinity(plant: StateSpace, stations: Array) -> Array:
    """Where the gain of the lowest derivative that the input enters changes its sign."""
    forms = [normal_form(_at(plant, stations, place)) for place in stations.tolist()]
    lowest = min(form.orders[0] for form in forms)
    gains = np.array([form.B_y[0, 0] if form.orders[0] == lowest else 0.0 for form in forms])
    changes = np.flatnonzero(gains[:-1] * gains[1:] < 0)
    before, after = gains[changes], gains[changes + 1]
    inside = stations[changes] + np.diff(stations)[changes] * before / (before - after)
    return np.union1d(inside, stations[1:-1][(gains[1:-1] == 0) & (gains[:-2] * gains[2:] < 0)])
