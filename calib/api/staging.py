"""Pictures are drawn into a folder beside their final place, so that work which is stopped leaves none."""

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from designer.base.errors import InputError
from designer.base.files import check_folder
from designer.base.own_files import require_ours


@contextmanager
def staging_folder(place: Path, option: str = "--overlay") -> Iterator[Path]:
    """A folder inside the pictures' final place, gone afterwards.

    Raises:
        InputError: the place takes no files.
    """
    check_folder(place, option)
    try:
        place.mkdir(parents=True, exist_ok=True)
        folder = Path(tempfile.mkdtemp(prefix=".unfinished-", dir=place))
    except OSError as error:
        raise InputError(f"{place}: cannot be written: {error.strerror}; choose another folder with {option}") from None
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def keep_pictures(staging: Path, place: Path) -> tuple[Path, ...]:
    """Put finished pictures in their place, which is returned.

    Raises:
        InputError: one would replace somebody else's file.
    """
    pictures = sorted(staging.iterdir())
    for picture in pictures:
        require_ours(place / picture.name, picture.read_bytes())
    return tuple(picture.replace(place / picture.name) for picture in pictures)


@contextmanager
def no_empty_folders(place: Path) -> Iterator[None]:
    """Remove the folders that were made for nothing, if it comes to that."""
    made = [folder for folder in (place, *place.parents) if not folder.exists()]
    try:
        yield
    finally:
        with suppress(OSError):  # the first that is not empty
            for folder in made:
                folder.rmdir()
