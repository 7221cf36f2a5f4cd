"""`invtrack animate`: runs that were kept as a moving picture."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import tyro

from invtrack.command.view import named_runs, recordings


@dataclass(frozen=True, kw_only=True)
class Animate:
    """Draw runs side by side as a small moving picture, WebP or GIF, without a display."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="RUN")]
    """Recordings (.rrd), or folders of runs."""

    out: Annotated[Path, tyro.conf.arg(metavar="FILE")] = Path("motion.webp")
    """The file, which ends in .webp or .gif."""

    rate: Annotated[float, tyro.conf.arg(metavar="1/s")] = 15.0
    """Pictures per second."""

    width: Annotated[int, tyro.conf.arg(metavar="PIXELS")] = 400
    """Of each run's picture."""

    height: Annotated[int, tyro.conf.arg(metavar="PIXELS")] = 300
    """Of each run's picture."""

    camera: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """A camera of the model to look with, in place of where the motion is seen best."""

    def execute(self) -> int:
        """Draw, and say where; 0."""
        from invtrack.recording import save_animation  # loads Rerun, which nobody waits for who asks for something else

        runs = [replace(run, name=name) for name, run in named_runs(recordings(self.runs)).items()]
        drawn = save_animation(runs, self.out, rate=self.rate, width=self.width, height=self.height, camera=self.camera)
        print(f"written to {drawn}")
        return 0
