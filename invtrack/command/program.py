"""The program: subcommands, and how each of them ends."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from importlib.metadata import version
from typing import Annotated, NoReturn

import tyro

from invtrack.command.advise import Advise
from invtrack.command.animate import Animate
from invtrack.command.doctor import Doctor
from invtrack.command.export import Export
from invtrack.command.report import Report
from invtrack.command.run import Run
from invtrack.command.shipped_studies import ShippedStudy, run_study
from invtrack.command.view import Compare, View
from invtrack.command.zeros import Zeros
from invtrack.errors import InvtrackError

Command = (
    Annotated[Zeros, tyro.conf.subcommand("zeros")]
    | Annotated[Advise, tyro.conf.subcommand("advise")]
    | Annotated[Run, tyro.conf.subcommand("run")]
    | Annotated[Export, tyro.conf.subcommand("export")]
    | Annotated[View, tyro.conf.subcommand("view")]
    | Annotated[Animate, tyro.conf.subcommand("animate")]
    | Annotated[Compare, tyro.conf.subcommand("compare")]
    | Annotated[Report, tyro.conf.subcommand("report")]
    | Annotated[ShippedStudy, tyro.conf.subcommand("study")]
    | Annotated[Doctor, tyro.conf.subcommand("doctor")]
)

DESCRIPTION = """Inversion-based output tracking of flexible, nonminimum-phase mechanisms, validated in MuJoCo.

Exit status: 0 done, 1 refused, 2 a command line that cannot be read, 3 a simulation diverged, 130 interrupted.

Completion by the tab key, once for all: invtrack --tyro-write-completion bash ~/.local/share/bash-completion/completions/invtrack
(zsh: a file _invtrack in a folder of your fpath)."""

BROKEN_PIPE = 141
"""128 + SIGPIPE, as shells report a program whose reader has gone."""


def main(args: Sequence[str] | None = None) -> NoReturn:
    """Read the command line (the process's unless given), do what it says, and end the program.

    What cannot be done ends with one readable line; an exception that is none of invtrack's is a defect and keeps its traceback.
    """
    words = list(sys.argv[1:] if args is None else args)
    if words == ["--version"]:
        print(f"invtrack {version('invtrack')}")
        raise SystemExit(0)
    try:
        if len(words) > 1 and words[0] == "study" and not words[1].startswith("-"):
            run_study(words[1:])
            raise SystemExit(0)
        command = tyro.cli(Command, prog="invtrack", description=DESCRIPTION, args=words)
        status = command.execute()
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # what is still to be written would be complained of
        raise SystemExit(BROKEN_PIPE) from None
    except (InvtrackError, OSError) as error:
        message = f"{error.filename}: {error.strerror}" if isinstance(error, OSError) and error.filename else str(error)
        print(f"invtrack: {'; '.join([message, *getattr(error, '__notes__', [])])}", file=sys.stderr)
        raise SystemExit(1) from None
    except KeyboardInterrupt:
        print("invtrack: interrupted", file=sys.stderr)
        raise SystemExit(130) from None
    raise SystemExit(status)
