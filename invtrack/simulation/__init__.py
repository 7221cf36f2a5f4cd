"""The closed loop: a plant in MuJoCo, or its linear model, driven by a controller and recorded."""

from invtrack.simulation.acting_limits import ActingLimit, Stretches
from invtrack.simulation.closed_loop import simulate
from invtrack.simulation.linear_plant import LinearPlant, LinearStepper
from invtrack.simulation.simulated_plant import Sensor, SimulatedPlant, Stepper

__all__ = [
    "ActingLimit",
    "LinearPlant",
    "LinearStepper",
    "Sensor",
    "SimulatedPlant",
    "Stepper",
    "Stretches",
    "simulate",
]
