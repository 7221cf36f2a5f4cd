"""The command line that every sim shares, and the way a sim ends."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, TypeVar

import tyro

from invtrack.errors import InvtrackError, SimulationError

FAILED = 1
INTERRUPTED = 130  # 128 + SIGINT, as shells report it

# One flag, --no-figures, instead of the pair that a bool would give.
_Figures = Annotated[
    tyro.conf.FlagCreatePairsOff[bool],
    tyro.conf.arg(help="Draw no figures.", help_behavior_hint="(default: figures are drawn)"),
]


@dataclass(frozen=True, kw_only=True)
class SimOptions:
    """Options of every sim. A sim with more options of its own derives from this class."""

    out: Path
    """Directory for summary.json, recordings and figures; made if it is not there."""

    timestep: float
    """Largest physics step [s]."""

    record_every: int = 10
    """The recording keeps every so many samples; 1 keeps all (metrics and figures always use all)."""

    figures: _Figures = True
    """Whether to draw figures."""

    def __post_init__(self) -> None:
        if self.record_every < 1:
            raise SimulationError(f"--record-every: expected a whole number from 1 on, got {self.record_every}")
        if not (math.isfinite(self.timestep) and self.timestep > 0):
            raise SimulationError(f"--timestep: expected a positive, finite number of seconds such as 1e-3, got {self.timestep}")


Options = TypeVar("Options", bound=SimOptions)


def run_sim(
    main: Callable[[Options], object], *, defaults: Options, description: str = "", args: Sequence[str] | None = None
) -> None:
    """Read the command line, call main(options), and end the program with one readable line where that fails.

    `defaults` holds the sim's own defaults and, by its type, the options that there are:

        run_sim(main, defaults=SimOptions(out=Path("runs/cantilever_jumps"), timestep=1e-3), description=__doc__)

    `args` are the command line's words, those of the process unless given. Raises SystemExit with status 0 for --help, 2 for
    options that cannot be used, 1 where the sim raises InvtrackError or a file cannot be used, 130 where it is interrupted. Any
    other exception is a defect and keeps its traceback.
    """
    try:
        main(_parse(defaults, description, args))
    except InvtrackError as error:
        _leave(str(error), FAILED)
    except KeyboardInterrupt:
        _leave("interrupted", INTERRUPTED)
    except OSError as error:
        name = f"{error.filename}: " if error.filename else ""
        _leave(f"{name}{error.strerror or error}", FAILED)


def _parse(defaults: Options, description: str, args: Sequence[str] | None) -> Options:
    return tyro.cli(type(defaults), default=defaults, description=description, args=args)


def _leave(message: str, status: int) -> None:
    print(f"{Path(sys.argv[0]).stem}: {message}", file=sys.stderr)
    raise SystemExit(status)
