"""What `calib live` says while photos are taken, and when it is stopped."""

import re
from typing import NoReturn

from designer.base.answer import StoppedError, Summary, command_line
from designer.base.words import printable


def said(line: str) -> None:
    """A line of what happens, at once: who waits for the address may be a program."""
    print(printable(line), flush=True)


def line_to_show() -> str:
    """The command as it was typed, without the passwords in addresses."""
    return re.sub(r"//[^/@\s]*@", "//USER:PASSWORD@", command_line())


def line_to_go_on() -> str:
    """The command that adds photos to those that are there."""
    line = line_to_show()
    return line if "--resume" in line.split() else f"{line} --resume"


def stopped_live(summary: Summary) -> NoReturn:
    """End after Ctrl-C: photos are kept.

    Raises:
        StoppedError: always.
    """
    raise StoppedError(f"stopped; the photos are kept: {line_to_go_on()}", summary) from None
