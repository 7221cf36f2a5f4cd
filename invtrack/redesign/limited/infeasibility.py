"""Why limits cannot all be kept: which of them conflict, and how far one would have to give way."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from invtrack.redesign.limited.quadratic_program import CONFLICT, QuadraticProgram
from invtrack.redesign.limits import Bound


def explain(program: QuadraticProgram, owner: NDArray[np.intp], bounds: Sequence[Bound]) -> str:
    """The limits whose least common loosening makes the programme solvable, and what each alone would have to become.

    owner: number of the bound behind each row of G, in units of the bound's size.
    """
    loosened = program.least_loosening(owner)
    if loosened is None:
        return "no loosening of them helps: the plant cannot get from one end to the other at all"
    needed = [(bound, by) for bound, by in zip(bounds, loosened, strict=True) if by > CONFLICT]
    together = [f"{bound} by {by * bound.size:.3g}" for bound, by in needed]
    alone = []
    for number, bound in enumerate(bounds):
        share = program.least_loosening(np.where(owner == number, 0, -1))
        if share is not None:
            by = float(share[0] * bound.size)
            alone.append(f"{bound.name} between {bound.low + bound.offset - by:.6g} and {bound.high + bound.offset + by:.6g}")
    one = f"one of these alone would be enough: {'; '.join(alone)}" if alone else "no single limit, loosened alone, is enough"
    return f"the least that has to give way, in all, is {', '.join(together)}; {one}"
