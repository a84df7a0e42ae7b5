"""Machine code of kernels, kept under what went into it.

An entry's name is a digest of all that its machine code depends on: the kernel's own code and options, those of kernels
it calls, the constants they use, the types of the arguments, Python's, NumPy's and Numba's version, and the processor.
So another copy of the sources, a new environment, or an upgrade that leaves a kernel as it was find what was compiled
before; an entry is never stale; and two processes that write the same one write the same.

A wheel may carry entries that were compiled for `BASELINE`, a processor that most have at least. They serve where the
user's folder has none for this very processor, which are up to an eighth faster.
"""

import hashlib
import io
import os
import pickle
import sys
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Protocol, cast

import numba
import numpy as np
from llvmlite.binding import ModuleRef, parse_bitcode
from numba.core import sigutils, types
from numba.core.caching import _Cache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import compile_result
from numba.core.environment import Environment, lookup_environment
from numba.core.runtime.nrt import rtsys
from numba.core.serialize import dumps

from calib.core.kernel_code import Kernel, code_digest, label, types_text
from calib.core.kernel_store import SUFFIX, read_entry, store

BASELINE = "x86-64-v3"
BASELINE_FEATURES = (
    *("64bit", "avx", "avx2", "bmi", "bmi2", "cmov", "crc32", "cx16", "cx8", "f16c", "fma", "fxsr", "lzcnt", "mmx"),
    *("movbe", "popcnt", "sahf", "sse", "sse2", "sse3", "sse4.1", "sse4.2", "ssse3", "xsave"),
)
"""What the processors of that level have (System V ABI, AMD64, 3.1.1), as LLVM calls it."""
CARRIED = Path(__file__).resolve().parent.parent / "_kernels"
"""Entries that came with the wheel."""

Missed = Callable[[Kernel, tuple[types.Type, ...]], bool]


class _Engine(Protocol):
    _defined_symbols: set[str]


class _Function(Protocol):
    llvm_func_name: str
    llvm_cpython_wrapper_name: str


class _Processor(Protocol):
    """What code is made for."""

    _engine: _Engine

    def magic_tuple(self) -> tuple[str, str, str]: ...

    def set_env(self, name: str, environment: Environment) -> None: ...


class _Target(Protocol):
    """Where code is put."""

    typing_context: object

    def codegen(self) -> _Processor: ...

    def get_executable(self, library: JITCodeLibrary, function: _Function, environment: Environment) -> object: ...


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
        missed: is told of a kernel and its arguments' types when there is no entry, and says whether there may be now.
    """

    def __init__(self, kernel: Kernel, missed: Missed) -> None:
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
        rtsys.initialize(target_context)  # not `refresh`, which loads all that compiles, SciPy's linear algebra too
        if not self._enabled:
            return None
        arguments, _ = sigutils.normalize_signature(sig)
        made_for = target_context.codegen().magic_tuple()
        name = entry_name(self._kernel, arguments, made_for)
        payload = store().read(name) or _carried(self._kernel, arguments, made_for[0])
        if payload is None and self._missed(self._kernel, arguments):
            payload = store().read(name)
        if payload is None:
            return None
        try:
            return _rebuilt(target_context, *_Reader(io.BytesIO(payload.partition(b"\n")[2])).load())
        except Exception:  # whatever is wrong with an entry, the kernel can be compiled
            return None

    def save_overload(self, sig: object, data: _Compiled) -> None:
        """Keep what was compiled for such arguments."""
        if self._enabled and not data.lifted and not data.library.has_dynamic_globals:
            arguments, _ = sigutils.normalize_signature(sig)
            told = f"{label(self._kernel.py_func)}({types_text(arguments)})\n"
            name = entry_name(self._kernel, arguments, data.codegen.magic_tuple())
            store().write(name, told.encode() + dumps(data._reduce()))


def entry_name(kernel: Kernel, arguments: tuple[types.Type, ...], made_for: tuple[str, str, str]) -> str:
    """The name of the file with a kernel's code for such arguments, made for a processor as LLVM tells of it."""
    versions = (sys.implementation.cache_tag, np.__version__.rpartition(".")[0], numba.__version__)
    parts = (code_digest(kernel), types_text(arguments), *made_for, *map(str, versions))
    digest = hashlib.sha256("\n".join(parts).encode()).hexdigest()
    return f"{kernel.py_func.__name__.strip('_')}-{digest[:32]}{SUFFIX}"


def _carried(kernel: Kernel, arguments: tuple[types.Type, ...], triple: str) -> bytes | None:
    """What the wheel carries for such arguments."""
    if not _may_use_carried():
        return None
    return read_entry(CARRIED / entry_name(kernel, arguments, (triple, BASELINE, baseline_features())))


def baseline_features() -> str:
    """What `BASELINE` has, as LLVM takes it."""
    return ",".join(f"+{feature}" for feature in BASELINE_FEATURES)


@lru_cache(maxsize=1)
def _may_use_carried() -> bool:
    """Whether there are entries that came with the wheel, and this processor can run them."""
    if not CARRIED.is_dir() or "NUMBA_CPU_NAME" in os.environ:
        return False
    from llvmlite.binding import get_host_cpu_features

    host = get_host_cpu_features()
    return all(host.get(feature, False) for feature in BASELINE_FEATURES)


class _KeptLibrary(JITCodeLibrary):
    """Machine code as it was kept; what callers put into themselves is read only when one is compiled."""

    bitcode: bytes

    def _get_module_for_linking(self) -> ModuleRef:
        if self._shared_module is None:
            self._shared_module = parse_bitcode(self.bitcode)
        return self._shared_module


def _rebuilt(
    target: _Target, library: tuple[str, str, tuple[bytes, bytes]], function: _Function, environment: Environment,
    signature: object, objectmode: bool, lifted: tuple[object, ...], annotation: str,
    reload_init: tuple[Callable[[], object], ...], environments: tuple[Environment, ...],
) -> _Compiled:  # fmt: skip
    """As `CompileResult._rebuild`, which spends most of its time on reading what nothing is compiled from."""
    for again in reload_init:
        again()
    codegen, (name, _, (machine_code, bitcode)) = target.codegen(), library
    made = _KeptLibrary(codegen, name)  # type: ignore[no-untyped-call]  # Numba gives it no types
    made.bitcode, kept = bitcode, cast("JITCodeLibrary", made)
    kept.enable_object_caching()
    kept._set_compiled_object(machine_code)
    kept._finalize_final_module()
    codegen._engine._defined_symbols |= {function.llvm_func_name, function.llvm_cpython_wrapper_name}
    entry_point = target.get_executable(kept, function, environment)
    for one in environments:
        codegen.set_env(one.env_name, one)
    return cast("_Compiled", compile_result(
        target_context=target, typing_context=target.typing_context, library=kept, environment=environment,
        entry_point=entry_point, fndesc=function, type_annotation=annotation, signature=signature,
        objectmode=objectmode, lifted=lifted, reload_init=reload_init, referenced_envs=environments,
    ))  # fmt: skip


class _Reader(pickle.Unpickler):
    """Reads an entry of a folder that only the user may write, and loads nothing but what the kernel itself takes.

    An environment (what a kernel keeps of Python's) names the module that it comes from. Numba loads that, to have the
    names in it; compiled code asks for the constants alone, and a kernel holds those of many modules.
    """

    def find_class(self, module: str, name: str) -> object:
        """Numba's own, but for environments."""
        is_environment = (module, name) == ("numba.core.environment", "_rebuild_env")
        return _environment if is_environment else super().find_class(module, name)


def _environment(module: str, constants: list[object], name: str) -> Environment:
    """As `numba.core.environment._rebuild_env`, without loading the module."""
    known = lookup_environment(name)
    if known is None:
        known = Environment(vars(sys.modules[module]) if module in sys.modules else {"__name__": module})
        known.consts[:] = constants
        known.env_name = name
        Environment._memo[name] = known
    return cast("Environment", known)
