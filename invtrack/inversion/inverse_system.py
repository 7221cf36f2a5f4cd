"""The inverse of a linear plant as a two-sided system: the tracking law and the split internal dynamics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from invtrack.linear.internal_dynamics import SplitDynamics, split_dynamics
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.two_sided import DrivenSystem, Part, TwoSidedSystem
from invtrack.references.signal import Generator

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Correction:
    """The term v = feedback V eta + feedforward [zeta_d; y_d^(r)] of u = B_y^-1 (y_d^(r) - A_x x + v), which gives up exactness.

    feedback (p, n) acts on the state's distance V eta from P zeta_d, feedforward (p, rho + p) on the wanted output's derivatives.
    """

    feedback: Array
    feedforward: Array


@dataclass(frozen=True, eq=False)
class InverseSystem:
    """x = P zeta_d + V (W_s z_s + W_u z_u), u = B_y^-1 (y_d^(r) - A_x x + v): z_s forward, z_u backward.

    What is continuous through a jump is the state x (n,). Without a correction v = 0 and the outputs' derivatives zeta = C* x are
    prescribed; a modified inverse prescribes none (Devasia 1996, eqs. 7-9 and 12; Devasia, Paden, Rossi 1996, eqs. 3-5).
    """

    plant: StateSpace
    split: SplitDynamics
    correction: Correction
    system: TwoSidedSystem

    @classmethod
    def of(cls, plant: StateSpace, split: SplitDynamics, correction: Correction | None = None) -> InverseSystem:
        """The inverse of `plant` with these internal dynamics, which take account of the correction."""
        form = split.internal.form
        if correction is None:
            rho, p = sum(form.relative_degree), plant.n_channels
            correction = Correction(np.zeros((p, plant.n_states)), np.zeros((p, rho + p)))
        x_s, x_u = form.V @ split.W_s, form.V @ split.W_u
        T = np.vstack([form.C_star, split.L_s @ form.N, split.L_u @ form.N])
        system = TwoSidedSystem(
            Part(split.A_s, _values(plant, split, x_s, correction.feedback @ x_s), x_s),
            Part(split.A_u, _values(plant, split, x_u, correction.feedback @ x_u), x_u),
            T,
            len(form.C_star),
        )
        return cls(plant, split, correction, system)

    def driven(self, generator: Generator) -> DrivenSystem:
        """The inverse for outputs y_d = R w, w' = S w."""
        form = self.split.internal.form
        derivatives = [generator.derivative(k) for k in range(max(form.relative_degree) + 1)]
        zeta_rows = [derivatives[k][i] for i, r in enumerate(form.relative_degree) for k in range(r)]
        Z = np.array(zeta_rows).reshape(-1, len(generator.S))
        highest = np.array([derivatives[r][i] for i, r in enumerate(form.relative_degree)])
        drive = np.vstack([Z, highest])
        return DrivenSystem(
            system=self.system,
            S=generator.S,
            D_f=self.split.G_s @ drive,
            D_b=self.split.G_u @ drive,
            X_w=_values(self.plant, self.split, form.P @ Z, highest + self.correction.feedforward @ drive),
            J_w=form.P @ Z,
        )


def split_each(plant: SwitchedSystem) -> tuple[SplitDynamics, ...]:
    """Split internal dynamics of each interval; models that recur share them.

    Zeros on the imaginary axis are refused in the first and the last interval, which have no end; over the others they stay
    bounded. Raises NonHyperbolicError, RelativeDegreeError.
    """
    endless = {id(plant.systems[0]), id(plant.systems[-1])}
    return plant.map(lambda system: split_dynamics(system, endless=id(system) in endless))


def _values(plant: StateSpace, split: SplitDynamics, x_rows: Array, y_r_rows: Array) -> Array:
    """Rows of [x; u; y] from those of x and of y_d^(r) + v."""
    F, G = split.internal.form.tracking_law()
    u_rows = F @ x_rows + G @ y_r_rows
    return np.vstack([x_rows, u_rows, plant.C @ x_rows + plant.D @ u_rows])
