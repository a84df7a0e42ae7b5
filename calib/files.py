"""Writing files so that they are whole or as they were."""

import os
from collections.abc import Mapping
from pathlib import Path
from secrets import token_hex

from designer.errors import InputError


def write_files(files: Mapping[Path, bytes]) -> None:
    """Write each file under a temporary name beside its final one, then rename all; a full disk changes none.

    Raises:
        InputError: a folder cannot be made or written, or the disk is full.
    """
    staged: dict[Path, Path] = {}
    try:
        for final, content in files.items():
            final.parent.mkdir(parents=True, exist_ok=True)
            staged[final] = final.with_name(f".unfinished-{token_hex(8)}")
            with staged[final].open("xb") as stream:
                stream.write(content)
                stream.flush()
                os.fsync(stream.fileno())
        for final, place in staged.items():
            place.replace(final)
    except OSError as error:
        raise InputError(
            f"{next(iter(files))}: cannot be written: {error.strerror}; choose another place, or make room"
        ) from None
    finally:
        for place in staged.values():
            place.unlink(missing_ok=True)
