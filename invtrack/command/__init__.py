"""The `invtrack` command: from an MJCF file to its zeros, a run, and a look at it."""

from invtrack.command.program import main

__all__ = ["main"]
