"""What works at a time: compiled work over threads, linear algebra on one, and processes that serve another."""

import multiprocessing.resource_tracker
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import lru_cache, wraps
from typing import TYPE_CHECKING, ParamSpec, TypeVar

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

_SMALLEST_CHUNK = 16
Given = ParamSpec("Given")
Result = TypeVar("Result")
PARENT_CHECK_S = 0.5


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


def one_thread(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """The function, its matrix products and factors made by one thread."""

    @wraps(function)
    def limited(*args: Given.args, **kwargs: Given.kwargs) -> Result:
        with _libraries("scipy.linalg" in sys.modules).limit(limits=1):
            return function(*args, **kwargs)

    return limited


def one_thread_with_scipy(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """As `one_thread`, for what imports SciPy's linear algebra: its library can be limited only once it is there."""
    limited = one_thread(function)

    @wraps(function)
    def after_scipy(*args: Given.args, **kwargs: Given.kwargs) -> Result:
        import scipy.linalg  # noqa: F401  # loads the library

        return limited(*args, **kwargs)

    return after_scipy


@lru_cache(maxsize=2)
def _libraries(_has_scipy: bool) -> "ThreadpoolController":
    """The libraries of linear algebra; with SciPy comes another. Finding them takes as long as a small solution."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


def serve(parent: int) -> None:
    """Make this process a servant: deaf to Ctrl-C, which is for its parent, and gone soon after that ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(PARENT_CHECK_S)
        os._exit(1)

    if sys.platform != "win32":
        threading.Thread(target=watch, daemon=True).start()


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Ctrl-C is for this process: those started meanwhile never see it, and this one sees it afterwards."""
    if sys.platform == "win32":
        yield
        return
    # Else it is started with the first process, and lets the signal through again, for that process too.
    multiprocessing.resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
