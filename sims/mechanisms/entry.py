"""One mechanism of the gallery: a file that comes with a package, where it rests, how it is to move, and what became of it."""

from __future__ import annotations

import importlib.metadata
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import invtrack
from invtrack.errors import InvtrackError
from invtrack.figures import tracking_figure
from invtrack.studies import Case

PACKAGES = {
    "gymnasium": "gymnasium/envs/mujoco/assets",
    "dm-control": "dm_control/suite",
    "drone-models": "drone_models/data",
    "openarm-mujoco": "share/openarm_mujoco/v2",
}
"""Where each package keeps its MJCF files."""

SAMPLES = 401  # of a plan, for the sizes of its states


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One mechanism, from its file to a plan.

    Args:
        name: of its case.
        package: the distribution on PyPI that its file comes with.
        file: where that stands among the package's MJCF files.
        plant: makes the plant of the file, at rest.
        motion: how far each output moves, (p,) in its unit.
        duration: of the motion [s].
        smoothness: how many derivatives of the motion are continuous.
        method: plans it, and `called` is what the table calls it.
        refused_by: the error by which it must be refused, where this is what the entry shows.
    """

    name: str
    package: str
    file: str
    plant: Callable[[Path], invtrack.Plant]
    motion: tuple[float, ...]
    duration: float
    smoothness: int = 4
    method: Callable[[invtrack.StateSpace, invtrack.PiecewiseSignal], invtrack.Plan] = invtrack.invert
    called: str = "inversion"
    refused_by: type[InvtrackError] | None = None

    def case(self) -> Case:
        """Its simulation; all that comes before the plan happens here."""
        clock = _Clock()
        with clock:
            plant = self.plant(installed_file(self.package, self.file))

        def controller() -> invtrack.TrackingController:
            clock.start()
            model = invtrack.linearize(plant)
            rest = model.operating_point.y0
            reference = invtrack.rest_to_rest(rest, rest + self.motion, duration=self.duration, smoothness=self.smoothness)
            plan = self.method(model, reference)
            return invtrack.TrackingController(plan, feedback(model, plan))

        def numbers(result: invtrack.RunResult) -> Mapping[str, Any]:
            clock.stop()
            return {**self.described, **self._measured(plant, result), "time": clock.elapsed}

        return Case(
            self.name,
            plant,
            controller,
            numbers=numbers,
            figures={"tracking": tracking_figure},
            refused_by=self.refused_by,
        )

    @property
    def described(self) -> dict[str, str]:
        """What the table says of it whether it is refused or not."""
        return {"package": self.package, "file": self.file, "method": self.called}

    def _measured(self, plant: invtrack.Plant, result: invtrack.RunResult) -> dict[str, Any]:
        peaks = np.max(np.abs(result.applied.values), axis=0)
        sizes = np.max(np.abs(plant.input_limits), axis=1)
        hardest = int(np.argmax(peaks / sizes if np.all(np.isfinite(sizes)) else peaks))
        limit = float(sizes[hardest])
        units = np.array(plant.outputs.units)
        motion = {unit: float(np.max(np.abs(self.motion)[units == unit])) for unit in dict.fromkeys(plant.outputs.units)}
        errors = np.max(np.abs(result.error), axis=0)
        return {
            **invtrack.metrics(result),
            "motion": f"{', '.join(f'{size:g} {unit}' for unit, size in motion.items())} in {self.duration:g} s",
            "error_share": float(np.max(errors / [motion[unit] for unit in plant.outputs.units])),
            "hardest_input": plant.inputs.names[hardest],
            "hardest_peak": f"{peaks[hardest]:.3g} {plant.inputs.units[hardest]}",
            "range_share": float(peaks[hardest] / limit) if np.isfinite(limit) else None,
        }


@dataclass
class _Clock:
    """The time that an entry takes, over the stretches in which it is its turn."""

    elapsed: float = 0.0
    _since: float = field(default=0.0, repr=False)

    def start(self) -> None:
        self._since = time.perf_counter()

    def stop(self) -> None:
        self.elapsed += time.perf_counter() - self._since

    def __enter__(self) -> None:
        self.start()

    def __exit__(self, *error: object) -> None:
        self.stop()


def installed_file(package: str, name: str) -> Path:
    """The path of an MJCF file that a package has installed. Raises InvtrackError where package or file is not there."""
    wanted = f"{PACKAGES[package]}/{name}"
    try:
        files = importlib.metadata.files(package) or []
    except importlib.metadata.PackageNotFoundError:
        raise InvtrackError(f"{package} is not installed; pip install '.[gallery]' brings all files of the gallery") from None
    for file in files:
        if file.as_posix().endswith(wanted):
            return Path(str(file.locate())).resolve()
    version = importlib.metadata.version(package)
    raise InvtrackError(
        f"{package} {version} has no file {wanted}; the gallery was made with the versions that pyproject.toml names"
    )


def feedback(model: invtrack.StateSpace, plan: invtrack.Plan) -> invtrack.GainSchedule:
    """LQR gains by Bryson's rule, with the sizes that the plan has itself: they do not change with the size of the motion.

    A position's deviation counts as a share of the largest motion in its unit, an input as one of the largest change in its unit.
    What hardly moves is not held more tightly than the rest, and speeds do not count: against inputs that move light limbs they
    would ask for a feedback faster than any timestep.
    """
    times = np.linspace(*plan.manoeuvre, SAMPLES)
    positions = np.isin(model.states.units, ["m", "rad"])
    x = _largest(np.max(np.abs(plan(times).x), axis=0), model.states.units)
    u = _largest(np.ptp(plan.inputs(times), axis=0), model.inputs.units)
    return invtrack.lqr(model, Q=np.diag(positions / x**2), R=np.diag(1 / u**2))


def _largest(sizes: np.ndarray, units: Sequence[str]) -> np.ndarray:
    """The largest size in the unit of each channel; 1 in a unit in which nothing moves."""
    largest = np.array([np.max(sizes[np.array(units) == unit]) for unit in units])
    return np.where(largest > 0, largest, 1.0)
