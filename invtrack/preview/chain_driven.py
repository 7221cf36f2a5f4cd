"""A two-sided system measured from what the known outputs make of it: only their highest derivative drives it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from invtrack.arrays import Array
from invtrack.linear.propagation import Propagator
from invtrack.linear.state_space import StateSpace
from invtrack.plans.two_sided import DrivenSystem, TwoSidedSystem
from invtrack.plans.two_sided_problem import Driveable
from invtrack.preview.output_chain import OutputChain
from invtrack.references.generator import Generator

KEPT = 512
"""Carriers that are kept for further use, at most: a reference has few kinds of pieces, and most are of one length."""


@dataclass(frozen=True, eq=False)
class Carrier:
    """What a stretch of length L [s] of a reference w' = S w does.

    z_f(end) = decay_f z_f(start) + f w(start), z_b(start) = decay_b z_b(end) - g w(start), w(end) = turn w(start). At any time in
    it the outputs' derivatives are zeta = zeta w and chi = chi w, as deviations from rest.
    """

    decay_f: Array
    decay_b: Array
    f: Array
    g: Array
    turn: Array
    zeta: Array
    chi: Array


@dataclass(frozen=True, eq=False)
class ChainDriven:
    """z_f' = A_f z_f + G_f chi and z_b' = A_b z_b + G_b chi, both measured from their values for zeta' = S zeta, chi = 0.

    Those values Pi_f zeta and Pi_b zeta are the only ones that do not grow exponentially where the outputs go on as polynomials.
    [x; u; y] = X_f z_f + X_b z_b + X_zeta zeta + X_chi chi, as deviations from rest, and what is continuous through a jump is
    J_f z_f + J_b z_b + J_zeta zeta, all in the parts of `system`.

    Args:
        plant: the interval's model.
        chain: of its outputs.
        model: the method's two-sided system, which a reference drives.
        Pi_f, Pi_b: (n_f, q) and (n_b, q).
        G_f, G_b: (n_f, p) and (n_b, p).
        X_zeta, X_chi, J_zeta: (n + m + p, q), (n + m + p, p) and (., q).
        driven, carriers: by the reference's generators, as far as they have been asked for.
    """

    plant: StateSpace
    chain: OutputChain
    model: Driveable
    Pi_f: Array
    Pi_b: Array
    G_f: Array
    G_b: Array
    X_zeta: Array
    X_chi: Array
    J_zeta: Array
    made: dict[Generator, DrivenSystem] = field(default_factory=dict, repr=False)
    carriers: dict[tuple[Generator, float], Carrier] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, plant: StateSpace, chain: OutputChain, model: Driveable) -> ChainDriven:
        """Raises InversionError where no output can be held (a zero at the origin)."""
        q, rows = chain.size, plant.n_states + plant.n_inputs + plant.n_outputs
        driven = model.driven(chain.generator)
        alone = replace(driven, S=chain.shift, D_f=driven.D_f[:, :q], D_b=driven.D_b[:, :q], settled=None, made=[])
        Pi_f, Pi_b = alone.steady()
        forward, backward = model.system.forward, model.system.backward
        return cls(
            plant=plant,
            chain=chain,
            model=model,
            Pi_f=Pi_f,
            Pi_b=Pi_b,
            G_f=driven.D_f[:, q:] - Pi_f @ chain.entry,
            G_b=driven.D_b[:, q:] - Pi_b @ chain.entry,
            X_zeta=(driven.X_w[:, :q] + forward.X @ Pi_f + backward.X @ Pi_b)[:rows],
            X_chi=driven.X_w[:rows, q:],
            J_zeta=driven.J_w[:, :q] + forward.J @ Pi_f + backward.J @ Pi_b,
        )

    @property
    def system(self) -> TwoSidedSystem:
        """The two-sided system, whatever drives it."""
        return self.model.system

    @cached_property
    def columns(self) -> tuple[Array, Array]:
        """X_f (n + m + p, n_f) and X_b (n + m + p, n_b)."""
        rows = len(self.X_zeta)
        return self.system.forward.X[:rows], self.system.backward.X[:rows]

    @cached_property
    def rest(self) -> Array:
        """zeta at rest (q,): that of the reference less this is its deviation."""
        return self.chain.at_rest(self.plant.operating_point.y0)

    def decays(self, duration: float) -> tuple[Array, Array]:
        """exp(A_f duration) and exp(-A_b duration)."""
        forward, backward = self.system.propagators
        return _transition(forward, duration), _transition(backward, duration)

    def driven_by(self, generator: Generator) -> DrivenSystem:
        """The method's system, driven by outputs y_d = R w that are measured from rest."""
        if generator not in self.made:
            if len(self.made) >= KEPT:
                self.made.clear()
            driven = self.model.driven(generator)
            rows = len(self.X_zeta)
            self.made[generator] = driven if len(driven.X_w) == rows else driven.mapped(np.eye(rows, len(driven.X_w)))
        return self.made[generator]

    def carrier(self, generator: Generator, length: float) -> Carrier:
        """What a stretch [s] of a reference from this generator does."""
        key = (generator, length)
        if key not in self.carriers:
            if len(self.carriers) >= KEPT:
                self.carriers.clear()
            self.carriers[key] = self._carrier(generator, length)
        return self.carriers[key]

    def _carrier(self, generator: Generator, length: float) -> Carrier:
        chi, S = self.chain.chi(generator), generator.S
        turn = _transition(generator.propagator(1.0), length)
        forward, backward = self.system.propagators
        both = _transition(forward.driven(self.G_f @ chi, S), length), _transition(backward.driven(self.G_b @ chi, -S), length)
        n_f, n_b = len(self.G_f), len(self.G_b)
        return Carrier(
            decay_f=both[0][:n_f, :n_f],
            decay_b=both[1][:n_b, :n_b],
            f=both[0][:n_f, n_f:],
            g=both[1][:n_b, n_b:] @ turn,
            turn=turn,
            zeta=self.chain.zeta(generator),
            chi=chi,
        )


def _transition(propagator: Propagator, duration: float) -> Array:
    return np.asarray(propagator.matrices(np.array([duration]))[0])
