"""What commands show: tables on standard output, progress on standard error while there is a screen."""

import shlex
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

from designer.command import printable

if TYPE_CHECKING:
    from rich.console import Console

WIDE = 240


def shown(path: Path) -> str:
    """A path as a line of the screen has it."""
    return printable(str(path))


def quoted(path: Path) -> str:
    """A path as it is typed in a shell."""
    return shlex.quote(shown(path))


def table_console() -> "Console":
    """Where tables go. Off a terminal nobody's window is narrow: a row is a line."""
    from rich.console import Console

    return Console(highlight=False, soft_wrap=True, width=None if sys.stdout.isatty() else WIDE)


@contextmanager
def progress_bar(label: str, total: int, *, rate: bool = False) -> Iterator[Callable[[float], None]]:
    """A bar that is told how many of the total are done, parts of one included.

    Args:
        label: what is being done, as in "searching".
        total: how many there are.
        rate: say how many are done in a second.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn, TimeRemainingColumn
    from rich.text import Text

    class Rate(ProgressColumn):
        def render(self, task: Task) -> Text:
            return Text(f"{task.speed:.0f}/s" if rate and task.speed else "")

    columns = (
        TextColumn(label), BarColumn(), TextColumn("{task.fields[whole]}/{task.total}"), Rate(), TimeRemainingColumn()
    )  # fmt: skip
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(label, total=total, whole=0)
        yield lambda done: bar.update(task, completed=done, whole=int(done + 1e-9))


@contextmanager
def waiting(label: str) -> Iterator[None]:
    """A sign of life while something of unknown length is done.

    Args:
        label: what is being done, as in "solving".
    """
    from rich.console import Console

    console = Console(stderr=True)
    with console.status(label, spinner="dots") if console.is_terminal else nullcontext():
        yield
