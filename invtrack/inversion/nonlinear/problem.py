"""What a nonlinear inversion starts from: a mechanism at rest, a reference to rest, changes of parameters on the way."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arguments import items
from invtrack.arrays import Array, ComplexArray, finite_number, shown
from invtrack.errors import BoundednessError, PlanError, RelativeDegreeError, TrajectoryError
from invtrack.inversion.held_outputs import held_outputs
from invtrack.inversion.nonlinear.ends import unstable, zeros_at
from invtrack.inversion.nonlinear.rest import Rest, rest_at_end, rest_with
from invtrack.inversion.smoothness import require_smooth
from invtrack.linear.internal_dynamics import InternalDynamics, format_zeros, internal_dynamics
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SAME_POINT, SwitchedSystem, as_switched
from invtrack.plans.dynamics import Dynamics, Mechanism, ScheduledChange
from invtrack.references.profiles import constant
from invtrack.references.signal import PiecewiseSignal

POSTURES = 33
"""Postures at rest along the reference that lead from its start to its end, at most."""

AWAY = 1e-6
"""The operating point is an equilibrium where the nearest one is no further away (radians, metres, shares of inputs)."""

MOTION = "a plan on a nonlinear motion"


@dataclass(frozen=True, eq=False)
class MotionProblem:
    """A mechanism, a reference and the intervals between changes of parameters, checked to fit each other.

    Args:
        mechanism: what moves.
        reference: outputs from rest to rest, absolute.
        switch_times: of the parameters (N,) [s].
        values: all parameters on each interval.
        dynamics: of each interval.
        rests: at the start, and with the parameters of each interval in the posture in which the reference is in its middle; the
            last one is the end.
    """

    mechanism: Mechanism
    reference: PiecewiseSignal
    switch_times: Array
    values: tuple[Mapping[str, float], ...]
    dynamics: tuple[Dynamics, ...]
    rests: tuple[Rest, ...]

    @classmethod
    def of(
        cls, mechanism: Mechanism, reference: PiecewiseSignal, schedule: Sequence[ScheduledChange], *, exact: bool = True
    ) -> MotionProblem:
        """The problem; raises RelativeDegreeError, TrajectoryError, PlanError for what does not fit.

        exact: whether outputs are to follow the reference exactly, which not all numbers of inputs and not all references allow.
        """
        if exact:
            _require_square(mechanism)
        _require_channels(mechanism, reference)
        times, values = _intervals(mechanism, schedule)
        dynamics = tuple(mechanism.dynamics(each) for each in values)
        first, last = held_outputs(reference, MOTION)
        start = _start(mechanism, dynamics[0], first)
        edges = np.unique(np.concatenate([reference.breakpoints, times]))
        bounds = np.concatenate([edges[:1], times, edges[-1:]])
        rests = [start]
        for k in range(1, len(values)):
            until = edges[-1] if k == len(values) - 1 else (bounds[k] + bounds[k + 1]) / 2
            rests.append(_rest_at(mechanism, dynamics[k], reference, start, float(edges[0]), float(until)))
        if len(values) == 1 and np.any(first != last):
            rests.append(_rest_at(mechanism, dynamics[0], reference, start, float(edges[0]), float(edges[-1])))
        problem = cls(mechanism, reference, times, values, dynamics, tuple(rests))
        if exact:
            problem._require_smooth()
            problem._require_same_zeros()
        return problem

    @property
    def manoeuvre(self) -> tuple[float, float]:
        """(T_i, T_f) [s]: the hull of the reference's breakpoints and of the changes of parameters."""
        edges = self.stops
        return float(edges[0]), float(edges[-1])

    @cached_property
    def stops(self) -> Array:
        """Times [s] at which the motion is not smooth: breakpoints of the reference and changes of parameters."""
        return np.unique(np.concatenate([self.reference.breakpoints, self.switch_times]))

    @cached_property
    def held_outputs(self) -> tuple[Array, Array]:
        """Outputs (p,) held before and after the manoeuvre."""
        return held_outputs(self.reference, MOTION)

    @cached_property
    def motion_size(self) -> Array:
        """Peak to peak of each wanted output over the manoeuvre (p,)."""
        times = np.concatenate([np.linspace(a, b, 200) for a, b in itertools.pairwise(self.stops)] or [self.stops])
        return np.asarray(np.ptp(self.reference(times), axis=0))

    @cached_property
    def linear_models(self) -> tuple[StateSpace, ...]:
        """The linear model at each of `rests`."""
        owners = self.dynamics_of_rests
        return tuple(each.linear_model(rest.point, rest.inputs) for each, rest in zip(owners, self.rests, strict=True))

    @cached_property
    def internals(self) -> tuple[InternalDynamics, ...]:
        """The internal dynamics of each of the linear models."""
        return tuple(internal_dynamics(model) for model in self.linear_models)

    @cached_property
    def zeros(self) -> tuple[ComplexArray, ...]:
        """Invariant zeros at each of `rests` [rad/s], those of coordinates that are no states of the linear models among them."""
        whole = self.linear_models[0].n_states == self.last_dynamics.size
        owners = zip(self.dynamics_of_rests, self.rests, strict=True)
        return tuple(each.zeros for each in self.internals) if whole else tuple(zeros_at(each, rest) for each, rest in owners)

    @property
    def relative_degree(self) -> tuple[int, ...] | None:
        """Of each output at the start; None where there is no vector relative degree."""
        return self.internals[0].form.relative_degree

    @property
    def dynamics_of_rests(self) -> tuple[Dynamics, ...]:
        return self.dynamics if len(self.dynamics) == len(self.rests) else self.dynamics * len(self.rests)

    @property
    def last_dynamics(self) -> Dynamics:
        """Those with which the motion ends."""
        return self.dynamics[-1]

    def model(self, edges: Array) -> SwitchedSystem:
        """The linear models between whose rests the plan lies, switching at edges of its mesh.

        Without changes of parameters that of the start gives way to that of the end in the middle of the manoeuvre.
        """
        models = self.linear_models
        times = self.switch_times
        if len(models) > len(times) + 1:
            middle = sum(self.manoeuvre) / 2
            times = edges[[int(np.argmin(np.abs(edges - middle)))]]
        return SwitchedSystem(models, times)

    def with_stops(self, times: ArrayLike) -> MotionProblem:
        """The same with further stops [s]; what is known of its equilibria, in which these have no part, is kept."""
        other = replace(self, reference=self.reference.refined(times))
        for name in ("linear_models", "zeros", "internals"):
            if name in self.__dict__:
                other.__dict__[name] = self.__dict__[name]
        return other

    def _require_smooth(self) -> None:
        model = self.linear_models[0]
        deviation = self.reference + constant(-model.operating_point.y0, at=self.reference.manoeuvre[0])
        require_smooth(as_switched(model), [self.internals[0]], deviation)

    def _require_same_zeros(self) -> None:
        counts = [unstable(found, _pace(model)) for found, model in zip(self.zeros, self.linear_models, strict=True)]
        for k, count in enumerate(counts):
            if count != counts[0]:
                where = "at the end" if k == len(counts) - 1 else f"with the parameters {dict(self.values[k])}"
                raise BoundednessError(
                    f"no bounded inverse: the posture at the start has {counts[0]} unstable zero(s) "
                    f"({format_zeros(self.zeros[0])}), that {where} has {count} "
                    f"({format_zeros(self.zeros[k])}), so that there are {counts[0]} unknown(s) for {count} condition(s); "
                    "end in a posture like the first, or track another output"
                )


def _pace(model: StateSpace) -> float:
    """How fast the plant is [rad/s]."""
    return float(max(np.max(np.abs(np.linalg.eigvals(model.A))), np.finfo(float).tiny))


def _require_square(mechanism: Mechanism) -> None:
    m, p = len(mechanism.inputs), len(mechanism.outputs)
    if m != p:
        raise RelativeDegreeError(
            f"inversion of a nonlinear plant needs as many inputs as outputs, got {m} inputs {list(mechanism.inputs.names)} for "
            f"{p} output(s) {list(mechanism.outputs.names)}; name fewer inputs in Plant.from_xml, or track further outputs"
        )


def _require_channels(mechanism: Mechanism, reference: object) -> None:
    if not isinstance(reference, PiecewiseSignal):
        raise TrajectoryError(
            "expected a reference such as invtrack.rest_to_rest(0.0, 1.0, duration=2.0) or invtrack.sampled_reference(times, "
            f"values), got {type(reference).__name__}"
        )
    if reference.n_channels != len(mechanism.outputs):
        raise TrajectoryError(
            f"the reference has {reference.n_channels} channels, the plant {len(mechanism.outputs)} outputs "
            f"{list(mechanism.outputs.names)}; stack one signal per output with invtrack.references.stack"
        )


def _intervals(mechanism: Mechanism, schedule: Sequence[ScheduledChange]) -> tuple[Array, tuple[dict[str, float], ...]]:
    """Switch times and the parameters on each interval."""
    changes = items("schedule", schedule, expected="a list of changes, such as invtrack.Change(3.0, tip_mass=1.0)", error=PlanError)
    values: list[dict[str, float]] = [dict(mechanism.parameter_values)]
    times: list[float] = []
    for change in changes:
        if not (hasattr(change, "time") and hasattr(change, "parameters")):
            raise PlanError(f"schedule must hold changes such as invtrack.Change(3.0, tip_mass=1.0), got {shown(change)} in it")
    for change in sorted(changes, key=lambda each: float(each.time)):
        time = finite_number("the time of a change", change.time, unit="s", error=PlanError)
        if times and time == times[-1]:
            raise PlanError(f"two changes at t = {time} s; name all parameters in one Change")
        unknown = [name for name in change.parameters if name not in values[0]]
        if unknown:
            raise PlanError(f"{change} names unknown parameters {unknown}; the plant's are: {', '.join(values[0]) or 'none'}")
        times.append(time)
        values.append({**values[-1], **change.parameters})
    return np.array(times), tuple(values)


def _start(mechanism: Mechanism, dynamics: Dynamics, outputs: Array) -> Rest:
    """The operating point, if it is an equilibrium in which the reference begins; raises PlanError where it is not."""
    point, inputs = mechanism.operating_point
    found = rest_with(dynamics, outputs, Rest(point, inputs, 0.0))
    rates, reached = dynamics.evaluate(point[None], inputs[None])
    call = f"plant = invtrack.trim(plant, outputs={np.round(outputs, 6).tolist()}).plant"
    away = np.abs(dynamics.output_difference(reached[0], outputs))
    if np.any(away > SAME_POINT * np.maximum(1.0, np.abs(outputs))):
        raise PlanError(
            f"the reference begins at {outputs.tolist()}, the plant stands at {reached[0].tolist()}; references are absolute: let "
            f"yours begin there, or plan from where it begins: {call}"
        )
    distance = np.inf
    if found is not None:
        moved = np.concatenate([dynamics.difference(found.point[None], point[None])[0], found.inputs - inputs])
        distance = float(np.max(np.abs(moved) / np.maximum(1.0, np.concatenate([np.zeros(dynamics.size), np.abs(found.inputs)]))))
    if found is None or distance > AWAY:
        raise PlanError(
            f"the operating point of plant {mechanism.name!r} is no equilibrium: its state changes at rates of up to "
            f"{np.max(np.abs(rates)):.3g} (SI units); plan from one: {call}"
        )
    exact = rest_with(dynamics, outputs, found)
    return found if exact is None else exact


def _rest_at(mechanism: Mechanism, dynamics: Dynamics, reference: PiecewiseSignal, start: Rest, begin: float, until: float) -> Rest:
    """The posture at rest that the reference leads to by the time `until` [s], with the parameters of these dynamics.

    Args:
        mechanism: for its name.
        dynamics: with the parameters that count.
        reference: what leads there.
        start: the posture that it leads from.
        begin, until: from when to when it leads [s].
    """

    path = reference(np.linspace(begin, until, POSTURES))
    last, followed = rest_at_end(dynamics, path, start)
    if last is None:
        raise PlanError(
            f"plant {mechanism.name!r} has no equilibrium near the motion with the outputs {path[-1].tolist()} of "
            f"t = {until:.6g} s: followed along the reference, equilibria end at {path[followed].tolist()}; "
            f"invtrack.trim(plant, outputs={np.round(path[-1], 6).tolist()}) says why"
        )
    return last
