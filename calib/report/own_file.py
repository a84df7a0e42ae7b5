"""Files that a command leaves in a folder of pictures, for the folder's page: plain dataclasses as JSON."""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from designer.command import printable
from designer.errors import InputError
from designer.small_file import parse_json, read_small_text

MAX_FILE_BYTES = 256 * 2**20
MOST_PHOTOS = 100_000
LARGEST_COUNT = 10**9
LONGEST_PLACE = 200
FARTHEST_MM = 1e9
"""A camera farther away sees nothing, and squares of its distance overflow further on."""

Own = TypeVar("Own")


def own_to_json(document: Mapping[str, object]) -> bytes:
    """The text of a file: a line a field, its format first."""
    first = {name: document[name] for name in ("format", "version")}
    lines = (f"{json.dumps(name)}: {json.dumps(value)}" for name, value in {**first, **document}.items())
    return ("{\n" + ",\n".join(lines) + "\n}\n").encode()


def read_own(path: Path, kind: type[Own], remedy: str) -> Own:
    """Read a file.

    Args:
        path: the file.
        kind: a dataclass, whose `format` and `version` are literals.
        remedy: what makes the file again, as in "detect again".

    Raises:
        InputError: it cannot be read, or breaks a rule; the message names file and place.
    """
    from pydantic import TypeAdapter, ValidationError

    what = f"a {path.name}"
    document = parse_json(read_small_text(path, MAX_FILE_BYTES, what), path, what)
    try:
        return TypeAdapter(kind).validate_python(document)
    except ValidationError as error:
        first = error.errors()[0]
        place = printable(".".join(map(str, first["loc"]))[:LONGEST_PLACE]) or "the document"
        raise InputError(f"{path}: {place}: {first['msg']}; {remedy}") from None


def require_counts(path: Path, counts: Iterable[int], remedy: str) -> None:
    """Refuse numbers of things that nothing has.

    Raises:
        InputError: one is below zero or beyond all reason.
    """
    if any(not 0 <= count <= LARGEST_COUNT for count in counts):
        raise InputError(f"{path}: holds a count that is not from 0 to {LARGEST_COUNT}; {remedy}")


def require_near(path: Path, cam_from_target: NDArray[np.float64], remedy: str) -> None:
    """Refuse poses (V, 4, 4) of cameras that stand nowhere on earth.

    Raises:
        InputError: one is farther away than all reason, or stands in the target's origin.
    """
    distance = np.abs(cam_from_target[:, :3, 3]).max(axis=1, initial=0)
    if not ((distance > 0) & (distance <= FARTHEST_MM)).all():
        raise InputError(f"{path}: a pose is not from more than 0 to {FARTHEST_MM:g} mm away; {remedy}")
