"""What the zeros of a plant mean for its inversion: where they lie, which are hidden modes, how much preactuation they cost."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from invtrack.arrays import ComplexArray
from invtrack.layout import aligned
from invtrack.linear.hidden_modes import ZeroKind, zero_kinds
from invtrack.linear.internal_dynamics import format_zeros, internal_dynamics, on_axis
from invtrack.linear.state_space import as_state_space

NEAR_AXIS = 0.1
"""A zero is called near the imaginary axis where |Re| is below this share of its magnitude."""

COLUMNS = ("zero [rad/s]", "side", "time constant [s]", "frequency [rad/s]", "kind")

START_SHARE = 0.01
"""The preactuation time reported runs from where the input has grown to this share of its size at the start of the manoeuvre."""


@dataclass(frozen=True)
class Zero:
    """One invariant zero [rad/s] of a plant: its value, whether it is a hidden mode, and whether it counts as on the axis."""

    value: complex
    kind: ZeroKind
    on_axis: bool

    @property
    def hidden(self) -> bool:
        """Whether the zero is a mode that no input moves or no output shows."""
        return self.kind != "transmission zero"

    @property
    def uncontrollable(self) -> bool:
        """Whether no input moves this mode."""
        return self.kind in ("uncontrollable mode", "uncontrollable and unobservable mode")

    @property
    def antistable(self) -> bool:
        """Whether the zero lies to the right of the imaginary axis."""
        return self.value.real > 0 and not self.on_axis

    @property
    def distance_to_axis(self) -> float:
        """|Re s| [rad/s]."""
        return abs(self.value.real)

    @property
    def near_axis(self) -> bool:
        """Whether an oscillation with this zero fades by little per period (damping ratio below 0.1), though not on the axis."""
        return not self.on_axis and self.distance_to_axis <= NEAR_AXIS * abs(self.value)

    @property
    def time_constant(self) -> float:
        """1 / |Re s| [s], infinite on the axis."""
        return math.inf if self.on_axis else 1 / self.distance_to_axis

    @property
    def frequency(self) -> float:
        """|Im s| [rad/s]."""
        return abs(self.value.imag)


@dataclass(frozen=True)
class ZeroReport:
    """The zeros of a plant, from left to right in the complex plane.

    Args:
        zeros: those that are finite.
        relative_degree: (r_1, ..., r_p), or None where there is no vector relative degree.
        infinite_orders: orders of the zeros at infinity, one for each output; the relative degree, where there is one (p,).
        derivatives: highest derivative of each output that the input needs; the relative degree, where there is one (p,).
        decoupling_condition: condition number of B_y, rows and columns scaled to unit size.
    """

    zeros: tuple[Zero, ...]
    relative_degree: tuple[int, ...] | None
    infinite_orders: tuple[int, ...]
    derivatives: tuple[int, ...]
    decoupling_condition: float

    @property
    def on_axis(self) -> tuple[Zero, ...]:
        """Those that cannot be told from zeros on the imaginary axis: no bounded inverse decays on both sides."""
        return tuple(zero for zero in self.zeros if zero.on_axis)

    @property
    def near_axis(self) -> tuple[Zero, ...]:
        """Those with a damping ratio below 0.1, not on the axis: long preactuation, or long ringing afterwards."""
        return tuple(zero for zero in self.zeros if zero.near_axis)

    @property
    def hidden(self) -> tuple[Zero, ...]:
        """Those that are modes which no input moves or no output shows."""
        return tuple(zero for zero in self.zeros if zero.hidden)

    @property
    def slowest(self) -> Zero | None:
        """The antistable zero nearest the axis, or None.

        Modes that no input moves are left out: the bounded inverse leaves them at rest.
        """
        candidates = [zero for zero in self.zeros if zero.antistable and not zero.uncontrollable]
        return min(candidates, key=lambda zero: zero.distance_to_axis, default=None)

    @property
    def preactuation_time(self) -> float:
        """ln(100) / Re s [s] of the slowest antistable zero s, in which the inverse grows from 1 % to its size; 0 without one."""
        return 0.0 if self.slowest is None else math.log(1 / START_SHARE) * self.slowest.time_constant

    @property
    def degrees(self) -> str:
        """The relative degree as text, or the derivatives that the input needs where there is none."""
        if self.relative_degree is not None:
            return f"relative degree {_tuple(self.relative_degree)}"
        orders, infinite = _tuple(self.derivatives), _tuple(self.infinite_orders)
        return f"no vector relative degree, zeros at infinity of orders {infinite}, input from derivatives up to {orders}"

    def __str__(self) -> str:
        head = f"{len(self.zeros)} zero(s); {self.degrees}, condition number of B_y {self.decoupling_condition:.3g}"
        lines, size = [head], max((abs(zero.value) for zero in self.zeros), default=0.0)
        rows = []
        for zero in self.zeros:
            if zero.value.imag < 0:
                continue  # stands in the line of its conjugate
            side = "on axis" if zero.on_axis else "antistable" if zero.antistable else "stable"
            rows.append((format_zeros(zero.value, size), side, f"{zero.time_constant:.4g}", f"{zero.frequency:.4g}", zero.kind))
        if rows:
            lines += aligned(COLUMNS, rows)
        return "\n".join(lines + self._sentences())

    def _sentences(self) -> list[str]:
        sentences = []
        if self.on_axis:
            sentences.append("  zeros on the imaginary axis: stable inversion serves references that leave nothing moving there")
        if self.near_axis:
            listed = format_zeros([zero.value for zero in self.near_axis])
            sentences.append(f"  near the imaginary axis (damping ratio below {NEAR_AXIS:g}): {listed}")
        if self.slowest is not None:
            sentences.append(
                f"  preactuation: the antistable zero nearest the axis, {format_zeros(_upper(self.slowest.value))}, takes "
                f"{self.preactuation_time:.4g} s to grow from {100 * START_SHARE:g} % to its size at the start of the manoeuvre"
            )
        return sentences


def _tuple(numbers: tuple[int, ...]) -> str:
    return f"({', '.join(map(str, numbers))})"


def _upper(value: complex) -> complex:
    return complex(value.real, abs(value.imag))


def zeros(system: Any) -> ComplexArray:
    """Invariant zeros [rad/s] of a plant with a (right) inverse: the eigenvalues of its internal dynamics, as many as stay as they
    are whatever inputs that are left over do; (n - rho,) of a square plant.

    system: StateSpace, or anything with A, B, C, D. Raises ModelError for a malformed model, RelativeDegreeError where its transfer
    matrix has no inverse.
    """
    return internal_dynamics(as_state_space(system)).zeros


def zero_report(system: Any) -> ZeroReport:
    """The invariant zeros of a plant: on which side of the axis, hidden or not, and the preactuation they imply.

    A zero s is an eigenvalue of the internal dynamics; it is an uncontrollable mode where rank [A - s I, B] < n, an unobservable
    one where rank [A - s I; C] < n, else a transmission zero (Emami-Naeini, Van Dooren 1982). system: StateSpace, or anything with
    A, B, C, D. Zeros on the axis are reported, not refused; `print` shows a table.

    Raises ModelError for a malformed model, RelativeDegreeError where its transfer matrix has no inverse.
    """
    plant = as_state_space(system)
    internal = internal_dynamics(plant)
    kinds = zero_kinds(plant, internal.zeros)
    found = [
        Zero(complex(value), kind, bool(axis)) for value, kind, axis in zip(internal.zeros, kinds, on_axis(internal), strict=True)
    ]
    found.sort(key=lambda zero: (round(zero.value.real, 12), zero.frequency, zero.value.imag))
    form = internal.form
    return ZeroReport(tuple(found), form.relative_degree, form.orders, form.derivatives, form.decoupling_condition)
