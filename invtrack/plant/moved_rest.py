"""Equilibria that a change of parameters moves: where they are, and as states measured from where the plant was before."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal, get_args

import mujoco
import numpy as np

from invtrack.arguments import one_of
from invtrack.arrays import Array
from invtrack.errors import PlantError
from invtrack.linear.state_space import StateSpace
from invtrack.plant.configuration import state_of
from invtrack.plant.elements import listed
from invtrack.plant.equilibrium.trim import trim
from invtrack.plant.plant import Plant

Kept = Literal["same outputs", "same controls"]

SMALL_ANGLE = 1e-2
"""Below this [rad] a rotation's coefficients come from their series, whose next term is then rounding."""

ACTS = 1e-12
"""A dropped rotation turns into a kept one where the derivative exceeds this."""


def equilibrium_of(plant: Plant, equilibrium: Kept | Plant | None, parameter_values: Mapping[str, float]) -> Plant:
    """The plant at the equilibrium about which it is to be linearized with these parameter values; see `linearize`.

    Raises PlantError where there is none, and for another plant, or one that holds other controls than its inputs elsewhere.
    """
    if equilibrium is None:
        return plant
    if not isinstance(equilibrium, Plant):
        one_of("equilibrium", equilibrium, get_args(Kept), error=PlantError)
        rest, values = plant.operating_point, dict[str, Any](parameter_values)
        if equilibrium == "same outputs":
            return trim(plant, outputs=rest.y0, **values).plant
        return trim(plant, controls=rest.u0, **values).plant
    channels = ("states", "inputs", "outputs", "measurements")
    if equilibrium.model.signature != plant.model.signature or any(
        getattr(equilibrium, kind) != getattr(plant, kind) for kind in channels
    ):
        raise PlantError(
            f"equilibrium must be plant {plant.name!r} itself at another operating point, such as invtrack.trim(plant, ...).plant;"
            f" got {equilibrium.name!r} with inputs {listed(equilibrium.inputs.names)} and outputs"
            f" {listed(equilibrium.outputs.names)}"
        )
    ours, theirs = plant.configuration, equilibrium.configuration
    held = np.setdiff1d(np.arange(plant.model.nu), plant.input_addresses)
    if not (
        np.array_equal(ours.ctrl[held], theirs.ctrl[held])
        and np.array_equal(ours.mocap_pos, theirs.mocap_pos)
        and np.array_equal(ours.mocap_quat, theirs.mocap_quat)
    ):
        raise PlantError(
            "equilibrium holds actuators that are no inputs, or mocap bodies, elsewhere than the plant; during a run they stay as"
            " they are, so make these actuators inputs, or find the equilibrium without them: invtrack.trim(plant, ...)"
        )
    return equilibrium


def measured_from(plant: Plant, model: StateSpace, point: Plant) -> StateSpace:
    """A linear model about `point`, with its states measured from the operating point of `plant` instead.

    A rotation vector s + d from there is, to first order, s and J^-1(s) d for the d from `point`, J^-1 the inverse of the right
    Jacobian of the exponential map (J. Solà, J. Deray, D. Atchuthan, "A micro Lie theory for state estimation in robotics", 2018,
    eq. 144). Raises PlantError where a rotation that is dropped from the states turns into one that is kept.
    """
    origin = plant.configuration
    at, kept = point.configuration, plant.state_addresses
    rest = state_of(plant.model, origin.x0, at.qpos, at.qvel, at.act)
    turned = _rotated_frame(plant.model, rest)
    dropped = np.setdiff1d(np.arange(len(rest)), kept)
    if np.any(np.abs(turned[np.ix_(kept, dropped)]) > ACTS):
        raise PlantError(
            f"plant {plant.name!r} drops {listed(plant.dropped)}, but from one equilibrium to the other it is rotated so that what"
            " is dropped here is a part of what is kept there; take rotations out of drop_states"
        )
    T = turned[np.ix_(kept, kept)]
    if not np.array_equal(T, np.eye(len(T))):
        model = model.transformed(T, states=model.states)
    return replace(model, operating_point=replace(model.operating_point, x0=origin.x0), rest=rest[kept])


def _rotated_frame(model: mujoco.MjModel, rest: Array) -> Array:
    """Derivative (2 nv + na, 2 nv + na) of states measured from here by those measured from `rest`."""
    derivative = np.eye(len(rest))
    # A free joint's rotation follows its translation.
    places = {int(mujoco.mjtJoint.mjJNT_BALL): 0, int(mujoco.mjtJoint.mjJNT_FREE): 3}
    for kind, first in zip(model.jnt_type.tolist(), model.jnt_dofadr.tolist(), strict=True):
        if kind in places:
            start = first + places[kind]
            derivative[start : start + 3, start : start + 3] = _inverse_right_jacobian(rest[start : start + 3])
    return derivative


def _inverse_right_jacobian(s: Array) -> Array:
    """J^-1(s) (3, 3) = 1 + [s] / 2 + c [s]^2, c = (1 - (a / 2) cot(a / 2)) / a^2, of a rotation by a = |s| < 2 pi."""
    angle = float(np.linalg.norm(s))
    c = 1 / 12 + angle**2 / 720 if angle < SMALL_ANGLE else (1 - angle / 2 / np.tan(angle / 2)) / angle**2
    cross = np.array([[0.0, -s[2], s[1]], [s[2], 0.0, -s[0]], [-s[1], s[0], 0.0]])
    return np.asarray(np.eye(3) + cross / 2 + c * cross @ cross)
