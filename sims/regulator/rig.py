"""The cantilever with a swappable tip mass, the paper's exosystem, and the feedback that all cases share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

import invtrack
from invtrack.studies import Case

A_E = ((0, 1, 0, 0), (-1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0))
C_E = ((0, 0, 0, 1),)
X_E = (0.0, 1.0, 0.0, 0.0)  # at T_i = 0: y_d = 1 - cos t
MEASUREMENTS = ("base_position", "tip_position")
POLES = (-0.4 + 2j, -0.4 - 2j, -0.3 + 0.3j, -0.3 - 0.3j, -0.12 + 0.08j, -0.12 - 0.08j)  # [rad/s], in every interval
OBSERVER_POLES = (-3.0, -5.0, -6.0, -7.0)  # [rad/s], of the estimate of the exosystem's state
LONG = "long_"  # begins the names of cases over many cycles
STATE_OBSERVER = invtrack.KalmanFilter(input_noise=0.02, measurement_noise=1e-3)


@dataclass(frozen=True, eq=False)
class Rig:
    """Plant, its models between jumps of the tip mass, gains per interval, the maps that are compared by name, and their plan."""

    plant: invtrack.Plant
    model: invtrack.SwitchedSystem
    gains: invtrack.GainSchedule
    maps: dict[str, invtrack.regulation.RegulationMap]
    plan: invtrack.Plan

    def controller(self, name: str, **options: Any) -> invtrack.ExosystemController:
        """The law with one of the maps; all are judged by the exact plan for the same wanted output."""
        return invtrack.ExosystemController(self.maps[name], self.gains, exosystem_state=X_E, plan=self.plan, **options)

    def own_state(self, name: str) -> np.ndarray:
        """The plant's state that a map wants when the manoeuvre starts, G(T_i) x_e (n,), from inside the manoeuvre."""
        first, second = self.maps[name].breakpoints[:2]
        return np.asarray(self.maps[name].x_map([first], inside=[(first + second) / 2])[0] @ X_E)

    def case(self, name: str, controller: invtrack.ExosystemController, **options: Any) -> Case:
        """One case in MuJoCo, the tip mass jumping as the plan expects; options: of the case."""
        return Case(name, self.plant, controller, **options)


def rig(plant: invtrack.Plant, masses: Sequence[float], jumps: Sequence[float], *, end: float) -> Rig:
    """The plant with these tip masses [kg], exchanged at `jumps` [s], and the exosystem running from 0 to `end` [s]."""
    linear = {mass: invtrack.linearize(plant, tip_mass=mass) for mass in dict.fromkeys(masses)}
    model = invtrack.SwitchedSystem([linear[mass] for mass in masses], jumps)
    wanted = invtrack.references.exosystem(A_E, C_E, start=0.0, end=end)
    maps = {
        "exact_map": invtrack.exosystem_map(model, wanted, tolerance=1e-11),
        "switched_francis": invtrack.regulation.switched_francis(model, wanted),
        "single_francis": invtrack.regulation.single_francis(model, wanted, interval=0),
    }
    return Rig(plant, model, invtrack.place(model, POLES), maps, maps["exact_map"].plan(X_E))


def cantilever() -> invtrack.Plant:
    """The MuJoCo plant."""
    return invtrack.Plant.from_xml(
        invtrack.model_path("cantilever"),
        inputs=["base_force"],
        outputs=["tip_position"],
        measurements=MEASUREMENTS,
        parameters={"tip_mass": "body:tip:mass"},
    )


def interval_errors(run: invtrack.RunResult, edges: Sequence[float]) -> list[float]:
    """Largest |y - y_d| from each of the edges [s] to the next, both ends included; what a run does not reach is 0."""
    slack = 1e-9 * float(np.max(np.abs(run.time)))  # an edge and its sample may differ by rounding
    error = np.max(np.abs(run.error), axis=1)
    return [float(np.max(error[(run.time >= a - slack) & (run.time <= b + slack)], initial=0.0)) for a, b in pairwise(edges)]
