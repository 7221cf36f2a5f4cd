"""`invtrack study`: the simulations that come with invtrack, from wherever it is installed."""

from __future__ import annotations

import ast
import runpy
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from invtrack.errors import InvtrackError


@dataclass(frozen=True, kw_only=True)
class ShippedStudy:
    """Run a simulation that comes with invtrack, such as cantilever_jumps; its options follow its name. Without one, list all."""

    name: Annotated[tyro.conf.Positional[str | None], tyro.conf.arg(metavar="NAME")] = None
    """Which one."""

    def execute(self) -> int:
        """List them; one with a name is run by `run_study` before the command line is read any further."""
        for name, path in shipped().items():
            text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
            print(f"{name}: {text.partition(chr(10) * 2)[0].replace(chr(10), ' ')}")
        return 0


def run_study(words: Sequence[str]) -> None:
    """Run the study named first with the options after it, as `python sims/NAME.py` does; it ends the program itself.

    Raises InvtrackError, with the names there are, for a study that there is not.
    """
    name, *options = words
    studies = shipped()
    if name not in studies:
        raise InvtrackError(f"there is no study {name!r}; there are: {', '.join(studies)}")
    script = studies[name]
    sys.path.insert(0, str(script.parent))  # where its neighbours are, as for a script
    sys.argv[:] = [str(script), *options]
    runpy.run_path(str(script), run_name="__main__")


def shipped() -> dict[str, Path]:
    """The studies by their names: a wheel carries them inside the package, a checkout has them in `sims/` beside it.

    Raises InvtrackError where there are none.
    """
    package = Path(__file__).resolve().parents[1]
    found = {path.stem: path for folder in (package.parent / "sims", package / "sims") for path in sorted(folder.glob("*.py"))}
    if not found:
        raise InvtrackError(f"no studies came with {package}; take a checkout of the project, which has them in sims/")
    return found
