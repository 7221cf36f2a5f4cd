"""`invtrack report`: a page of a run or a study."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from invtrack.command.motion import share
from invtrack.command.printed import Printed
from invtrack.report import write_report


@dataclass(frozen=True, kw_only=True)
class Report(Printed):
    """Write one HTML page of a run or a study: the verdict, a table, figures, certificates, and how to repeat it."""

    run: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="RUN")]
    """The folder that `invtrack run`, or a study, has written."""

    out: Annotated[Path | None, tyro.conf.arg(metavar="PAGE.html")] = None
    """The page; report.html in the folder unless given."""

    error: Annotated[str, tyro.conf.arg(metavar="SHARE")] = "1%"
    """Share of the motion within which runs are to track, for the verdict."""

    def execute(self) -> int:
        """Write it and say where; 0."""
        path = write_report(self.run, self.out, error=share("--error", self.error))
        if self.json:
            print(json.dumps({"page": str(path)}, indent=2))
        elif not self.quiet:
            print(path)
        return 0
