"""Exosystems: autonomous linear systems whose output is the wanted trajectory, switched at known times."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, get_args

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from invtrack.arguments import flag, items, one_of, texts
from invtrack.arrays import (
    Array,
    Indices,
    finite_number,
    increasing_times,
    real_matrix,
    real_numbers,
    real_vector,
    shown,
    whole_number,
)
from invtrack.errors import TrajectoryError
from invtrack.references.generator import Generator
from invtrack.references.signal import PiecewiseSignal

Outside = Literal["zero", "held"]

LARGEST_DEGREE = 100
"""Of a polynomial exosystem: of higher degree its states, derivatives of the output, differ by more than numbers reach."""


@dataclass(frozen=True, eq=False)
class Exosystem:
    """x_e' = A_e x_e, y_d = C_e x_e, with A_e and C_e constant between known switch times; x_e is continuous there.

    A: N + 1 matrices (q, q); C: N + 1 matrices (p, q); switch_times (N,) [s], may be empty: interval k reaches from t_k to t_(k+1),
    the first from -infinity and the last to infinity. names: of the q states. The switch times need not be those of the plant
    (Devasia, Paden, Rossi 1996, eq. 13).

    Raises TrajectoryError where the numbers do not fit, are not finite, or times do not increase.
    """

    A: tuple[Array, ...]
    C: tuple[Array, ...]
    switch_times: Array
    names: tuple[str, ...]

    def __init__(
        self, A: Sequence[ArrayLike], C: Sequence[ArrayLike], switch_times: ArrayLike = (), *, names: Sequence[str] | None = None
    ) -> None:
        matrices_A, matrices_C = _copies("A_e", A), _copies("C_e", C)
        times = increasing_times("switch times of the exosystem", switch_times)
        if not len(matrices_A) == len(matrices_C) == len(times) + 1:
            raise TrajectoryError(
                f"expected one A_e and one C_e per interval, {len(times) + 1} of each for {len(times)} switch times; got "
                f"{len(matrices_A)} and {len(matrices_C)}"
            )
        q, p = len(matrices_A[0]), len(matrices_C[0])
        for k, (A_e, C_e) in enumerate(zip(matrices_A, matrices_C, strict=True)):
            if A_e.shape != (q, q) or C_e.shape != (p, q) or not (p and q):
                raise TrajectoryError(
                    f"interval {k} of the exosystem has A_e {A_e.shape} and C_e {C_e.shape}, expected ({q}, {q}) and ({p}, {q})"
                )
        given = tuple(f"x_e{i + 1}" for i in range(q)) if names is None else _names(names)
        if len(given) != q or len(set(given)) != q:
            raise TrajectoryError(f"expected {q} distinct names of the exosystem's states, got {list(given)}")
        times.setflags(write=False)
        for name, value in (("A", matrices_A), ("C", matrices_C), ("switch_times", times), ("names", given)):
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        """Number of intervals N + 1."""
        return len(self.A)

    @cached_property
    def numbers(self) -> Indices:
        """Which of the distinct pairs (A_e, C_e) each interval has, (N + 1,)."""
        pairs = [(id(A_e), id(C_e)) for A_e, C_e in zip(self.A, self.C, strict=True)]
        place = {pair: number for number, pair in enumerate(dict.fromkeys(pairs))}
        return np.array([place[pair] for pair in pairs], dtype=np.intp)

    @property
    def n_states(self) -> int:
        """Number of states q."""
        return len(self.names)

    @property
    def n_outputs(self) -> int:
        """Number of outputs p."""
        return len(self.C[0])

    def interval(self, t: ArrayLike) -> Indices:
        """Index of the interval that holds each time; a switch time itself belongs to the interval that it starts."""
        times = real_numbers("times [s]", t)
        if np.any(np.isnan(times)):
            raise TrajectoryError("times [s] must be numbers, got NaN among them")
        return np.searchsorted(self.switch_times, times, side="right")

    def reference(self, x_e: ArrayLike, *, at: float | None = None) -> PiecewiseSignal:
        """The output y_d = C_e x_e (p channels) of the trajectory that passes through x_e (q,) at time `at` [s].

        `at` is the first switch time by default, 0 where nothing switches. Raises TrajectoryError for a state of another size.
        """
        return self._signal(x_e, at, self.C)

    def states(self, x_e: ArrayLike, at: float | None, t: ArrayLike, *, inside: ArrayLike | None = None) -> Array:
        """States (m, q) at times t (m,) [s], or (q,) for a scalar, of the trajectory with x_e at `at`; see `reference`.

        The states are continuous, so `inside` is of no consequence; it is there so that all signals are called alike.
        """
        return self._signal(x_e, at, (np.eye(self.n_states),) * len(self))(t, inside=inside)

    def transition(self, start: float, end: float) -> Array:
        """Phi (q, q) with x_e(end) = Phi x_e(start), over any number of switches and in either direction of time.

        Raises TrajectoryError for times [s] that are not finite, and where Phi is beyond the range of floating-point numbers.
        """
        start, end = finite_number("the start of a transition", start, unit="s"), finite_number("its end", end, unit="s")
        first, last = min(start, end), max(start, end)
        inner = self.switch_times[(self.switch_times > first) & (self.switch_times < last)]
        edges = np.concatenate([[first], inner, [last]])
        if end < start:
            edges = edges[::-1]
        Phi: Array = np.eye(self.n_states)
        for a, b in itertools.pairwise(edges.tolist()):
            with np.errstate(over="ignore", invalid="ignore"):
                angle = self.A[int(self.interval(a / 2 + b / 2))] * (b - a)
                Phi = scipy.linalg.expm(angle) @ Phi if np.all(np.isfinite(angle)) else np.full_like(Phi, np.inf)
        if not np.all(np.isfinite(Phi)):
            raise TrajectoryError(f"from {start} s to {end} s the exosystem's states leave the range of floating-point numbers")
        return Phi

    def resampled(self, switch_times: ArrayLike) -> Exosystem:
        """The same exosystem with its matrices listed for other switch times, which must hold its own ones."""
        times = increasing_times("switch times", switch_times)
        missing = np.setdiff1d(self.switch_times, times)
        if missing.size:
            raise TrajectoryError(f"the switch times {missing.tolist()} of the exosystem are not among the new ones")
        owner = self.interval(np.concatenate([[-np.inf], times]))
        return Exosystem([self.A[k] for k in owner], [self.C[k] for k in owner], times, names=self.names)

    def transformed(self, T: ArrayLike, *, names: Sequence[str] | None = None) -> Exosystem:
        """The same exosystem in the coordinates T x_e (T (q, q), nonsingular): T A_e T^-1, C_e T^-1."""
        matrix = real_matrix("T", T)
        q = self.n_states
        if matrix.shape != (q, q) or not np.linalg.cond(matrix) <= 1 / np.finfo(float).eps:
            raise TrajectoryError(f"T must be a nonsingular ({q}, {q}) matrix, got shape {matrix.shape}")
        return self._mapped(
            lambda A_e: np.asarray(np.linalg.solve(matrix.T, (matrix @ A_e).T).T, dtype=float),
            lambda C_e: np.asarray(np.linalg.solve(matrix.T, C_e.T).T, dtype=float),
            names=names,
        )

    def weighted(self, weights: ArrayLike) -> Exosystem:
        """The same outputs from the states w x_e, weights w (q,), not negative; exact where they are powers of two.

        States of weight 0, which no output may show, stand still.
        """
        given = real_vector("weights", weights, self.names)
        if np.any(given < 0):
            raise TrajectoryError(f"weights must not be negative, got {given.tolist()}")
        seen = given > 0
        w = np.where(seen, given, 1.0)
        return self._mapped(lambda A_e: np.where(seen[:, None] & seen, A_e / w * w[:, None], 0.0), lambda C_e: C_e / w)

    def _mapped(
        self, A_of: Callable[[Array], Array], C_of: Callable[[Array], Array], *, names: Sequence[str] | None = None
    ) -> Exosystem:
        """The exosystem with other matrices, worked out once for pairs that recur, so that they stay the same."""
        first = np.unique(self.numbers, return_index=True)[1]
        A, C = [A_of(self.A[k]) for k in first], [C_of(self.C[k]) for k in first]
        names = self.names if names is None else names
        return Exosystem([A[k] for k in self.numbers], [C[k] for k in self.numbers], self.switch_times, names=names)

    def shifted(self, delay: float) -> Exosystem:
        """The same exosystem `delay` seconds later."""
        delay = finite_number("delay", delay, unit="s")
        return Exosystem(self.A, self.C, self.switch_times + delay, names=self.names)

    def _signal(self, x_e: ArrayLike, at: float | None, rows: Sequence[Array]) -> PiecewiseSignal:
        """rows[k] x_e(t) in interval k: piece by piece forward and backward from `at`."""
        x, time = real_vector("the exosystem's state", x_e, self.names), self._reference_time(at)
        edges = self.switch_times if len(self) > 1 else np.array([time])
        owner = np.concatenate([[0], self.interval(edges)])
        numbers: dict[tuple[int, int], int] = {}
        keys = [(id(self.A[k]), id(rows[k])) for k in owner]
        kind = np.array([numbers.setdefault(key, len(numbers)) for key in keys], dtype=np.intp)
        first = [keys.index(key) for key in numbers]
        generators = tuple(Generator(self.A[owner[j]], rows[owner[j]]) for j in first)
        return PiecewiseSignal(edges, generators, kind, self._anchors(x, time, edges, generators, kind))

    def _anchors(self, x: Array, at: float, edges: Array, generators: Sequence[Generator], kind: Indices) -> Array:
        """States at the start of each piece, of piece 0 at its end."""
        states = np.empty((len(edges), len(x)))
        after = int(np.searchsorted(edges, at))  # the first edge not before `at`

        def carried(state: Array, piece: int, length: float) -> Array:
            generator = generators[kind[piece]]
            if not abs(length) <= generator.horizon:
                raise TrajectoryError(
                    f"the exosystem's state cannot be followed over {abs(length):.3g} s: rounding of such times hides what it does "
                    f"beyond {generator.horizon:.3g} s; give it at a time closer by"
                )
            with np.errstate(over="ignore", invalid="ignore"):  # refused by the signal
                result: Array = generator.propagator(length).states(state[np.newaxis], np.array([abs(length)]))[0]
            return result

        state, time = x, at
        for j in range(after, len(edges)):
            state, time = carried(state, j, edges[j] - time), edges[j]
            states[j] = state
        state, time = x, at
        for j in range(after - 1, -1, -1):
            state, time = carried(state, j + 1, edges[j] - time), edges[j]
            states[j] = state
        return np.concatenate([states[:1], states])

    def _reference_time(self, at: float | None) -> float:
        if at is None:
            return float(self.switch_times[0]) if len(self) > 1 else 0.0
        return finite_number("the time at which the exosystem's state is given", at, unit="s")


def exosystem(
    A_e: ArrayLike,
    C_e: ArrayLike,
    *,
    start: float | None = None,
    end: float | None = None,
    outside: Outside = "zero",
    names: Sequence[str] | None = None,
) -> Exosystem:
    """x_e' = A_e x_e, y_d = C_e x_e between `start` and `end`; outside x_e stands still (A_e = 0).

    Args:
        A_e, C_e: (q, q) and (p, q).
        start, end: when it starts and ends [s]; None: it runs for ever on that side.
        outside: the output there: "zero" (C_e = 0), or "held" at its value.
        names: of the q states; x_e1, x_e2 and so on unless stated.

    Raises TrajectoryError where shapes or times do not fit.
    """
    one_of("outside", outside, get_args(Outside), error=TrajectoryError)
    start = None if start is None else finite_number("start", start, unit="s")
    end = None if end is None else finite_number("end", end, unit="s")
    if start is not None and end is not None and not end > start:
        raise TrajectoryError(f"end must be after start, got start {start} and end {end}")
    A, C = real_matrix("A_e", A_e), real_matrix("C_e", C_e)
    idle = (np.zeros_like(A), np.zeros_like(C) if outside == "zero" else C)
    before, after = [idle] * (start is not None), [idle] * (end is not None)
    intervals = [*before, (A, C), *after]
    times = [time for time in (start, end) if time is not None]
    return Exosystem([A for A, _ in intervals], [C for _, C in intervals], times, names=names)


def _copies(name: str, matrices: Sequence[ArrayLike]) -> tuple[Array, ...]:
    """Copies that cannot be written to; one that recurs stays one, so that what is worked out for it is worked out once."""
    known: dict[int, Array] = {}
    matrices = items(name, matrices, expected="a list of matrices, one for each interval", error=TrajectoryError)
    for value in matrices:
        if id(value) not in known:
            known[id(value)] = real_matrix(name, value)
            known[id(value)].setflags(write=False)
    return tuple(known[id(value)] for value in matrices)


def sinusoidal_exosystem(
    frequencies: ArrayLike, *, bias: bool = True, start: float | None = None, end: float | None = None, outside: Outside = "zero"
) -> Exosystem:
    """y_d = b + sum_i x_i, x_i' = w_i x_i^+, x_i^+' = -w_i x_i: sinusoids of any amplitude and phase, and a constant if `bias`.

    States: "bias" first, then for each frequency x_i, "cos w", and x_i^+, "sin w", each named after the signal that it makes where
    it is 1 at t = 0 and all others are 0.

    Args:
        frequencies: w_i > 0 [rad/s].
        bias: whether the output has the constant part b.
        start, end, outside: see `exosystem`.

    Raises TrajectoryError for frequencies that are not positive and distinct.
    """
    omegas, bias = np.atleast_1d(real_numbers("frequencies", frequencies)), flag("bias", bias, error=TrajectoryError)
    if omegas.ndim != 1 or not np.all(np.isfinite(omegas) & (omegas > 0)) or len(np.unique(omegas)) != len(omegas):
        raise TrajectoryError(f"frequencies must be positive and distinct [rad/s], got {shown(frequencies)}")
    blocks = [np.zeros((1, 1))] * bias + [np.array([[0.0, omega], [-omega, 0.0]]) for omega in omegas.tolist()]
    if not blocks:
        raise TrajectoryError("expected at least one frequency, or a bias")
    rows = [np.ones(1)] * bias + [np.array([1.0, 0.0])] * len(omegas)
    names = ["bias"] * bias + [f"{kind} {omega:.12g}" for omega in omegas.tolist() for kind in ("cos", "sin")]
    return exosystem(scipy.linalg.block_diag(*blocks), np.concatenate(rows), start=start, end=end, outside=outside, names=names)


def polynomial_exosystem(
    degree: int, *, start: float | None = None, end: float | None = None, outside: Outside = "zero"
) -> Exosystem:
    """y_d a polynomial of time of the degree stated: its states are y_d, y_d', ..., y_d^(degree).

    start, end, outside: see `exosystem`. Raises TrajectoryError for a degree that is no whole number from 0 to 100.
    """
    degree = whole_number("degree", degree, highest=LARGEST_DEGREE)
    names = ["value", *(f"derivative {k}" for k in range(1, degree + 1))]
    first = np.eye(1, degree + 1)
    return exosystem(np.eye(degree + 1, k=1), first, start=start, end=end, outside=outside, names=names)


def step_exosystem(*, start: float | None = None, end: float | None = None, outside: Outside = "zero") -> Exosystem:
    """y_d constant, of any value: `polynomial_exosystem` of degree 0."""
    return polynomial_exosystem(0, start=start, end=end, outside=outside)


def sum_exosystems(parts: Sequence[Exosystem]) -> Exosystem:
    """One exosystem whose states are those of all `parts` and whose output is the sum of theirs.

    Names that occur twice are told apart by the number of their part ("2: bias"). Raises TrajectoryError where the numbers of
    outputs differ, or for no parts.
    """
    parts = _exosystems(parts)
    if len({part.n_outputs for part in parts}) > 1:
        raise TrajectoryError(f"cannot add exosystems with {[part.n_outputs for part in parts]} outputs")
    return _side_by_side(parts, lambda *rows: np.hstack(rows))


def stack_exosystems(parts: Sequence[Exosystem]) -> Exosystem:
    """One exosystem whose states and outputs are those of all `parts`: for a plant with several outputs. See `sum_exosystems`."""
    parts = _exosystems(parts)
    return _side_by_side(parts, scipy.linalg.block_diag)


def _side_by_side(parts: Sequence[Exosystem], join_rows: Callable[..., Array]) -> Exosystem:
    times = np.unique(np.concatenate([part.switch_times for part in parts]))
    aligned = [part.resampled(times) for part in parts]
    names = [name for part in parts for name in part.names]
    if len(set(names)) < len(names):
        names = [f"{i}: {name}" for i, part in enumerate(parts, start=1) for name in part.names]
    A = [scipy.linalg.block_diag(*(part.A[k] for part in aligned)) for k in range(len(times) + 1)]
    C = [join_rows(*(part.C[k] for part in aligned)) for k in range(len(times) + 1)]
    return Exosystem(A, C, times, names=names)


def _exosystems(parts: Sequence[Exosystem]) -> list[Exosystem]:
    listed = items("parts", parts, expected="a list of exosystems", error=TrajectoryError)
    strangers = [type(part).__name__ for part in listed if not isinstance(part, Exosystem)]
    if not listed or strangers:
        raise TrajectoryError(f"expected at least one exosystem and nothing else, got {strangers or 'none'}")
    return listed


def _names(names: Sequence[str]) -> tuple[str, ...]:
    return texts("names", names, expected="a list of names of the exosystem's states", error=TrajectoryError)
