"""The same plant with something about its hardware changed for good: parameters, input limits, velocity couplings."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from dataclasses import replace

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from invtrack.arguments import by_name, instance, require_text
from invtrack.arrays import finite_number, real_numbers
from invtrack.errors import PlantError
from invtrack.plant.couplings import velocity_couplings
from invtrack.plant.elements import listed
from invtrack.plant.parameters import element_of_spec
from invtrack.plant.plant import A_PLANT, Plant


def with_input_limits(plant: Plant, limits: Mapping[str, ArrayLike]) -> Plant:
    """The plant whose actuators pass on only the inputs within `limits` (their ctrlrange), in place of the file's ctrlrange.

    Limits on forces that the file states stay, and `Plant.input_limits` are the tightest of both.

    limits: (lowest, highest) by the name of the input, in its unit; a number stands for (-number, number). Inputs that are not
    named keep their range.

    Raises PlantError for inputs that do not exist, limits that are not finite or not in order, and a model that disables clamping.
    """
    instance("plant", plant, Plant, expected=A_PLANT, error=PlantError)
    limits = by_name("limits", limits, expected="limits by the names of inputs", error=PlantError)
    unknown = [name for name in limits if name not in plant.inputs]
    if unknown:
        raise PlantError(f"limits are given for {listed(unknown)}; the plant's inputs are: {listed(plant.inputs.names)}")
    model, spec = copy.copy(plant.model), None if plant.spec is None else plant.spec.copy()
    if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL:
        raise PlantError(f"plant {plant.name!r} disables the clamping of controls, so limits would do nothing; remove that flag")
    for name, given in limits.items():
        bounds = real_numbers(f"limits of input {name!r}", given, error=PlantError)
        if bounds.shape not in ((), (2,)):
            raise PlantError(f"limits of input {name!r} must be a number or two (lowest, highest), got shape {bounds.shape}")
        low, high = (-bounds, bounds) if bounds.ndim == 0 else bounds
        if not (math.isfinite(low) and math.isfinite(high) and low < high):
            raise PlantError(f"limits of input {name!r} must be finite, the lowest before the highest, got {bounds.tolist()}")
        address = int(plant.input_addresses[plant.inputs.index(name)])
        index = int(np.searchsorted(model.actuator_ctrladr, address, side="right")) - 1
        if model.actuator_ctrlnum[index] > 1:
            raise PlantError(f"input {name!r} is one of several controls of its actuator; state its ctrlrange in the file")
        model.actuator_ctrllimited[address], model.actuator_ctrlrange[address] = True, (low, high)
        if spec is not None:
            actuator = element_of_spec(spec, "actuator", index)
            actuator.ctrllimited, actuator.ctrlrange = mujoco.mjtLimited.mjLIMITED_TRUE, (low, high)
    return replace(plant, model=model, spec=spec)


def with_parameter_values(plant: Plant, values: Mapping[str, float]) -> Plant:
    """The plant in whose model and specification named parameters have these values, in place of the file's.

    values: by the parameter's name. The parameters keep their names, so that they can change from there on.

    Raises PlantError for parameters that do not exist and values that leave no mechanism, as `Plant.apply` does.
    """
    instance("plant", plant, Plant, expected=A_PLANT, error=PlantError)
    values = by_name("values", values, expected="values by the names of parameters", error=PlantError)
    model = plant.model_with(values)
    spec = None if plant.spec is None else plant.spec.copy()
    if spec is not None:
        for name, value in values.items():
            plant.parameters[name].write_spec(spec, float(value), reference=plant.model)
    return replace(plant, model=model, spec=spec)


def with_coupling_scaled(plant: Plant, name: str, scale: float) -> Plant:
    """The plant whose velocity coupling of that name has the matrix `scale` K in place of K, in the model, its specification and
    the forces alike.

    Raises PlantError for a coupling that does not exist and a scale that is not finite.
    """
    instance("plant", plant, Plant, expected=A_PLANT, error=PlantError)
    require_text("name", name, error=PlantError)
    scale = finite_number("scale", scale, error=PlantError)
    known = {coupling.name: coupling for coupling in plant.couplings}
    if name not in known:
        raise PlantError(f"plant {plant.name!r} has no velocity coupling {name!r}; there are: {listed(known)}")
    model, spec = copy.copy(plant.model), None if plant.spec is None else plant.spec.copy()
    entries = (scale * known[name].K).ravel()
    start = model.numeric_adr[mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_NUMERIC, name)]
    model.numeric_data[start : start + entries.size] = entries
    if spec is not None:
        for i, entry in enumerate(entries.tolist()):
            spec.numeric(name).data[i] = entry
    return replace(plant, model=model, spec=spec, couplings=velocity_couplings(model))
