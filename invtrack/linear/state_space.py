"""Linear time-invariant models with named channels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arguments import by_name, instance, texts
from invtrack.arrays import Array, finite_number, real_numbers
from invtrack.channels import Channels
from invtrack.errors import ModelError
from invtrack.linear.display import in_a_line, in_html


@dataclass(frozen=True, eq=False)
class OperatingPoint:
    """The point about which a linear model holds, in absolute coordinates.

    x0 is the state from which deviations are measured (for a mechanism: qpos, qvel and activations, so it may be longer than the
    model's state), u0 (m,) the input and y0 (p,) the output at rest, in the units of actuators and sensors. The model is at rest in
    x0 itself unless it says otherwise (`StateSpace.rest`).

    Raises ModelError for what is no vector of finite numbers.
    """

    x0: Array
    u0: Array
    y0: Array

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            object.__setattr__(self, name, _finite_vector(f"an operating point's {name}", value))

    def transformed(self, T: Array) -> OperatingPoint:
        """The same point in the coordinates T x, where x0 is a state of the model's own coordinates; a mechanism's x0 stays."""
        return replace(self, x0=T @ self.x0) if self.x0.shape == T.shape[1:] and np.any(self.x0) else self

    def agrees_with(self, other: OperatingPoint, tolerance: float = 1e-9) -> bool:
        """Whether both points are the same to within `tolerance`, relative to the size of each entry (at least 1)."""
        pairs = ((self.x0, other.x0), (self.u0, other.u0), (self.y0, other.y0))
        return all(a.shape == b.shape and np.allclose(a, b, rtol=tolerance, atol=tolerance) for a, b in pairs)


@dataclass(frozen=True, eq=False, init=False)
class Measurement:
    """What a controller can measure: y_m = y0 + C (x - rest) + D (u - u0).

    C (k, n), D (k, m), k channels (names alone will do), and the values y0 (k,) at rest. Any number of signals k;
    they need not be the outputs that follow a trajectory.

    Raises ModelError for what is no matrix or vector of finite numbers.
    """

    C: Array
    D: Array
    channels: Channels
    y0: Array

    def __init__(self, C: ArrayLike, D: ArrayLike, channels: Channels | Sequence[str], y0: ArrayLike) -> None:
        rest = _finite_vector("a measurement's y0", y0)
        matrices = {"C": _matrix("a measurement's C", C), "D": _matrix("a measurement's D", D)}
        for name, value in {**matrices, "channels": Channels.of(channels), "y0": rest}.items():
            object.__setattr__(self, name, value)


@dataclass(frozen=True, eq=False, repr=False)
class StateSpace:
    """A linear model x' = A (x - rest) + B (u - u0), y = y0 + C (x - rest) + D (u - u0): n states, m inputs and p outputs.

    x is the deviation from the operating point's x0; inputs u and outputs y are absolute. Exact inversion needs at least as many
    inputs as outputs, and some methods as many inputs as outputs; where that is so they say it.

    Args:
        A, B, C, D: (n, n), (n, m), (p, n) and (p, m); D is zero unless stated.
        states, inputs, outputs: names and units, as Channels or names alone; x1, u1, y1 and so on unless stated.
        operating_point: where u0 and y0 come from; None: both are zero.
        rest: the state x (n,) in which the model is at rest with the input u0, zero unless stated: a payload that is picked up
            moves the equilibrium, but not the x0 from which states are measured.
        input_limits: smallest and largest value of each input (m, 2), absolute, infinite where there is none; unlimited unless
            stated.
        measurement: what a controller can measure, the outputs themselves unless stated.
        parameters: values, by name, of the physical parameters that the model holds for, as far as they are known.
        error_estimates: for a model that was found numerically, estimates of the errors of its matrices' entries, by the matrix's
            name: an array of its shape, or a number for all entries. What is exact (position' = velocity) has none.
        left_out: what the real plant has besides and no linear model can have (dry friction, delays), each in words.

    Raises ModelError where shapes do not fit, an entry is not finite, or names are too few, too many or not distinct.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    states: Channels
    inputs: Channels
    outputs: Channels
    operating_point: OperatingPoint
    rest: Array
    input_limits: Array
    measurement: Measurement
    parameters: Mapping[str, float] = field(default_factory=dict)
    error_estimates: Mapping[str, Array] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()

    def __init__(
        self,
        A: ArrayLike,
        B: ArrayLike,
        C: ArrayLike,
        D: ArrayLike | None = None,
        *,
        states: Channels | Sequence[str] | None = None,
        inputs: Channels | Sequence[str] | None = None,
        outputs: Channels | Sequence[str] | None = None,
        operating_point: OperatingPoint | None = None,
        rest: ArrayLike | None = None,
        input_limits: ArrayLike | None = None,
        measurement: Measurement | None = None,
        parameters: Mapping[str, float] | None = None,
        error_estimates: Mapping[str, ArrayLike] | None = None,
        left_out: Sequence[str] = (),
    ) -> None:
        A, B, C = _matrix("A", A), _matrix("B", B), _matrix("C", C)
        D = np.zeros((C.shape[0], B.shape[1])) if D is None else _matrix("D", D)
        n, m, p = A.shape[0], B.shape[1], C.shape[0]
        if min(n, m, p) == 0:
            raise ModelError(f"expected at least one state, input and output, got {n} states, {m} inputs and {p} outputs")
        expected = {"A": (n, n), "B": (n, m), "C": (p, n), "D": (p, m)}
        for name, matrix in (("A", A), ("B", B), ("C", C), ("D", D)):
            if matrix.shape != expected[name]:
                raise ModelError(
                    f"{name} has shape {matrix.shape}, expected {expected[name]} for {n} states, {m} inputs and {p} outputs"
                )
        if operating_point is None:
            operating_point = OperatingPoint(x0=np.zeros(n), u0=np.zeros(m), y0=np.zeros(p))
        expecting = "an OperatingPoint, such as linearize(plant).operating_point"
        instance("operating_point", operating_point, OperatingPoint, expected=expecting, error=ModelError)
        if operating_point.u0.shape != (m,) or operating_point.y0.shape != (p,):
            raise ModelError(
                f"operating point has u0 of shape {operating_point.u0.shape} and y0 of shape {operating_point.y0.shape}, "
                f"expected ({m},) and ({p},)"
            )
        state_at_rest = np.zeros(n) if rest is None else _finite_vector("rest", rest)
        if state_at_rest.shape != (n,):
            raise ModelError(f"rest has shape {state_at_rest.shape}, expected ({n},), one value for each state")
        outputs = _channels("output", "y", outputs, p)
        if measurement is None:
            measurement = Measurement(C, D, outputs, operating_point.y0)
        instance("measurement", measurement, Measurement, expected="an invtrack.linear.Measurement", error=ModelError)
        count = len(measurement.channels)
        if measurement.C.shape != (count, n) or measurement.D.shape != (count, m) or measurement.y0.shape != (count,):
            raise ModelError(
                f"measurement of {count} signals has C {measurement.C.shape}, D {measurement.D.shape} and y0 "
                f"{measurement.y0.shape}, expected ({count}, {n}), ({count}, {m}) and ({count},)"
            )
        values: dict[str, Any] = {
            "A": A,
            "B": B,
            "C": C,
            "D": D,
            "states": _channels("state", "x", states, n),
            "inputs": _channels("input", "u", inputs, m),
            "outputs": outputs,
            "operating_point": operating_point,
            "rest": state_at_rest,
            "input_limits": _limits(input_limits, m),
            "measurement": measurement,
            "parameters": _numbers("parameters", parameters, "values by the names of physical parameters"),
            "error_estimates": _errors(error_estimates, expected),
            "left_out": tuple(texts("left_out", left_out, expected="a list of texts", error=ModelError)),
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def __repr__(self) -> str:
        """What it is, without its matrices."""
        return in_a_line(self)

    def _repr_html_(self) -> str:
        return in_html(self)

    @property
    def n_states(self) -> int:
        """Number of states n."""
        return len(self.A)

    @property
    def n_inputs(self) -> int:
        """Number of inputs m."""
        return len(self.inputs)

    @property
    def n_outputs(self) -> int:
        """Number of outputs p."""
        return len(self.outputs)

    def errors(self, name: str) -> Array:
        """Estimates of the errors of the entries of one of A, B, C and D, zero where there are none."""
        return self.error_estimates.get(name, np.zeros_like(getattr(self, name)))

    def with_outputs(self, outputs: Sequence[str]) -> StateSpace:
        """The system with only these of its outputs, in this order; what a controller can measure stays as it is.

        Raises ModelError for names that are not its outputs, or repeat.
        """
        rows, point = _chosen("outputs", outputs, self.outputs), self.operating_point
        return replace(
            self,
            C=self.C[rows],
            D=self.D[rows],
            outputs=self.outputs.subset(outputs),
            operating_point=replace(point, y0=point.y0[rows]),
            error_estimates={name: e[rows] if name in ("C", "D") else e for name, e in self.error_estimates.items()},
        )

    def with_inputs(self, inputs: Sequence[str]) -> StateSpace:
        """The system with only these of its inputs, in this order; the others stay at the operating point.

        Raises ModelError for names that are not its inputs, or repeat.
        """
        columns, point, measurement = _chosen("inputs", inputs, self.inputs), self.operating_point, self.measurement
        return replace(
            self,
            B=self.B[:, columns],
            D=self.D[:, columns],
            inputs=self.inputs.subset(inputs),
            input_limits=self.input_limits[columns],
            operating_point=replace(point, u0=point.u0[columns]),
            measurement=replace(measurement, D=measurement.D[:, columns]),
            error_estimates={name: e[:, columns] if name in ("B", "D") else e for name, e in self.error_estimates.items()},
        )

    def transformed(self, T: ArrayLike, states: Channels | Sequence[str] | None = None) -> StateSpace:
        """The same system in the coordinates T x (T (n, n), nonsingular): T A T^-1, T B, C T^-1, D."""
        T = _matrix("T", T)
        if T.shape != self.A.shape:
            raise ModelError(f"T has shape {T.shape}, expected {self.A.shape}")
        if np.linalg.cond(T) > 1 / np.finfo(float).eps:
            raise ModelError("T is singular to working precision, so it is no change of coordinates")
        stacked = np.vstack([self.A, self.C, self.measurement.C])
        A, C, C_m = np.split(np.linalg.solve(T.T, stacked.T).T, [self.n_states, self.n_states + self.n_outputs])  # [A; C; C_m] T^-1
        into, back = np.abs(T), np.abs(np.linalg.inv(T))
        errors = {
            "A": into @ self.errors("A") @ back,
            "B": into @ self.errors("B"),
            "C": self.errors("C") @ back,
            "D": self.errors("D"),
        }
        return StateSpace(
            T @ A,
            T @ self.B,
            C,
            self.D,
            states=states,
            inputs=self.inputs,
            outputs=self.outputs,
            operating_point=self.operating_point.transformed(T),
            rest=T @ self.rest,
            input_limits=self.input_limits,
            measurement=replace(self.measurement, C=C_m),
            parameters=self.parameters,
            error_estimates={name: errors[name] for name in self.error_estimates},
            left_out=self.left_out,
        )


def as_state_space(system: Any) -> StateSpace:
    """A StateSpace from anything that has attributes A, B, C and D, such as python-control's and scipy.signal's systems.

    Raises ModelError for a discrete-time system or an object without these attributes.
    """
    if isinstance(system, StateSpace):
        return system
    missing = [name for name in "ABCD" if not hasattr(system, name)]
    if missing:
        raise ModelError(
            f"expected a StateSpace or an object with attributes A, B, C, D; {type(system).__name__} has no {', '.join(missing)}"
            " (linearize a Plant with invtrack.linearize; convert a transfer function to state space first)"
        )
    E = getattr(system, "E", None)
    if E is not None and not np.array_equal(E, np.eye(len(np.atleast_2d(system.A)))):
        raise ModelError(
            "expected x' = A x + B u, got a descriptor system E x' = A x + B u; solve for x' first (E^-1 A, E^-1 B), or "
            "eliminate the states without a derivative where E is singular"
        )
    if getattr(system, "dt", None) not in (None, 0, 0.0):
        raise ModelError(
            f"expected a continuous-time system, got one with sampling time {system.dt}; convert it to continuous time"
        )
    return StateSpace(system.A, system.B, system.C, system.D)


def _matrix(name: str, value: ArrayLike) -> Array:
    matrix = real_numbers(name, value, error=ModelError)
    if matrix.ndim != 2:
        raise ModelError(f"{name} must be a matrix, got an array with {matrix.ndim} dimension(s)")
    if not np.all(np.isfinite(matrix)):
        raise ModelError(f"{name} has entries that are not finite")
    matrix.setflags(write=False)
    return matrix


def _chosen(kind: str, names: Sequence[str], channels: Channels) -> list[int]:
    """Numbers of the channels of these names."""
    chosen = texts(kind, names, expected=f"a list of some of the {kind} {list(channels.names)}", error=ModelError)
    if not chosen or len(set(chosen)) < len(chosen) or any(name not in channels.names for name in chosen):
        raise ModelError(f"expected some of the {kind} {list(channels.names)}, each once, got {list(chosen)}")
    return [channels.names.index(name) for name in chosen]


def _limits(value: ArrayLike | None, m: int) -> Array:
    limits = real_numbers("input_limits", [[-np.inf, np.inf]] * m if value is None else value, error=ModelError)
    if limits.shape != (m, 2) or not np.all(limits[:, 0] <= limits[:, 1]):
        raise ModelError(f"input_limits must be ({m}, 2), lowest before highest, got {limits.tolist()}")
    return limits


def _errors(value: Mapping[str, ArrayLike] | None, shapes: Mapping[str, tuple[int, int]]) -> dict[str, Array]:
    given = {} if value is None else by_name("error_estimates", value, expected="errors by the names of matrices", error=ModelError)
    result = {}
    for name, entry in given.items():
        if name not in shapes:
            raise ModelError(f"error estimates are given for A, B, C and D, got one for {name!r}")
        errors = real_numbers(f"the error estimate of {name}", entry, error=ModelError)
        if errors.shape not in ((), shapes[name]) or not np.all(np.isfinite(errors) & (errors >= 0)):
            raise ModelError(
                f"the error estimate of {name} must be a number or an array of its shape {shapes[name]}, finite and not negative, "
                f"got {entry!r}"
            )
        result[name] = np.array(np.broadcast_to(errors, shapes[name]))
    return result


def _finite_vector(name: str, value: ArrayLike) -> Array:
    vector = real_numbers(name, value, error=ModelError)
    if vector.ndim != 1:
        raise ModelError(f"{name} must be a vector, got an array with {vector.ndim} dimension(s)")
    if not np.all(np.isfinite(vector)):
        raise ModelError(f"{name} has entries that are not finite")
    return vector


def _numbers(name: str, value: Mapping[str, float] | None, expected: str) -> dict[str, float]:
    given = {} if value is None else by_name(name, value, expected=expected, error=ModelError)
    return {key: finite_number(f"{name}[{key!r}]", entry, error=ModelError) for key, entry in given.items()}


def _channels(kind: str, letter: str, given: Channels | Sequence[str] | None, count: int) -> Channels:
    if given is None:
        return Channels.numbered(letter, count)
    names = given.names if isinstance(given, Channels) else None
    if names is None:
        names = texts(f"{kind} names", given, expected=f"a list of {count} names, or Channels", error=ModelError)
    if len(names) != count or len(set(names)) != count:
        raise ModelError(f"expected {count} distinct {kind} names, got {list(names)}")
    return given if isinstance(given, Channels) else Channels(names)
