"""Plans for references that are known only some time ahead: inversion and redesign with preview."""

from invtrack.preview.inversion import inversion_planner, preview_inversion
from invtrack.preview.planner import Foreseen, PlanPiece, PreviewPlanner
from invtrack.preview.redesign import preview_redesign, redesign_planner

__all__ = [
    "Foreseen",
    "PlanPiece",
    "PreviewPlanner",
    "inversion_planner",
    "preview_inversion",
    "preview_redesign",
    "redesign_planner",
]
