"""Malformed calls: a right one with one argument, or two, replaced from the table of bad values."""

from __future__ import annotations

import contextlib
import io
import os
import signal
import tempfile
import time
from collections.abc import Iterator
from functools import lru_cache
from types import FrameType

import numpy as np

from invtrack.errors import InvtrackError
from tests.random_draws.bad_values import BAD_VALUES, NEVER_RIGHT
from tests.random_draws.outcomes import Kind, Outcome
from tests.random_draws.valid_calls import valid_calls

PATIENCE = 20.0
"""A call that takes longer [s] counts as endless: a right one takes a tenth of a second or so."""

TWO_AT_ONCE = 0.1
"""Share of the calls in which two arguments are replaced."""


class EndlessError(BaseException):
    """The call has not ended in time; no Exception, so that nothing that is tested catches it."""


@lru_cache(maxsize=1)
def workplace() -> tempfile.TemporaryDirectory[str]:
    """The folder in which this process makes its calls, so that what they write goes away with it."""
    folder = tempfile.TemporaryDirectory()
    os.chdir(folder.name)
    return folder


def call_outcome(seed: int, number: int) -> Outcome:
    """Make the malformed call of this number in the sequence that `seed` starts: each once before any comes again."""
    begin = time.perf_counter()
    workplace()
    calls = valid_calls()
    every = [(name, argument, value) for name, call in calls.items() for argument in call.arguments for value in BAD_VALUES]
    order = np.random.default_rng([seed, 2]).permutation(len(every))
    name, argument, value = every[order[number % len(every)]]
    rng = np.random.default_rng([seed, number, 3])
    replaced = {argument: value}
    if rng.random() < TWO_AT_ONCE:
        replaced[str(rng.choice(list(calls[name].arguments)))] = str(rng.choice(list(BAD_VALUES)))
    kind, detail = attempted(name, replaced)
    shown = ", ".join(f"{which} = {value}" for which, value in replaced.items())
    return Outcome(number, name, kind, f"{shown}: {detail}", seconds=time.perf_counter() - begin)


def attempted(name: str, replaced: dict[str, str]) -> tuple[Kind, str]:
    """What the call of this name does with values from the table in the place of some of its arguments."""
    call = valid_calls()[name]
    arguments = {**call.arguments, **{argument: BAD_VALUES[value]() for argument, value in replaced.items()}}
    try:
        with impatient(), contextlib.redirect_stdout(io.StringIO()):
            call.function(**arguments)
    except InvtrackError as refusal:
        return "refused", f"{type(refusal).__name__}: {str(refusal)[:160]}"
    except EndlessError:
        return "endless", f"not done after {PATIENCE:g} s"
    except Exception as fault:
        return "foreign exception", f"{type(fault).__name__}: {str(fault)[:160]}"
    wrong = [value for argument, value in replaced.items() if value in NEVER_RIGHT and argument not in call.open]
    return ("malformed, yet accepted", "no error") if wrong else ("accepted", "")


@contextlib.contextmanager
def impatient() -> Iterator[None]:
    """Ends what takes too long, where the platform has a timer for that."""

    def stop(number: int, frame: FrameType | None) -> None:
        raise EndlessError

    previous = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, PATIENCE)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, previous)
