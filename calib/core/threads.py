"""Spread compiled work, which releases the interpreter's lock, over threads."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

_SMALLEST_CHUNK = 16


def in_chunks(work: Callable[[int, int], None], count: int) -> None:
    """Call `work(first, last)` on pieces of range(count); each piece writes its own rows, so order does not matter."""
    threads = max(1, min(os.cpu_count() or 1, count // _SMALLEST_CHUNK))
    if threads == 1:
        work(0, count)
        return
    chunk = max(_SMALLEST_CHUNK, -(-count // (4 * threads)))
    with ThreadPoolExecutor(threads) as pool:
        for done in [pool.submit(work, at, min(at + chunk, count)) for at in range(0, count, chunk)]:
            done.result()
