"""Where the moved zeros go, as a matrix with these eigenvalues: equal ones in as many Jordan chains as inputs keep apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from invtrack.arrays import Array, ComplexArray
from invtrack.linear.pole_placement import repeated


@dataclass(frozen=True, eq=False)
class TargetChains:
    """Poles (k,) shared out among Jordan chains: those of the real ones, then, each by its upper pole, those of the pairs.

    A pole of multiplicity m has m eigenvectors at best, and then makes m chains of one; but there are no more than there are
    independent ways for the inputs to reach it (H. Rosenbrock, State-Space and Multivariable Theory, 1970, ch. 5), and with a
    single one all m make one chain.
    """

    chains: tuple[ComplexArray, ...]

    @classmethod
    def of(cls, targets: ComplexArray, count: int) -> TargetChains:
        """Each of the distinct poles in `count` chains, or as many as its multiplicity, of nearly equal lengths."""
        upper = np.concatenate([targets[targets.imag == 0], targets[targets.imag > 0]])
        chains: list[ComplexArray] = []
        for equal in repeated(upper):
            parts = np.array_split(np.full(len(equal), np.mean(upper[equal])), min(count, len(equal)))
            chains += parts
        return cls(tuple(sorted(chains, key=lambda chain: bool(chain[0].imag > 0))))

    @property
    def poles(self) -> ComplexArray:
        """All of them, chain by chain, each upper one followed by its conjugate (k,)."""
        listed = [s for chain in self.chains for pole in chain for s in ((pole,) if pole.imag == 0 else (pole, pole.conjugate()))]
        return np.array(listed, dtype=complex)

    @property
    def matrix(self) -> Array:
        """Lambda (k, k), real: a chain's poles on the diagonal (pairs as rotations), the steps between them above it."""
        blocks = []
        for chain in self.chains:
            width = 1 if chain[0].imag == 0 else 2
            poles = [np.array([[s.real]]) if width == 1 else np.array([[s.real, s.imag], [-s.imag, s.real]]) for s in chain]
            blocks.append(scipy.linalg.block_diag(*poles) + abs(chain[0]) * np.eye(width * len(chain), k=width))
        return np.asarray(scipy.linalg.block_diag(*blocks)) if blocks else np.zeros((0, 0))

    def eigenvectors(self, apart: ComplexArray) -> ComplexArray:
        """Those of Lambda (k, k) with its poles replaced by `apart` (k,), near them, but no two alike."""
        vectors, at = [], 0
        for chain in self.chains:
            width = 1 if chain[0].imag == 0 else 2
            poles = apart[at : at + width * len(chain) : width]
            # (Lambda - s_j) v = 0 from the last entry, j, up, and scaled to 1 in the first one.
            steps = (poles[:, None] - poles[None, :]) / abs(chain[0])  # (j, i): s_j - s_i
            columns = np.array([np.cumprod(np.concatenate([[1.0], step[:-1]])) for step in steps]).T
            if width == 1:
                vectors.append(columns)
            else:
                both = [np.kron(columns, np.array([[1.0], [1j]])), np.kron(columns.conj(), np.array([[1.0], [-1j]]))]
                vectors.append(np.stack(both, axis=2).reshape(width * len(chain), -1))
            at += width * len(chain)
        return np.asarray(scipy.linalg.block_diag(*vectors), dtype=complex) if vectors else np.zeros((0, 0), dtype=complex)
