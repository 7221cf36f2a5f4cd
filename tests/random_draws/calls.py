"""Malformed calls: a right one with one argument, or two, replaced from the table of bad values."""

from __future__ import annotations

import contextlib
import io
import signal
import time
from collections.abc import Iterator
from types import FrameType

import numpy as np

from invtrack.errors import InvtrackError
from invtrack.testing import RunAssertionError
from tests.random_draws.bad_values import BAD_VALUES, FUNCTIONS, NEVER_RIGHT
from tests.random_draws.outcomes import Kind, Outcome
from tests.random_draws.valid_calls import Call, valid_calls, workplace

PATIENCE = 20.0
"""A call that computes for longer [s] counts as endless: a right one takes a tenth of a second or so."""

TWO_AT_ONCE = 0.1
"""Share of the calls in which two arguments are replaced."""


class EndlessError(BaseException):
    """The call has not ended in time; no Exception, so that nothing that is tested catches it."""


def call_outcome(seed: int, number: int) -> Outcome:
    """Make the malformed call of this number in the sequence that `seed` starts: each once before any comes again."""
    begin = time.perf_counter()
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
        with impatient(), contextlib.chdir(workplace().name), contextlib.redirect_stdout(io.StringIO()):
            call.function(**arguments)
    except InvtrackError as refusal:
        return "refused", f"{type(refusal).__name__}: {str(refusal)[:160]}"
    except RunAssertionError as answer:  # an assertion that judges the run by what it was given
        return "accepted", str(answer)[:160]
    except EndlessError:
        return "endless", f"not done after {PATIENCE:g} s"
    except Exception as fault:
        if any(_is_function(call, *each) for each in replaced.items()):
            return "accepted", "the user's own function fails"
        return "foreign exception", f"{type(fault).__name__}: {str(fault)[:160]}"
    wrong = [
        value
        for argument, value in replaced.items()
        if value in NEVER_RIGHT and value not in call.takes and not _is_function(call, argument, value)
    ]
    return ("malformed, yet accepted", "no error") if wrong else ("accepted", "")


def _is_function(call: Call, argument: str, value: str) -> bool:
    """Whether a function is expected there and the value can be called, as some libraries' systems can."""
    return argument in call.callbacks and value in FUNCTIONS


@contextlib.contextmanager
def impatient() -> Iterator[None]:
    """Ends what computes for too long; time in which other processes have the processor does not count."""

    def stop(number: int, frame: FrameType | None) -> None:
        raise EndlessError

    previous = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, PATIENCE)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, previous)
