"""Waits for what another thread, process or browser does: for a state, never for a time."""

import time
from collections.abc import Callable

WITHIN_S = 300.0
"""Far longer than anything takes, also on a busy machine: a test that fails may take long."""


def wait_until(is_so: Callable[[], object], pause: Callable[[], object] = lambda: time.sleep(0.01)) -> None:
    """Wait until something is so; `pause` is what lets it happen, if sleeping would not."""
    end = time.monotonic() + WITHIN_S
    while not is_so():
        assert time.monotonic() < end, f"not so within {WITHIN_S:g} s"
        pause()
