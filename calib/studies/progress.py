"""Progress of work that has parts."""

from collections.abc import Callable

Tell = Callable[[float], None]
"""Told how many are done."""


def after(before: float, tell: Tell) -> Tell:
    """Tells of the progress of a part, what came before it included."""
    return lambda done: tell(before + done)
