"""The one way numeric kernels are compiled."""

from collections.abc import Callable
from typing import TypeVar, cast

import numba

from calib.core.compile_ahead import on_first_miss
from calib.core.kernel_cache import KernelCache
from calib.core.kernel_code import Kernel

Function = TypeVar("Function", bound=Callable[..., object])

_FAST_SUMS = {"reassoc", "contract"}


def jit(function: Function) -> Function:
    """Compile a kernel: no Python objects inside, the lock released, the machine code kept on disk.

    Kernels release the lock, so callers spread independent work over threads and results do not depend on how many.
    """
    return _compiled(function)


def jit_sums(function: Function) -> Function:
    """As `jit`, but sums may be taken in any order, so that the processor adds several numbers at once."""
    return _compiled(function, fastmath=_FAST_SUMS)


def jit_inside(function: Function) -> Function:
    """As `jit_sums`, for what a loop over pixels calls: put into its caller, so that the loop takes several at once."""
    return _compiled(function, fastmath=_FAST_SUMS, forceinline=True)


def _compiled(function: Function, *, fastmath: bool | set[str] = False, forceinline: bool = False) -> Function:
    kernel = numba.njit(nogil=True, error_model="numpy", fastmath=fastmath, forceinline=forceinline)(function)
    if hasattr(kernel, "enable_caching"):  # else NUMBA_DISABLE_JIT is set, and the kernel the function itself
        cast("Kernel", kernel)._cache = KernelCache(cast("Kernel", kernel), on_first_miss)
    return cast("Function", kernel)
