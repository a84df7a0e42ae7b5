"""The command `calib warm-up`."""

import os
import time
from typing import Annotated

import typer

from designer.base.answer import StoppedError, Summary
from designer.base.errors import InputError
from designer.page.terminal import shown


def warm_up(
    parts: Annotated[
        list[str] | None, typer.Argument(help="of the work: detect, solve, run, ... (default: all)", metavar="PART...")
    ] = None,
) -> Summary:
    """Compile all kernels now, on all cores, so that no later command has to; for images and new machines.

    They are kept in the user's cache folder, or where RINGSOLID_CACHE says.
    """
    from calib.core.compile_ahead import Teller
    from calib.core.compile_ahead import warm_up as compile_ahead
    from calib.core.kernel_list import kernel_list, missing
    from calib.core.kernel_store import store

    if os.environ.get("NUMBA_DISABLE_JIT", "0") != "0":
        raise InputError("NUMBA_DISABLE_JIT is set, with which nothing is compiled; unset it")
    known = kernel_list()
    unknown = [part for part in parts or () if part not in known]
    if unknown:
        raise InputError(f"there is no part {unknown[0]!r}; there are {', '.join(known)}")
    wanted = tuple(dict.fromkeys(parts or known))
    lines = [line for part in wanted for line in known[part]]
    start_s = time.monotonic()
    try:
        compiled = compile_ahead(wanted, Teller())
    except KeyboardInterrupt:
        ready = len(lines) - len(missing(lines))
        raise StoppedError(f"stopped; {ready} of {len(lines)} kernels are ready, the same command goes on") from None
    seconds = time.monotonic() - start_s
    left = missing(lines)
    kept = f"kept in {shown(store().folder)}"
    if left:
        print(f"{compiled - len(left)} kernels compiled; {len(left)} could not be, {left[0].name} first")
    elif compiled:
        print(f"{compiled} kernels compiled in {seconds:.0f} s, {kept}")
    else:
        print(f"all {len(lines)} kernels are ready, {kept}")
    return Summary(
        {"kernels": len(lines), "compiled": compiled - len(left), "failed": len(left), "folder": str(store().folder)},
        exit_code=1 if left else 0,
    )
