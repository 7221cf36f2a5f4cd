"""Plants that advice is asked for, from their equations of motion."""

from __future__ import annotations

import numpy as np

import invtrack


def crane(load: float = 2.0, *, limit: float = np.inf) -> invtrack.StateSpace:
    """A trolley of 5 kg that carries a load on a rope of 1.5 m; the output is where the load is.

    (M + m) x'' + m l phi'' = u - b x', m l x'' + m l^2 phi'' = -m g l phi, y = x + l phi. The rope's own inertia makes the
    load turn by more than the massless rope would let it, so that y has relative degree 2, and is nonminimum phase.
    """
    trolley, rope, length, gravity = 5.0, 0.1, 1.5, 9.81
    mass = np.array(
        [
            [trolley + rope + load, (load + rope / 2) * length],
            [(load + rope / 2) * length, (load + rope / 3) * length**2],
        ]
    )
    stiffness, damping = np.diag([0.0, (load + rope / 2) * gravity * length]), np.diag([1.0, 0.02])
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(mass, stiffness), -np.linalg.solve(mass, damping)]])
    B = np.concatenate([np.zeros(2), np.linalg.solve(mass, [1.0, 0.0])])[:, np.newaxis]
    C = np.array([[1.0, length, 0.0, 0.0]])
    names = {"states": ["x", "swing", "x velocity", "swing velocity"], "inputs": ["drive"], "outputs": ["load"]}
    return invtrack.StateSpace(A, B, C, **names, input_limits=[[-limit, limit]])


def mass(limit: float = np.inf) -> invtrack.StateSpace:
    """A mass of 1 kg: y'' = u."""
    return invtrack.StateSpace([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]], input_limits=[[-limit, limit]])
