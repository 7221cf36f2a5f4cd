"""The command: draws, judges, prints a table, and fails where a bound is broken."""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # a process for each core; before numpy is loaded

from tests.random_draws.command import main

if __name__ == "__main__":
    raise SystemExit(main())
