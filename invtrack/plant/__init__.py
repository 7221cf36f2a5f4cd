"""MuJoCo mechanisms as plants: named inputs, outputs and parameters, what changes in mid-run, and linearization."""

from invtrack.plant.configuration import Configuration
from invtrack.plant.dynamics import PlantDynamics
from invtrack.plant.equilibrium.trim import trim
from invtrack.plant.equilibrium.trim_point import TrimmedQuantity, TrimPoint
from invtrack.plant.linearize import linearize
from invtrack.plant.loading import model_path
from invtrack.plant.parameters import Change, Parameter
from invtrack.plant.plant import Plant
from invtrack.plant.variants import with_coupling_scaled, with_input_limits, with_parameter_values

__all__ = [
    "Change",
    "Configuration",
    "Parameter",
    "Plant",
    "PlantDynamics",
    "TrimPoint",
    "TrimmedQuantity",
    "linearize",
    "model_path",
    "trim",
    "with_coupling_scaled",
    "with_input_limits",
    "with_parameter_values",
]
