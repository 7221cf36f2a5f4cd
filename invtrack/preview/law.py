"""What a plan that looks ahead makes of the future: z_b = Phi z_f + phi, phi from the outputs that are known and from the jumps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg

from invtrack.arrays import Array
from invtrack.errors import BoundednessError, CompatibilityError
from invtrack.linear.state_sizes import unit_ratios
from invtrack.linear.switched import SwitchedSystem
from invtrack.preview.chain_driven import ChainDriven
from invtrack.preview.output_chain import OutputChain

SOLVABLE = 1e-9
"""Ratio of singular values below which what the future asks at a jump does not fix z_b before it."""

CONSISTENT = 1e-7
"""Share of its terms by which what is prescribed at a jump may miss."""


@dataclass(frozen=True, eq=False)
class Junction:
    """The jump from one interval to the next, for any state and any future.

    With v = [z_f; z_b; zeta; 1] right before it (zeta absolute) z_f right after it is `forward` v. A future that asks for
    z_b = Phi z_f + phi right after it asks for z_b = `ahead` z_f + phi_before right before it, where
    phi_before = `back` phi + `offset` [zeta; 1]; it is `held` [zeta; 1] where the outputs go on from there as polynomials
    through all later jumps.

    forward (n_f, .), ahead (n_b, n_f), back (n_b, n_b), offset and held (n_b, q + 1).
    """

    forward: Array
    ahead: Array
    back: Array
    offset: Array
    held: Array


@dataclass(frozen=True, eq=False)
class PreviewLaw:
    """A method on a switched plant, solved from the future: what it asks of z_b at any time.

    Args:
        method: its name.
        plant: the model.
        chain: of its outputs.
        intervals: of each interval of the plant (N + 1,); those that recur are the same object.
        keeps_state: whether a new plan begins in the state x that the last one has reached, or with its z_f, so that x may jump.
    """

    method: str
    plant: SwitchedSystem
    chain: OutputChain
    intervals: Sequence[ChainDriven]
    keeps_state: bool

    @cached_property
    def extension(self) -> Array:
        """[zeta; 1]' = extension [zeta; 1] where the outputs go on as polynomials (q + 1, q + 1)."""
        return np.pad(self.chain.shift, (0, 1))

    @cached_property
    def junctions(self) -> tuple[Junction, ...]:
        """Of each switch, from the last one back.

        Raises CompatibilityError and BoundednessError where the state before a jump and the future after it do not fix the plan.
        """
        found: list[Junction] = []
        n_b, n_f = len(self.intervals[-1].G_b), len(self.intervals[-1].G_f)
        Phi, Q = np.zeros((n_b, n_f)), np.zeros((n_b, self.chain.size + 1))
        for k in range(len(self.plant.switch_times) - 1, -1, -1):
            junction = self._junction(k, Phi, Q)
            found.append(junction)
            if k:
                duration = float(self.plant.switch_times[k] - self.plant.switch_times[k - 1])
                decay_f, decay_b = self.intervals[k].decays(duration)
                Phi, Q = decay_b @ junction.ahead @ decay_f, decay_b @ junction.held @ self.extended(duration)
        return tuple(reversed(found))

    def extended(self, duration: float) -> Array:
        """[zeta; 1] after a time [s] in which the outputs go on as polynomials (q + 1, q + 1)."""
        return np.asarray(scipy.linalg.expm(self.extension * duration))

    def until_jump(self, interval: int, time: float) -> float | None:
        """Time [s] left of an interval; None of the last one."""
        times = self.plant.switch_times
        return None if interval == len(times) else float(times[interval]) - time

    def slope(self, interval: int, time: float) -> Array | None:
        """Phi (n_b, n_f) at a time [s] in an interval; None where it is zero, after the last jump."""
        left = self.until_jump(interval, time)
        if left is None:
            return None
        decay_f, decay_b = self.intervals[interval].decays(left)
        return np.asarray(decay_b @ self.junctions[interval].ahead @ decay_f)

    def phi_of(self, interval: int, time: float) -> Array:
        """phi = (these rows) [zeta; 1] at a time [s] from which on the outputs go on as polynomials (n_b, q + 1)."""
        left = self.until_jump(interval, time)
        if left is None:
            return np.zeros((len(self.intervals[interval].G_b), self.chain.size + 1))
        _, decay_b = self.intervals[interval].decays(left)
        return np.asarray(decay_b @ self.junctions[interval].held @ self.extended(left))

    def forward_state(self, interval: int, Phi: Array | None, x: Array, phi: Array, zeta: Array) -> Array:
        """z_f for a state and what the future asks for.

        Args:
            interval: of the plant.
            Phi, phi: z_b = Phi z_f + phi; None: Phi is zero.
            x: the state (n,), as deviation from the operating point's x0.
            zeta: the outputs and their derivatives (q,), absolute.
        """
        each, n = self.intervals[interval], self.plant.n_states
        J_f, J_b = (part.J[:n] for part in (each.system.forward, each.system.backward))
        onto = J_f if Phi is None else J_f + J_b @ Phi
        rhs = x - each.plant.rest - J_b @ phi - each.J_zeta[:n] @ (zeta - each.rest)
        return np.asarray(scipy.linalg.solve(onto, rhs))

    def response(self, interval: int, Phi: Array | None) -> Array:
        """By how much [x; u; y] change (n + m + p, n_b) with phi, for the z_f, or the state, that a new plan begins with."""
        each = self.intervals[interval]
        X_f, X_b = each.columns
        if not self.keeps_state:
            return X_b
        n = self.plant.n_states
        J_f, J_b = (part.J[:n] for part in (each.system.forward, each.system.backward))
        if Phi is None:
            return np.asarray(X_b - X_f @ scipy.linalg.solve(J_f, J_b))
        moved = scipy.linalg.solve(J_f + J_b @ Phi, J_b)
        return np.asarray(X_b - (X_f + X_b @ Phi) @ moved)

    def _junction(self, k: int, Phi: Array, Q: Array) -> Junction:
        """That of switch k, for Phi and phi = Q [zeta; 1] right after it."""
        before, after = self.intervals[k], self.intervals[k + 1]
        rho, n_f = after.system.prescribed, after.system.forward.size
        shift = np.zeros(len(after.J_zeta))
        shift[: self.plant.n_states] = self.plant.shifts[k]
        Delta = np.column_stack([before.J_zeta - after.J_zeta, shift - before.J_zeta @ before.rest + after.J_zeta @ after.rest])
        J = np.hstack([before.system.forward.J, before.system.backward.J, Delta])
        if rho:  # what is continuous is then the state alone
            uncancelled = np.abs(before.J_zeta) + np.abs(after.J_zeta), np.abs(before.J_zeta @ before.rest) + np.abs(shift)
            sizes = np.column_stack([np.abs(J[:, : -Delta.shape[1]]), *uncancelled])
            likely = np.max(unit_ratios(self.plant)[:, :, None] * sizes, axis=1)
            self._require_compatible(k, np.abs(after.system.T[:rho] @ J), np.abs(after.system.T[:rho]) @ likely)
        T_f, T_b = after.system.T[rho : rho + n_f], after.system.T[rho + n_f :]
        asked = T_b - Phi @ T_f
        M = asked @ before.system.backward.J
        self._require_fixed(k, M)
        onward = asked @ np.hstack([before.system.forward.J, Delta])
        solved = scipy.linalg.solve(M, np.hstack([np.eye(len(M)), -onward])) if M.size else np.zeros((0, len(M) + onward.shape[1]))
        back, ahead, offset = np.split(solved, [len(M), len(M) + before.system.forward.size], axis=1)
        return Junction(T_f @ J, ahead, back, offset, back @ Q + offset)

    def _require_compatible(self, k: int, miss: Array, terms: Array) -> None:
        """Raises CompatibilityError for rows of what is prescribed that miss by more than rounding of their terms."""
        if np.any(miss > CONSISTENT * terms):
            raise CompatibilityError(
                f"the outputs and their derivatives are other functions of the state after the jump at "
                f"t = {self.plant.switch_times[k]:.6g} s than before it: what exact tracking asks there cannot be met by a plan "
                "that is made as the reference becomes known; use invtrack.invert with the whole reference, or a redesign"
            )

    def _require_fixed(self, k: int, M: Array) -> None:
        if M.shape[0] != M.shape[1]:
            raise BoundednessError(
                f"a plan that looks ahead needs as many antistable zeros before a jump as after it, got {M.shape[1]} before and "
                f"{M.shape[0]} after t = {self.plant.switch_times[k]:.6g} s; use invtrack.invert with the whole reference, or a "
                "redesign"
            )
        if M.size:
            row = np.linalg.norm(M, axis=1, keepdims=True)
            sizes = np.linalg.svd(M / np.where(row > 0, row, 1.0), compute_uv=False)
            if sizes[-1] <= SOLVABLE * sizes[0]:
                raise BoundednessError(
                    f"what keeps the internal state bounded after the jump at t = {self.plant.switch_times[k]:.6g} s does not fix "
                    "it before the jump; change the parameters or the time of the jump, or use a redesign"
                )
