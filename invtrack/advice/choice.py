"""Which of the trials is recommended, and why."""

from __future__ import annotations

import math
from collections.abc import Sequence

from invtrack.advice.task import Task
from invtrack.advice.trial import Trial

ALIKE = 1.05
"""Peak inputs, and times of ringing, within this factor of the least count as alike."""


def chosen(trials: Sequence[Trial], *, fastest: bool) -> Trial | None:
    """Of the trials that do what was asked, the one with the least peak input, and of those with about as little the least ringing.

    Of those that ring alike, too, it is one on the linear model where there is one, for that is the simpler plan. With `fastest`
    it is one of those alone that last shortest. None where no trial does what was asked.
    """
    good = [trial for trial in trials if trial.meets]
    if fastest:
        shortest = min((trial.duration for trial in good), default=0.0)
        good = [trial for trial in good if trial.duration == shortest]
    least = min((trial.peak_input for trial in good), default=0.0)
    alike = [trial for trial in good if trial.peak_input <= ALIKE * least]
    quietest = min(map(ringing, alike), default=0.0)
    quiet = [trial for trial in alike if ringing(trial) <= ALIKE * quietest]
    return min(quiet, key=lambda trial: (trial.plan.linearizations is not None, trial.peak_input), default=None)


def promise(trial: Trial) -> tuple[bool, float]:
    """A key that sorts the most promising first: those that do what was asked by peak input, then the others by error."""
    return (not trial.meets, trial.peak_input if trial.meets else trial.error)


def ringing(trial: Trial) -> float:
    """How long the input rings [s], infinite where that is not defined."""
    return math.inf if trial.ringing is None else trial.ringing


def ordered(trials: Sequence[Trial], recommended: Trial | None) -> list[Trial]:
    """The recommended one first, then those that do what was asked by their peak input, then the others by their error."""
    return sorted(
        trials,
        key=lambda trial: (trial is not recommended, *promise(trial), trial.error),
    )


def reason(task: Task, trials: Sequence[Trial], trial: Trial | None, *, fastest: bool, unit: str) -> str:
    """Why this trial is recommended, or why none is, in a few sentences."""
    asked = [f"an error of at most {100 * task.error:.3g} % of the motion"]
    if task.bounds:
        asked.append("the limits")
    if math.isfinite(task.max_preactuation):
        asked.append(f"at most {task.max_preactuation:.3g} s of preactuation")
    wanted = ", ".join(asked[:-1]) + (" and " if len(asked) > 1 else "") + asked[-1]
    if trial is None:
        return _none(trials, wanted)
    good = [each for each in trials if each.meets]
    peak = f"{trial.peak_input:.3g} {unit}".rstrip()
    later = f", though not before {trial.duration:.4g} s" if trial.duration > task.duration else ""
    said = [f"it keeps to {wanted}{later}"]
    others = [each for each in good if each is not trial and (not fastest or each.duration == trial.duration)]
    if fastest:
        said.append(f"no motion shorter than {trial.duration:.4g} s that was tried does")
    if not others:
        said.append("nothing else that was tried does")
    elif trial.peak_input <= min(each.peak_input for each in others):
        said.append(f"of {len(others) + 1} that do it takes the least peak input, {peak}")
    else:
        close = f"is within {100 * (ALIKE - 1):.0f} % of the least"
        said.append(f"its peak input, {peak}, {close}, and of those it rings about as little as any")
    if trial.error_off is not None:
        said.append(
            f"with parameters off its error is {100 * trial.error_off:.3g} % of the motion, {100 * trial.error:.3g} % without"
        )
    return "; ".join(said)


def _none(trials: Sequence[Trial], wanted: str) -> str:
    if not trials:
        return "no method applies; the table says why"
    nearest = min(trials, key=lambda trial: (len(trial.misses), trial.error))
    return (
        f"nothing that was tried keeps to {wanted}; nearest comes {nearest.method} with {nearest.duration:.4g} s for the motion: "
        f"{'; '.join(nearest.misses.values())}. Allow a larger error, a longer motion, or more of what is limited"
    )
