"""Many draws on all cores, their table, and whether they keep the bounds."""

from __future__ import annotations

import json
import multiprocessing
import re
import sys
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import tyro

from tests.random_draws.calls import call_outcome
from tests.random_draws.outcomes import KINDS, Kind, Outcome, counted, plant_outcome, switched_outcome, wide_outcome

REFUSED_AT_MOST = 1e-3
"""Largest share of the draws that are solvable by a margin which may be refused."""


@dataclass(frozen=True)
class Draws:
    """What to draw and where to put what came of it.

    Args:
        plants: how many plants.
        wide: how many plants with more inputs than outputs.
        switched: how many switched plants.
        calls: how many malformed calls.
        seed: starts the sequences.
        first: number of the first draw of each sequence.
        processes: how many at a time; as many as there are cores unless stated.
        json: file for all counts, and every draw that is neither a right plan nor a confirmed refusal.
    """

    plants: int = 10_000
    wide: int = 200
    switched: int = 1_000
    calls: int = 10_000
    seed: int = 0
    first: int = 0
    processes: int | None = None
    json: Path | None = None


SEQUENCES: dict[str, Callable[[int, int], Outcome]] = {
    "plants": plant_outcome,
    "wide": wide_outcome,
    "switched": switched_outcome,
    "calls": call_outcome,
}


def main(arguments: list[str] | None = None) -> int:
    """Draw, print, and return 1 where a bound is broken."""
    draws = tyro.cli(Draws, args=arguments, description=__doc__)
    report: dict[str, object] = {"draws": {**asdict(draws), "json": str(draws.json)}}
    faults: list[str] = []
    for name, judge in SEQUENCES.items():
        numbers = range(draws.first, draws.first + getattr(draws, name))
        outcomes = list(_shown(name, drawn(partial(judge, draws.seed), numbers, draws.processes), len(numbers)))
        if outcomes:
            print(table(name, outcomes))
            faults += broken_bounds(name, outcomes)
            report[name] = summary(outcomes)
    if draws.json is not None:
        draws.json.write_text(json.dumps({**report, "broken_bounds": faults}, indent=1), encoding="utf-8")
    for fault in faults:
        print(fault)
    return 1 if faults else 0


def drawn(judge: Callable[[int], Outcome], numbers: range, processes: int | None) -> Iterator[Outcome]:
    """What becomes of each number, in any order."""
    if processes == 1 or len(numbers) < 2:
        _begin()
        yield from map(judge, numbers)
        return
    with multiprocessing.get_context("spawn").Pool(processes, initializer=_begin) as pool:
        yield from pool.imap_unordered(judge, numbers, chunksize=max(1, min(20, len(numbers) // 20)))


def _begin() -> None:
    warnings.simplefilter("ignore")  # what a malformed number makes of arithmetic on the way to its refusal


def _shown(name: str, outcomes: Iterable[Outcome], total: int) -> Iterator[Outcome]:
    """The same outcomes, with a line on the terminal that says how far they are."""
    kinds: Counter[Kind] = Counter()
    for count, outcome in enumerate(outcomes, start=1):
        kinds[outcome.kind] += 1
        if sys.stderr.isatty() or count % 100 == 0 or count == total:
            suspect = ", ".join(f"{kinds[kind]} {kind}" for kind in SUSPECT if kinds[kind])
            print(f"\r{name}: {count} of {total}; {suspect or 'nothing suspect'} ", end="", file=sys.stderr, flush=True)
        yield outcome
    if total:
        print(file=sys.stderr)


SUSPECT: tuple[Kind, ...] = (
    "plan wrong",
    "refused though solvable",
    "refused, reason not confirmed",
    "malformed, yet accepted",
    "endless",
    "foreign exception",
)
"""What must not be, or only rarely."""


def table(name: str, outcomes: list[Outcome]) -> str:
    """Counts by family as text, and of what is suspect the commonest details with a number that shows each."""
    counts = counted(outcomes)
    kinds = [kind for kind in KINDS if any(count[kind] for count in counts.values())]
    width = max(len(family) for family in counts) + 2
    lines = [f"{name}: {len(outcomes)} drawn", " " * width + "  ".join(kinds)]
    for family, count in sorted(counts.items()):
        lines.append(f"{family:<{width}}" + "  ".join(f"{count[kind]:>{len(kind)}}" for kind in kinds))
    total = sum(counts.values(), Counter[Kind]())
    lines.append(f"{'all':<{width}}" + "  ".join(f"{total[kind]:>{len(kind)}}" for kind in kinds))
    right = [outcome.worst for outcome in outcomes if outcome.kind == "plan right"]
    if right:
        lines.append(f"largest contradiction among the right plans: {max(right):.1e} of the terms' size")
    for kind in SUSPECT:
        found: dict[str, list[int]] = {}
        for outcome in outcomes:
            if outcome.kind == kind:
                alike = re.sub(r"\[.*?\]|-?\d[-+.\de]*", "#", outcome.detail)  # but for numbers and names of channels
                found.setdefault(f"{outcome.family}: {alike[:110]}", []).append(outcome.number)
        for detail, numbers in sorted(found.items(), key=lambda item: -len(item[1]))[:40]:
            lines.append(f"  {kind} x {len(numbers)} (as no. {min(numbers)}): {detail}")
    return "\n".join(lines)


def broken_bounds(name: str, outcomes: list[Outcome]) -> list[str]:
    """What must not be, in words."""
    total = sum(counted(outcomes).values(), Counter[Kind]())
    faults = [
        f"{name}: {total[kind]} times {kind}, allowed: never"
        for kind in SUSPECT
        if total[kind] and kind != "refused though solvable"
    ]
    refused = total["refused though solvable"]
    solvable = refused + total["plan right"] + total["plan wrong"]
    if refused > REFUSED_AT_MOST * solvable:
        faults.append(f"{name}: {refused} of {solvable} refused though solvable by a margin, allowed: {REFUSED_AT_MOST:g} of them")
    return faults


def summary(outcomes: list[Outcome]) -> dict[str, object]:
    """Counts by family, and every suspect draw."""
    return {
        "counts": {family: dict(count) for family, count in counted(outcomes).items()},
        "largest_contradiction_of_a_right_plan": max((o.worst for o in outcomes if o.kind == "plan right"), default=0.0),
        "seconds": sum(outcome.seconds for outcome in outcomes),
        "suspect": [asdict(outcome) for outcome in outcomes if outcome.kind in SUSPECT],
    }
