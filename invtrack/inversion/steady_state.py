"""The usual practice that inversion is compared with: follow the wanted output by its steady state."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from invtrack.errors import InversionError
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import as_switched
from invtrack.plans.certificate import certify
from invtrack.plans.plan import Plan, TwoSidedGenerator, TwoSidedTrajectory
from invtrack.plans.problem import deviation_reference, require_reference
from invtrack.references.signal import PiecewiseSignal

Array = NDArray[np.float64]

CONDITION_LIMIT = 1e14
"""Largest condition number, in the best of units, with which the equations of the steady state still count as solvable."""


def steady_state_feedforward(model: Any, reference: PiecewiseSignal) -> Plan:
    """State and input that would hold the output at y_d(t) if it stood still there: A x + B u = 0, C x + D u = y_d.

    No inverse stands behind it: it is not a trajectory of the plant (its certificate's dynamics residual says by how much), and
    with feedback around it, it is what a controller without inversion does.

    Raises InversionError where some output cannot be held (a zero at s = 0), TrajectoryError for a wrong number of channels.
    """
    plant = as_switched(model)
    require_reference(plant, reference)
    deviation = deviation_reference(plant, reference)
    edges = deviation.breakpoints
    owner = plant.interval(deviation.inner_times())
    generators: list[TwoSidedGenerator] = []
    known: dict[tuple[int, int], int] = {}
    kind = np.empty(len(owner), dtype=np.intp)
    for piece, key in enumerate(zip(owner.tolist(), deviation.kind.tolist(), strict=True)):
        if key not in known:
            known[key] = len(generators)
            system, generator = plant.systems[key[0]], deviation.generators[key[1]]
            rows = np.vstack([_steady_state(system) @ generator.R, generator.R])
            none = np.zeros((0, 0))
            generators.append(TwoSidedGenerator(generator.S, rows, none, np.zeros((len(rows), 0))))
        kind[piece] = known[key]
    # Before the manoeuvre only a backward part is allowed; the reference holds still there, so both directions are the same.
    g = generators[kind[0]]
    generators.append(TwoSidedGenerator(g.M_b, g.X_b, g.M_f, g.X_f))
    kind[0] = len(generators) - 1
    trajectory = TwoSidedTrajectory(edges, tuple(generators), kind, deviation.anchors, deviation.anchors)
    manoeuvre = (float(edges[0]), float(edges[-1]))
    return Plan(
        method="static reference",
        model=plant,
        reference=reference,
        trajectory=trajectory,
        manoeuvre=manoeuvre,
        preactuation=0.0,
        postactuation=0.0,
        tolerance=0.0,
        certificate=certify(plant, trajectory, deviation, manoeuvre),
        remarks=("not a trajectory of the plant: the steady state of each wanted output",),
    )


def _steady_state(system: StateSpace) -> Array:
    """[x; u] (n + p, p) that holds each output at one: A x + B u = 0, C x + D u = 1."""
    pencil = np.block([[system.A, system.B], [system.C, system.D]])
    n, p = system.n_states, system.n_channels
    try:
        inverse = np.linalg.solve(pencil, np.eye(n + p))
        # The spectral radius of |M^-1| |M| is the condition number that the best scaling of rows and columns reaches (Bauer 1963).
        condition = float(np.max(np.abs(np.linalg.eigvals(np.abs(inverse) @ np.abs(pencil)))))
    except np.linalg.LinAlgError:
        condition = np.inf
    if not condition < CONDITION_LIMIT:
        raise InversionError(f"the outputs {list(system.outputs.names)} cannot be held at constant values (a zero at s = 0)")
    return np.asarray(inverse[:, n:])
