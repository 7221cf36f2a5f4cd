"""MuJoCo's warnings, collected run by run."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import mujoco

_lock = threading.Lock()
_lists: dict[int, list[list[str]]] = {}  # by thread, of nested blocks the inner one last
_previous: list[object] = []


@contextmanager
def mujoco_warnings() -> Iterator[list[str]]:
    """Collect the texts of MuJoCo's warnings in this thread in a list, in place of its log file MUJOCO_LOG.TXT and its lines on
    stderr.

    MuJoCo warns of each kind once per MjData. Its handler is global to the process: it is installed while any block lives, and what
    was there before gets the warnings of other threads and is back in place at the end.
    """
    texts: list[str] = []
    thread = threading.get_ident()
    with _lock:
        if not _lists:
            _previous[:] = [mujoco.get_mju_user_warning()]
            mujoco.set_mju_user_warning(_collect)
        _lists.setdefault(thread, []).append(texts)
    try:
        yield texts
    finally:
        with _lock:
            _lists[thread].pop()
            if not _lists[thread]:
                del _lists[thread]
            if not _lists:
                mujoco.set_mju_user_warning(_previous.pop())


def _collect(text: str) -> None:
    ours = _lists.get(threading.get_ident())
    if ours:
        ours[-1].append(text)
    elif _previous and callable(_previous[0]):
        _previous[0](text)
    else:
        print(f"WARNING: {text}", file=sys.stderr)
