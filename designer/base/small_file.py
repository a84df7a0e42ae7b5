"""Text files that a person names: read whole, within bounds, with one line of reason where that cannot be."""

import json
import re
import stat
import tomllib
from collections import Counter
from os import PathLike, fspath
from pathlib import Path
from typing import TypeAlias

from designer.base.errors import InputError
from designer.base.words import shown

MAX_TOML_BYTES = 2**14
JsonValue: TypeAlias = "dict[str, JsonValue] | list[JsonValue] | str | int | float | bool | None"


def place_of(value: object, wanted: str) -> Path:
    """The path that a person gave, where a name or a path is `wanted`, in words with an article.

    Raises:
        InputError: it is of another type, or empty.
    """
    if not isinstance(value, str | PathLike):
        raise InputError(f"{shown(value)}: is of type {type(value).__name__}; give {wanted}")
    if not fspath(value):
        raise InputError(f"{fspath(value)!r}: is no path; give {wanted}")
    return Path(value)


def read_small_text(path: Path, max_bytes: int, kind: str, errors: str = "strict") -> str:
    """The text of a regular UTF-8 file of at most `max_bytes`.

    Args:
        path: the file.
        max_bytes: a file of its kind is never larger.
        kind: what it should be, with its article, as in "a target file".
        errors: what becomes of bytes that are no UTF-8 text, as `bytes.decode` has it.

    Raises:
        InputError: no such file, a folder or device, too large, or not UTF-8 text; the message names the file.
    """
    try:
        return read_small(path, max_bytes, kind).decode("utf-8-sig", errors)
    except UnicodeDecodeError:
        raise InputError(f"{path}: not UTF-8 text, so not {kind}") from None


def read_small(path: Path, max_bytes: int, kind: str) -> bytes:
    """The content of a regular file of at most `max_bytes`.

    Raises:
        InputError: no such file, a folder or device, or too large; the message names the file.
    """
    try:
        # Asked before it is opened: a pipe would wait, a device would never end.
        if not stat.S_ISREG(path.stat().st_mode):
            raise InputError(f"{path}: not a regular file; name {kind}")
        with path.open("rb") as stream:
            content = stream.read(max_bytes + 1)
        if len(content) > max_bytes:
            raise InputError(f"{path}: more than {max_bytes} bytes; {kind} is smaller")
        return content
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}; check the path") from error
    except ValueError as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{str(path)!r}: is no file name: {error}; check the path") from None


def read_spec_file(path: Path) -> dict[str, object]:
    """The keys and values of a spec or a printer profile in TOML, not yet checked.

    Raises:
        InputError: the file cannot be read or is no TOML; the message names file, line and column.
    """
    text = read_small_text(path, MAX_TOML_BYTES, "a TOML file of a few lines")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise InputError(f"{path}: nested too deep for a spec") from None
    except tomllib.TOMLDecodeError as error:
        place = re.search(r" \(at (?:line (\d+), column (\d+)|end of document)\)", str(error))
        where = f"line {place[1]}, column {place[2]}" if place and place[1] else "at its end"
        what = str(error)[: place.start()] if place else str(error)
        raise InputError(f"{path}: {where}: {what[:1].lower()}{what[1:]}; not valid TOML") from None
    except ValueError:  # Python refuses to read integers of thousands of digits
        raise InputError(f"{path}: a number is too long; not a spec") from None


def parse_json(text: str, path: Path, kind: str) -> JsonValue:
    """The value in a JSON text.

    Raises:
        InputError: not JSON, nested too deep, a number of thousands of digits, or a key twice; the message names the
            file.
    """
    try:
        value: JsonValue = json.loads(text, object_pairs_hook=once_each)
    except json.JSONDecodeError as error:
        raise InputError(f"{path}: line {error.lineno}, column {error.colno}: {error.msg}; not valid JSON") from None
    except RecursionError:
        raise InputError(f"{path}: nested too deep for {kind}") from None
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except ValueError:  # Python refuses to read integers of thousands of digits
        raise InputError(f"{path}: a number is too long; not {kind}") from None
    return value


def once_each(pairs: list[tuple[str, JsonValue]]) -> dict[str, JsonValue]:
    """An object of a JSON text: of a key that stands there twice nobody knows which value was meant.

    Raises:
        InputError: there is one.
    """
    values = dict(pairs)
    if len(values) < len(pairs):
        twice = Counter(key for key, _ in pairs).most_common(1)[0][0]
        raise InputError(f"key {twice[:40]!a} stands there twice; leave one of them out")
    return values
