"""Plans for references that are known only some time ahead: inversion and redesign with preview."""

from invtrack.preview.bound import PreviewBound, preview_bound
from invtrack.preview.inversion import inversion_planner, preview_inversion
from invtrack.preview.plan_piece import PlanPiece
from invtrack.preview.planner import Foreseen, PreviewPlanner
from invtrack.preview.redesign import preview_redesign, redesign_planner
from invtrack.preview.stop import stop
from invtrack.preview.worst_reference import WorstReference

__all__ = [
    "Foreseen",
    "PlanPiece",
    "PreviewBound",
    "PreviewPlanner",
    "WorstReference",
    "inversion_planner",
    "preview_bound",
    "preview_inversion",
    "preview_redesign",
    "redesign_planner",
    "stop",
]
