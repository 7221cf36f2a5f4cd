"""What a plan for a zero-order hold begins and ends with: how it may leave rest, and how it comes back to it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg

from invtrack.arrays import Array
from invtrack.inversion.held_modes import HeldModes, Modes
from invtrack.inversion.inverse_system import InverseSystem
from invtrack.inversion.nonlinear.ends import ALTERNATING, LASTING
from invtrack.inversion.sampled_element import SampledElement
from invtrack.plans.tail import Side, Tail


@dataclass(frozen=True, eq=False)
class HeldEnd:
    """A rest before or after the manoeuvre, and the motions about it that keep the outputs.

    Args:
        element: the holds there, in whose coordinates states are q.
        rest: state and input (n,), (m,), as deviations from the interval's rest.
        expanding: how many motions grow from hold to hold, n_u.
        rows: (n - n_u, n) before, (n_u, n) after: rows q = 0 for a motion that has left rest, or comes to it; orthonormal.
        departure: motions that die out away from the manoeuvre, but not within a few holds: those of the state x itself, by rates,
            their input as it moves.
        neutral: those that neither die out nor grow, of the state x itself, by rates.
    """

    element: SampledElement
    rest: tuple[Array, Array]
    expanding: int
    rows: Array
    departure: Modes
    neutral: Modes

    @classmethod
    def of(cls, inverse: InverseSystem, element: SampledElement, tail: Tail, side: Side) -> HeldEnd:
        """For the inverse of the plant there, and the tail of a continuous plan, which ends in the same rest.

        Raises NonHyperbolicError where zeros run together.
        """
        modes, n, m, h = HeldModes.of(inverse.system, element), inverse.plant.n_states, inverse.plant.n_inputs, element.length
        into, back = element.coordinates.into, element.coordinates.back
        ending, starting = (modes.growing, modes.expanding), (modes.decaying, modes.contracting)
        slow, quick = ending if side == "before" else starting
        outward = slow.joined(quick.divided(_lasts)[0].by_rates(h))
        at_rest = (*starting, modes.neutral) if side == "before" else ending
        # An input that is held is the one in the middle of each hold.
        U = np.linalg.solve(scipy.linalg.expm(outward.T * h / 2).T, outward.U.T).T
        return cls(
            element=element,
            rest=(tail.held[:n], tail.held[n : n + m]),
            expanding=len(modes.growing.T) + len(modes.expanding.T),
            rows=np.linalg.qr(np.vstack([each.Z for each in at_rest]).T)[0].T,
            departure=Modes(outward.T, back @ outward.X, U, outward.Z @ into),
            neutral=replace(modes.neutral, X=back @ modes.neutral.X, Z=modes.neutral.Z @ into),
        )

    def left_by(self, x: Array) -> Array:
        """rows q for a state x (n,), as deviation from the interval's rest, of a motion that keeps the outputs: their q is zero."""
        q = self.element.coordinates.into @ (x - self.rest[0])
        q[: self.element.coordinates.prescribed] = 0.0
        return np.asarray(self.rows @ q)


def _lasts(multiplier: complex) -> bool:
    """Whether a motion is there for more than a few holds, and does not alternate from one to the next."""
    size = max(abs(multiplier), np.finfo(float).tiny)
    return bool(abs(np.log(size)) < LASTING and abs(np.angle(multiplier)) < ALTERNATING)
