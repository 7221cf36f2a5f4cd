"""Mechanisms made to measure, as MJCF: a flexible beam of any geometry on a sliding base."""

from invtrack.mechanisms.beam import Beam
from invtrack.mechanisms.chain import Chain

__all__ = ["Beam", "Chain"]
