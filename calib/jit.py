"""The one way numeric kernels are compiled."""

from collections.abc import Callable
from typing import TypeVar, cast

import numba

Kernel = TypeVar("Kernel", bound=Callable[..., object])


def jit(function: Kernel) -> Kernel:
    """Compile a kernel: no Python objects inside, the lock released, the machine code kept on disk.

    Kernels release the lock, so callers spread independent work over threads and results do not depend on how many.
    """
    return cast("Kernel", numba.njit(cache=True, nogil=True, error_model="numpy")(function))


def jit_sums(function: Kernel) -> Kernel:
    """As `jit`, but sums may be taken in any order, so that the processor adds several numbers at once."""
    return cast(
        "Kernel", numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract"})(function)
    )
