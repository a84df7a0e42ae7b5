"""Writing files so that they are whole or as they were."""

import os
import tempfile
from collections.abc import Mapping
from pathlib import Path

from designer.errors import InputError


def write_files(files: Mapping[Path, bytes]) -> None:
    """Write all files, or none: each under a temporary name beside its final one first, then all are renamed.

    Raises:
        InputError: a folder cannot be made or written, or the disk is full.
    """
    staged: dict[Path, Path] = {}
    try:
        for final, content in files.items():
            final.parent.mkdir(parents=True, exist_ok=True)
            number, name = tempfile.mkstemp(prefix=".unfinished-", dir=final.parent)
            staged[final] = Path(name)
            with os.fdopen(number, "wb") as stream:
                stream.write(content)
                stream.flush()
                os.fsync(stream.fileno())
            staged[final].chmod(0o666 & ~_umask())
        for final, place in staged.items():
            place.replace(final)
    except OSError as error:
        raise InputError(
            f"{next(iter(files))}: cannot be written: {error.strerror}; choose another place, or make room"
        ) from None
    finally:
        for place in staged.values():
            place.unlink(missing_ok=True)


def _umask() -> int:
    """The permissions that new files do not get; a temporary file starts with fewer."""
    mask = os.umask(0o022)
    os.umask(mask)
    return mask
