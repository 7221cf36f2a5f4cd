"""The hash of a study: equal in every process as long as nothing changes that its rows depend on, and different once it does."""

from __future__ import annotations

import ast
import hashlib
import importlib.metadata
import importlib.util
import json
import sys
import sysconfig
import types
from collections.abc import Iterable, Iterator
from enum import Enum
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from invtrack.arrays import shown
from invtrack.errors import FileError, SweepError

PACKAGE = Path(__file__).parents[1]
LIBRARIES = ("mujoco", "numpy", "scipy")
INSTALLED = tuple(Path(sysconfig.get_path(name)).resolve() for name in ("stdlib", "platstdlib", "purelib", "platlib"))
LENGTH = 16  # hexadecimal digits: 2^32 versions of a study until two are likely to share one


def study_hash(parts: Iterable[Any], files: Iterable[Path]) -> str:
    """Digest of what decides a sweep's rows.

    It covers, of every function and class among `parts`, its name and the whole source text of the module that defines it and of
    the modules which that imports, other than installed packages; of a function without a source file, and of a lambda, the
    compiled code and the globals that it uses; arguments bound to functions, and the attributes of objects; the content of
    `files`; the source text of this package, and the versions of mujoco, numpy and scipy.

    Raises SweepError for a part that cannot be taken to pieces as pickle does, FileError for a file that cannot be read.
    """
    sink = hashlib.sha256()
    for library in LIBRARIES:
        sink.update(f"{library} {importlib.metadata.version(library)}\n".encode())
    sink.update(_package_digest().encode())
    for path in files:
        try:
            sink.update(hashlib.sha256(path.read_bytes()).digest())
        except OSError as error:
            raise FileError(f"cannot read {path}, on which the study depends: {error.strerror}") from error
    digests = _Digests()
    for part in parts:
        sink.update(digests.of(part).encode())
    return sink.hexdigest()[:LENGTH]


class _Digests:
    """Digests of values, taken to pieces as pickle does, but without regard to which objects are one and the same."""

    def __init__(self) -> None:
        self._open: list[int] = []  # the objects that are being taken to pieces, outermost first

    def of(self, value: Any) -> str:
        """The digest of a value."""
        if id(value) in self._open:
            return f"cycle {self._open.index(id(value))}"
        self._open.append(id(value))
        try:
            kind, content = self._pieces(value)
        finally:
            self._open.pop()
        return hashlib.sha256(json.dumps([kind, content]).encode()).hexdigest()

    def _pieces(self, value: Any) -> tuple[str, Any]:
        """A kind, and what tells the value from others of its kind, as JSON."""
        if value is None or type(value) in (bool, int, str):
            return type(value).__name__, value
        if type(value) in (float, complex, bytes):
            return type(value).__name__, repr(value)
        if isinstance(value, np.ndarray) and value.dtype != object:
            return "array", [value.dtype.str, value.shape, hashlib.sha256(value.tobytes()).hexdigest()]
        if isinstance(value, np.generic):
            return "numpy", [value.dtype.str, value.tobytes().hex()]
        if isinstance(value, np.ndarray):
            return "objects", [value.shape, [self.of(entry) for entry in value.ravel()]]
        if type(value) in (list, tuple):
            return type(value).__name__, [self.of(entry) for entry in value]
        if type(value) in (set, frozenset):
            return "set", sorted(self.of(entry) for entry in value)
        if type(value) in (dict, types.MappingProxyType):
            return "dict", sorted([self.of(key), self.of(entry)] for key, entry in value.items())
        if isinstance(value, Path):
            return "path", str(value)
        if isinstance(value, Enum):
            return "enum", [self.of(type(value)), value.name]
        if isinstance(value, types.ModuleType):
            return "module", [value.__name__, _sources(value)]
        if isinstance(value, types.FunctionType):
            return "function", self._function(value)
        if isinstance(value, types.CodeType):
            return "code", [value.co_code.hex(), value.co_names, [self.of(constant) for constant in value.co_consts]]
        if isinstance(value, types.MethodType):
            return "method", [self.of(value.__func__), self.of(value.__self__)]
        if isinstance(value, type):
            return "class", [value.__qualname__, _sources(sys.modules.get(value.__module__)) or value.__module__]
        return "object", self._reduced(value)

    def _function(self, function: types.FunctionType) -> list[Any]:
        cells = [cell.cell_contents for cell in function.__closure__ or ()]
        bound = [self.of(part) for part in (function.__defaults__, function.__kwdefaults__, cells)]
        sources = _sources(sys.modules.get(function.__module__))
        if sources and function.__name__ != "<lambda>":  # of which several may stand in one place
            return [function.__qualname__, sources, bound]
        used = {name: function.__globals__[name] for name in sorted(_names(function.__code__)) if name in function.__globals__}
        return [
            function.__qualname__,
            sources,
            self.of(function.__code__),
            [[name, self.of(part)] for name, part in used.items()],
            bound,
        ]

    def _reduced(self, value: Any) -> Any:
        if isinstance(value, types.BuiltinFunctionType) and isinstance(value.__self__, (types.ModuleType, type(None))):
            return [value.__module__, value.__qualname__]
        if hasattr(value, "__wrapped__"):  # a cache around a function
            return self.of(value.__wrapped__)
        try:
            pieces = value.__reduce_ex__(4)
        except Exception as error:
            raise SweepError(
                f"expected a study whose arguments can be compared between two processes, got {shown(value)} in it, which has no "
                f"pickle ({error}); make it in the function given as prepare"
            ) from error
        if isinstance(pieces, str):
            return [type(value).__module__, pieces]
        make, arguments, *rest = (*pieces, None, None, None)[:5]
        state, entries, pairs = rest
        if isinstance(state, dict):
            state = {
                name: part for name, part in state.items() if not isinstance(getattr(type(value), name, None), cached_property)
            }
        listed = [None if each is None else [self.of(part) for part in each] for each in (entries, pairs)]
        return [self.of(make), self.of(arguments), self.of(state), listed]


def _names(code: types.CodeType) -> set[str]:
    """Names of globals and attributes in compiled code and in the functions inside it."""
    inner = [_names(constant) for constant in code.co_consts if isinstance(constant, types.CodeType)]
    return {*code.co_names}.union(*inner)


def _sources(module: types.ModuleType | None) -> str:
    """Digest of a module's text and of the texts that it imports and that are not installed; "" without a file."""
    path = _source_file(getattr(module, "__file__", None))
    if module is None or path is None:
        return ""
    found: dict[Path, str] = {}
    waiting = [(path, module.__package__ or "")]
    while waiting:
        path, package = waiting.pop()
        if path in found:
            continue
        text = path.read_text(encoding="utf-8")
        found[path] = hashlib.sha256(text.encode()).hexdigest()
        if not _is_installed(path):
            waiting.extend(_own_imports(text, package))
    return ",".join(sorted(found.values()))


def _own_imports(text: str, package: str) -> Iterator[tuple[Path, str]]:
    """File and package of each module that a text imports and that is not installed."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = package.split(".")[: len(package.split(".")) + 1 - node.level] if node.level else []
            stem = ".".join([*base, *([node.module] if node.module else [])])
            names = [stem, *(f"{stem}.{alias.name}" for alias in node.names)]
        else:
            continue
        for name in names:
            if name.partition(".")[0] in sys.stdlib_module_names or name.partition(".")[0] == PACKAGE.name:
                continue
            try:
                spec = importlib.util.find_spec(name)
            except (ImportError, ValueError, AttributeError):
                continue  # a name in a module, or a module that this study does without
            path = _source_file(spec.origin if spec else None)
            if spec and path and not _is_installed(path):
                yield path, spec.name if spec.submodule_search_locations else spec.name.rpartition(".")[0]


def _source_file(name: str | None) -> Path | None:
    return Path(name).resolve() if name and name.endswith(".py") and Path(name).is_file() else None


def _is_installed(path: Path) -> bool:
    """Whether a file belongs to Python, to an installed package or to this one, which the hash covers in other ways."""
    return path.is_relative_to(PACKAGE) or any(path.is_relative_to(place) for place in INSTALLED)


@lru_cache(maxsize=1)
def _package_digest() -> str:
    """Of the source text of this package."""
    sink = hashlib.sha256()
    for path in sorted(PACKAGE.rglob("*.py")):
        sink.update(path.relative_to(PACKAGE).as_posix().encode() + b"\0" + path.read_bytes())
    return sink.hexdigest()
