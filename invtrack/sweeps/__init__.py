"""Sweeps: one study at thousands of points, on all cores or on a cluster, each row kept as soon as it is there."""

from invtrack.sweeps.design import Design, grid, latin_hypercube, listed, monte_carlo
from invtrack.sweeps.row import Row
from invtrack.sweeps.running import sweep
from invtrack.sweeps.sensitivity import rank_correlations
from invtrack.sweeps.swept import Replay, Swept

__all__ = [
    "Design",
    "Replay",
    "Row",
    "Swept",
    "grid",
    "latin_hypercube",
    "listed",
    "monte_carlo",
    "rank_correlations",
    "sweep",
]
