"""`report.json`: what a folder holds, and the command that made it, so that its page can be built again."""

from dataclasses import dataclass
from pathlib import Path

from designer.base.errors import InputError
from designer.base.file_kind import FileKind
from designer.base.marks import Line, Word
from designer.base.words import printable

ORIGIN_FILE = "report.json"
LONGEST_COMMAND, LONGEST_WORD = 4000, 200


@dataclass(frozen=True)
class Origin:
    """Where a folder's results come from."""

    kind: Word  # a key of `calib.show.folder.KINDS`
    command: Line  # the command line; "" if it is not known
    program: Word  # name and version


ORIGIN = FileKind(Origin, "report", "a report.json", "delete it and try again", largest_bytes=2**16)


def origin_of(kind: str, command: str, program: str) -> Origin:
    """An origin that a file can hold: each text on one line, a command of thousands of file names cut."""
    line = printable(command)
    short = line if len(line) <= LONGEST_COMMAND else f"{line[: LONGEST_COMMAND - 4]} ..."
    return Origin(kind, short, printable(program)[:LONGEST_WORD])


def read_origin(folder: Path) -> Origin:
    """The origin of a folder's results.

    Raises:
        InputError: the folder holds no `report.json`, or one that breaks a rule; the message names it.
    """
    return ORIGIN.read(folder / ORIGIN_FILE)


def is_of_kind(folder: Path, kind: str) -> bool:
    """Whether a folder has a page of a kind: what lies there was written with it."""
    try:
        return read_origin(folder).kind == kind
    except InputError:
        return False
