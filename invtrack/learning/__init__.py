"""Learning from run to run: the error that a run leaves, within a band, corrects what the next plan is made for."""

from invtrack.learning.iterate import Learned, iterate
from invtrack.learning.learning import Learning, LearningStep

__all__ = ["Learned", "Learning", "LearningStep", "iterate"]
