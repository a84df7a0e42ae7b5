"""Progress of work that has parts."""

from collections.abc import Callable
from dataclasses import dataclass

Tell = Callable[[float], None]
"""Told how many are done."""


def after(before: float, tell: Tell) -> Tell:
    """Tells of the progress of a part, what came before it included."""
    return lambda done: tell(before + done)


@dataclass(frozen=True)
class DrawCount:
    """How many draws were computed, and how long that took."""

    new: int = 0
    before: int = 0  # that the folder had
    seconds: float = 0.0
