"""Ctrl-C while a program begins and ends, and whoever else ends it: both stop it in one line, and leave nothing half.

Loads next to nothing, as before this no Ctrl-C ends in one line.
"""

import signal
from contextlib import suppress

MASKED = hasattr(signal, "pthread_sigmask")  # not on Windows
STOPS = {signal.SIGINT, signal.SIGTERM}


def hold_interrupts() -> None:
    """Let Ctrl-C wait: while modules load it would leave a traceback, or get lost."""
    if MASKED:
        signal.pthread_sigmask(signal.SIG_BLOCK, STOPS)


def heed_interrupts() -> None:
    """Let Ctrl-C do what it does, and at once if it was waiting."""
    with suppress(ValueError):  # in another thread than the main one
        signal.signal(signal.SIGTERM, signal.default_int_handler)
    if MASKED:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, STOPS)
