"""Overlays of photos that were searched before, drawn from the photos' files."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

from calib.core.types import Detections
from calib.observe.photos import PhotoFile, PhotoResult, Search, detect_photos
from designer.base.errors import InputError
from designer.base.own_files import is_ours

AT_ONCE = 4
"""Photos that are drawn at a time."""


def with_overlays(search: Search, staging: Path) -> Search:
    """The search with a picture of each photo, drawn from its file."""
    known = {result.photo.name: result for result in search.results}

    def found_before(photo: PhotoFile, _: object) -> Detections:
        seen = known[photo.name].seen
        if seen is None:
            raise InputError(known[photo.name].failure)
        return seen

    photos = [result.photo for result in search.results]
    drawn = detect_photos(photos, search.target, found_before, overlay_folder=staging, jobs=AT_ONCE)
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
