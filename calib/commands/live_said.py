"""What `calib live` says while photos are taken, and when it is stopped."""

from pathlib import Path
from typing import NoReturn

from designer.base.answer import StoppedError, Summary
from designer.base.words import printable
from designer.page.terminal import quoted


def said(line: str) -> None:
    """A line of what happens, at once: who waits for the address may be a program."""
    print(printable(line), flush=True)


def stopped_live(target: Path, folder: Path, summary: Summary, sources: str = "") -> NoReturn:
    """End after Ctrl-C: photos are kept.

    Raises:
        StoppedError: always.
    """
    again = f"calib live {quoted(target)} -o {quoted(folder)}{sources} --resume"
    raise StoppedError(f"stopped; the photos are kept: {again}", summary) from None
