"""Tests of controllers: what they assert of a run, runs simulated once, parameters that are off; and a plugin of pytest.

The assertions are plain functions. Where pytest runs, the plugin (`invtrack.testing.plugin`, loaded by itself where invtrack is
installed) adds the fixtures `invtrack_run` and `invtrack_factors`, the marker `invtrack_factors`, and keeps the recording and a
figure of what failed; see docs/guide/testing.md.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # what __getattr__ does, for type checkers and editors
    from invtrack.testing.artifacts import Artifacts
    from invtrack.testing.assertions import (
        RunAssertionError,
        assert_peak_input,
        assert_residual_vibration,
        assert_settles,
        assert_tracks,
    )
    from invtrack.testing.factors import factor_cases
    from invtrack.testing.ringing import Mode, Oscillation, nearest_mode, oscillation
    from invtrack.testing.run_cache import RunCache

__all__ = [
    "Artifacts",
    "Mode",
    "Oscillation",
    "RunAssertionError",
    "RunCache",
    "assert_peak_input",
    "assert_residual_vibration",
    "assert_settles",
    "assert_tracks",
    "factor_cases",
    "nearest_mode",
    "oscillation",
]

# Loaded when a name is first used: pytest imports this package with its plugin in every run, also in those that simulate nothing.
_MODULES = {
    "artifacts": ("Artifacts",),
    "assertions": (
        "RunAssertionError",
        "assert_peak_input",
        "assert_residual_vibration",
        "assert_settles",
        "assert_tracks",
    ),
    "factors": ("factor_cases",),
    "ringing": ("Mode", "Oscillation", "nearest_mode", "oscillation"),
    "run_cache": ("RunCache",),
}


def __getattr__(name: str) -> Any:
    for module, names in _MODULES.items():
        if name in names:
            globals()[name] = value = getattr(importlib.import_module(f"{__name__}.{module}"), name)
            return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
