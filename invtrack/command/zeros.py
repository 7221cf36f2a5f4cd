"""`invtrack zeros`: what stands between a mechanism and exact tracking."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np

from invtrack.command.mechanism import Mechanism
from invtrack.command.printed import Printed
from invtrack.linear.zeros import ZeroReport, zero_report
from invtrack.plant import linearize


@dataclass(frozen=True, kw_only=True)
class Zeros(Mechanism, Printed):
    """Zeros, relative degree and modes of a mechanism about its operating point, and the preactuation that exact tracking needs."""

    def execute(self) -> int:
        """Print the report; 0."""
        model = linearize(self.plant())
        report = zero_report(model)
        modes = np.linalg.eigvals(model.A)
        if self.json:
            print(json.dumps(_as_json(report, modes), indent=2))
        elif not self.quiet:
            unstable = np.count_nonzero(modes.real > 1e-9 * float(np.max(np.abs(modes), initial=0.0)))
            print(f"{report}\n{len(modes)} modes, {unstable} of them unstable")
        return 0


def _as_json(report: ZeroReport, modes: Any) -> dict[str, Any]:
    return {
        "relative_degree": report.relative_degree,
        "preactuation_time": report.preactuation_time,
        "zeros": [
            {"real": zero.value.real, "imag": zero.value.imag, "kind": zero.kind, "on_axis": zero.on_axis} for zero in report.zeros
        ],
        "modes": [{"real": float(mode.real), "imag": float(mode.imag)} for mode in modes],
    }
