"""Writing files so that they are whole or as they were."""

import os
import stat
import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from secrets import token_hex

from designer.base.errors import InputError, NotWrittenError
from designer.base.own_files import require_ours, signed

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
    place = next(place for place in (folder, *folder.absolute().parents) if os.path.lexists(place))
    try:
        if not stat.S_ISDIR(place.stat().st_mode):
            raise InputError(f"{place}: is a file, not a folder; choose another with {option}")
        with tempfile.TemporaryFile(dir=place):
            pass
    except OSError as error:
        raise InputError(
            f"{folder}: cannot be written: {error.strerror}; choose another folder with {option}"
        ) from None


def write_files(files: Mapping[Path, bytes]) -> None:
    """Write each file under a temporary name beside its final one, then rename all; a full disk changes none.

    Raises:
        NotWrittenError: a folder cannot be made or written, or the disk is full.
        InputError: a file is somebody else's.
    """
    staged: dict[Path, Path] = {}
    ours = {final: signed(final.name, content) for final, content in files.items()}
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
            place.replace(final)
    except OSError as error:
        raise NotWrittenError(
            f"{next(iter(files))}: cannot be written: {error.strerror}; choose another place, or make room"
        ) from None
    finally:
        for place in staged.values():
            place.unlink(missing_ok=True)
