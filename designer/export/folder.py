"""Writing a set of files so that a failure leaves the earlier ones as they were."""

import os
import shutil
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from designer.errors import InputError


@dataclass(frozen=True)
class OutputFile:
    """A file to write: its bare name and content."""

    name: str
    content: bytes
    purpose: str  # one phrase for the person


def write_folder(folder: Path, files: Iterable[OutputFile]) -> None:
    """Write all files into the folder, or none of them.

    Everything is written under temporary names on the same disk first, then renamed.

    Raises:
        InputError: the folder cannot be made or written, or the disk is full.
    """
    staging: Path | None = None
    try:
        folder.mkdir(parents=True, exist_ok=True)
        staging = Path(tempfile.mkdtemp(prefix=".unfinished-", dir=folder))
        staged = []
        for file in files:
            place = staging / file.name
            with place.open("wb") as stream:
                stream.write(file.content)
                stream.flush()
                os.fsync(stream.fileno())
            staged.append(place)
        for place in staged:
            if (folder / place.name).is_dir():
                raise IsADirectoryError(None, "a folder has the name of a file to write", str(folder / place.name))
        for place in staged:
            place.replace(folder / place.name)
    except OSError as error:
        where = error.filename if isinstance(error, IsADirectoryError) else folder
        raise InputError(
            f"{where}: cannot be written: {error.strerror}; choose another folder with -o, or make room"
        ) from error
    finally:
        if staging is not None:
            shutil.rmtree(staging, ignore_errors=True)
