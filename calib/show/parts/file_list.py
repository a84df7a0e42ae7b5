"""The files of a folder, as its page lists them."""

from collections.abc import Sequence
from pathlib import Path

from designer.page.blocks import FileList, FileRow


def file_list(folder: Path, purposes: Sequence[tuple[str, str]]) -> FileList:
    """Those of the named files that are there.

    Args:
        folder: of the page.
        purposes: paths within it and what they are for, in the order to list them.
    """
    rows = []
    for path, purpose in purposes:
        place = folder / path
        if place.is_file():
            rows.append(FileRow(path, purpose, place.stat().st_size))
    return FileList(tuple(rows))
