"""The options that say how much a command prints, and as what."""

from __future__ import annotations

from dataclasses import dataclass

import tyro


@dataclass(frozen=True, kw_only=True)
class Printed:
    """What a command writes to standard output."""

    json: tyro.conf.FlagCreatePairsOff[bool] = False
    """Print JSON in place of tables and text."""

    quiet: tyro.conf.FlagCreatePairsOff[bool] = False
    """Print nothing but errors, and no progress."""
