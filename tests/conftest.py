"""Settings of all tests."""

from __future__ import annotations

from hypothesis import settings

# The same examples in every run: a failure is never a matter of luck, and neither is a success.
settings.register_profile("fixed", derandomize=True, deadline=None)
settings.load_profile("fixed")
