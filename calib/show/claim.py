"""Whether a folder's `index.html` may be written: folders of pictures are often folders of something else too."""

from pathlib import Path

from calib.show.parts.origin import ORIGIN_FILE, read_origin
from calib.show.write import PAGE_FILE
from designer.base.errors import InputError
from designer.base.words import printable

REPLACED = (("detections", "calibration"),)
"""Kinds that give way to another in the same folder: a run that found nothing, to one that found a camera."""


def why_no_page(folder: Path, kind: str) -> str:
    """Why a folder's page has to stay as it is, in one line; "" if a page of this kind may be written.

    A page is replaced by one of its own kind only: what `calib run` wrote about a folder is worth more than what
    another command would say of a part of it, and an `index.html` without a `report.json` is somebody's own.
    """
    page, origin = folder / PAGE_FILE, folder / ORIGIN_FILE
    if not origin.exists():
        return f"{printable(str(page))}: is there already and stays as it is" if page.exists() else ""
    try:
        there = read_origin(folder).kind
    except InputError as error:
        return printable(str(error))
    if there == kind or (there, kind) in REPLACED:
        return ""
    return f"{printable(str(page))}: stays as it is, the page of what is in this folder otherwise ({printable(there)})"
