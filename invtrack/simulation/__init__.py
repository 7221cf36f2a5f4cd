"""The closed loop: a plant in MuJoCo, or its linear model, driven by a controller and recorded."""

from invtrack.simulation.acting_limits import ActingLimit, Stretches
from invtrack.simulation.closed_loop import simulate
from invtrack.simulation.linear_plant import LinearPlant, LinearStageInput, LinearStepper
from invtrack.simulation.simulated_plant import Sensor, SimulatedPlant, StageInput, Stepper

__all__ = [
    "ActingLimit",
    "LinearPlant",
    "LinearStageInput",
    "LinearStepper",
    "Sensor",
    "SimulatedPlant",
    "StageInput",
    "Stepper",
    "Stretches",
    "simulate",
]
