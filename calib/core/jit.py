"""The one way numeric kernels are compiled."""

import os
from collections.abc import Callable, Iterator
from types import CodeType, FunctionType, ModuleType
from typing import TypeVar, cast

import numba
import numpy as np

Kernel = TypeVar("Kernel", bound=Callable[..., object])


def jit(function: Kernel) -> Kernel:
    """Compile a kernel: no Python objects inside, the lock released, the machine code kept on disk.

    Kernels release the lock, so callers spread independent work over threads and results do not depend on how many.
    """
    return _kept_while_valid(numba.njit(cache=True, nogil=True, error_model="numpy")(function), function)


def jit_sums(function: Kernel) -> Kernel:
    """As `jit`, but sums may be taken in any order, so that the processor adds several numbers at once."""
    fast = {"reassoc", "contract"}
    return _kept_while_valid(numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=fast)(function), function)


def jit_inside(function: Kernel) -> Kernel:
    """As `jit_sums`, for what a loop over pixels calls: put into its caller, so that the loop takes several at once."""
    fast = {"reassoc", "contract"}
    compiled = numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=fast, forceinline=True)(function)
    return _kept_while_valid(compiled, function)


def _kept_while_valid(kernel: object, function: Kernel) -> Kernel:
    """The kernel, its machine code thrown away once anything changes that went into it.

    Numba looks at the kernel's own file only, while the code of kernels it calls, the values of constants that other
    files define and the options that this file gives go into it, too. So the version that numba keeps with the code is
    made to tell of these. It is compared before the rest is unpickled, which fails where a class has another name now.
    """
    file = getattr(getattr(kernel, "_cache", None), "_cache_file", None)
    if file is not None:
        parts = {_state(__name__, __file__), *_parts(cast("FunctionType", function), set())}
        file._version = (file._version, *sorted(parts))
    return cast("Kernel", kernel)


def _state(module: str, file: str) -> str:
    found = os.stat(file)
    return f"{module} {found.st_mtime_ns} {found.st_size}"


def _parts(function: FunctionType, known: set[str]) -> Iterator[str]:
    """The file of a function and what it takes from elsewhere, with the state they are in."""
    yield _state(function.__module__, function.__code__.co_filename)
    for name, value in _taken(function):
        called = getattr(value, "py_func", None)
        if isinstance(value, int | float | str | tuple | np.ndarray):
            yield f"{name} {value.tobytes().hex() if isinstance(value, np.ndarray) else repr(value)}"
        elif called is not None and (label := f"{called.__module__}.{called.__qualname__}") not in known:
            known.add(label)
            yield from _parts(called, known)


def _taken(function: FunctionType) -> Iterator[tuple[str, object]]:
    """What the names of a function may stand for: globals, and what modules among these have by such a name."""
    names = set(_names(function.__code__))
    spaces = [function.__globals__]
    for space in spaces:  # which grows by the modules that are found
        for name in names & space.keys():
            value = space[name]
            if not isinstance(value, ModuleType):
                yield f"{space['__name__']}.{name}", value
            elif not any(vars(value) is one for one in spaces):
                spaces.append(vars(value))


def _names(code: CodeType) -> Iterator[str]:
    """Names that a function looks up, those of its comprehensions, too."""
    yield from code.co_names
    for part in code.co_consts:
        if isinstance(part, CodeType):
            yield from _names(part)
