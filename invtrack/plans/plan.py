"""The planned trajectory that every method returns: input, state and output over all of time, with its certificate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arguments import instance
from invtrack.arrays import Array, Indices, Refusal
from invtrack.errors import PlanError
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.certificate import Certificate
from invtrack.plans.linearizations import Linearizations
from invtrack.plans.ringing import Ringing
from invtrack.plans.trajectory import Trajectory
from invtrack.references.signal import PiecewiseSignal, finite_times

Difference = Callable[[Array, Array], Array]

LEAST_NODES, ALL_NODES = 5, 8192
"""Times per piece, ends included, at which an input is looked at: at least, and of all pieces together unless that is fewer."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Values of a plan at given times.

    Args:
        time: (m,) [s].
        x: states (m, n), as deviations from the operating point before all jumps.
        u: inputs (m, p), absolute.
        y, y_d: planned and wanted outputs (m, p), absolute.
    """

    time: Array
    x: Array
    u: Array
    y: Array
    y_d: Array


@dataclass(frozen=True, eq=False, repr=False)
class Plan:
    """Input, state and output that a method plans for a reference, over all of time.

    Args:
        method: its name.
        model: the plant that it was planned for.
        reference: the wanted output y_d.
        trajectory: [x; u; y] as deviations from the rest of the interval of the model in which each piece lies.
        manoeuvre: (T_i, T_f) [s], the hull of the reference's breakpoints and of the plant's jumps.
        preactuation, postactuation: how long before T_i and after T_f [s] the plan differs from rest by more than `tolerance`.
        tolerance: what counts as rest, as a share of the peak of each state and input.
        certificate: how well the plan meets its own equations.
        remarks: what a user should know about the solution (for instance that it was not unique).
        difference: x minus x_ref in the plant's own way, both (n,), where plain subtraction will not do (angles that turn round,
            quaternions); None: plain subtraction.
        ringing: what lightly damped modes make of the input after the manoeuvre; None where there is none to speak of.
        linearizations: of a nonlinear plant, all along the planned motion; None where `model` stands for them.
    """

    method: str
    model: SwitchedSystem
    reference: PiecewiseSignal
    trajectory: Trajectory
    manoeuvre: tuple[float, float]
    preactuation: float
    postactuation: float
    tolerance: float
    certificate: Certificate
    remarks: tuple[str, ...] = ()
    difference: Difference | None = None
    ringing: Ringing | None = None
    linearizations: Linearizations | None = None

    def __repr__(self) -> str:
        """What it is, without its arrays."""
        (low, high), (T_i, T_f) = self.input_range, self.manoeuvre
        rings = (
            "" if self.ringing is None else f", rings on for {self.ringing.duration:.4g} s at {self.ringing.share:.2g} of its peak"
        )
        inputs = ", ".join(f"{name} {a:.4g} to {b:.4g}" for name, a, b in zip(self.model.inputs.names, low, high, strict=True))
        return (
            f"<{type(self).__name__} by {self.method}: manoeuvre {T_i:.6g} to {T_f:.6g} s, preactuation {self.preactuation:.4g} s, "
            f"postactuation {self.postactuation:.4g} s, {inputs}{rings}>"
        )

    @property
    def schedule(self) -> tuple[tuple[float, dict[str, float]], ...]:
        """When which physical parameters take other values: (time [s], {name: new value}), as the model switches.

        The values before the first change are `model.parameters`; empty where the models do not know what they hold for.
        """
        return self.model.schedule

    @property
    def start(self) -> float:
        """Time [s] at which the plan leaves rest: T_i - preactuation."""
        return self.manoeuvre[0] - self.preactuation

    @property
    def end(self) -> float:
        """Time [s] at which the plan has come to rest: T_f + postactuation."""
        return self.manoeuvre[1] + self.postactuation

    @cached_property
    def input_range(self) -> tuple[Array, Array]:
        """Lowest and highest value of each input from start to end of the plan, both (m,): known before a simulation."""
        times, inside = dense_times(np.unique(np.concatenate([[self.start], self.breakpoints, [self.end]])))
        u = self.inputs(times, inside=inside)
        return u.min(axis=0), u.max(axis=0)

    @cached_property
    def rest_inputs(self) -> Array:
        """Inputs (2, m) at rest before and after the manoeuvre, absolute; NaN where the plan goes on moving for ever."""
        edges, n = self.breakpoints[[0, -1]], self.model.n_states
        rows = slice(n, n + self.model.n_inputs)
        rest = replace(self, trajectory=self.trajectory.settled()).inputs(edges, inside=edges + np.array([-1.0, 1.0]))
        for end, tail in enumerate((self.trajectory.before, self.trajectory.after)):
            if not tail.holds_still and np.any(tail.X_w[rows] @ tail.S):
                rest[end] = np.nan
        return rest

    @property
    def breakpoints(self) -> Array:
        """Times [s] at which the plan is not smooth: switch times and the reference's breakpoints."""
        return self.trajectory.breakpoints

    @cached_property
    def _interval(self) -> Indices:
        """The interval of the model in which each piece of the trajectory lies, by its middle (m + 2,)."""
        return intervals_of_pieces(self.model, self.trajectory.breakpoints)

    def _pieces(self, t: ArrayLike, inside: ArrayLike | None) -> tuple[Array, Indices, Indices]:
        """Times (m,) [s], and of each its piece of the trajectory and its interval of the model."""
        times, within = finite_times(t, inside)
        piece = self.trajectory.locate(within)
        return times, piece, self._interval[piece]

    def departures(self, t: ArrayLike, *, inside: ArrayLike | None = None) -> Samples:
        """Values at times t (m,) [s], all of them as deviations from the rest of the interval in force; see __call__."""
        times, piece, interval = self._pieces(t, inside)
        n, m = self.model.n_states, self.model.n_inputs
        x, u, y = np.split(self.trajectory(times, piece), [n, n + m], axis=1)
        return Samples(times, x, u, y, self.reference(times, inside=inside) - self.model.rest_outputs.take(interval, axis=0))

    def states(self, t: ArrayLike, *, inside: ArrayLike | None = None) -> Array:
        """States (k, n) at times t (k,) [s], as deviations from the operating point before all jumps; see __call__."""
        times, piece, interval = self._pieces(t, inside)
        return self.trajectory(times, piece, slice(0, self.model.n_states)) + self.model.rest_states.take(interval, axis=0)

    def inputs(self, t: ArrayLike, *, inside: ArrayLike | None = None) -> Array:
        """Inputs (k, m) at times t (k,) [s]; see __call__."""
        times, piece, interval = self._pieces(t, inside)
        n, m = self.model.n_states, self.model.n_inputs
        return self.trajectory(times, piece, slice(n, n + m)) + self.model.rest_inputs.take(interval, axis=0)

    def inputs_with(self, K: Array, t: ArrayLike, *, inside: ArrayLike | None = None) -> Array:
        """u + K x (k, m) at times t (k,) [s], for K (m, n) and states as deviations from the operating point; see __call__."""
        times, piece, interval = self._pieces(t, inside)
        model = self.model
        rows = np.hstack([K, np.eye(model.n_inputs), np.zeros((model.n_inputs, model.n_outputs))])
        rest = model.rest_inputs + model.rest_states @ K.T
        return self.trajectory.mapped(rows)(times, piece) + rest.take(interval, axis=0)

    def __call__(self, t: ArrayLike, *, inside: ArrayLike | None = None) -> Samples:
        """Values at times t (k,) [s]; `inside` names, by times within them, the pieces meant where a side matters."""
        times, piece, interval = self._pieces(t, inside)
        n, m, model = self.model.n_states, self.model.n_inputs, self.model
        x, u, y = np.split(self.trajectory(times, piece), [n, n + m], axis=1)
        return Samples(
            time=times,
            x=x + model.rest_states.take(interval, axis=0),
            u=u + model.rest_inputs.take(interval, axis=0),
            y=y + model.rest_outputs.take(interval, axis=0),
            y_d=self.reference(times, inside=inside),
        )


def dense_times(edges: Array) -> tuple[Array, Array]:
    """Times (k,) over the pieces between edges (m + 1,) [s], and for each one inside its piece.

    Dense at the pieces' ends, where an input peaks, both sides of a jump included.
    """
    if len(edges) == 1:  # a motion that runs for ever without a breakpoint: the one time it names
        edges = np.repeat(edges, 2)
    middle, half = (edges[:-1] + edges[1:]) / 2, np.diff(edges) / 2
    count = max(LEAST_NODES, ALL_NODES // len(middle))
    nodes = np.cos(np.linspace(np.pi, 0.0, count))
    return (middle[:, None] + half[:, None] * nodes).ravel(), np.repeat(middle, count)


def intervals_of_pieces(model: SwitchedSystem, edges: Array) -> Indices:
    """The interval of the model in which each piece before, between and after the edges (m + 1,) lies, by its middle (m + 2,)."""
    first = np.searchsorted(model.switch_times, edges[:1], side="left")
    last = np.searchsorted(model.switch_times, edges[-1:], side="right")
    return np.concatenate([first, model.interval(edges[:-1] + np.diff(edges) / 2), last])


def require_plan(value: object, *, error: Refusal = PlanError) -> None:
    """Raises `error` for what is no plan."""
    instance("plan", value, Plan, expected="a Plan, such as invtrack.invert(model, reference)", error=error)
