"""Three mechanisms that differ from their models by 10 %: the error contracts in MuJoCo as in rehearsal on a linear plant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

import invtrack
from invtrack.learning import iterate


@dataclass(frozen=True)
class Mechanism:
    plant: invtrack.Plant
    reference: invtrack.PiecewiseSignal
    span: tuple[float, float]
    band: float
    gains: tuple[float, float]
    assumed: float | None = None


def _plant(name: str, inputs: list[str], output: str, changing: str) -> invtrack.Plant:
    return invtrack.Plant.from_xml(invtrack.model_path(name), inputs=inputs, outputs=[output], parameters={"changing": changing})


def _mechanism(name: str) -> Mechanism:
    if name == "cantilever":
        plant = _plant("cantilever", ["base_force"], "tip_position", "body:tip:mass")
        return Mechanism(plant, invtrack.rest_to_rest(0.0, 2.0, 4.0, smoothness=4), (-8.0, 12.0), 8.0, (100.0, 0.01), 10.0)
    if name == "two_disc":
        plant = _plant("two_disc", ["motor"], "disc2_angle", "tendon:twist:stiffness")
        return Mechanism(plant, invtrack.rest_to_rest(0.0, 1.0, 5.0, smoothness=4), (-6.0, 15.0), 8.0, (10.0, 0.1))
    plant = _plant("cart_pole", ["force"], "joint:cart", "body:pole:mass")
    return Mechanism(plant, invtrack.rest_to_rest(0.0, 0.5, 2.0, smoothness=4), (-3.0, 6.0), 10.0, (10.0, 0.1))


@pytest.mark.parametrize("name", ["cantilever", "two_disc", "cart_pole"])
def test_the_error_contracts_as_in_rehearsal(name: str) -> None:
    mechanism = _mechanism(name)
    plant, (Q, R) = mechanism.plant, mechanism.gains
    assumed = plant.parameter_values["changing"] if mechanism.assumed is None else mechanism.assumed
    model, real = (invtrack.linearize(plant, changing=factor * assumed) for factor in (1.0, 1.1))
    K = invtrack.lqr(model, Q=Q, R=R)

    def run(target: invtrack.Plant | invtrack.LinearPlant, plan: invtrack.Plan) -> invtrack.RunResult:
        changes = [invtrack.Change(-1e3, changing=1.1 * assumed)] if isinstance(target, invtrack.Plant) else None
        return invtrack.simulate(
            target,
            invtrack.TrackingController(plan, K),
            schedule=changes,
            timestep=2e-3,
            start=mechanism.span[0],
            end=mechanism.span[1],
            initial_state=plan.states(mechanism.span[0])[0],
        )

    found = iterate(
        lambda plan: run(plant, plan),
        lambda y_d: invtrack.invert(model, y_d),
        mechanism.reference,
        band=mechanism.band,
        runs=3,
        rehearsal=lambda plan: run(invtrack.LinearPlant(real), plan),
    )
    predicted, measured = found.predicted[:2], found.contractions[:2]
    assert np.all(measured < 2 * predicted)
    assert np.all(predicted < 2 * measured)
    assert found.best.error < 0.1 * found.steps[0].error
