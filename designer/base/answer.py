"""What a command answers to a program: one JSON document, the same envelope for every command (docs/json.md)."""

import json
from collections.abc import Mapping, Sequence
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias

from designer.base.words import NAME

FORMAT, VERSION = "ringsolid.summary", 1

Value: TypeAlias = "Mapping[str, Value] | Sequence[Value] | str | int | float | None"
"""What an answer is made of; a number that is not finite is not known."""


@dataclass(frozen=True)
class Summary:
    """What came of a command."""

    answer: Mapping[str, Value] = field(default_factory=dict)  # keys of numbers carry units: rms_px
    wrote: tuple[Path, ...] = ()
    next_steps: tuple[str, ...] = ()  # command lines
    remarks: tuple[str, ...] = ()  # what a person must know, a line each
    exit_code: int = 0  # 1: it ran, but the answer is negative


class StoppedError(Exception):
    """A person stopped the command. One line that says what stays, and the summary of that."""

    def __init__(self, message: str, summary: Summary | None = None) -> None:
        super().__init__(message)
        self.summary = Summary() if summary is None else summary


class NegativeError(Exception):
    """The command ran and its answer is no: one line that says why, and the summary of that."""

    def __init__(self, message: str, summary: Summary) -> None:
        super().__init__(message)
        self.summary = summary


LINE = ContextVar("command line", default="")
"""Set while a command runs, and for it only."""


def command_line() -> str:
    """The command as it was typed, quoted for a shell, without passwords in addresses; "" outside a command."""
    return LINE.get()


def program() -> str:
    """Name and version, for the record."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return f"{NAME} {version(NAME)}"
    except PackageNotFoundError:
        return f"{NAME}, not installed"


def document(summary: Summary, *, command: str, line: str, error: str | None) -> str:
    """The text of the JSON document: one line of ASCII, which survives any terminal.

    Args:
        summary: what came of the command.
        command: its name, as in "calib run".
        line: the command as it was typed.
        error: why it did not come to its end, in one line.
    """
    from designer.base.codec import encode_by_value  # here: who only asks for help needs no files

    envelope: dict[str, Value] = {
        "format": FORMAT,
        "version": VERSION,
        "command": command,
        "line": line,
        "program": program(),
        "exit_code": summary.exit_code,
        "wrote": [str(path) for path in dict.fromkeys(summary.wrote)],
        "next": summary.next_steps,
        "remarks": list(dict.fromkeys(summary.remarks)),
        "error": error,
        "answer": summary.answer,
    }
    return json.dumps(encode_by_value(envelope), allow_nan=False) + "\n"
