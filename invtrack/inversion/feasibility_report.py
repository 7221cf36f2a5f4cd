"""What is known about the solvability of exact tracking through parameter jumps, as data and as text."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from invtrack.layout import aligned
from invtrack.linear.zeros import ZeroReport

SAME_SUBSPACE = 1e-7
"""Largest principal angle [rad], in balanced states, between subspaces that count as the same."""

SHOWN = 20
"""How many intervals, and how many jumps, the text lists; the data has them all."""

INTERVAL_COLUMNS = ("from [s]", "to [s]", "rel. degree", "cond B_y", "stable", "antistable", "on axis", "hidden")

JUMP_COLUMNS = ("jump at [s]", "C* same", "compat. rows", "fixed miss", "miss", "ker C* [rad]", "stable [rad]", "antist. [rad]")


@dataclass(frozen=True)
class IntervalReport:
    """One interval from `start` to `end` [s]. zeros: its zeros and relative degree, None where that is not defined.

    problem: why the interval alone already rules the inverse out, or "".
    """

    start: float
    end: float
    zeros: ZeroReport | None
    problem: str

    @property
    def counts(self) -> tuple[int, int, int]:
        """How many zeros are stable, antistable, and on the imaginary axis."""
        found = () if self.zeros is None else self.zeros.zeros
        antistable, on_axis = sum(zero.antistable for zero in found), sum(zero.on_axis for zero in found)
        return len(found) - antistable - on_axis, antistable, on_axis


@dataclass(frozen=True)
class JumpReport:
    """One jump. What cannot be told because some interval has no (hyperbolic) internal dynamics is None.

    Args:
        time: when it happens [s].
        same_outputs: whether relative degree and C* are the same on both sides (assumption 4), so that Lemma 3 holds there.
        subspace_angle: largest principal angle between both sides' internal dynamics ker C*, in balanced states [rad]; NaN where
            the dimensions differ.
        stable_angle, antistable_angle: the same between their stable and between their antistable parts.
        compatibility_rows: how many rows of C* x = Y_d constrain the internal state.
        fixed_miss: by how much the rows that constrain nothing fail, relative to their terms.
        miss: by how much the conditions gathered up to this jump contradict each other, relative to the trajectory.
    """

    time: float
    same_outputs: bool | None
    subspace_angle: float | None
    stable_angle: float | None
    antistable_angle: float | None
    compatibility_rows: int | None
    fixed_miss: float | None
    miss: float | None

    @property
    def same_parts(self) -> bool:
        """Whether the internal dynamics have the same stable and the same antistable subspace on both sides."""
        angles = (self.stable_angle, self.antistable_angle)
        return all(angle is not None and angle <= SAME_SUBSPACE for angle in angles)  # false for NaN


@dataclass(frozen=True)
class BoundaryConditions:
    """The linear equations of Lemma 1, counted and ranked.

    Args:
        unknowns: n_u,0, the number of antistable modes of the inverse (zeros, for as many inputs as outputs) in the first interval.
        end_conditions: n_u,N, that in the last interval.
        compatibility_rows: of all jumps together.
        stable_after: n_s,N, the number of stable modes of the inverse in the last interval.
        freedom: number of directions that the equations leave open.
        conditioning: smallest pivot of the elimination relative to its block (1 is best).
        final_miss: by how much the end conditions fail, relative to the trajectory.
    """

    unknowns: int
    end_conditions: int
    compatibility_rows: int
    stable_after: int
    freedom: int
    conditioning: float
    final_miss: float

    @property
    def generic(self) -> Literal["square", "overdetermined", "underdetermined"]:
        """Unknowns against conditions: what to expect of a system and a reference picked at random."""
        surplus = self.unknowns - self.end_conditions - self.compatibility_rows
        return "square" if surplus == 0 else "underdetermined" if surplus > 0 else "overdetermined"

    @property
    def dependent(self) -> int:
        """How many of the conditions depend on others, so that right-hand sides exist that contradict them.

        Counted to within what the arithmetic resolves: where a mode grows over one interval by more than about 1e9, that it must
        not is a condition of its own there, as if the interval had no end.
        """
        return self.freedom - (self.unknowns - self.end_conditions - self.compatibility_rows)

    @property
    def lemma_4_rank(self) -> int:
        """rank [S_N L_s,N], where no compatibility rows reduce S_N; Lemma 4 asks for n_z = n_s,N + n_u,N.

        The directions that the equations leave open are the intersection of S_N (n_u,0 columns) and L_s,N (n_s,N columns).
        """
        return self.unknowns + self.stable_after - self.freedom


@dataclass(frozen=True)
class FeasibilityReport:
    """Whether a reference can be followed exactly with bounded state and input (Devasia, Paden, Rossi 1996, Lemmas 1 to 4).

    Args:
        solvable: whether `invert` accepts the reference.
        failed: the condition that fails, "" where solvable.
        message: how it fails and what would help, "" where solvable.
        intervals, jumps: a report of each.
        boundary: the equations; None where some interval, or an endless mode of the reference, rules the inverse out.
        remarks: of the plan, where solvable: what to know before it is run, such as how long it rings on.
    """

    solvable: bool
    failed: str
    message: str
    intervals: tuple[IntervalReport, ...]
    jumps: tuple[JumpReport, ...]
    boundary: BoundaryConditions | None
    remarks: tuple[str, ...]

    @property
    def unique(self) -> bool:
        """Whether there is one bounded inverse and no other."""
        return self.solvable and self.boundary is not None and self.boundary.freedom == 0

    @property
    def assumption_4(self) -> bool:
        """Whether relative degree and C* are the same in all intervals."""
        return all(jump.same_outputs is True for jump in self.jumps)

    @property
    def invariant(self) -> bool:
        """Whether even the stable and antistable subspaces never change: then every admissible reference has one inverse."""
        return self.assumption_4 and all(jump.same_parts for jump in self.jumps)

    @property
    def rests(self) -> bool:
        """Whether zeros of the first or last interval lie on the imaginary axis, whose motion has to come to rest."""
        ends = (self.intervals[0].zeros, self.intervals[-1].zeros)
        return any(zeros is not None and bool(zeros.on_axis) for zeros in ends)

    def __str__(self) -> str:
        verdict = "not solvable" if not self.solvable else "solvable, unique" if self.unique else "solvable, not unique"
        lines = [f"Exact output tracking: {verdict}"]
        lines += _table(INTERVAL_COLUMNS, [_interval_cells(interval) for interval in self.intervals[:SHOWN]], len(self.intervals))
        if self.jumps:
            lines += _table(JUMP_COLUMNS, [_jump_cells(jump) for jump in self.jumps[:SHOWN]], len(self.jumps))
        lines += self._lemmas()
        lines += [f"remark: {remark}" for remark in self.remarks]
        return "\n".join([*lines, f"fails: {self.failed}. {self.message}"] if self.failed else lines)

    def _lemmas(self) -> list[str]:
        b = self.boundary
        if b is None:
            return []
        lines = [
            f"Lemma 1: {b.unknowns} unknown(s) (antistable zeros before), {b.end_conditions} end condition(s) (antistable zeros "
            f"after) and {b.compatibility_rows} compatibility condition(s): {b.generic}",
            f"  {b.freedom} free direction(s), {b.dependent} dependent condition(s), smallest pivot {b.conditioning:.1e}, end "
            f"conditions missed by {b.final_miss:.1e}",
        ]
        if not self.assumption_4:
            return [*lines, "Lemmas 3 and 4 do not apply: C* changes at a jump"]
        lines.append("Lemma 3: C* is the same throughout, so the compatibility conditions hold for every smooth enough reference")
        if b.dependent:
            lines.append(f"Lemma 4: rank [S_N L_s,N] falls {b.dependent} short of n_z, so not every reference can be followed")
        else:
            which = "that leaves the zeros on the imaginary axis at rest " if self.rests else ""
            lines.append(f"Lemma 4: rank [S_N L_s,N] = n_z, so every smooth enough reference {which}can be followed")
        if self.jumps and self.invariant:
            lines.append("the stable and antistable subspaces are the same throughout: one inverse for every such reference")
        return lines


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]], total: int) -> list[str]:
    lines = aligned(head, rows)
    return lines if len(rows) == total else [*lines, f"  ... {total - len(rows)} more"]


def _interval_cells(interval: IntervalReport) -> tuple[str, ...]:
    span = (f"{interval.start:.6g}", f"{interval.end:.6g}")
    zeros = interval.zeros
    if zeros is None:
        return (*span, "undefined", *["-"] * 5)
    counts = (*interval.counts, len(zeros.hidden))
    degrees = ", ".join(str(r) for r in zeros.derivatives) + (" *" if zeros.relative_degree is None else "")
    return (*span, degrees, f"{zeros.decoupling_condition:.3g}", *(str(count) for count in counts))


def _jump_cells(jump: JumpReport) -> tuple[str, ...]:
    misses = ("-" if miss is None else f"{miss:.1e}" for miss in (jump.fixed_miss, jump.miss))
    angles = (_angle_cell(angle) for angle in (jump.subspace_angle, jump.stable_angle, jump.antistable_angle))
    same = {True: "yes", False: "no", None: "-"}[jump.same_outputs]
    rows = "-" if jump.compatibility_rows is None else str(jump.compatibility_rows)
    return (f"{jump.time:.6g}", same, rows, *misses, *angles)


def _angle_cell(angle: float | None) -> str:
    if angle is None:
        return "-"
    if math.isnan(angle):
        return "other dim."
    return "same" if angle <= SAME_SUBSPACE else f"{angle:.2g}"
