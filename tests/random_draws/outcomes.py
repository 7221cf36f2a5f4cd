"""One draw planned and judged, and counts of many."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from invtrack.errors import InvtrackError
from invtrack.inversion.exact import invert
from tests.random_draws.invariant_zeros import judged
from tests.random_draws.jump_conditions import judged_jumps
from tests.random_draws.least_inputs import HiddenMotions, gain
from tests.random_draws.plants import drawn_plant
from tests.random_draws.shooting import contradiction
from tests.random_draws.switched_plants import drawn_jumps
from tests.random_draws.wide_plants import drawn_wide_plant

WRONG = 1e-6
"""A plan is wrong where the independent integration contradicts it by more than this share of the terms' size."""

Kind = Literal[
    "plan right",
    "plan wrong",
    "refused, no solution",
    "refused, in the band",
    "refused, reason not confirmed",
    "refused though solvable",
    "refused",
    "accepted",
    "malformed, yet accepted",
    "endless",
    "foreign exception",
]
"""Of plans, of refusals by what an independent judgement makes of them, and of malformed calls."""

KINDS: tuple[Kind, ...] = get_args(Kind)

REASONS = {
    "on the axis": ("NonHyperbolicError",),
    "degenerate": ("RelativeDegreeError",),
    "incompatible": ("CompatibilityError",),
    "unbounded": ("BoundednessError",),
    "either": ("CompatibilityError", "BoundednessError"),
}
"""What a refusal must be called where an independent judgement finds that there is no inverse."""


@dataclass(frozen=True)
class Outcome:
    """What became of one draw.

    Args:
        number: of the draw.
        family: what was drawn.
        kind: what came of it.
        detail: class and first words of an exception, or which condition a wrong plan misses.
        worst: the plan's contradiction; 0 without a plan.
        seconds: how long it took.
    """

    number: int
    family: str
    kind: Kind
    detail: str = ""
    worst: float = 0.0
    seconds: float = 0.0


def plant_outcome(seed: int, number: int) -> Outcome:
    """Draw a plant, plan its exact inverse, judge what comes."""
    begin = time.perf_counter()
    drawn = drawn_plant(seed, number)
    judgement = judged(drawn.unit)

    def attempt() -> tuple[Kind, str, float]:
        plan = invert(drawn.model, drawn.reference)
        found = contradiction(plan, [drawn.unit], np.zeros(0), drawn.units, zeros=judgement.zeros)
        return ("plan right", "", found.worst) if found.worst <= WRONG else ("plan wrong", str(found), found.worst)

    kind, detail, worst = judged_attempt(attempt, judgement.verdict)
    return Outcome(number, drawn.family, kind, detail, worst, time.perf_counter() - begin)


def wide_outcome(seed: int, number: int) -> Outcome:
    """Draw a plant with more inputs than outputs, plan its exact inverse of least input, judge what comes."""
    begin = time.perf_counter()
    drawn = drawn_wide_plant(seed, number)
    motions = HiddenMotions.of(drawn.unit)
    judgement = judged(drawn.unit) if motions is None else motions.judgement(drawn.weight)

    def attempt() -> tuple[Kind, str, float]:
        plan = invert(drawn.model, drawn.reference, R=drawn.R)
        found = contradiction(plan, [drawn.unit], np.zeros(0), drawn.units, zeros=judgement.zeros)
        saved = gain(plan, drawn.unit, drawn.units, drawn.weight, judgement.zeros)
        worst = max(found.worst, saved)
        return ("plan right", "", worst) if worst <= WRONG else ("plan wrong", f"{found}, gain={saved}", worst)

    kind, detail, worst = judged_attempt(attempt, judgement.verdict)
    return Outcome(number, drawn.family, kind, detail, worst, time.perf_counter() - begin)


def switched_outcome(seed: int, number: int) -> Outcome:
    """Draw a plant that jumps, plan its exact inverse, judge what comes."""
    begin = time.perf_counter()
    drawn = drawn_jumps(seed, number)
    judgement = judged_jumps(drawn)

    def attempt() -> tuple[Kind, str, float]:
        plan = invert(drawn.model, drawn.reference)
        found = contradiction(plan, drawn.plants, drawn.switch_times, drawn.units, zeros=judgement.zeros)
        return ("plan right", "", found.worst) if found.worst <= WRONG else ("plan wrong", str(found), found.worst)

    kind, detail, worst = judged_attempt(attempt, judgement.verdict)
    return Outcome(number, drawn.family, kind, detail, worst, time.perf_counter() - begin)


def judged_attempt(attempt: Callable[[], tuple[Kind, str, float]], verdict: str) -> tuple[Kind, str, float]:
    """What `attempt` finds of a plan; of a refusal, what the independent verdict on the draw makes of it."""
    try:
        return attempt()
    except InvtrackError as refusal:
        name = type(refusal).__name__
        detail = f"{name}: {str(refusal)[:160]}"
        if verdict == "solvable":
            return "refused though solvable", detail, 0.0
        if verdict == "band":
            return "refused, in the band", detail, 0.0
        return (
            ("refused, no solution" if name in REASONS[verdict] else "refused, reason not confirmed"),
            f"{verdict}; {detail}",
            0.0,
        )
    except Exception as fault:
        return "foreign exception", f"{type(fault).__name__}: {str(fault)[:160]}", 0.0


def counted(outcomes: Iterable[Outcome]) -> dict[str, Counter[Kind]]:
    """How often each kind came of each family."""
    table: dict[str, Counter[Kind]] = {}
    for outcome in outcomes:
        table.setdefault(outcome.family, Counter())[outcome.kind] += 1
    return table
