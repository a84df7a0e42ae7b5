"""Progress: who works tells how far it is, and a command shows it on standard error, while there is a screen."""

import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import TypeAlias

Progress: TypeAlias = Callable[[str, float, int], None]
"""Is told what is being done, how many are done, and of how many, as in `("searching", 3, 12)`; of 0 nobody knows.

Rooms never print; a caller may.
"""

SAID_EVERY_S = 4.0
"""Between lines of progress where there is no terminal."""


def unheard(what: str, done: float, total: int) -> None:
    """Progress of which nobody is told."""


@contextmanager
def progress_bar(label: str, total: int) -> Iterator[Callable[[float], None]]:
    """A bar that is told how many of the total are done, parts of one included; off a terminal, a line now and then.

    Args:
        label: what is being done, as in "searching".
        total: how many there are.
    """
    from rich.console import Console

    console = Console(stderr=True)
    if not console.is_terminal:
        yield _lines(label, total)
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = TextColumn(label), BarColumn(), TextColumn("{task.fields[whole]}/{task.total}"), TimeRemainingColumn()
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(label, total=total, whole=0)
        yield lambda done: bar.update(task, completed=done, whole=int(done + 1e-9))


@contextmanager
def progress_bars() -> Iterator[Callable[[str, float, int], None]]:
    """A bar for each kind of work, one after the other, as `Progress` has it."""
    with ExitStack() as stack:
        open_bars: dict[str, Callable[[float], None]] = {}

        def tell(what: str, done: float, total: int) -> None:
            if what not in open_bars:
                stack.pop_all().close()
                open_bars.clear()
                bar = progress_bar(what, total) if total else _waiting_bar(what)
                open_bars[what] = stack.enter_context(bar)
            open_bars[what](done)

        yield tell


@contextmanager
def _waiting_bar(label: str) -> Iterator[Callable[[float], None]]:
    with waiting(label):
        yield lambda done: None


def _lines(label: str, total: int) -> Callable[[float], None]:
    """Tells how many are done and about how long the rest takes, in a line every few seconds."""
    start = said = time.monotonic()

    def tell(done: float) -> None:
        nonlocal said
        now = time.monotonic()
        if now - said >= SAID_EVERY_S and 0 < done < total:
            said = now
            left_s = math.ceil((now - start) * (total - done) / done)
            print(f"{label}: {int(done + 1e-9)}/{total}, about {left_s} s left", file=sys.stderr, flush=True)

    return tell


@contextmanager
def waiting(label: str) -> Iterator[None]:
    """A sign of life while something of unknown length is done.

    Args:
        label: what is being done, as in "solving".
    """
    if not sys.stderr.isatty():  # what draws it takes a while to load
        yield
        return
    from rich.console import Console

    with Console(stderr=True).status(label, spinner="dots"):
        yield
