"""Named physical parameters, what each changes in MuJoCo, and changes of them in mid-run."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import mujoco

from invtrack.arguments import by_name, items, texts
from invtrack.arrays import finite_number, shown
from invtrack.errors import PlantError, SimulationError
from invtrack.plant.elements import checked_component, element_id, find_element, listed, split_component
from invtrack.plant.quantities import QUANTITIES, Quantity


class Parameter(Protocol):
    """A physical quantity that may change between runs or in mid-run.

    `body` is the body it belongs to, if it belongs to one, `lowest` the least value that makes sense. `write` changes fields of a
    compiled model (the constants that MuJoCo derives from them are Plant's business), `write_spec` changes the specification that a
    model is compiled from; `reference` is the model as the file has it. `check` raises PlantError where the values written, all
    those of one change, leave no mechanism.
    """

    @property
    def body(self) -> str | None: ...

    @property
    def lowest(self) -> float: ...

    def unit(self, model: mujoco.MjModel) -> str: ...

    def read(self, model: mujoco.MjModel) -> float: ...

    def write(self, model: mujoco.MjModel, value: float, *, reference: mujoco.MjModel) -> None: ...

    def check(self, model: mujoco.MjModel) -> None: ...

    def write_spec(self, spec: mujoco.MjSpec, value: float, *, reference: mujoco.MjModel) -> None: ...


@dataclass(frozen=True)
class ElementParameter:
    """A quantity of one element: what a path such as "body:tip:mass" stands for.

    kind, element: of which element, by its name. quantity, component: which of its quantities.
    """

    kind: str
    element: str
    quantity: str
    component: int

    @property
    def body(self) -> str | None:
        return self.element if self.kind == "body" else None

    @property
    def lowest(self) -> float:
        return self._quantity.lowest

    def unit(self, model: mujoco.MjModel) -> str:
        return self._quantity.unit(model, self._index(model), self.component)

    def read(self, model: mujoco.MjModel) -> float:
        return self._quantity.read(model, self._index(model), self.component)

    def write(self, model: mujoco.MjModel, value: float, *, reference: mujoco.MjModel) -> None:
        self._quantity.write(model, self._index(model), self.component, value, reference)

    def check(self, model: mujoco.MjModel) -> None:
        self._quantity.check(model, self._index(model))

    def write_spec(self, spec: mujoco.MjSpec, value: float, *, reference: mujoco.MjModel) -> None:
        element = element_of_spec(spec, self.kind, self._index(reference))
        self._quantity.write_spec(element, self.component, value, reference)

    @property
    def identity(self) -> tuple[object, ...]:
        """Equal for two parameters that are one quantity, as a mass is whatever happens to the inertia."""
        return (self.kind, self.element, self._quantity.attribute, self.component)

    @property
    def _quantity(self) -> Quantity:
        return QUANTITIES[self.kind][self.quantity]

    def _index(self, model: mujoco.MjModel) -> int:
        return element_id(model, self.kind, self.element)


def element_of_spec(spec: mujoco.MjSpec, kind: str, index: int) -> Any:
    """The element of a specification that became the one of this index in its compiled model."""
    elements = {
        "body": spec.bodies,
        "joint": spec.joints,
        "geom": spec.geoms,
        "tendon": spec.tendons,
        "actuator": spec.actuators,
    }[kind]
    return next(element for element in elements if element.id == index)


def named_parameters(model: mujoco.MjModel, parameters: Mapping[str, str | Parameter] | Sequence[str]) -> dict[str, Parameter]:
    """The parameters of a model by their names: of one's own, with paths or parameters of one's own kind, or paths alone.

    Raises PlantError for names that cannot be written as keywords, what is no parameter, and what the model does not have.
    """
    if not isinstance(parameters, Mapping):
        expected = 'paths such as "body:tip:mass", or a dict of paths by names of your own'
        paths = texts("parameters", parameters, expected=expected, error=PlantError)
        if len(set(paths)) != len(paths):
            raise PlantError(f"parameters must be distinct paths, got {listed(paths)}")
        parameters = {path: path for path in paths}
    given = by_name("parameters", parameters, expected='paths such as "body:tip:mass" by names of your own', error=PlantError)
    found: dict[str, Parameter] = {}
    for name, value in given.items():
        if not name.isidentifier() and name != value:
            raise PlantError(f"parameter {name!r} cannot be written as a keyword; use letters, digits and underscores")
        if isinstance(value, str):
            found[name] = parameter_at(value, model)
        elif isinstance(value, type) or not callable(getattr(value, "read", None)):
            raise PlantError(f'parameter {name!r} must be a path such as "body:tip:mass", got {shown(value)}')
        else:
            found[name] = value
        found[name].read(model)  # raises where it names nothing in this model
    _require_distinct_quantities(found)
    return found


def _require_distinct_quantities(parameters: Mapping[str, Parameter]) -> None:
    """Refuse two parameters that are one quantity: setting one of them would silently set the other."""
    seen: dict[tuple[object, ...], str] = {}
    for name, parameter in parameters.items():
        if isinstance(parameter, ElementParameter):
            other = seen.setdefault(parameter.identity, name)
            if other != name:
                raise PlantError(f"parameters {other!r} and {name!r} are the same quantity; name it once")


def parameter_at(path: str, model: mujoco.MjModel) -> ElementParameter:
    """The parameter that a path such as "body:tip:mass" or "actuator:thrust:gear[2]" stands for.

    Raises PlantError for what is no such path, with the names there are, and for elements that have no such quantity.
    """
    kind, _, rest = path.partition(":")
    if kind not in QUANTITIES or not rest:
        raise PlantError(f"no parameter is called {path!r}; a parameter is one of: {listed(parameter_forms())}")
    parts = rest.split(":")
    for cut in range(len(parts) - 1, 0, -1):
        element, name = ":".join(parts[:cut]), ":".join(parts[cut:])
        if find_element(model, kind, element) is not None:
            return _parameter_of(path, model, kind, element, name)
    element_id(model, kind, parts[0])  # raises, with the names there are, unless the element alone is given
    raise PlantError(f"{path!r} names no quantity; there are: {listed(f'{path}:{name}' for name in QUANTITIES[kind])}")


def parameter_forms() -> list[str]:
    """All paths there are, with NAME for the element's name."""
    return [f"{kind}:NAME:{name}" for kind, quantities in QUANTITIES.items() for name in quantities]


def _parameter_of(path: str, model: mujoco.MjModel, kind: str, element: str, name: str) -> ElementParameter:
    quantity_name, component = split_component(name, QUANTITIES[kind])
    if quantity_name not in QUANTITIES[kind]:
        known = listed(f"{kind}:{element}:{known}" for known in QUANTITIES[kind])
        raise PlantError(f"no parameter is called {path!r}; of this {kind} there are: {known}")
    quantity, index = QUANTITIES[kind][quantity_name], element_id(model, kind, element)
    quantity.require_meaning(model, index)
    if component is None:
        component = quantity.default
    return ElementParameter(
        kind, element, quantity_name, checked_component("parameter", path, component, quantity.components(model, index))
    )


def as_arguments(values: Mapping[str, float]) -> str:
    """Values of parameters as they are written in a call: "tip_mass=3.0, **{'body:cart:mass': 2.0}"."""
    named = [f"{name}={value!r}" for name, value in values.items() if name.isidentifier()]
    paths = {name: value for name, value in values.items() if not name.isidentifier()}
    return ", ".join([*named, *([f"**{paths}"] if paths else [])])


class Change:
    """At `time` [s] the named parameters take new values, as in Change(3.0, tip_mass=100.0); the state is continuous.

    A parameter whose name is its path is given as Change(3.0, **{"body:tip:mass": 100.0}).
    """

    def __init__(self, time: float, **parameters: float) -> None:
        self.time = finite_number("the time of a change", time, unit="s", error=SimulationError)
        if not parameters:
            raise SimulationError(
                f"the change at t = {time} s names no parameter; write for instance Change({time}, tip_mass=100.0)"
            )
        self.parameters = {name: finite_number(name, value, error=SimulationError) for name, value in parameters.items()}

    def __repr__(self) -> str:
        return f"Change({self.time}, {as_arguments(self.parameters)})"


def ordered(schedule: Sequence[Change]) -> list[Change]:
    """The changes in the order of their times. Raises SimulationError where two happen at once."""
    schedule = items("schedule", schedule, expected="a list of changes", error=SimulationError)
    strange = [change for change in schedule if not isinstance(change, Change)]
    if strange:
        raise SimulationError(
            f"the schedule holds {shown(strange[0])}; expected changes such as invtrack.Change(3.0, tip_mass=100.0)"
        )
    result = sorted(schedule, key=lambda change: change.time)
    for first, second in itertools.pairwise(result):
        if first.time == second.time:
            raise SimulationError(f"two changes at t = {first.time} s; name all parameters in one Change")
    return result
