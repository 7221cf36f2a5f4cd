"""Settings of all tests."""

from __future__ import annotations

import gc
import os
from importlib.metadata import entry_points

# Before anything loads numpy: for matrices of this size threads cost more than they save, several times more on a busy machine.
for library in ("OPENBLAS", "OMP", "MKL"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

from hypothesis import settings  # noqa: E402

# invtrack's own plugin comes with the package where that is installed, and from here in a checkout that is not.
pytest_plugins = ["pytester"]
if not entry_points(group="pytest11", name="invtrack"):
    pytest_plugins.append("invtrack.testing.plugin")

# The same examples in every run: a failure is never a matter of luck, and neither is a success.
settings.register_profile("fixed", derandomize=True, deadline=None)
settings.load_profile("fixed")


def pytest_collection_finish() -> None:
    """What tests are made of stays, so no search for garbage needs to look at it."""
    gc.collect()
    gc.freeze()
