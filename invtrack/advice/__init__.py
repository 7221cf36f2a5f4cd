"""Which method to take for a motion: all that apply, tried on the plant and compared, with one recommendation."""

from invtrack.advice.advice import Advice
from invtrack.advice.advise import advise
from invtrack.advice.move import Move
from invtrack.advice.trial import Trial

__all__ = ["Advice", "Move", "Trial", "advise"]
