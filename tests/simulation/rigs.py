"""The shipped cantilever with its papers' motion, as the simulation tests use it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import invtrack

JUMPS = (np.pi / 2, 3 * np.pi / 2)
MASSES = (0.0, 100.0, 10.0)


@dataclass(frozen=True)
class Rig:
    plant: invtrack.Plant
    model: invtrack.SwitchedSystem
    reference: invtrack.PiecewiseSignal
    plan: invtrack.Plan
    gains: invtrack.GainSchedule

    @property
    def controller(self) -> invtrack.TrackingController:
        return invtrack.TrackingController(self.plan, self.gains)


def cantilever_plant(measurements: tuple[str, ...] | None = None) -> invtrack.Plant:
    return invtrack.Plant.from_xml(
        invtrack.model_path("cantilever"),
        inputs=["base_force"],
        outputs=["tip_position"],
        measurements=measurements,
        parameters={"tip_mass": "body:tip:mass"},
    )


def cantilever_rig(tolerance: float = 1e-11, measurements: tuple[str, ...] | None = None) -> Rig:
    plant = cantilever_plant(measurements)
    model = invtrack.SwitchedSystem([invtrack.linearize(plant, tip_mass=m) for m in MASSES], JUMPS)
    reference = invtrack.raised_cosine(2.0)
    return Rig(
        plant=plant,
        model=model,
        reference=reference,
        plan=invtrack.invert(model, reference, tolerance=tolerance),
        gains=invtrack.lqr(model, Q=100.0, R=0.01),
    )
