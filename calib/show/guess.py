"""What a folder without `report.json` holds, by the files in it."""

from collections.abc import Mapping
from pathlib import Path

from calib.show.parts.gallery import OVERLAYS
from calib.show.parts.origin import ORIGIN_FILE, Origin, origin_of, read_origin
from calib.show.photos.photos_file import PHOTOS_FILE, read_photos
from calib.show.run.run_folder import is_run_folder
from designer.base.answer import program
from designer.base.errors import InputError
from designer.base.own_files import kind_of

TABLE_FILE = "table.json"
HEAD_BYTES = 200
BY_FORMAT: Mapping[str, str] = {
    "ringsolid.study_table": "bootstrap", "ringsolid.tolerance_table": "tolerance", "ringsolid.comparison": "compare",
}  # fmt: skip
"""Formats of table.json and what the folder then is."""
OF_PAPER = "targets"
"""A study of the paper has a folder with the targets it made up."""
OLDER: Mapping[str, str] = {
    "undistorted.json": "calib undistort", "detected.json": "calib detect", "posed.json": "calib pose",
    "truth.json": "calib render",
}  # fmt: skip
"""Files in folders of pictures that have no photos.json: of a run that was stopped, or of an earlier version."""
MEASURED = "*.as_built.json"
DESIGN = "*.target.json"


def origin_in(folder: Path) -> Origin:
    """The origin that a folder states, or that its files tell; then the command that made it is not known.

    Raises:
        InputError: no folder, or one that holds nothing to report, or a damaged `report.json`; the message says what
            to do.
    """
    if not folder.is_dir():
        what = "is a file, not a folder" if folder.exists() else "no such folder"
        raise InputError(f"{folder}: {what}; give a folder of calib run, calib measure or calib study")
    if (folder / ORIGIN_FILE).exists():
        return read_origin(folder)
    kind = _kind(folder)
    if kind:
        return origin_of(kind, "", program())
    if any(folder.glob(DESIGN)):
        name = next((path.name for path in sorted(folder.glob("*.toml"))), "NAME.toml")
        raise InputError(f"{folder}: is a design's folder: design make {name} -o {folder} writes its page")
    for name, command in OLDER.items():
        if (folder / name).is_file():
            raise InputError(f"{folder}: has a {name} and no {PHOTOS_FILE}: the same {command} again writes its page")
    if (folder / OVERLAYS / PHOTOS_FILE).is_file():
        raise InputError(
            f"{folder}: holds no camera, only what was found in photos: calib report {folder / OVERLAYS} writes "
            "its page"
        )
    raise InputError(
        f"{folder}: holds nothing to report; give a folder that calib run, calib measure, calib study or "
        "design tolerance wrote"
    )


def _kind(folder: Path) -> str:
    """The kind of a folder's results; "" if there are none."""
    if is_run_folder(folder):
        return "calibration"
    table = folder / TABLE_FILE
    if table.is_file():
        with table.open("rb") as stream:
            kind = BY_FORMAT.get(kind_of(stream.read(HEAD_BYTES)).decode("utf-8", "replace"), "")
        return "paper" if kind == "bootstrap" and (folder / OF_PAPER).is_dir() else kind
    if any(folder.glob(MEASURED)):
        return "measure"
    return read_photos(folder).kind if (folder / PHOTOS_FILE).is_file() else ""
