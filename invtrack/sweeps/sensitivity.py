"""What matters: how strongly each parameter of a sweep goes with a number."""

from __future__ import annotations

import numpy as np

from invtrack.arrays import Array
from invtrack.errors import SweepError
from invtrack.sweeps.swept import Swept, require_swept


def rank_correlations(swept: Swept, number: str) -> dict[str, float]:
    """Spearman's rank correlation of each parameter with a number, from -1 to 1, over the rows where the number is defined.

    +-1 is a monotonic dependence, however curved; 0 means none, or one that has no direction (an error that grows both ways).
    Parameters that are texts, or the same in all these rows, are left out. Among n samples of what does not matter, 95 % lie
    within 1.96/sqrt(n - 1).

    Raises SweepError for fewer than 3 rows with the number, or where it is the same in all of them.
    """
    values = require_swept(swept).numbers(number)
    defined = np.isfinite(values)
    if np.count_nonzero(defined) < 3 or np.ptp(values[defined]) == 0:
        raise SweepError(
            f"expected 3 or more rows in which {number!r} is defined and not always the same, got {np.count_nonzero(defined)} rows"
        )
    ranks = _centred_ranks(values[defined])
    found = {}
    for name in swept.design.parameters:
        column = swept.design.column(name)
        if any(isinstance(value, str) for value in column):
            continue
        others = _centred_ranks(np.array(column, dtype=float)[defined])
        size = np.linalg.norm(others) * np.linalg.norm(ranks)
        if size > 0:
            found[name] = float(others @ ranks / size)
    return found


def _centred_ranks(values: Array) -> Array:
    from scipy.stats import rankdata  # takes half a second, which a worker of a cluster need not spend

    ranks: Array = rankdata(values)
    return ranks - np.mean(ranks)
