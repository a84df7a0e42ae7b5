"""Writing files so that they are whole or as they were.

Text files that a person names: read whole, within bounds, with one line of reason where that cannot be.
"""

import json
import os
import re
import shutil
import stat
import tempfile
import tomllib
from collections import Counter
from collections.abc import Mapping, Sequence
from os import PathLike, fspath
from pathlib import Path
from secrets import token_hex
from typing import TypeAlias

from designer.base.errors import InputError, NotWrittenError
from designer.base.own_files import require_ours, signed
from designer.base.words import shown

MAX_NAME_BYTES = 200
"""Of a file that is named after another; file systems take 255 with what is added."""


def distinct_stems(names: Sequence[str]) -> list[str]:
    """A name without suffix for what is made of each of several files, their names distinct and with `/` for folders.

    Names that differ in their suffix or folders only keep them; if that does not do, they are numbered.
    """
    flat = [name.replace("/", "_") for name in names]
    stems = [Path(name).stem for name in flat]
    count = Counter(stems)
    kept = [stem if count[stem] == 1 else name for stem, name in zip(stems, flat, strict=True)]
    if len(set(kept)) < len(kept) or any(len(os.fsencode(name)) > MAX_NAME_BYTES for name in kept):
        return [str(number) for number in range(1, len(kept) + 1)]
    return kept


def named_in_files(path: Path) -> str:
    """A path for results and advice, to be typed where it was typed; of an absolute one the name: no place is told."""
    return path.name if path.is_absolute() else str(path)


def check_folder(folder: Path, option: str = "-o") -> None:
    """Refuse a folder that takes no files before any work is done.

    Raises:
        InputError: it, or the folder it is to be made in, is none, cannot be written, or is a link to nowhere.
    """
    above = (
        folder.parents
        if folder.is_absolute()
        else (*folder.parents[:-1], *folder.absolute().parents[len(folder.parents) - 1 :])
    )
    place = next(place for place in (folder, *above) if os.path.lexists(place))
    try:
        if not stat.S_ISDIR(place.stat().st_mode):
            raise InputError(f"{place}: is a file, not a folder; choose another with {option}")
        with tempfile.TemporaryFile(dir=place):
            pass
    except OSError as error:
        raise InputError(
            f"{folder}: cannot be written: {error.strerror}; choose another folder with {option}"
        ) from None


def write_files(files: Mapping[Path, bytes], sort: str = "result") -> None:
    """Write each file under a temporary name beside its final one, then rename all: what fails changes none.

    Every file is whole at any moment: earlier ones stay under a second name until all are in place.

    Args:
        files: contents by their places.
        sort: of thing that texts hold, see `signed`.

    Raises:
        NotWrittenError: a folder cannot be made or written, or the disk is full.
        InputError: a file is somebody else's.
    """
    staged: dict[Path, Path] = {}
    earlier: dict[Path, Path | None] = {}
    ours = {final: signed(final.name, content, sort) for final, content in files.items()}
    for final, content in ours.items():
        require_ours(final, content)
    try:
        for final, content in ours.items():
            final.parent.mkdir(parents=True, exist_ok=True)
            staged[final] = final.with_name(f".unfinished-{token_hex(8)}")
            with staged[final].open("xb") as stream:
                stream.write(content)
                stream.flush()
                os.fsync(stream.fileno())
        for final, place in staged.items():
            kept = _kept(place) if final.exists() else None
            if kept is not None:
                _link(final, kept)
            earlier[final] = kept
            place.replace(final)
    except (OSError, KeyboardInterrupt) as error:
        for final, kept in earlier.items():
            if kept is None:
                final.unlink(missing_ok=True)
            else:
                kept.replace(final)
        if isinstance(error, KeyboardInterrupt):
            raise
        raise NotWrittenError(
            f"{next(iter(files))}: cannot be written: {error.strerror}; choose another place, or make room"
        ) from None
    finally:
        for place in staged.values():
            place.unlink(missing_ok=True)
            _kept(place).unlink(missing_ok=True)


def _kept(place: Path) -> Path:
    """Where an earlier file stays beside a new one."""
    return place.with_name(f"{place.name}.earlier")


def _link(final: Path, kept: Path) -> None:
    """A second name for a file, or a copy where the disk knows no links."""
    try:
        os.link(final, kept)
    except OSError:
        shutil.copy2(final, kept)


MAX_TOML_BYTES = 2**16
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
