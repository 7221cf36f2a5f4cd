"""What people use today, as plans: feedback alone, shaped commands, approximate inverses of sampled plants."""

from invtrack.baselines.approximate_inverse import approximate_inverse
from invtrack.baselines.base_servo import base_servo
from invtrack.baselines.feedback_tracking import feedback_tracking
from invtrack.baselines.modes import Mode, flexible_modes
from invtrack.baselines.residual_vibration import insensitivity, residual_vibration_ratio
from invtrack.baselines.shaper import Shaper, shaper

__all__ = [
    "Mode",
    "Shaper",
    "approximate_inverse",
    "base_servo",
    "feedback_tracking",
    "flexible_modes",
    "insensitivity",
    "residual_vibration_ratio",
    "shaper",
]
