"""Ctrl-C while a program begins and ends. Loads next to nothing, as before this no Ctrl-C ends in one line."""

import signal

MASKED = hasattr(signal, "pthread_sigmask")  # not on Windows


def hold_interrupts() -> None:
    """Let Ctrl-C wait: while modules load it would leave a traceback, or get lost."""
    if MASKED:
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})


def heed_interrupts() -> None:
    """Let Ctrl-C do what it does, and at once if it was waiting."""
    if MASKED:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
