"""The planned trajectory that every method returns: input, state and output over all of time, with its certificate."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invtrack.linear.propagation import Propagator
from invtrack.linear.switched import SwitchedSystem
from invtrack.references.signal import PiecewiseSignal, selection

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TwoSidedGenerator:
    """A piece whose decaying part runs forward from its start and whose growing part runs backward from its end.

    values = X_f v_f + X_b v_b with v_f' = M_f v_f given at the start and v_b' = M_b v_b given at the end; each is integrated in the
    direction in which it does not grow, so that no exponential overflows. values stacks [x; u; y] (n + 2 p).
    """

    M_f: Array
    X_f: Array
    M_b: Array
    X_b: Array

    @cached_property
    def propagators(self) -> tuple[Propagator, Propagator]:
        """Those of the forward and of the backward part."""
        return Propagator(self.M_f), Propagator(-self.M_b)


@dataclass(frozen=True, eq=False)
class TwoSidedTrajectory:
    """Pieces of TwoSidedGenerators on all of time: breakpoints (m + 1,), m + 2 pieces as in PiecewiseSignal.

    kind (m + 2,): generator of each piece; v_f (m + 2, .) at the start, v_b (m + 2, .) at the end of each piece, padded with zeros.
    Piece 0 has a backward part only, the last piece a forward part only.
    """

    breakpoints: Array
    generators: tuple[TwoSidedGenerator, ...]
    kind: NDArray[np.intp]
    v_f: Array
    v_b: Array

    def locate(self, t: ArrayLike) -> NDArray[np.intp]:
        """Index of the piece that holds each time; a breakpoint belongs to the piece on its right."""
        return np.searchsorted(self.breakpoints, np.asarray(t, dtype=float), side="right")

    def __call__(self, times: Array, piece: NDArray[np.intp], rows: slice = slice(None)) -> Array:
        """Stacked values at times (m,) taken in the pieces (m,) stated, all or some of their rows: (m, n + 2 p)."""
        result = np.empty((len(times), len(self.generators[0].X_f[rows])))
        since = np.maximum(times - self.breakpoints[np.maximum(piece - 1, 0)], 0.0)
        until = np.maximum(self.breakpoints[np.minimum(piece, len(self.breakpoints) - 1)] - times, 0.0)
        kind = self.kind[piece]
        for index, g in enumerate(self.generators):
            chosen = selection(kind == index)
            if chosen is None:
                continue
            forward, backward = g.propagators
            resolution = 4 * float(np.spacing(np.max(np.abs(times[chosen]))))
            if g.M_f.size:
                values = forward.outputs(
                    g.X_f[rows], self.v_f[:, : len(g.M_f)], piece[chosen], since[chosen], resolution=resolution
                )
                result[chosen] = values
            else:
                result[chosen] = 0.0
            if g.M_b.size:
                values = backward.outputs(
                    g.X_b[rows], self.v_b[:, : len(g.M_b)], piece[chosen], until[chosen], resolution=resolution
                )
                result[chosen] += values
        return result


@dataclass(frozen=True)
class Certificate:
    """How well a planned trajectory meets its conditions, measured from its values alone, not from how it was found.

    dynamics_residual: largest |x(b) - x(a) - integral of A x + B u| over panels, relative to each state's peak.
    output_error: largest |C x + D u - wanted output| (and whether the planned y says the same), relative to the peak of the wanted
    motion.
    continuity: largest jump of a state at a breakpoint, relative to its peak.
    rest_residual: largest distance of a state from rest (or from its bounded particular solution) at the ends of the trajectory,
    relative to its peak.
    """

    dynamics_residual: float
    output_error: float
    continuity: float
    rest_residual: float


@dataclass(frozen=True, eq=False)
class Samples:
    """Values at given times: x (m, n) deviations from the operating point, u (m, p) and y, y_d (m, p) absolute."""

    time: Array
    x: Array
    u: Array
    y: Array
    y_d: Array


@dataclass(frozen=True, eq=False, repr=False)
class Plan:
    """Input, state and output that a method plans for a reference, on all of time.

    method: its name. model: the plant it was planned for. reference: the wanted output y_d. manoeuvre: (T_i, T_f) [s], the hull of
    the reference's breakpoints and of the plant's jumps. preactuation, postactuation: how long before T_i and after T_f [s] it
    differs from rest by more than `tolerance`, relative to the peak of each state and input. remarks: what a user should know
    about the solution (for instance that it was not unique).
    """

    method: str
    model: SwitchedSystem
    reference: PiecewiseSignal
    trajectory: TwoSidedTrajectory
    manoeuvre: tuple[float, float]
    preactuation: float
    postactuation: float
    tolerance: float
    certificate: Certificate
    remarks: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """What it is, without its arrays."""
        (low, high), (T_i, T_f) = self.input_range, self.manoeuvre
        inputs = ", ".join(f"{name} {a:.4g} to {b:.4g}" for name, a, b in zip(self.model.inputs.names, low, high, strict=True))
        return (
            f"<{type(self).__name__} by {self.method}: manoeuvre {T_i:.6g} to {T_f:.6g} s, preactuation {self.preactuation:.4g} s, "
            f"postactuation {self.postactuation:.4g} s, {inputs}>"
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
        """Lowest and highest value of each input from start to end of the plan, both (p,): known before a simulation."""
        edges = np.unique(np.concatenate([[self.start], self.breakpoints, [self.end]]))
        if len(edges) == 1:  # a motion that runs for ever without a breakpoint: its value at the one time it names
            edges = np.repeat(edges, 2)
        middle, half = (edges[:-1] + edges[1:]) / 2, np.diff(edges) / 2
        per_piece = max(64, 4096 // len(middle) + 1)
        nodes = np.cos(
            np.linspace(0.0, np.pi, per_piece)
        )  # dense at the ends, where the input peaks, both sides of a jump included
        u = self.inputs((middle[:, None] + half[:, None] * nodes).ravel(), inside=np.repeat(middle, per_piece))
        return u.min(axis=0), u.max(axis=0)

    @property
    def breakpoints(self) -> Array:
        """Times [s] at which the plan is not smooth: switch times and the reference's breakpoints."""
        return self.trajectory.breakpoints

    def states(self, t: ArrayLike, *, inside: ArrayLike | None = None) -> Array:
        """States (m, n) at times t (m,) [s], as deviations from the operating point; see __call__."""
        return self._rows(t, inside, slice(0, self.model.n_states))

    def inputs(self, t: ArrayLike, *, inside: ArrayLike | None = None) -> Array:
        """Inputs (m, p) at times t (m,) [s]; see __call__."""
        n, p = self.model.n_states, self.model.n_channels
        return self._rows(t, inside, slice(n, n + p)) + self.model.operating_point.u0

    def _rows(self, t: ArrayLike, inside: ArrayLike | None, rows: slice) -> Array:
        times = np.atleast_1d(np.asarray(t, dtype=float))
        within = times if inside is None else np.broadcast_to(np.asarray(inside, dtype=float), times.shape)
        return self.trajectory(times, self.trajectory.locate(within), rows)

    def __call__(self, t: ArrayLike, *, inside: ArrayLike | None = None) -> Samples:
        """Values at times t (m,) [s]; `inside` names, by times within them, the pieces meant where a side matters."""
        times = np.atleast_1d(np.asarray(t, dtype=float))
        within = times if inside is None else np.broadcast_to(np.asarray(inside, dtype=float), times.shape)
        values = self.trajectory(times, self.trajectory.locate(within))
        first = self.model.systems[0]
        n, p = first.n_states, first.n_channels
        point = first.operating_point
        return Samples(
            time=times,
            x=values[:, :n],
            u=values[:, n : n + p] + point.u0,
            y=values[:, n + p :] + point.y0,
            y_d=self.reference(times, inside=within),
        )
