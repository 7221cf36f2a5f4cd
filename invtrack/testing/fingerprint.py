"""When two calls ask for the same simulation: a digest of everything that they hand over, by content."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import PurePath
from typing import Any

import mujoco
import numpy as np

_PLAIN = (type(None), bool, int, float, complex, str, bytes, PurePath)


def fingerprint(value: Any) -> bytes:
    """Equal digests for what is equal in content: numbers, texts, arrays, models, and objects of one class made up of these.

    The content of an object is what Python would copy or pickle of it, without what it has cached (cached properties). What has no
    such content (a function, a class, an object of an extension module) stands for itself by its identity, which means something
    only as long as it is kept alive.
    """
    return _digest(value, {})


def _digest(value: Any, known: dict[int, tuple[Any, bytes]]) -> bytes:
    """known: objects with their digests by identity, so that what is shared is read once, and what holds itself comes to an end."""
    if isinstance(value, _PLAIN):
        return _hash(type(value).__qualname__.encode(), repr(value).encode())
    if id(value) not in known:
        known[id(value)] = value, b"number %d" % len(known)
        known[id(value)] = value, _hash(*_parts(value, known))
    return known[id(value)][1]


def _parts(value: Any, known: dict[int, tuple[Any, bytes]]) -> Iterator[bytes]:
    yield b"%s %d" % (type(value).__qualname__.encode(), id(type(value)))
    if isinstance(value, (np.ndarray, np.generic)) and value.dtype != object:
        yield f"{value.dtype.str} {value.shape}".encode()
        yield value.tobytes()
    elif isinstance(value, mujoco.MjModel):
        buffer = np.empty(mujoco.mj_sizeModel(value), np.uint8)
        mujoco.mj_saveModel(value, None, buffer)
        yield buffer.tobytes()
    elif isinstance(value, mujoco.MjSpec):
        return  # what a plant was compiled from: the compiled model stands beside it, and is what is simulated
    elif isinstance(value, Mapping):
        for key, entry in value.items():
            yield _digest(key, known)
            yield _digest(entry, known)
    elif isinstance(value, (list, tuple, np.ndarray)):
        yield from (_digest(entry, known) for entry in value)
    elif isinstance(value, (set, frozenset)):
        yield from sorted(_digest(entry, known) for entry in value)
    else:
        yield from (_digest(part, known) for part in _content(value))


def _content(value: Any) -> list[Any]:
    """What Python would pickle of an object, or its identity."""
    if isinstance(value, type) or inspect.isroutine(value) or inspect.ismodule(value):
        return [id(value)]
    try:
        reduced = value.__reduce_ex__(4)
    except Exception:  # objects of extension modules raise what they please
        return [id(value)]
    if isinstance(reduced, str):
        return [reduced]
    function, arguments, state, *items = (*reduced, None)[: max(len(reduced), 3)]
    if isinstance(state, Mapping):
        cached = {name for name in state if isinstance(inspect.getattr_static(type(value), str(name), None), cached_property)}
        state = {name: entry for name, entry in state.items() if name not in cached}
    return [function, arguments, state, *(None if entries is None else list(entries) for entries in items)]


def _hash(*parts: bytes) -> bytes:
    digest = hashlib.blake2b(digest_size=16)
    for part in parts:
        digest.update(b"%d:" % len(part))
        digest.update(part)
    return digest.digest()
