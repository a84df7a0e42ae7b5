"""Machine code of kernels, kept in the user's cache folder under what went into it.

An entry's name is a digest of all that its machine code depends on: the kernel's own code and options, those of kernels
it calls, the constants they use, the types of the arguments, Python's, NumPy's and Numba's version, and the processor.
So another copy of the sources, a new environment, or an upgrade that leaves a kernel as it was find what was compiled
before; an entry is never stale; and two processes that write the same one write the same.
"""

import hashlib
import logging
import os
import pickle
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cached_property, lru_cache
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Protocol, cast

import numba
import numpy as np
from numba.core import sigutils, types
from numba.core.caching import _Cache
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps

KEPT_DAYS = 60.0
"""Entries that no program has used for so long are deleted."""
SUFFIX = ".kernel"
_DAY_S = 86400.0
_DIGEST_BYTES = 32
_log = logging.getLogger("ringsolid")


class Kernel(Protocol):
    """A compiled function, as `numba.njit` makes it."""

    py_func: FunctionType
    targetoptions: dict[str, object]
    _cache: object


class _Processor(Protocol):
    """What code is made for."""

    def magic_tuple(self) -> tuple[object, ...]: ...


class _Target(Protocol):
    """Where code is put."""

    def refresh(self) -> None: ...
    def codegen(self) -> _Processor: ...


class _Library(Protocol):
    has_dynamic_globals: bool


class _Compiled(Protocol):
    """The code for arguments of some types."""

    lifted: tuple[object, ...]
    library: _Library
    codegen: _Processor

    def _reduce(self) -> tuple[object, ...]: ...


class KernelCache(_Cache):
    """Numba's interface for keeping machine code, filled by content.

    Args:
        kernel: the function whose code is kept.
        missed: is told of a kernel and its arguments' types when there is no entry, and says whether there is now.
    """

    def __init__(self, kernel: Kernel, missed: Callable[[str, tuple[types.Type, ...]], bool]) -> None:
        self._kernel = kernel
        self._missed = missed
        self._enabled = True

    @property
    def cache_path(self) -> str:
        """The folder that entries are written to."""
        return str(store().folder)

    def enable(self) -> None:
        """Keep entries from now on."""
        self._enabled = True

    def disable(self) -> None:
        """Keep none, and use none."""
        self._enabled = False

    def flush(self) -> None:
        """Nothing is stale, so nothing is thrown away."""

    def load_overload(self, sig: object, target_context: _Target) -> _Compiled | None:
        """The compiled code for such arguments, or None; an entry that cannot be read is none."""
        target_context.refresh()
        if not self._enabled:
            return None
        arguments, _ = sigutils.normalize_signature(sig)
        name = self.entry(arguments, target_context.codegen())
        payload = store().read(name)
        if payload is None and self._missed(label(self._kernel.py_func), arguments):
            payload = store().read(name)
        if payload is None:
            return None
        try:
            parts = pickle.loads(payload)  # noqa: S301  # of a folder that only the user may write
            return cast("_Compiled", CompileResult._rebuild(target_context, *parts))
        except Exception:  # whatever is wrong with an entry, the kernel can be compiled
            return None

    def save_overload(self, sig: object, data: _Compiled) -> None:
        """Keep what was compiled for such arguments."""
        if self._enabled and not data.lifted and not data.library.has_dynamic_globals:
            arguments, _ = sigutils.normalize_signature(sig)
            store().write(self.entry(arguments, data.codegen), dumps(data._reduce()))

    def entry(self, arguments: tuple[types.Type, ...], codegen: _Processor) -> str:
        """The name of the file with the code for such arguments, made for the processor that `codegen` is for."""
        signature = ", ".join(map(_type_text, arguments))
        parts = (code_digest(self._kernel.py_func, options_text(self._kernel)), signature, repr(codegen.magic_tuple()))
        digest = hashlib.sha256("\n".join((*parts, *_versions())).encode()).hexdigest()
        return f"{self._kernel.py_func.__name__.strip('_')}-{digest[:32]}{SUFFIX}"


@lru_cache(maxsize=1)
def _versions() -> tuple[str, ...]:
    return sys.version, np.__version__, numba.__version__


def label(function: FunctionType) -> str:
    """`module:name` of a kernel."""
    return f"{function.__module__}:{function.__qualname__}"


def options_text(kernel: Kernel) -> str:
    """The options that a kernel is compiled with, in a fixed order."""
    options = kernel.targetoptions
    return repr(sorted((key, sorted(value) if isinstance(value, set) else value) for key, value in options.items()))


def _type_text(numba_type: types.Type) -> str:
    """The name of a type; one of a named tuple tells of the class and its fields, as names alone may be alike."""
    if not isinstance(numba_type, types.BaseTuple):
        return str(numba_type)
    kind = _class_text(numba_type.instance_class) if hasattr(numba_type, "instance_class") else ""
    return f"{kind}({', '.join(map(_type_text, getattr(numba_type, 'types', ())))})"


# What a kernel is made of ------------------------------------------------------------------------


def code_digest(function: FunctionType, options: str) -> str:
    """A digest of a kernel's code and options, and of all kernels and constants that it takes from elsewhere."""
    reached = {label(function): (function, options)}
    parts: set[str] = set()
    for taken, with_options in (waiting := [(function, options)]):  # which grows by the kernels that are called
        own, called = _own_parts(taken, with_options)
        parts.update(own)
        new = [kernel for kernel in called if label(kernel[0]) not in reached]
        reached.update((label(kernel[0]), kernel) for kernel in new)
        waiting.extend(new)
    return hashlib.sha256("\n".join(sorted(parts)).encode()).hexdigest()


def called_kernels(function: FunctionType) -> tuple[FunctionType, ...]:
    """The kernels that a kernel names."""
    return tuple(kernel for kernel, _ in _own_parts(function, "")[1])


@lru_cache(maxsize=4096)
def _own_parts(function: FunctionType, options: str) -> tuple[tuple[str, ...], tuple[tuple[FunctionType, str], ...]]:
    """What a function's own lines say, constants included, and the kernels that it names."""
    parts = [f"{label(function)} {options} {function.__defaults__!r}", *_code_text(function.__code__, function.__doc__)]
    called = []
    for name, value in _taken(function):
        kernel = getattr(value, "py_func", None)
        if kernel is not None:
            called.append((kernel, options_text(cast("Kernel", value))))
            parts.append(f"{name} is {label(kernel)}")
        elif (text := _constant_text(value)) is not None:
            parts.append(f"{name} {text}")
    return tuple(parts), tuple(called)


def _code_text(code: CodeType, doc: str | None) -> Iterator[str]:
    """What a function does, without its file, its lines' numbers and its docstring."""
    constants = [
        value for value in code.co_consts if not isinstance(value, CodeType) and not (doc is not None and value == doc)
    ]
    names = (code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars)
    counts = (code.co_argcount, code.co_kwonlyargcount, code.co_posonlyargcount, code.co_flags)
    yield f"{code.co_code.hex()} {getattr(code, 'co_exceptiontable', b'').hex()} {constants!r} {names} {counts}"
    for part in code.co_consts:
        if isinstance(part, CodeType):
            yield from _code_text(part, None)


def _constant_text(value: object) -> str | None:
    """What a constant holds; None for what is no constant."""
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape} {value.flags.writeable} {value.tobytes().hex()}"
    if isinstance(value, tuple):
        return f"({', '.join(str(_constant_text(one)) for one in value)})"
    if isinstance(value, int | float | complex | str | bytes | np.generic):
        return f"{type(value).__name__} {value!r}"
    return _class_text(value) if isinstance(value, type) else None


def _class_text(kind: type) -> str:
    return f"{kind.__module__}.{kind.__qualname__}{getattr(kind, '_fields', '')}"


def _taken(function: FunctionType) -> Iterator[tuple[str, object]]:
    """What the names of a function may stand for: globals, what modules among these have by such a name, and cells."""
    names = sorted(set(_names(function.__code__)))
    spaces = [function.__globals__]
    for space in spaces:  # which grows by the modules that are found
        for name in names:
            if name not in space:
                continue
            value = space[name]
            if not isinstance(value, ModuleType):
                yield f"{space['__name__']}.{name}", value
            elif not any(vars(value) is one for one in spaces):
                spaces.append(vars(value))
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        yield name, cell.cell_contents


def _names(code: CodeType) -> Iterator[str]:
    """Names that a function looks up, those of its comprehensions, too."""
    yield from code.co_names
    for part in code.co_consts:
        if isinstance(part, CodeType):
            yield from _names(part)


# Where entries are -------------------------------------------------------------------------------


class Store:
    """A folder of entries, with another in place of one that cannot be written.

    A folder that others may write is not read: an entry holds code, and a pickle.

    Args:
        wanted: the folder to use; it is made where it is missing.
    """

    def __init__(self, wanted: Path) -> None:
        self._wanted = wanted
        self._is_swept = False
        self._has_said = False

    @cached_property
    def folders(self) -> tuple[Path, ...]:
        """Where entries are looked for; new ones go to the first."""
        why = refusal(self._wanted)
        if why is None and os.access(self._wanted, os.W_OK):
            return (self._wanted,)
        readable = () if why is not None else (self._wanted,)
        for_now = Path(tempfile.gettempdir()) / f"ringsolid-kernels-{getattr(os, 'getuid', int)()}"
        if refusal(for_now) is not None or not os.access(for_now, os.W_OK):
            for_now = Path(tempfile.mkdtemp(prefix="ringsolid-kernels-"))
        self._say(f"{self._wanted} {why or 'cannot be written'}; compiled kernels are kept in {for_now} meanwhile")
        return (for_now, *readable)

    @property
    def folder(self) -> Path:
        """Where new entries go."""
        return self.folders[0]

    def read(self, name: str) -> bytes | None:
        """What an entry holds, or None where there is none that is whole."""
        for folder in self.folders:
            with suppress(OSError), (folder / name).open("rb") as file:
                digest, payload = file.read(_DIGEST_BYTES), file.read()
                if hashlib.sha256(payload).digest() != digest:
                    continue
                used_s = os.fstat(file.fileno()).st_mtime
                if abs(time.time() - used_s) > _DAY_S:
                    with suppress(OSError):
                        os.utime(file.name)
                return payload
        return None

    def holds(self, name: str) -> bool:
        """Whether there is an entry, whole or not."""
        return any((folder / name).exists() for folder in self.folders)

    def write(self, name: str, payload: bytes) -> None:
        """Keep an entry whole or not at all; a full disk or a folder that is gone is said once and costs no result."""
        self._sweep()
        try:
            self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            with tempfile.NamedTemporaryFile(dir=self.folder, prefix=f".{name}.", delete=False) as file:
                try:
                    file.write(hashlib.sha256(payload).digest() + payload)
                    file.close()
                    os.replace(file.name, self.folder / name)
                except BaseException:
                    file.close()
                    os.unlink(file.name)
                    raise
        except OSError as error:
            self._say(f"{self.folder}: {error.strerror or error}; compiled kernels are not kept")

    def _sweep(self) -> None:
        """Delete what no program has used for long, once a process, when there was something to compile anyway."""
        if self._is_swept:
            return
        self._is_swept = True
        with suppress(OSError):
            for path in self.folder.iterdir():
                is_part = path.name.startswith(".") and SUFFIX in path.name
                kept_s = _DAY_S if is_part else KEPT_DAYS * _DAY_S
                if (is_part or path.suffix == SUFFIX) and time.time() - path.stat().st_mtime > kept_s:
                    path.unlink(missing_ok=True)

    def _say(self, what: str) -> None:
        if not self._has_said:
            self._has_said = True
            _log.warning("%s. RINGSOLID_CACHE names another folder.", what)


def refusal(folder: Path) -> str | None:
    """Why a folder of entries is not to be read, or None; one that is missing is made, for its user alone."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.stat()
    except OSError as error:
        return "is a file" if isinstance(error, FileExistsError) else f"cannot be made ({error.strerror})"
    if not os.access(folder, os.R_OK | os.X_OK):
        return "cannot be read"
    if sys.platform != "win32":
        if found.st_uid not in {os.getuid(), 0}:
            return "is another user's"
        if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
            return "may be written by others"
    return None


def wanted_folder() -> Path:
    """The folder that is asked for: `NUMBA_CACHE_DIR`, `RINGSOLID_CACHE`, or the user's cache folder."""
    if named := os.environ.get("NUMBA_CACHE_DIR"):
        return Path(named)
    if named := os.environ.get("RINGSOLID_CACHE"):
        return Path(named) / "kernels"
    from platformdirs import user_cache_path

    return user_cache_path("ringsolid", appauthor=False) / "kernels"


def store() -> Store:
    """The store that the environment asks for."""
    return _store(wanted_folder())


@lru_cache(maxsize=4)
def _store(wanted: Path) -> Store:
    return Store(wanted)
