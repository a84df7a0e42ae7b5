"""A progress bar on standard error, while there is a screen."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def progress_bar(label: str, total: int) -> Iterator[Callable[[float], None]]:
    """A bar that is told how many of the total are done, parts of one included.

    Args:
        label: what is being done, as in "searching".
        total: how many there are.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn(label), BarColumn(), TextColumn("{task.fields[whole]}/{task.total}"), TimeRemainingColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(label, total=total, whole=0)
        yield lambda done: bar.update(task, completed=done, whole=int(done + 1e-9))
