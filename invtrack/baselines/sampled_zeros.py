"""The inverse of a sampled plant: what its zeros are, and the states and held inputs that follow a sampled output."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from invtrack.arrays import Array, ComplexArray
from invtrack.errors import PlanError
from invtrack.linear.invariant_parts import InvariantParts, invariant_parts
from invtrack.linear.propagation import zero_order_hold
from invtrack.linear.state_space import StateSpace
from invtrack.linear.state_units import plant_units

MAGNIFIED = 0.1
"""Rounding of the states may grow to this share of them by A_z: what it leaves can then be solved for again."""

REFINEMENTS = 1
"""How often what rounding leaves of the equations is solved for again: much, where one hold hardly moves the next sample."""


@dataclass(frozen=True, eq=False)
class SampledInverse:
    """What y_k asks of x_(k+1) = A_d x_k + B_d u_k, y_k = C x_k + D u_k: x_(k+1) = A_z x_k + (y), u_k = (y_(k + lead) - f x_k) / g.

    f = C A_d, g = C B_d and lead = 1, or f = C, g = D and lead = 0 where the input reaches the output at once. The eigenvalues of
    A_z = A_d - B_d f / g are the zeros, and `lead` times 0.

    Args:
        A_d, B_d, C: in `units` of the states, (n, n), (n,), (n,).
        f, g, lead: (n,), a number, 0 or 1.
        units: of the states (n,).
    """

    A_d: Array
    B_d: Array
    C: Array
    f: Array
    g: float
    lead: int
    units: Array

    @classmethod
    def of(cls, system: StateSpace, hold: float) -> SampledInverse:
        """That of a plant with one input and one output whose input is held for `hold` [s].

        Raises PlanError where the input of one hold does nothing to the next sample of the output.
        """
        units = plant_units(system)
        A_d, B = zero_order_hold(system.A * units / units[:, np.newaxis], system.B / units[:, np.newaxis], hold)
        B_d, C, D = B[:, 0], (system.C * units)[0], float(system.D[0, 0])
        lead = 0 if D else 1
        f, g = (C @ A_d, float(C @ B_d)) if lead else (C, D)
        if not abs(g) * MAGNIFIED > np.finfo(float).eps * float(np.linalg.norm(g * A_d - np.outer(B_d, f), 1)):
            raise PlanError(
                f"an input held for {hold:.6g} s moves the next sample of the output by no more than rounding does, so no inverse "
                "of the sampled plant can be worked out; take a longer hold, or an input that is nearer to the output"
            )
        return cls(A_d, B_d, C, f, g, lead, units)

    @cached_property
    def zero_dynamics(self) -> Array:
        """A_z (n, n)."""
        return self.A_d - np.outer(self.B_d, self.f / self.g)

    @cached_property
    def zeros(self) -> ComplexArray:
        """Of the sampled plant (n - lead,)."""
        values = np.linalg.eigvals(self.zero_dynamics).astype(complex)
        return np.delete(values, np.argmin(np.abs(values))) if self.lead else values

    @cached_property
    def _parts(self) -> InvariantParts:
        """Zeros in or on the unit circle, and those outside."""
        return invariant_parts(self.zero_dynamics, lambda z: abs(z) <= 1)

    def followed(self, steps: Array, static: Array) -> tuple[Array, Array]:
        """States x_k (m + 1, n) and inputs u_k (m,) whose output takes these steps y_(k+1) - y_k (m,), from rest at 0 to rest.

        The steady state X_0 y_k, U_0 y_k and what x_k, u_k are off it, which steps of y alone drive: where y rests, nothing is left
        to rounding.

        static: [X_0; U_0] (n + 1,), which holds the output at 1.
        """
        X_0, U_0, y = static[:-1] / self.units, static[-1], np.append(0.0, np.cumsum(steps))
        driving = np.outer(steps, -X_0)  # as A_d X_0 + B_d U_0 = X_0
        missed, x, u = driving, np.zeros((len(y), len(X_0))), np.zeros(len(driving))
        for _ in range(1 + REFINEMENTS):
            more_x, more_u = self._corrected(missed)
            x, u = x + more_x, u + more_u
            missed = driving + x[:-1] @ self.A_d.T + np.outer(u, self.B_d) - x[1:]
        return (np.outer(y, X_0) + x) * self.units, U_0 * y[:-1] + u

    def _corrected(self, missed: Array) -> tuple[Array, Array]:
        """x (m + 1, n) and u (m,) of x_(k+1) = A_d x_k + B_d u_k + missed_k that the output does not show.

        What belongs to zeros inside the unit circle runs forward from rest, what belongs to those outside backward from rest.
        """
        seen = self.lead * (missed @ self.C) / self.g
        parts, driving, m = self._parts, missed - np.outer(seen, self.B_d), len(missed)
        forward, backward = driving @ parts.L_1.T, driving @ parts.L_2.T
        z_1, z_2 = np.zeros((m + 1, forward.shape[1])), np.zeros((m + 1, backward.shape[1]))
        for k in range(m):
            z_1[k + 1] = parts.A_1 @ z_1[k] + forward[k]
        back = np.linalg.solve(parts.A_2, np.eye(len(parts.A_2)))
        for k in range(m - 1, -1, -1):
            z_2[k] = back @ (z_2[k + 1] - backward[k])
        x = z_1 @ parts.W_1.T + z_2 @ parts.W_2.T
        return x, -(x[:-1] @ self.f) / self.g - seen
