"""Recordings of runs, for people to look at in Rerun and for programs to read back."""

from invtrack.recording.read import load_recording
from invtrack.recording.write import save_recording

__all__ = ["load_recording", "save_recording"]
