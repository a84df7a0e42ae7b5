"""Kernels compiled ahead: `calib warm-up`."""

import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from designer.base.answer import StoppedError
from designer.base.errors import InputError
from designer.base.marks import NOT_IN_FILE
from designer.base.options import argument
from designer.base.words import printable
from designer.page.capability import capability
from designer.page.progress import Progress, unheard
from designer.page.result import Result

if TYPE_CHECKING:
    from designer.page.blocks import Page


@dataclass(frozen=True, eq=False)
class CompiledKernels(Result, kind="kernels", title="Kernels", is_written=False):
    """Kernels that are ready: `warm_up().compiled`."""

    kernels: int
    compiled: int  # now
    failed: int
    folder: str
    first_failed: Annotated[str, NOT_IN_FILE]
    seconds: Annotated[float, NOT_IN_FILE]
    remarks = ()

    @property
    def is_negative(self) -> bool:
        """Whether one could not be compiled."""
        return self.failed > 0

    def page(self) -> "Page":
        """How many there are."""
        from designer.page.blocks import Headline, Page

        kept = f"kept in {printable(self.folder)}"
        if self.failed:
            said = f"{self.compiled} kernels compiled; {self.failed} could not be, {self.first_failed} first"
            return Page("", "", Headline("bad", "not ready", said), ())
        said = f"all {self.kernels} kernels are ready, {kept}"
        if self.compiled:
            said = f"{self.compiled} kernels compiled in {self.seconds:.0f} s, {kept}"
        return Page("", "", Headline("good", "ready", said), ())


@capability
def warm_up(
    parts: Annotated[
        Sequence[str], argument("of the work: detect, solve, run, ... (default: all)", metavar="PART...", is_many=True)
    ] = (),
    progress: Progress = unheard,
) -> CompiledKernels:
    """Compile all kernels now, on all cores, so that no later command has to: `warm_up(["detect"])`.

    For images and new machines. They are kept in the user's cache folder, or where RINGSOLID_CACHE says.

    Raises:
        InputError: no such part, or compiling is switched off.
        StoppedError: by a person; it says what is finished and stays.
    """
    from calib.core.compile_ahead import kernel_list, missing
    from calib.core.compile_ahead import warm_up as compile_ahead
    from calib.core.kernel_store import store

    if os.environ.get("NUMBA_DISABLE_JIT", "0") != "0":
        raise InputError("NUMBA_DISABLE_JIT is set, with which nothing is compiled; unset it")
    known = kernel_list()
    unknown = [part for part in parts if part not in known]
    if unknown:
        raise InputError(f"there is no part {unknown[0]!r}; there are {', '.join(known)}")
    wanted = tuple(dict.fromkeys(parts or known))
    lines = [line for part in wanted for line in known[part]]
    start_s = time.monotonic()
    try:
        compiled = compile_ahead(wanted, lambda done, count, left_s: progress("preparing kernels", done, count))
    except KeyboardInterrupt:
        ready = len(lines) - len(missing(lines))
        raise StoppedError(f"stopped; {ready} of {len(lines)} kernels are ready, the same command goes on") from None
    left = missing(lines)
    return CompiledKernels(
        kernels=len(lines), compiled=compiled - len(left), failed=len(left), folder=str(store().folder),
        first_failed=left[0].name if left else "", seconds=time.monotonic() - start_s,
    )  # fmt: skip
