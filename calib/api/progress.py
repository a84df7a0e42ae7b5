"""How long work reports where it is: nothing here prints, a caller may."""

from collections.abc import Callable
from typing import TypeAlias

Progress: TypeAlias = Callable[[str, float, int], None]
"""Is told what is being done, how many are done, and of how many, as in `("searching", 3, 12)`; of 0 nobody knows."""


def unheard(what: str, done: float, total: int) -> None:
    """Nobody is told."""
