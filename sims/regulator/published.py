"""The map at the start of the manoeuvre against the matrix that the paper prints."""

from __future__ import annotations

from typing import Any

import numpy as np

import invtrack

# The joints of models/cantilever.xml are (x1, x2 - x1, x3), the paper's coordinates (x1, x2, x3); the same for the velocities.
PAPER_FROM_MJCF = np.kron(np.eye(2), [[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
ROWS = ("x1", "x2", "x3", "x1'", "x2'", "x3'")
PRINTED = (
    (-4.6715, -3.3239),
    (0.0, 0.0),
    (6.9406, 2.6672),
    (-0.5935, -1.4710),
    (0.0, 0.0),
    (2.6851, -0.8211),
)
"""The first two columns of G(0); for the other two the paper prints zeros instead of solving."""


def published(model: invtrack.SwitchedSystem, wanted: invtrack.references.Exosystem) -> dict[str, Any]:
    """G(0), what it is compared with, its residuals, and the columns that no plant state can follow.

    In the paper's coordinates, because a column that cannot be followed depends on them: which internal coordinate is continuous
    where the output is not.
    """
    systems = {id(system): system.transformed(PAPER_FROM_MJCF, ROWS) for system in model.systems}
    regulation = invtrack.exosystem_map(
        invtrack.SwitchedSystem([systems[id(s)] for s in model.systems], model.switch_times), wanted
    )
    first, second = regulation.breakpoints[:2]
    G_0 = regulation.x_map([first], inside=[(first + second) / 2])[0, :, :2]
    certificate = regulation.certificate
    return {
        "G0": G_0,
        "G0_check": {
            "rows": ROWS,
            "columns": regulation.exosystem.names[:2],
            "printed": PRINTED,
            "difference": G_0 - PRINTED,
            "boundary_residual": certificate.boundary_residual,
            "dynamics_residual": certificate.dynamics_residual,
            "output_error": certificate.output_error,
            "continuity": certificate.continuity,
            "not_admissible": {state.name: str(state) for state in regulation.inadmissible},
        },
    }


def report(numbers: dict[str, Any]) -> str:
    """G(0), the printed one and the difference, row by row."""
    check = numbers["G0_check"]
    refused = check["not_admissible"]
    titles = [name + (" (not admissible)" if name in refused else "") for name in check["columns"]]
    lines = ["G(0) in the paper's coordinates: computed, printed in the paper, difference"]
    lines.append(" " * 6 + "   ".join(f"{title:35s}" for title in titles).rstrip())
    for row, mine, printed, apart in zip(ROWS, numbers["G0"], PRINTED, check["difference"], strict=True):
        cells = "   ".join(f"{a:15.10f}  {b:8.4f}  {c:8.4f}" for a, b, c in zip(mine, printed, apart, strict=True))
        lines.append(f"  {row:4s}{cells}")
    lines.append(
        f"boundary conditions met to {check['boundary_residual']:.1e}. Columns that no continuous state of the plant can follow:"
    )
    lines += [f"  {text}" for text in refused.values()]
    return "\n".join([*lines, ""])
