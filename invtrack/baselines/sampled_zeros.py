"""The inverse of a sampled plant: what its zeros are, and the recursion of its states that follows a sampled output."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from invtrack.arrays import Array, ComplexArray
from invtrack.errors import PlanError
from invtrack.linear.invariant_parts import invariant_parts
from invtrack.linear.propagation import zero_order_hold
from invtrack.linear.state_space import StateSpace
from invtrack.linear.state_units import plant_units

NO_HOLD = 1e-14
"""What one hold does to the output, as a share of what it does to the states that the output shows: below, it does nothing."""


@dataclass(frozen=True, eq=False)
class SampledInverse:
    """x_(k+1) = A_z x_k + b y_(k + lead), u_k = (y_(k + lead) - f x_k) / g: the states and held inputs of which y_k is the output.

    From x_(k+1) = A_d x_k + B_d u_k, y_k = C x_k + D u_k, with f, g = C A_d, C B_d and lead 1, or C, D and lead 0 where the input
    reaches the output at once. The eigenvalues of A_z = A_d - B_d f / g are the zeros, and `lead` times 0.

    Args:
        A_z, b, f, g, lead: (n, n), (n,), (n,), a number, 0 or 1.
        zeros: of the sampled plant (n - lead,).
        units: of the states in which A_z is to be taken apart (n,).
    """

    A_z: Array
    b: Array
    f: Array
    g: float
    lead: int
    zeros: ComplexArray
    units: Array

    @classmethod
    def of(cls, system: StateSpace, hold: float) -> SampledInverse:
        """That of a plant with one input and one output whose input is held for `hold` [s].

        Raises PlanError where the input of one hold does nothing to the next sample of the output.
        """
        units = plant_units(system)
        A_d, B_d = zero_order_hold(system.A * units / units[:, np.newaxis], system.B / units[:, np.newaxis], hold)
        C, feedthrough = (system.C * units)[0], float(system.D[0, 0])
        lead = 0 if feedthrough else 1
        f, g = (C @ A_d, float(C @ B_d[:, 0])) if lead else (C, feedthrough)
        if not abs(g) > NO_HOLD * float(np.abs(C) @ np.abs(B_d[:, 0])):
            raise PlanError(
                f"an input held for {hold:.6g} s leaves the next sample of the output where it was, so the sampled plant has no "
                "inverse; choose another hold"
            )
        A_z = A_d - np.outer(B_d[:, 0], f / g)
        zeros = np.linalg.eigvals(A_z).astype(complex)
        if lead:
            zeros = np.delete(zeros, np.argmin(np.abs(zeros)))
        b = B_d[:, 0] / g
        return cls(A_z, b, f, g, lead, zeros, units)

    def followed(self, y: Array) -> tuple[Array, Array]:
        """States x_k (m + 1, n) and inputs u_k (m,) whose output is y (m + lead,), from rest at 0 to rest at its last value.

        What belongs to zeros inside the unit circle runs forward from rest, what belongs to those outside backward from rest.
        """
        parts = invariant_parts(self.A_z, lambda z: abs(z) <= 1)
        driving = y[self.lead :]
        drive_1, drive_2 = np.outer(driving, parts.L_1 @ self.b), np.outer(driving, parts.L_2 @ self.b)
        m = len(driving)
        z_1, z_2 = np.zeros((m + 1, len(parts.A_1))), np.zeros((m + 1, len(parts.A_2)))
        for k in range(m):
            z_1[k + 1] = parts.A_1 @ z_1[k] + drive_1[k]
        if len(parts.A_2):
            unit = np.eye(len(parts.A_2))
            z_2[m] = np.linalg.solve(unit - parts.A_2, drive_2[-1])
            back = scipy.linalg.solve(parts.A_2, unit)
            for k in range(m - 1, -1, -1):
                z_2[k] = back @ (z_2[k + 1] - drive_2[k])
        x = z_1 @ parts.W_1.T + z_2 @ parts.W_2.T
        return x * self.units, (driving - x[:-1] @ self.f) / self.g
