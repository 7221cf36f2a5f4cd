"""Bodies that a named parameter belongs to: their size and shade follow their mass, a label states the value."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
import rerun as rr
from numpy.typing import NDArray

from invtrack.errors import RecordingError
from invtrack.recording.layout import entity_path, time_columns
from invtrack.recording.shapes import body_name, geom_rgba, geom_shape, visible_geoms
from invtrack.results.result import Array, RunResult

SMALLEST = 0.3
"""Size at mass zero relative to the size at the run's largest mass: still to be seen."""

PALENESS = 0.6
"""Share of white in the colour of a body without mass; none is left at the run's largest mass."""

LABEL_COLOR = (250, 250, 250, 255)


@dataclass(frozen=True)
class SizeChanges:
    """Sizes of a body relative to its geoms in the model: `factors` (K,), each from the sample in `samples` (K,) on."""

    samples: NDArray[np.int64]
    factors: Array


def size_factors(result: RunResult, model: mujoco.MjModel) -> dict[int, SizeChanges]:
    """For each body whose mass is a parameter (unit kg): size (m / m_max)^(1/3), m_max the largest mass in the run.

    Raises RecordingError where result.parameter_bodies names a parameter or a body that does not exist.
    """
    sizes: dict[int, SizeChanges] = {}
    for parameter, name in result.parameter_bodies.items():
        body, column = _find(result, model, parameter, name)
        if result.parameters.channels.units[column] != "kg" or body in sizes:
            continue
        masses = np.maximum(result.parameters.values[:, column], 0.0)
        samples = changes(result.parameters.values[:, column])
        largest = float(np.max(masses, initial=0.0))
        relative = masses[samples] / largest if largest > 0 else np.zeros(samples.size)
        sizes[body] = SizeChanges(samples, np.maximum(np.cbrt(relative), SMALLEST))
    return sizes


def changes(values: Array) -> NDArray[np.int64]:
    """Numbers of the steps at which a held value is new, the first included."""
    return np.flatnonzero(np.concatenate([[True], values[1:] != values[:-1]])[: values.size])


def send_sized_geom(
    recording: rr.RecordingStream, path: str, result: RunResult, model: mujoco.MjModel, geom: int, size: SizeChanges
) -> None:
    """Send a geom whose scale and colour change at some samples: its shape once, the changes over time."""
    shape, rgba = geom_shape(model, geom), geom_rgba(model, geom)
    recording.log(path, shape.archetype(**shape.fields), static=True, strict=True)
    count = size.samples.size
    white = PALENESS * (1 - size.factors[:, np.newaxis])
    colors = np.column_stack([(1 - white) * rgba[:3] + white, np.full(count, rgba[3])])
    indexes = time_columns(size.samples, result.time[size.samples])
    transforms = rr.Transform3D.columns(
        translation=np.tile(model.geom_pos[geom], (count, 1)),
        quaternion=np.tile(model.geom_quat[geom, [1, 2, 3, 0]], (count, 1)),
        scale=np.tile(size.factors[:, np.newaxis], (1, 3)),
    )
    rr.send_columns(path, indexes, [*transforms, *shape.color_columns(colors)], recording=recording, strict=True)


def send_labels(recording: rr.RecordingStream, result: RunResult, model: mujoco.MjModel, root: tuple[str, ...]) -> None:
    """Send the value of each parameter that belongs to a body as a text beside that body."""
    for number, (parameter, name) in enumerate(result.parameter_bodies.items()):
        body, column = _find(result, model, parameter, name)
        reach = max((float(model.geom_rbound[geom]) for geom in visible_geoms(model, body)), default=0.0)
        place = [0.0, 0.0, -(1.5 + number) * (reach or 0.05 * model.stat.extent)]
        path = entity_path(*root, "bodies", name, f"{parameter}_label")
        dot = rr.Points3D([place], radii=[1e-3 * reach], colors=[LABEL_COLOR], show_labels=True)
        recording.log(path, dot, static=True, strict=True)
        values, unit = result.parameters.values[:, column], result.parameters.channels.units[column]
        samples = changes(values)
        labels = rr.Points3D.columns(labels=[f"{parameter} = {value:.6g} {unit}" for value in values[samples]])
        rr.send_columns(path, time_columns(samples, result.time[samples]), labels, recording=recording, strict=True)


def _find(result: RunResult, model: mujoco.MjModel, parameter: str, body: str) -> tuple[int, int]:
    """Number of the body, and column of the parameter."""
    if parameter not in result.parameters.channels:
        known = ", ".join(result.parameters.channels.names)
        raise RecordingError(f"case {result.name!r} has no parameter {parameter!r}; there are: {known}")
    bodies = [body_name(model, number) for number in range(model.nbody)]
    if body not in bodies:
        raise RecordingError(
            f"no body {body!r}, to which parameter {parameter!r} belongs, in the model; it has: {', '.join(bodies)}"
        )
    return bodies.index(body), result.parameters.channels.index(parameter)
