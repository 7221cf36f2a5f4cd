"""The published plants as a table: `python -m tests.published.table` prints docs/published_plants.md."""

from __future__ import annotations

import numpy as np

from tests.published.library import PLANTS
from tests.published.plant import PublishedPlant

HEAD = """# Published plants

Plants from the literature with which the tests in `tests/published` compare relative degree, zeros, hidden modes, plans and
refusals; for most of them every choice of outputs. Right values come from exact rational arithmetic with the printed decimals, and
plans are integrated anew under their input alone. Figures that the sources print (zeros, poles, gains at rest) are tested too.

There are n states, m inputs and q outputs to choose from; relative degree and zeros are those of the outputs chosen for the table,
in the source's unit of time. A plant with zeros on the right moves before its output does: preactuation is ln(100) over the real
part of the slowest of them, endless where one lies on the imaginary axis.

| plant | n, m, q | relative degree | zeros on the right or on the axis | preactuation | source |
|---|---|---|---|---|---|
"""


def document() -> str:
    """The whole page."""
    return HEAD + "".join(f"| {' | '.join(_cells(plant))} |\n" for plant in PLANTS)


def _cells(plant: PublishedPlant) -> list[str]:
    _, B, C, _ = plant.matrices
    degrees, zeros = plant.exact.relative_degree(*plant.chosen), plant.exact.zeros(*plant.chosen)
    kept, time = "no input reaches the output", ""
    if zeros is not None:
        listed = sorted((zero for zero in zeros if zero.real >= 0 and zero.imag >= 0), key=abs)
        kept = ", ".join(_text(zero) for zero in listed) or ("no zeros" if not len(zeros) else "none")
        rates = zeros.real[zeros.real > 0]
        time = f"{np.log(100.0) / np.min(rates):.3g}" if rates.size else "0"
        if 0.0 in zeros.real:
            time = "endless"
    size = f"{plant.exact.n}, {B.shape[1]}, {len(C)}"
    return [plant.name, size, "none" if degrees is None else ", ".join(map(str, degrees)), kept, time, plant.source]


def _text(zero: complex) -> str:
    return f"{zero.real:.4g}" if zero.imag == 0 else f"{zero.real:.4g} ± {zero.imag:.4g}j"


if __name__ == "__main__":
    print(document(), end="")
