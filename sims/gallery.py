"""The gallery: MJCF files that others made, as they come with packages on PyPI, from the file to a recording or to a refusal.

For each mechanism: its equilibrium (`trim`), its linear model, a small motion of its outputs planned on that, LQR feedback, the run
in MuJoCo. What is refused is shown with its reason, and where the reason names a remedy the next entry has taken it. Nothing is
copied: `pip install '.[gallery]'` brings the packages.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import tyro
from mechanisms.entry import PACKAGES
from mechanisms.machines import MACHINES
from mechanisms.reinforcement import GYMNASIUM
from mechanisms.suite import DM_CONTROL

from invtrack.errors import InvtrackError
from invtrack.studies import Column, Session, Setup, Study, StudyOptions, Table
from invtrack.studies.session import MissingError

ENTRIES = {entry.name: entry for entry in (*GYMNASIUM, *DM_CONTROL, *MACHINES)}


@dataclass(frozen=True, kw_only=True)
class GalleryOptions(StudyOptions):
    """Options of the gallery."""

    package: Annotated[tuple[str, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="NAME")] = ()
    """Run only the entries whose files come with this package; may be given several times. Others need not be installed then."""

    def __post_init__(self) -> None:
        super().__post_init__()
        unknown = sorted(set(self.package) - set(PACKAGES))
        if unknown:
            raise InvtrackError(f"--package: there is no package {', '.join(unknown)}; there are: {', '.join(PACKAGES)}")


def build(options: GalleryOptions) -> Setup:
    wanted = [entry for entry in ENTRIES.values() if not options.package or entry.package in options.package]
    columns = [
        Column("method"),
        Column("motion"),
        Column("max error", "of motion", key="error_share"),
        Column("peak input", key="hardest_peak"),
        Column("share of range", key="range_share"),
        Column("preactuation time", "s"),
        Column("time", "s"),
    ]
    return Setup([entry.case() for entry in wanted], report=[Table("Gallery", columns), refusals])


def refusals(done: Session) -> str:
    """What was refused, and why."""
    refused = {name: numbers["reason"] for name, numbers in done.numbers.items() if numbers["status"] == "refused"}
    if not refused:
        raise MissingError("refusals")
    return "\n".join(f"{name} was refused: {reason}" for name, reason in refused.items())


STUDY = Study("gallery", build, description=__doc__, defaults=GalleryOptions())

if __name__ == "__main__":
    STUDY.main()
