"""Control laws in the record of a run: built-in ones as data, any other as a function that compiled code calls."""

from __future__ import annotations

import ctypes
from collections.abc import Callable

import numpy as np

from invtrack.arrays import Array
from invtrack.control.output_feedback import OutputFeedbackLaw
from invtrack.control.protocol import AffineLaw, DifferenceLaw, Law
from invtrack.errors import SimulationError
from invtrack.plans.plan import Difference
from invtrack.simulation.native.record import AFFINE, ASKED, ESTIMATING, RunMemory

_C_FUNCTION = ctypes.CFUNCTYPE(None, ctypes.c_int64)


class Calls:
    """Functions in Python that compiled code calls with a number; the first exception stops the run and is raised again here."""

    def __init__(self, memory: RunMemory) -> None:
        self._memory = memory
        self._failure: BaseException | None = None

    def address_of(self, name: str, function: Callable[[int], None]) -> int:
        """The address at which compiled code calls the function."""

        def guarded(number: int) -> None:
            try:
                function(number)
            except BaseException as failure:  # C cannot pass it on
                self._failure = self._failure or failure
                self._memory.put(stopped=1)

        kept = _C_FUNCTION(guarded)
        self._memory.keep(**{f"{name}_function": kept})
        return ctypes.cast(kept, ctypes.c_void_p).value or 0

    def raise_failure(self) -> None:
        """Raise what a function has raised, if one has."""
        if self._failure is not None:
            raise self._failure


Origins = Callable[[Array, Difference], Array | None]
"""The raw states (k, r) of states (k, n) that the loop measures from as this difference does; None where it does not."""


def put_law(memory: RunMemory, calls: Calls, law: Law, origins: Origins, *, n: int, p: int, m: int) -> None:
    """Put a law into the record of a run.

    Args:
        memory, calls: of the run.
        law: what is in force at each instant.
        origins: of the plant.
        n, p, m: numbers of states, inputs and measurements (0 where the law measures the state).
    """
    x, u, y, estimate = np.zeros(n), np.zeros(p), np.zeros(m), np.zeros(n if m else 0)
    memory.put(x=x, u=u, middle=np.zeros(p), y=y, estimate=estimate, n_measured=m)
    if type(law) is AffineLaw:
        memory.put(law=AFFINE)
        memory.copy(feedforward=law.offset, gains=np.stack(law.gains), which=law.which)
    elif type(law) is DifferenceLaw and (rows := origins(law.x_ref, law.difference)) is not None:
        memory.put(law=AFFINE)
        memory.copy(feedforward=law.feedforward, gains=np.stack(law.gains), which=law.which, origins=rows)
    elif type(law) is OutputFeedbackLaw:
        memory.put(law=ESTIMATING, none_seen=len(law.feedforward))
        memory.put(prior=np.zeros(n), deviation=np.zeros(n), innovation=np.zeros(m))
        memory.put(corrections=np.zeros((len(law.feedforward) + 1, p)))
        fields = ("feedforward", "x_ref", "expected", "seen_hold", "drift", "which")
        memory.copy(**{field: getattr(law, field) for field in fields})
        for field, name in (
            ("u_low", "low"),
            ("u_high", "high"),
            *((name, name) for name in ("K", "M", "C_m", "D_m", "A_d", "B_d")),
        ):
            memory.copy(**{field: np.stack([np.asarray(getattr(design, name), dtype=float) for design in law.designs])})
    else:
        measured = y if m else x

        def ask(instant: int) -> None:
            u[:] = _checked(law.update(instant, measured.copy()), p)
            if m:
                estimate[:] = np.asarray(law.estimate, dtype=float)

        memory.put(law=ASKED, ask=calls.address_of("ask", ask))


def _checked(u: Array, p: int) -> Array:
    if np.shape(u) != (p,):
        raise SimulationError(f"the controller's law must return an input ({p},), got shape {np.shape(u)}")
    return u
