"""Pictures of photos that were searched: drawn aside, and kept in the place of earlier ones when all are there."""

import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

from calib.core.types import Detections
from calib.observe.photos import PhotoFile, PhotoResult, Search, searched_photos
from designer.base.errors import InputError
from designer.base.files import check_folder
from designer.base.own_files import is_ours, require_ours

AT_ONCE = 4
"""Photos that are drawn at a time."""


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


def with_overlays(search: Search, staging: Path) -> Search:
    """The search with a picture of each photo, drawn from its file."""
    known = {result.photo.name: result for result in search.results}

    def found_before(photo: PhotoFile, _: object) -> Detections:
        seen = known[photo.name].seen
        if seen is None:
            raise InputError(known[photo.name].failure)
        return seen

    photos = [result.photo for result in search.results]
    drawn = searched_photos(photos, search.target, found_before, overlay_folder=staging, jobs=AT_ONCE)
    return replace(
        search, results=tuple(_drawn(before, now) for before, now in zip(search.results, drawn, strict=True))
    )


def _drawn(before: PhotoResult, now: PhotoResult) -> PhotoResult:
    gone = now.failure if before.seen is not None else ""
    failure = f"no overlay for {before.photo.name}: {gone}" if gone else now.overlay_failure
    return replace(before, overlay=now.overlay, overlay_failure=failure)


def remove_ours(kinds: Mapping[Path, str] | Iterable[Path]) -> None:
    """Remove files that this program made, each of its kind, "" for any; others stay."""
    of_kind = kinds if isinstance(kinds, Mapping) else dict.fromkeys(kinds, "")
    for path, kind in of_kind.items():
        if path.is_file() and is_ours(path, kind):
            path.unlink()
