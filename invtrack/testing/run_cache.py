"""Runs that are simulated once, however many assertions they serve."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from invtrack.arguments import by_name, instance
from invtrack.arrays import whole_number
from invtrack.control.protocol import Controller
from invtrack.errors import SimulationError
from invtrack.linear.state_space import StateSpace
from invtrack.plans.plan import Plan
from invtrack.plant.linearize import linearize
from invtrack.plant.plant import Plant
from invtrack.references.signal import PiecewiseSignal
from invtrack.results.result import RunResult
from invtrack.simulation.closed_loop import simulate
from invtrack.simulation.linear_plant import LinearPlant
from invtrack.simulation.parameter_factors import with_factors
from invtrack.testing.factors import case_name
from invtrack.testing.fingerprint import fingerprint

Design = Callable[[StateSpace, PiecewiseSignal], Controller]

KEPT = 32
"""Runs that a cache keeps, those last asked for, unless another number is asked for."""


@dataclass(frozen=True)
class _Entry:
    """asked: what was handed over, kept alive because functions are known by their identity alone."""

    asked: tuple[Any, ...]
    run: RunResult
    plan: Plan


class RunCache:
    """Simulates what is asked for, once: a second call that asks for the same returns the same RunResult.

    The same is what is equal in content: the plant (the compiled model and how it is seen), the controller with its plan and
    reference, factors and options. Two fixtures that build equal plants and controllers therefore share a run, and a change of the
    model file, of a gain or of the reference makes a new one. Functions are the same only if they are the same object.

    kept: how many runs stay in memory, those last asked for. Raises SimulationError unless that is at least 1.

        runs = RunCache()
        run = runs(plant, controller, timestep=1e-3)
        run = runs(plant, design, reference=reference)    # design(model, reference) -> controller, for the linearized plant
        run = runs(plant, controller, factors={"tip_mass": 1.1})
    """

    def __init__(self, kept: int = KEPT) -> None:
        self.kept = whole_number("kept", kept, lowest=1, error=SimulationError)
        self.handed_out: list[RunResult] = []
        self._entries: OrderedDict[bytes, _Entry] = OrderedDict()

    def __call__(
        self,
        plant: Plant | LinearPlant,
        controller: Controller | Design,
        *,
        reference: PiecewiseSignal | None = None,
        factors: Mapping[str, float] | None = None,
        **options: Any,
    ) -> RunResult:
        """The run of a plant with a controller.

        Args:
            plant: as in `invtrack.simulate`.
            controller: a controller, which has its reference in its plan; or, with `reference`, a function that designs one from
                the model linearized at the plant's operating point (a LinearPlant's own model) and the reference.
            reference: what such a function is given.
            factors: by the names or paths of parameters ("body:tip:mass"), how many times its value in the file, or in the plan,
                each one really has, from the run's start on and through every change; see `with_factors`.
            options: of `invtrack.simulate`. The name is the plant's, and what is off, unless given.

        Raises as linearize, the design and `invtrack.simulate` do; SimulationError for a design without a reference, or the other
        way round.
        """
        factors = by_name("factors", factors or {}, expected="factors by the names of parameters", error=SimulationError)
        asked = (plant, controller, reference, dict(factors), options)
        key = fingerprint(asked)
        if key not in self._entries:
            self._entries[key] = self._entry(asked)
            while len(self._entries) > self.kept:
                self._entries.popitem(last=False)
        self._entries.move_to_end(key)
        run = self._entries[key].run
        self.handed_out.append(run)
        return run

    def plan_of(self, run: RunResult) -> Plan | None:
        """The plan that a run followed, None for a run that is not, or no longer, in the cache."""
        return next((entry.plan for entry in self._entries.values() if entry.run is run), None)

    def _entry(self, asked: tuple[Any, ...]) -> _Entry:
        plant, controller, reference, factors, options = asked
        controller = _designed(plant, controller, reference)
        name = plant.name if not factors else f"{plant.name}, {case_name(factors)}"
        if factors:
            what = "an invtrack.Plant, whose parameters can be off by factors; a LinearPlant is off as its model says"
            instance("plant", plant, Plant, expected=what, error=SimulationError)
            plant, options = with_factors(plant, controller.plan, factors, options)
        return _Entry(asked, simulate(plant, controller, **{"name": name, **options}), controller.plan)


def _designed(plant: Plant | LinearPlant, controller: Any, reference: PiecewiseSignal | None) -> Any:
    """The controller: as it is, or designed for the plant and the reference."""
    instance(
        "plant", plant, (Plant, LinearPlant), expected="an invtrack.Plant, or invtrack.LinearPlant(model)", error=SimulationError
    )
    if hasattr(controller, "plan"):
        if reference is not None:
            raise SimulationError(
                "a controller follows the reference of its own plan; give a reference with a function that designs one,"
                " controller(model, reference), or none"
            )
        return controller
    if reference is None or not callable(controller):
        raise SimulationError(
            "expected a controller such as invtrack.TrackingController(plan, gains), or a function controller(model, reference)"
            f" that designs one together with reference=..., got {type(controller).__name__}"
            f" {'without' if reference is None else 'with'} a reference"
        )
    model = linearize(plant) if isinstance(plant, Plant) else plant.model
    return controller(model, reference)
