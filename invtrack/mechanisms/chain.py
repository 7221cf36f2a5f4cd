"""A straight chain of rigid parts on hinges and a sliding base: its mass and stiffness, its modes, and a damping matrix with the
damping ratios that are asked for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from invtrack.arrays import Array


@dataclass(frozen=True, eq=False)
class Chain:
    """A base that slides across the chain, a rigid part fixed to it, and n more behind as many hinges.

    Coordinates are q = (place of the base [m], angles of the hinges [rad]) (n + 1,), all zero where the chain is straight.

    Args:
        base_mass: of the base [kg].
        hinges: where the hinges are along the chain (n,) [m].
        length: of the chain [m].
        masses, centres, inertias: of the n + 1 parts: mass [kg], centre of mass along the chain [m], and moment of inertia about
            it [kg m^2].
        payload, payload_inertia: a further mass [kg] at the end of the chain, and its moment of inertia there [kg m^2].
        stiffness: of each hinge (n,) [N m/rad].
        weight: gravity along the chain [m/s^2]: positive where it pulls the chain straight, negative where it bends it further.
    """

    base_mass: float
    hinges: Array
    length: float
    masses: Array
    centres: Array
    inertias: Array
    payload: float
    payload_inertia: float
    stiffness: Array
    weight: float

    @property
    def _all_parts(self) -> tuple[Array, Array, Array, Array]:
        """Masses, centres, inertias (n + 2,) and last hinges before them, the payload among them."""
        n = len(self.hinges)
        return (
            np.append(self.masses, self.payload),
            np.append(self.centres, self.length),
            np.append(self.inertias, self.payload_inertia),
            np.append(np.arange(n + 1), n),
        )

    @property
    def mass_matrix(self) -> Array:
        """M (n + 1, n + 1) of the straight chain: the kinetic energy is q'' M q' / 2."""
        masses, centres, inertias, number = self._all_parts
        turns = np.arange(len(self.hinges)) < number[:, None]  # whether the hinge turns the part
        moves = np.hstack([np.ones((len(masses), 1)), np.where(turns, centres[:, None] - self.hinges, 0.0)])
        turned = np.hstack([np.zeros((len(masses), 1)), turns.astype(float)])
        M = moves.T * masses @ moves + turned.T * inertias @ turned
        M[0, 0] += self.base_mass
        return np.asarray(M)

    @property
    def stiffness_matrix(self) -> Array:
        """S (n + 1, n + 1) of the straight chain: that of hinges, and of gravity, as a turned part is shorter along the chain."""
        masses, centres, _, number = self._all_parts
        n, ends = len(self.hinges), np.append(self.hinges, self.length)
        # What hangs on each link, times how much of the link lies before it: the weight that turns it by its angle.
        lever = np.zeros(n)
        for mass, centre, at in zip(masses, centres, number.tolist(), strict=True):
            if at:
                lever[: at - 1] += mass * np.diff(ends)[: at - 1]
                lever[at - 1] += mass * (centre - self.hinges[at - 1])
        up_to = np.tri(n)  # the angle of link l is the sum of those of hinges 0 ... l
        S = np.zeros((n + 1, n + 1))
        S[1:, 1:] = np.diag(self.stiffness) + self.weight * (up_to.T * lever @ up_to)
        return S

    def flexible_modes(self) -> tuple[Array, Array]:
        """Frequencies (n,) [rad/s], increasing, and shapes (n + 1, n) of unit modal mass, of the modes on the free base.

        The base is first eliminated, as the forces in the hinges leave the total momentum alone, so that no frequency of zero has
        to be told from rounding. A chain that bends under its own weight has a frequency of NaN.
        """
        M, S = self.mass_matrix, self.stiffness_matrix[1:, 1:]
        follows = -M[0, 1:] / M[0, 0]  # the base's place while the momentum stays zero
        relative = M[1:, 1:] + np.outer(M[1:, 0], follows)
        values, shapes = scipy.linalg.eigh(S, relative)
        with np.errstate(invalid="ignore"):
            frequencies = np.sqrt(values)
        return frequencies, np.vstack([follows @ shapes, shapes])

    def modal_damping(self, ratios: Array) -> Array:
        """D (n, n) of the hinges [N m s/rad]: torques -D (rates of the angles) damp the modes with these ratios (n,).

        D = M (sum of 2 ratio_i w_i phi_i phi_i') M over the flexible modes; the base takes no part in it, since the modes carry no
        momentum.
        """
        frequencies, shapes = self.flexible_modes()
        momenta = (self.mass_matrix @ shapes)[1:]
        return np.asarray(momenta * (2 * ratios * frequencies) @ momenta.T)
