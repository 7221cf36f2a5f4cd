"""What compiled code needs to work on memory that it knows by address: views of arrays, calls of functions, symbols.

Addresses are whole numbers, handed over at run time: so what numba compiles is the same in every process and is kept on disk. It is
looked up there by the file that the entry or callback stands in: after an edit of compiled code in another file remove the folders
`__pycache__`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import llvmlite.binding
import numpy as np
from llvmlite import ir
from numba import carray, cfunc, njit, types
from numba.core import cgutils
from numba.extending import intrinsic

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """The function, compiled for use by other compiled code alone, of which it becomes a part."""
    options = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    return njit(nogil=True, error_model="numpy", **options)(function)  # type: ignore[no-any-return]


def entry(function: F) -> F:
    """The function, compiled at its first call from Python and kept on disk; it holds no interpreter lock while it runs."""
    try:
        result = njit(nogil=True, cache=True, error_model="numpy")(function)
    except RuntimeError:  # no folder that numba may write to
        result = njit(nogil=True, error_model="numpy")(function)
    return result  # type: ignore[no-any-return]


def callback(*arguments: str) -> Callable[[Callable[..., None]], Any]:
    """Makes a C function of pointers or whole numbers -> void, compiled and kept on disk; its `address` is what C calls.

    arguments: what they are called.
    """
    signature = types.void(*[types.intp for _ in arguments])

    def made(function: Callable[..., None]) -> Any:
        try:
            return cfunc(signature, cache=True)(function)
        except RuntimeError:
            return cfunc(signature)(function)

    return made


@intrinsic
def _pointer(_typing, address):  # type: ignore[no-untyped-def]
    """The address as a pointer."""

    def code(_context, builder, _signature, arguments):  # type: ignore[no-untyped-def]
        return builder.inttoptr(arguments[0], cgutils.voidptr_t)

    return types.voidptr(types.intp), code


@intrinsic
def call(_typing, function, arguments):  # type: ignore[no-untyped-def]
    """Call the C function without a result at an address with a tuple of arguments: int64 for pointers, int32, float64."""

    def code(context, builder, _signature, values):  # type: ignore[no-untyped-def]
        parts = cgutils.unpack_tuple(builder, values[1])
        kind = ir.FunctionType(ir.VoidType(), [part.type for part in parts])
        builder.call(builder.inttoptr(values[0], kind.as_pointer()), parts)
        return context.get_dummy_value()

    return types.void(types.intp, arguments), code


@compiled
def floats(address: int, size: int) -> Any:
    """The float64 numbers (size,) at an address."""
    return carray(_pointer(address), (size,), np.float64)


@compiled
def matrix(address: int, rows: int, columns: int) -> Any:
    """The float64 matrix (rows, columns) at an address."""
    return carray(_pointer(address), (rows, columns), np.float64)


@compiled
def integers(address: int, size: int) -> Any:
    """The int64 numbers (size,) at an address."""
    return carray(_pointer(address), (size,), np.int64)


@compiled
def copy(source: Any, target: Any) -> None:
    """Copy numbers; a loop compiles in a fraction of the time that slices take."""
    for i in range(target.shape[0]):
        target[i] = source[i]


@compiled
def word(address: int) -> int:
    """The int64 number, or the pointer, at an address."""
    return carray(_pointer(address), (1,), np.int64)[0]  # type: ignore[no-any-return]


@compiled
def count(address: int) -> int:
    """The int32 number at an address."""
    return carray(_pointer(address), (1,), np.int32)[0]  # type: ignore[no-any-return]


@compiled
def address_in(array: Any) -> int:
    """The address of a contiguous array's first entry."""
    return array.ctypes.data  # type: ignore[no-any-return]


def records(dtype: np.dtype[Any]) -> Callable[[int, int], Any]:
    """A compiled function of an address and a size: the records (size,) of this type that stand there."""

    @compiled
    def at(address: int, size: int) -> Any:
        return carray(_pointer(address), (size,), dtype)

    return at


@compiled
def registered(table: int, key: int) -> int:
    """The value that is registered under a key in the table of `invtrack.plant.native.slots` at an address; 0 where none is."""
    used = integers(table, 1)[0]
    pairs = integers(table + 8, 2 * used)
    for i in range(used - 1, -1, -1):  # of nested blocks for one model the latest counts
        if pairs[2 * i] == key:
            return pairs[2 * i + 1]  # type: ignore[no-any-return]
    return 0


def symbol(name: str, address: int) -> Any:
    """A compiled function without arguments that gives an address of this process, which cached code must not hold.

    The code refers to it by name, and the name is resolved when the code is loaded.
    """
    llvmlite.binding.add_symbol(name, address)

    @intrinsic
    def value(_typing):  # type: ignore[no-untyped-def]
        def code(_context, builder, _signature, _arguments):  # type: ignore[no-untyped-def]
            known = builder.module.globals.get(name)
            if known is None:
                known = ir.GlobalVariable(builder.module, ir.IntType(64), name)
                known.linkage = "external"
            return builder.ptrtoint(known, ir.IntType(64))

        return types.intp(), code

    return value
