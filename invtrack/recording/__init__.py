"""Recordings of runs, for people to look at in Rerun and for programs to read back."""

from invtrack.recording.animation import save_animation
from invtrack.recording.recording_file import load_recording, save_recording

__all__ = ["load_recording", "save_animation", "save_recording"]
