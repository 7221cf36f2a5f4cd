"""MuJoCo's shared library: the addresses of its functions, which compiled code calls without Python."""

from __future__ import annotations

import ctypes
import sys
from functools import cache
from pathlib import Path

import mujoco

from invtrack.errors import PlantError

_NAMES = {"linux": "libmujoco.so*", "darwin": "libmujoco*.dylib", "win32": "mujoco.dll"}
"""What the library is called beside the package `mujoco`, by `sys.platform`."""


@cache
def library() -> ctypes.CDLL:
    """The library that the package `mujoco` itself runs on. Raises PlantError on platforms where it cannot be found."""
    pattern = _NAMES.get(sys.platform)
    folder = Path(mujoco.__file__).parent
    found = sorted(folder.glob(pattern)) if pattern else []
    if not found:
        where = f"there is no {pattern} in {folder}" if pattern else f"where its library is kept on {sys.platform!r} is not known"
        raise PlantError(
            f"invtrack drives MuJoCo through its shared library, and {where}; the wheels of mujoco on PyPI for Linux, macOS and "
            "Windows have it"
        )
    return ctypes.CDLL(str(found[0]))


@cache
def address_of(function: str) -> int:
    """The address of one of MuJoCo's functions, such as "mj_step"."""
    try:
        return ctypes.cast(getattr(library(), function), ctypes.c_void_p).value or 0
    except AttributeError:
        raise PlantError(f"MuJoCo {mujoco.__version__} has no function {function}; invtrack needs mujoco 3.17 or later") from None
