"""`report.json`: what a folder holds, and the command that made it, so that its page can be built again."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from designer.errors import InputError
from designer.small_file import parse_json, read_small_text
from designer.words import printable

ORIGIN_FILE = "report.json"
FORMAT = "ringsolid.report"
VERSION = 1
MAX_FILE_BYTES = 2**16
LONGEST_COMMAND, LONGEST_WORD = 4000, 200
WHAT = "a report.json"


@dataclass(frozen=True)
class Origin:
    """Where a folder's results come from."""

    kind: str  # a key of `calib.report.registry.KINDS`
    command: str  # the command line; "" if it is not known
    program: str  # name and version


class _OriginFile(BaseModel):
    """The keys of the file."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    format: Literal["ringsolid.report"]
    version: Annotated[int, Field(strict=True)]
    kind: Annotated[str, Field(strict=True, max_length=LONGEST_WORD)]
    command: Annotated[str, Field(strict=True, max_length=LONGEST_COMMAND)]
    program: Annotated[str, Field(strict=True, max_length=LONGEST_WORD)]


def origin_of(kind: str, command: str, program: str) -> Origin:
    """An origin that a file can hold: each text on one line, a command of thousands of file names cut."""
    line = printable(command)
    short = line if len(line) <= LONGEST_COMMAND else f"{line[: LONGEST_COMMAND - 4]} ..."
    return Origin(kind, short, printable(program)[:LONGEST_WORD])


def origin_to_json(origin: Origin) -> bytes:
    """The text of `report.json`."""
    document = {"format": FORMAT, "version": VERSION, **asdict(origin)}
    return (json.dumps(document, indent=1) + "\n").encode()


def read_origin(folder: Path) -> Origin:
    """The origin of a folder's results.

    Raises:
        InputError: the folder holds no `report.json`, or one that breaks a rule; the message names it.
    """
    path = folder / ORIGIN_FILE
    document = parse_json(read_small_text(path, MAX_FILE_BYTES, WHAT), path, WHAT)
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise InputError(f'{path}: not of this program: it must hold "format": "{FORMAT}"; give another folder')
    if document.get("version") != VERSION:
        raise InputError(
            f"{path}: version {str(document.get('version'))[:20]}; this program reads version {VERSION}: "
            "use the version that wrote it"
        )
    try:
        file = _OriginFile.model_validate(document)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))[:LONGEST_WORD]
        raise InputError(f"{path}: {place}: {first['msg']}; delete it and try again") from None
    return origin_of(file.kind, file.command, file.program)


def is_of_kind(folder: Path, kind: str) -> bool:
    """Whether a folder has a page of a kind: what lies there was written with it."""
    try:
        return read_origin(folder).kind == kind
    except InputError:
        return False
