"""The helicopter HE3 in hover, its manoeuvre, and what its states and inputs are called."""

from __future__ import annotations

import numpy as np
from numpy.polynomial import Polynomial

import invtrack

INPUTS = ("collective", "longitudinal_cyclic", "lateral_cyclic", "tail_rotor")
OUTPUTS = {"U": "velocity[0]", "W": "velocity[2]", "V": "velocity[1]", "R": "rate[2]"}  # forward, down, right [m/s], yaw [rad/s]
ATTITUDES = {"pitch theta": "helicopter.ry", "roll phi": "helicopter.rx"}  # [rad]
POSITION_AND_HEADING = tuple(f"helicopter.{coordinate}" for coordinate in ("x", "y", "z", "rz"))

LINEAR = "_linear"  # ends the names of cases on the linear model, in the place of MuJoCo
NONLINEAR = "_nonlinear"  # ends those of plans for the rigid body itself

DISPLACEMENT = 1.0  # [m], to the right and down
DURATION = 5.0  # [s]


def helicopter() -> invtrack.Plant:
    """The free body with the 8 states of HE3: where it stands and where it heads act on nothing."""
    return invtrack.Plant.from_xml(
        invtrack.model_path("hover"), inputs=INPUTS, outputs=list(OUTPUTS.values()), drop_states=POSITION_AND_HEADING
    )


def sidestep_and_descent() -> invtrack.PiecewiseSignal:
    """The wanted U, W, V, R: the velocity of a minimum-jerk displacement for W and V, zero for U and R."""
    s = Polynomial([0.0, 0.0, 0.0, 10.0, -15.0, 6.0])  # from 0 to 1, at rest with no acceleration at both ends
    speed = s.deriv() * (DISPLACEMENT / DURATION)
    velocity = invtrack.references.piecewise_polynomial([0.0, DURATION], [speed.coef], time_scale=DURATION, held=(0.0, 0.0))
    still = invtrack.references.constant(0.0)
    return invtrack.references.stack([still, velocity, velocity, still])


def displacement(run: invtrack.RunResult) -> dict[str, float]:
    """How far [m] the body went in MuJoCo, along the axes that are its own at the start: x forward, y right, z down."""
    forward, left, up = (run.qpos[-1] - run.qpos[0])[:3]
    return {"forward": float(forward), "right": float(-left), "down": float(-up)}


def channel(values: np.ndarray, names: tuple[str, ...], name: str) -> np.ndarray:
    """The named column of values (m, k)."""
    return np.asarray(values[:, names.index(name)])
