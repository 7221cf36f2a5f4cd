"""MuJoCo's callbacks for compiled code: installed once for the process, they serve what is registered and nothing else.

The callbacks of MuJoCo are global to the process, and called from any thread. What is installed here is a C function that looks the
address of the model (or of the data) up in a table of those that are registered and returns at once where it is not there, so that
models in other threads, models that are being compiled and models of the user go on undisturbed.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import mujoco
import numpy as np

from invtrack.errors import PlantError

SLOTS = 1024
"""So many models, or data, may be registered at a time."""

_C_CALLBACK = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)
_C_FUNCTION: Any = _C_CALLBACK.__mro__[1]  # what every pointer to a C function is


class CallbackSlots:
    """The models (or data) that one of MuJoCo's global callbacks serves.

    kind: "control" or "passive". size: how many at a time. address: of the table in memory, the number of slots in use and then
    pairs of key and value, in which compiled code looks (`invtrack.plant.native.pointers.registered`). Before the first block
    starts `serve` says which C function is called; it is in place as long as any block lives.
    """

    def __init__(self, kind: str, size: int = SLOTS) -> None:
        self._get: Callable[[], Any] = getattr(mujoco, f"get_mjcb_{kind}")
        self._set: Callable[[Any], None] = getattr(mujoco, f"set_mjcb_{kind}")
        self._slots = np.zeros(1 + 2 * size, dtype=np.int64)
        self.address = int(self._slots.ctypes.data)
        self._lock = threading.Lock()
        self._blocks = 0
        self._previous: Any = None
        self._function: Any = None

    def serve(self, function: Any) -> None:
        """The compiled callback (`invtrack.plant.native.pointers.callback`) that looks into the table."""
        self._function = _C_CALLBACK(function.address)

    @contextmanager
    def block(self, key: int, value: int) -> Iterator[None]:
        """A block in which `value`, an address, is registered under `key`, the address of a model or of data.

        A callback that was there before keeps serving everything that is not registered here, and is back in place afterwards.

        Raises PlantError where all slots are taken.
        """
        slot = self._enter(key, value)
        try:
            yield
        finally:
            self._leave(slot)

    def _enter(self, key: int, value: int) -> int:
        with self._lock:
            pairs = self._slots[1:].reshape(-1, 2)
            free = np.flatnonzero(pairs[:, 0] == 0)
            # After the latest in use, as long as there is room: of nested blocks for one model the inner one counts.
            used = int(self._slots[0])
            slot = used if used < len(pairs) else int(free[0]) if len(free) else -1
            if slot < 0:
                raise PlantError(
                    f"{len(pairs)} runs and blocks with forces are under way in this process, and no more are possible at a time; "
                    "wait for some to end, or use several processes"
                )
            pairs[slot] = 0, value
            pairs[slot, 0] = key
            self._slots[0] = max(used, slot + 1)
            self._blocks += 1
            if self._blocks == 1:
                self._previous = self._get()
                self._set(self._function if self._previous is None else self._beside(self._previous))
        return slot

    def _leave(self, slot: int) -> None:
        with self._lock:
            pairs = self._slots[1:].reshape(-1, 2)
            pairs[slot] = 0
            in_use = np.flatnonzero(pairs[:, 0])
            self._slots[0] = in_use[-1] + 1 if len(in_use) else 0
            self._blocks -= 1
            if self._blocks == 0:
                self._set(self._previous)
                self._previous = None

    def _beside(self, other: Callable[..., object]) -> Callable[[Any, Any], None]:
        """A callback in Python for the case that somebody else has installed one, which it calls for what is not ours."""
        function, slots = self._function, self._slots

        def dispatch(model: mujoco.MjModel, data: mujoco.MjData) -> None:
            keys = slots[1 : 1 + 2 * int(slots[0]) : 2]
            if model._address in keys or data._address in keys:
                function(model._address, data._address)
            elif isinstance(other, _C_FUNCTION):
                other(model._address, data._address)
            else:
                other(model, data)

        return dispatch

    @contextmanager
    def suspended(self) -> Iterator[None]:
        """A block without callbacks in Python, which cannot be given a model that is not finished; the compiled one stays."""
        installed = self._get()
        if installed is None or installed is self._function:
            yield
            return
        self._set(self._function if self._blocks else None)
        try:
            yield
        finally:
            self._set(installed)


PASSIVE = CallbackSlots("passive")
"""Models whose passive forces are computed by compiled code."""

CONTROL = CallbackSlots("control")
"""Data whose controls are computed by compiled code."""


@contextmanager
def python_callbacks_suspended() -> Iterator[None]:
    """A block in which MuJoCo may try out what it compiles: no callback in Python is called."""
    with PASSIVE.suspended(), CONTROL.suspended():
        yield
