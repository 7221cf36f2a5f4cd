"""The inverse of a plant as a two-sided system: the internal dynamics, driven by the outputs that are wanted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from invtrack.arrays import Array
from invtrack.errors import RelativeDegreeError
from invtrack.inversion.tracking_values import tracking_values
from invtrack.linear.internal_dynamics import InternalDynamics, SplitDynamics, split_dynamics
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.two_sided import DrivenSystem, Part, Settled, TwoSidedSystem, settled_states
from invtrack.plans.two_sided_problem import Driveable
from invtrack.references.generator import Generator


class Inverse(Driveable, Protocol):
    """An inverse of one interval: with as many inputs as outputs or with more, exact or modified."""

    @property
    def internal(self) -> InternalDynamics:
        """The plant's internal dynamics."""
        ...


@dataclass(frozen=True, eq=False)
class Correction:
    """The term v = feedback V eta + feedforward [zeta_d; chi_d] of u = B_y^-1 (chi_d - A_x x + v), which gives up exactness.

    feedback (p, n) acts on the state's distance V eta from P zeta_d, feedforward (p, rho + p) on the wanted output's derivatives.
    """

    feedback: Array
    feedforward: Array


@dataclass(frozen=True, eq=False)
class InverseSystem:
    """x = P zeta_d + V (W_s z_s + W_u z_u), u = B_y^-1 (chi_d - A_x x + v): z_s forward, z_u backward.

    zeta_d and chi_d are what `NormalForm` makes of the wanted outputs and their derivatives. What is continuous through a jump is
    the state x (n,). Without a correction v = 0 and zeta = C* x is prescribed; a modified inverse prescribes nothing
    (Devasia 1996, eqs. 7-9 and 12; Devasia, Paden, Rossi 1996, eqs. 3-5).
    """

    plant: StateSpace
    split: SplitDynamics
    correction: Correction | None
    system: TwoSidedSystem

    @property
    def internal(self) -> InternalDynamics:
        """The plant's internal dynamics."""
        return self.split.internal

    @classmethod
    def of(cls, plant: StateSpace, split: SplitDynamics, correction: Correction | None = None) -> InverseSystem:
        """The inverse of `plant` with these internal dynamics, which take account of the correction."""
        form = split.internal.form
        parts = []
        for A, W in ((split.A_s, split.W_s), (split.A_u, split.W_u)):
            x = form.V @ W
            if correction is None:
                values = tracking_values(plant, x, x @ A, np.zeros((plant.n_outputs, len(A))))
            else:
                values = tracking_values(plant, x, x @ A, _shown(plant, split, x, correction.feedback @ x))
            parts.append(Part(A, values, x))
        T = np.vstack([form.C_star, split.L_s @ form.N, split.L_u @ form.N])
        return cls(plant, split, correction, TwoSidedSystem(parts[0], parts[1], T, len(form.C_star), split.neutral))

    def driven(self, generator: Generator) -> DrivenSystem:
        """The inverse for outputs y_d = R w, w' = S w."""
        form = self.split.internal.form
        Z, highest = form.zeta.rows(generator.derivative), form.chi.rows(generator.derivative)
        drive, x = np.vstack([Z, highest]), form.P @ Z
        D_f, D_b = self.split.G_s @ drive, self.split.G_u @ drive
        driven = self._driven(generator, (D_f, D_b), x, highest, drive)
        parts = zip((self.split.A_s, self.split.A_u), (D_f, D_b), self.split.quick, strict=True)
        P_f, P_b = (settled_states(A, D, generator.S, quick) for A, D, quick in parts)
        if not (np.any(P_f) or np.any(P_b)):
            return driven
        slow = tuple(np.where(np.any(P, axis=1, keepdims=True), 0.0, D) for P, D in ((P_f, D_f), (P_b, D_b)))
        held = self.system.forward.J @ P_f + self.system.backward.J @ P_b
        return replace(
            driven, settled=Settled(self._driven(generator, (slow[0], slow[1]), x + held, highest, drive, held), P_f, P_b)
        )

    def _driven(
        self, generator: Generator, D: tuple[Array, Array], x: Array, highest: Array, drive: Array, held: Array | None = None
    ) -> DrivenSystem:
        """The system of z_f' = A_f z_f + D_f w, z_b' = A_b z_b + D_b w with the state J_f z_f + J_b z_b + x w.

        Args:
            generator: of y_d = R w, w' = S w.
            D: D_f, D_b.
            x: (n, q).
            highest, drive: rows of chi_d, and of [zeta_d; chi_d].
            held: what of x is a part of V eta (n, q).
        """
        forward, backward = self.system.forward.J, self.system.backward.J
        rate, y = forward @ D[0] + backward @ D[1] + x @ generator.S, generator.R
        if self.correction is not None:
            v = self.correction.feedforward @ drive
            v = v if held is None else v + self.correction.feedback @ held
            y = _shown(self.plant, self.split, x, highest + v)
        values = tracking_values(self.plant, x, rate, y)
        return DrivenSystem(system=self.system, S=generator.S, D_f=D[0], D_b=D[1], X_w=values, J_w=x)


def require_square(plant: SwitchedSystem, method: str) -> None:
    """Raises RelativeDegreeError where inputs are left over, for a method that knows no use for them."""
    if plant.n_inputs > plant.n_outputs:
        raise RelativeDegreeError(
            f"{method} needs as many inputs as outputs, got {plant.n_inputs} inputs {list(plant.inputs.names)} for "
            f"{plant.n_outputs} output(s) {list(plant.outputs.names)}; leave inputs out (StateSpace.with_inputs), track further "
            "outputs, or use invtrack.invert, which takes the least of the inputs that do it"
        )


def hyperbolic_splits(plant: SwitchedSystem) -> tuple[SplitDynamics, ...]:
    """Split internal dynamics of each interval; models that recur share them.

    Zeros on the imaginary axis are refused in the first and the last interval, which have no end; over the others they stay
    bounded. Raises NonHyperbolicError, RelativeDegreeError.
    """
    return plant.map(lambda system: split_dynamics(system, endless=plant.is_endless(system)))


def inverse_systems(
    plant: SwitchedSystem, splits: Sequence[SplitDynamics], corrections: Sequence[Correction] | None = None
) -> list[InverseSystem]:
    """The inverse of each interval; intervals that share their split dynamics share it, too."""
    known: dict[int, InverseSystem] = {}
    for k, split in enumerate(splits):
        if id(split) not in known:
            known[id(split)] = InverseSystem.of(plant.systems[k], split, None if corrections is None else corrections[k])
    return [known[id(split)] for split in splits]


def _shown(plant: StateSpace, split: SplitDynamics, x_rows: Array, chi_rows: Array) -> Array:
    """Rows of y from those of x and of chi_d + v, which is y itself for outputs in which inputs show at once."""
    direct = np.array(split.internal.form.orders) == 0
    return np.where(direct[:, None], chi_rows, plant.C @ x_rows)
