"""What matters: how strongly each parameter of a sweep goes with a number."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from invtrack.arguments import by_name
from invtrack.arrays import Array, finite_number
from invtrack.errors import SweepError
from invtrack.sweeps.swept import Swept, require_swept


def rank_correlations(swept: Swept, number: str, *, about: Mapping[str, float] | None = None) -> dict[str, float]:
    """Spearman's rank correlation of each parameter with a number, from -1 to 1, over the rows where the number is defined.

    +-1 is a monotonic dependence, however curved; 0 means none, or one that has no direction. An error grows whether a mass is too
    large or too small: parameters in `about`, which maps them to what the plan assumes, count by their distance from it.
    Parameters that are texts, or the same in all these rows, are left out. Among n samples of what does not matter, 95 % lie
    within 1.96/sqrt(n - 1).

    Raises SweepError for fewer than 3 rows with the number, where it is the same in all of them, and for `about` a parameter that
    is not there or no number.
    """
    values = require_swept(swept).numbers(number)
    defined = np.isfinite(values)
    if np.count_nonzero(defined) < 3 or np.ptp(values[defined]) == 0:
        raise SweepError(
            f"expected 3 or more rows in which {number!r} is defined and not always the same, got {np.count_nonzero(defined)} rows"
        )
    centres = by_name("about", {} if about is None else about, expected="values by the names of parameters", error=SweepError)
    for name, centre in centres.items():
        swept.numbers(name)  # refused where it is none
        finite_number(f"about: {name}", centre, error=SweepError)
    ranks = _centred_ranks(values[defined])
    found = {}
    for name in swept.design.parameters:
        column = swept.design.column(name)
        if any(isinstance(value, str) for value in column):
            continue
        settings = np.array(column, dtype=float)[defined]
        others = _centred_ranks(np.abs(settings - centres[name]) if name in centres else settings)
        size = np.linalg.norm(others) * np.linalg.norm(ranks)
        if size > 0:
            found[name] = float(others @ ranks / size)
    return found


def _centred_ranks(values: Array) -> Array:
    from scipy.stats import rankdata  # takes half a second, which a worker of a cluster need not spend

    ranks: Array = rankdata(values)
    return ranks - np.mean(ranks)
