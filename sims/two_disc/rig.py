"""The two-disc rig, its slews, and what a redesign changes about them, as shares."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import invtrack
from invtrack.redesign import outcome

R, Q_TWIST, Q_Y = 1.0, 5000.0, 1.0  # the papers' weights
SLEW = 1.0  # [rad]
PROFILES = {"quintic": 2, "septic": 3}  # derivatives that vanish at both ends
SHOWN = ("quintic", 30.0)  # where about 10 % of the slew is given up
PUBLISHED = {"output_change": 0.10, "input_reduction": 0.60, "twist_reduction": 0.20}
SHARES = tuple(PUBLISHED)
AFTER = 30.0  # [s] simulated after the slew
MARGIN = 1e-4  # share of hard limits that a plan leaves to feedback, which corrects what holding the input over a step costs
TOLERANCE = 1e-6  # of the plans, which sets how early they start

TWIST = np.array([1.0, -1.0, 0.0, 0.0])  # of the states th1, th2, th1 velocity, th2 velocity
TWIST_WEIGHT = np.outer(TWIST, TWIST)
WEIGHTS: dict[str, Any] = {"R": R, "Q_x": Q_TWIST * TWIST_WEIGHT, "Q_y": Q_Y}
MEASUREMENTS = ("disc1_angle", "disc2_angle")  # the potentiometers


def rig() -> invtrack.Plant:
    """The identified rig; its command has no unit, the file states the torques per unit of it."""
    return invtrack.Plant.from_xml(
        invtrack.model_path("two_disc"),
        inputs=["motor"],
        outputs=["disc2_angle"],
        measurements=MEASUREMENTS,
        parameters={
            "disc1_mass": "body:disc1:mass:scaled",
            "disc2_mass": "body:disc2:mass:scaled",
            "shaft_stiffness": "tendon:twist:stiffness",
        },
        units={"motor": "1", "shaft_stiffness": "N m/rad"},
    )


def slew(duration: float, profile: str) -> invtrack.PiecewiseSignal:
    """The wanted output."""
    return invtrack.rest_to_rest(0.0, SLEW, duration, smoothness=PROFILES[profile])


@dataclass(frozen=True)
class Plans:
    """Exact inversion and redesign of one slew."""

    exact: invtrack.Plan
    redesigned: invtrack.Plan

    @classmethod
    def of(cls, model: invtrack.StateSpace, duration: float, profile: str, *, tolerance: float = TOLERANCE) -> Plans:
        """With the papers' weights."""
        reference = slew(duration, profile)
        return cls(
            exact=invtrack.invert(model, reference, tolerance=tolerance),
            redesigned=invtrack.quadratic_redesign(model, reference, **WEIGHTS, tolerance=tolerance),
        )

    def in_place_of_redesigned(self, plan: invtrack.Plan) -> Plans:
        """Exact inversion beside another redesign."""
        return replace(self, redesigned=plan)

    def shares(self) -> dict[str, float]:
        """What the redesign changes, predicted from the plans alone, as shares of the slew and of the exact plan's peaks."""
        exact, redesigned = (outcome(plan, {"twist": TWIST}) for plan in (self.exact, self.redesigned))
        return _shares(
            redesigned.max_error, (exact.peak_input, redesigned.peak_input), (exact.peaks["twist"], redesigned.peaks["twist"])
        )


def measured_shares(exact: invtrack.RunResult, redesigned: invtrack.RunResult) -> dict[str, float]:
    """The same of two runs."""
    runs = (exact, redesigned)
    inputs = [peak(result.applied.values) for result in runs]
    twists = [peak(twist(result.state.values)) for result in runs]
    return _shares(peak(redesigned.error), inputs, twists)


def run_settings(plan: invtrack.Plan, *, after: float = AFTER) -> dict[str, Any]:
    """Arguments of a simulation until `after` [s] after the slew."""
    return {"end": plan.manoeuvre[1] + after}


def twist(x: np.ndarray) -> np.ndarray:
    """th1 - th2 [rad] of states (m, 4)."""
    return np.asarray(x @ TWIST)


def clamped_steps(result: invtrack.RunResult) -> int:
    """Number of steps at which the actuator passed on something else than what was commanded."""
    return int(np.sum(np.any(result.applied.values != result.commanded.values, axis=1)))


def peak(values: np.ndarray) -> float:
    """Largest magnitude."""
    return float(np.max(np.abs(values)))


def _shares(change: float, inputs: Sequence[float], twists: Sequence[float]) -> dict[str, float]:
    """From the output's largest change and the peaks (exact, redesigned) of input and twist."""
    return {
        "output_change": change / SLEW,
        "input_reduction": 1 - inputs[1] / inputs[0],
        "twist_reduction": 1 - twists[1] / twists[0],
    }
