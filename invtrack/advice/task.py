"""What is asked: a plant, a motion, and what is acceptable; checked once, with the sizes that everything is measured in."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import mujoco
import numpy as np

from invtrack.advice.move import Move
from invtrack.advice.program import DIGITS, Line, Name, decimal, rounded
from invtrack.arguments import by_name
from invtrack.arrays import Array, finite_number, real_number, require_not_negative, require_share, shown
from invtrack.errors import PlanError, PlantError, RelativeDegreeError
from invtrack.linear.switched import SwitchedSystem, as_switched
from invtrack.linear.zeros import zero_report
from invtrack.plant import Plant, linearize
from invtrack.redesign import Limits
from invtrack.redesign.limits import Bound, bounds_of
from invtrack.references import PiecewiseSignal
from invtrack.simulation.parameter_factors import with_parameter

ROOM_FOR_FEEDBACK = 0.03
"""Share of each limit's distance from rest that plans within limits leave to the feedback."""

QUANTITIES = (("body", "mass"), ("joint", "stiffness"), ("tendon", "stiffness"))
"""What is off where one number is given for the errors of all parameters of a mechanism that names none."""


@dataclass(frozen=True, eq=False)
class Task:
    """Args:

    subject: what was given: a Plant, or a linear model.
    plant: the Plant, with the parameters that may be off, or None where a linear model stands for it.
    model: the linear model.
    reference: a Move, or a signal.
    error: largest |y - y_d| that is acceptable, as a share of the motion.
    limits: what must never be exceeded, None where nothing is limited.
    off: what the plant may be besides: factors of parameters by a readable name, or linear models.
    max_preactuation: [s].
    timestep: of the runs [s].
    """

    subject: Any
    plant: Plant | None
    model: SwitchedSystem
    reference: Move | PiecewiseSignal
    error: float
    limits: Limits | None
    off: Mapping[str, Mapping[str, float] | SwitchedSystem]
    max_preactuation: float
    timestep: float

    @classmethod
    def of(
        cls,
        subject: Any,
        reference: Move | PiecewiseSignal,
        *,
        error: float,
        limits: Limits | None,
        parameter_errors: float | Mapping[str, Any],
        max_preactuation: float | None,
        timestep: float,
    ) -> Task:
        """Checked. Raises PlanError for what does not fit, and what `linearize` and `Limits` raise."""
        require_share("error, a share of the motion such as 0.01,", error, error=PlanError)
        if max_preactuation is not None:
            require_not_negative("max_preactuation", max_preactuation, error=PlanError)
        if not 0 < real_number("timestep", timestep, unit="s", error=PlanError) < math.inf:
            raise PlanError(f"timestep must be a positive, finite time [s], got {timestep}")
        if not isinstance(reference, Move | PiecewiseSignal):
            raise PlanError(
                f"reference must be a Move(by, duration) or a signal such as rest_to_rest makes, got {shown(reference)}"
            )
        plant = subject if isinstance(subject, Plant) else None
        off = _off(plant, parameter_errors)
        if plant is not None:
            for factors in off.values():
                for name in factors:
                    plant, _ = with_parameter(plant, name)
        model = as_switched(linearize(plant) if plant is not None else subject)
        if plant is None:
            off = {name: _alike(model, name, other) for name, other in off.items()}
        count = len(reference.by) if isinstance(reference, Move) else reference.n_channels
        if count != model.n_outputs:
            raise PlanError(f"expected a motion of the {model.n_outputs} output(s) {model.outputs}, got one of {count}")
        if limits is None and np.any(np.isfinite(model.input_limits)):
            limits = Limits(input=tuple(model.input_limits.T))
        if limits is not None:
            bounds_of(limits, model)
        return cls(
            subject=subject,
            plant=plant,
            model=model,
            reference=reference,
            error=float(error),
            limits=limits,
            off=off,
            max_preactuation=math.inf if max_preactuation is None else float(max_preactuation),
            timestep=float(timestep),
        )

    @cached_property
    def start(self) -> Array:
        """Where the outputs stand (p,)."""
        return np.asarray(self.model.operating_point.y0)

    @cached_property
    def moved(self) -> Array:
        """How far each output moves (p,)."""
        if isinstance(self.reference, Move):
            return np.abs(self.reference.by)
        return np.asarray(np.ptp(self.reference(np.linspace(*self.reference.manoeuvre, 1001)), axis=0))

    @cached_property
    def motion(self) -> Array:
        """How far each output counts as moving (p,); where it stays still, the largest motion of those with its unit, or of all."""
        moved = self.moved
        if not np.any(moved):  # it holds still while something else happens: every unit counts as a motion
            return np.ones(len(moved))
        units = np.array(self.model.outputs.units)
        alike = np.array([np.max(moved[units == unit]) for unit in units])
        return np.where(moved > 0, moved, np.where(alike > 0, alike, np.max(moved)))

    @property
    def duration(self) -> float:
        """How long the motion may take [s]."""
        if isinstance(self.reference, Move):
            return self.reference.duration
        return self.reference.manoeuvre[1] - self.reference.manoeuvre[0]

    def reference_lines(self, duration: float, smoothness: int | None, *, target: str = "reference") -> tuple[Line, ...]:
        """The line that makes the reference; none where it was given as a signal."""
        if not isinstance(self.reference, Move):
            return ()
        start, end = self.start, self.start + self.reference.by
        ends = [decimal(start[0]), decimal(end[0])] if len(start) == 1 else [decimal(start), decimal(end)]
        return (Line(target, "invtrack.rest_to_rest", ends, {"duration": duration, "smoothness": smoothness}),)

    @cached_property
    def least_smoothness(self) -> int:
        """That of the model, see `least_smoothness`."""
        return least_smoothness(self.model)

    @cached_property
    def sizes(self) -> tuple[Array, Array]:
        """About how far states (n,) and inputs (m,) go in such a motion: their response to the outputs at s = (1/2 + j) pi / T.

        Off the axis, so that no undamped mode or zero stands in the way.
        """
        system = self.model.systems[-1]
        s = (0.5 + 1j) * np.pi / self.duration
        X = np.linalg.solve(s * np.eye(system.n_states) - system.A, system.B.astype(complex))
        inputs = np.linalg.pinv(system.C @ X + system.D)
        u = np.abs(inputs) @ self.motion
        x = np.abs(X @ inputs) @ self.motion
        largest = float(np.max(u))
        return rounded_array(x), rounded_array(np.where(u > 1e-6 * largest, u, largest or 1.0))

    @cached_property
    def bounds(self) -> tuple[Bound, ...]:
        """The limits as rows of [x; u; y]."""
        return () if self.limits is None else bounds_of(self.limits, self.model)

    @cached_property
    def planned_limits(self) -> Limits | None:
        """The limits less what is left to the feedback."""
        if self.limits is None:
            return None
        point, share = self.model.operating_point, 1 - ROOM_FOR_FEEDBACK
        rests = {"input": point.u0, "input_rate": np.zeros(len(point.u0)), "output": self.start}
        narrowed: dict[str, Any] = {}
        for name, rest in rests.items():
            low, high = _sides(getattr(self.limits, name), len(rest))
            if name == "output":  # planned outputs reach their end, whatever is left to the feedback
                narrowed[name] = (low, high)
            else:
                narrowed[name] = (_towards(rest, low, share), _towards(rest, high, share))
        return Limits(**{name: pair for name, pair in narrowed.items() if np.any(np.isfinite(pair))}, states=self.limits.states)


def least_smoothness(model: SwitchedSystem) -> int:
    """Derivatives of a motion that have to vanish at its ends for the inverse's input to be continuous; 2 without an inverse."""
    try:
        return max(max(zero_report(system).derivatives, default=1) for system in model.distinct)
    except RelativeDegreeError:
        return 2


def rounded_array(values: Array) -> Array:
    """Values to the digits that a program shows."""
    return np.array(rounded(values), dtype=float)


def subject_lines(task: Task) -> tuple[Line, ...]:
    """The linear model of a Plant; nothing where the model was given."""
    return (Line("model", "invtrack.linearize", [Name("plant")]),) if task.plant is not None else ()


def _towards(rest: Array, side: Array, share: float) -> Array:
    """Limits moved towards rest, rounded towards it, too."""
    with np.errstate(invalid="ignore"):
        moved = rest + share * (side - rest)
    return np.where(np.isfinite(side), np.round(moved, DIGITS + 2), side)


def _sides(value: Any, count: int) -> tuple[Array, Array]:
    low, high = value if isinstance(value, tuple) else (-np.asarray(value, dtype=float), value)
    return tuple(np.broadcast_to(np.asarray(side, dtype=float), count) for side in (low, high))  # type: ignore[return-value]


def _off(plant: Plant | None, errors: Any) -> dict[str, Any]:
    """What the plant may be besides, by a readable name: factors of parameters, or what was given in place of a linear model."""
    if plant is None:
        none = isinstance(errors, int | float) and errors == 0
        expected = "other linear models by their names"
        return {} if none else dict(by_name("parameter_errors", errors, expected=expected, error=PlanError))
    if not isinstance(errors, Mapping):
        share = finite_number("parameter_errors", errors, error=PlanError)
        errors = dict.fromkeys(parameters_that_matter(plant), share) if share else {}
    shares = by_name("parameter_errors", errors, expected="shares by the names or paths of parameters", error=PlanError)
    found: dict[str, Any] = {}
    for name, share in shares.items():
        if not 0 < finite_number(f"the error of {name!r}", share, error=PlanError) < 1:
            raise PlanError(f"the error of {name!r} must be a share of its value between 0 and 1, such as 0.1, got {share}")
        for sign in (-1, 1):
            found[f"{name} {100 * sign * share:+g} %"] = {name: 1 + sign * share}
    return found


def _alike(model: SwitchedSystem, name: str, other: Any) -> SwitchedSystem:
    """Another linear model that the plant may be; raises PlanError where it has other channels."""
    found = as_switched(other)
    if not all(getattr(found, kind).fits(getattr(model, kind)) for kind in ("states", "inputs", "outputs")):
        raise PlanError(
            f"the model {name!r} in parameter_errors has other states, inputs or outputs than the one that is planned for"
        )
    return found


def parameters_that_matter(plant: Plant) -> list[str]:
    """Those that the plant names, or else the masses of bodies that move and the stiffnesses of joints and tendons, by their paths.

    Raises PlantError where there are none.
    """
    if plant.parameters:
        return list(plant.parameters)
    model = plant.model
    kinds = {
        "body": [i for i in range(1, model.nbody) if model.body_weldid[i] and model.body_mass[i] > 0],
        "joint": [i for i in range(model.njnt) if np.any(model.jnt_stiffness[i])],
        "tendon": [i for i in range(model.ntendon) if np.any(model.tendon_stiffness[i])],
    }
    objects = {"body": mujoco.mjtObj.mjOBJ_BODY, "joint": mujoco.mjtObj.mjOBJ_JOINT, "tendon": mujoco.mjtObj.mjOBJ_TENDON}
    names = [
        f"{kind}:{name}:{quantity}"
        for kind, quantity in QUANTITIES
        for i in kinds[kind]
        if (name := mujoco.mj_id2name(model, objects[kind], i))
    ]
    if not names:
        raise PlantError(
            f"plant {plant.name!r} has no named body, joint or tendon whose mass or stiffness could be off; name the parameters: "
            'parameter_errors={"body:load:mass": 0.1}'
        )
    return names
