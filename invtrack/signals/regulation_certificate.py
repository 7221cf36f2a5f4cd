"""How well a regulation map meets its equations, and which exosystem states it cannot serve."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class InadmissibleState:
    """A named state of the exosystem (x_e(T_i) = that unit vector) whose output no continuous state of the plant can follow.

    time [s]: where that fails. output, derivative: which derivative of which output jumps there ("" and -1 where none does but the
    state has to). jump: by how much, in units of that derivative (of the state, for "").
    """

    name: str
    time: float
    output: str
    derivative: int
    jump: float

    def __str__(self) -> str:
        if not self.output:
            return f"{self.name}: at t = {self.time:.6g} s the state that keeps the output exact jumps by {self.jump:.3g}"
        return (
            f"{self.name}: at t = {self.time:.6g} s derivative {self.derivative} of output {self.output!r} jumps by {self.jump:.3g}"
        )


@dataclass(frozen=True)
class RegulationCertificate:
    """How well a map meets its equations, measured from its values alone, not from how it was found.

    dynamics_residual: largest |G(b) - G(a) - integral of A G + B F - G A_e| over panels, relative to the size of each entry.
    output_error: largest |C G + D F - C_e|, relative to the size of C_e and of the terms. boundary_residual: how far the stable
    internal coordinates are at T_i, and the antistable ones at T_f, from the bounded particular solutions outside. continuity:
    largest jump of G x_e at a breakpoint, over the admissible exosystem states (of the Francis regulators, which are known to jump:
    over all of them). Relative to the size of G.
    """

    dynamics_residual: float
    output_error: float
    boundary_residual: float
    continuity: float
