"""Sightings of unknown points from a table: camera,frame,point,u,v and how sure each is, in any order."""

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.cameras.rig import Rig
from calib.observe.csv_table import CsvTable, column_fault, read_table, read_text, skip_comments
from calib.space.sightings import PointSightings, of_rows
from designer.base.errors import InputError
from designer.base.words import shown, suggestion

REQUIRED = ("camera", "frame", "point", "u", "v")
SIGMA = "sigma_px"
LEAST_SIGMA_PX, MOST_SIGMA_PX = 1e-6, 1e4
MAX_FILE_BYTES = 256 * 2**20
OUTSIDE = 0.1
"""Share of a side that a sighting may lie outside the image; beyond, it is another camera's."""
LONGEST_NAME = 200


def read_point_table(path: Path, rig: Rig) -> PointSightings:
    """The sightings in a table: `read_point_table(Path("sightings.csv"), rig)`.

    Raises:
        InputError: it cannot be read, or a line breaks a rule; the message names the line.
    """
    stream = io.StringIO(read_text(path, "a table of sightings", MAX_FILE_BYTES), newline="")
    table = read_table(path, stream, skip_comments(stream), _column_fault, skip_spaces=True)
    if not table.lines:
        raise InputError(f"{path}: holds no sightings; a line is such as left,shot1,corner7,812.3,455.1")
    camera, center = _cameras(table, rig), np.stack([table.reals("u"), table.reals("v")], axis=1)
    _require_inside(table, rig, camera, center)
    frames, points = table.cells["frame"], table.cells["point"]
    table.require(np.array([0 < len(name) <= LONGEST_NAME for name in points]), "point needs a name")
    table.require(np.array([len(name) <= LONGEST_NAME for name in frames]), "frame has too long a name")
    seen = of_rows(camera, frames, points, center, _covariance(table))
    table.sorted_once(seen.camera, seen.place, "the same point of the same frame and camera a second time; keep one")
    return seen


def has_known_points(path: Path) -> bool:
    """Whether a table is of a target's points, by their coordinates or ids, and not of unknown points by name."""
    stream = io.StringIO(read_text(path, "a table of sightings", MAX_FILE_BYTES), newline="")
    skip_comments(stream)
    columns = {name.strip() for name in stream.readline().split(",")}
    return "point" not in columns and (columns >= {"X", "Y", "Z"} or "id" in columns)


def _column_fault(columns: tuple[str, ...]) -> str:
    return column_fault(columns, REQUIRED, f"the columns must be {','.join(REQUIRED)}, and may be {SIGMA}")


def _cameras(table: CsvTable, rig: Rig) -> NDArray[np.int64]:
    """The row in the rig of each line's camera.  # (M,)"""
    row = {name: number for number, name in enumerate(rig.names)}
    camera = np.array([row.get(name, -1) for name in table.cells["camera"]], dtype=np.int64)
    if (camera < 0).any():
        name = table.cells["camera"][int(np.argmax(camera < 0))]
        hint = suggestion(name, list(rig.names)) or "; there are " + ", ".join(map(shown, rig.names))
        table.require(camera >= 0, f"camera {shown(name)} is not in the rig{hint}")
    return camera


def _require_inside(table: CsvTable, rig: Rig, camera: NDArray[np.int64], center_px: NDArray[np.float64]) -> None:
    """Refuse sightings far outside their camera's image."""
    size = np.array([one.image_size for one in rig.cameras], dtype=np.float64)[camera]
    outside = np.maximum(-0.5 - center_px, center_px - size + 0.5) > OUTSIDE * size
    table.require(np.asarray(~outside.any(axis=1)), "u, v lie far outside the camera's image; is it another camera's?")


def _covariance(table: CsvTable) -> NDArray[np.float64] | None:
    """The covariances of the lines, if the table states standard deviations.  # (M, 2, 2)"""
    if SIGMA not in table.cells:
        return None
    sigma = table.reals(SIGMA)
    table.require(
        (sigma >= LEAST_SIGMA_PX) & (sigma <= MOST_SIGMA_PX),
        f"{SIGMA} must be from {LEAST_SIGMA_PX:g} to {MOST_SIGMA_PX:g}",
    )
    return np.asarray(sigma[:, None, None] ** 2 * np.eye(2))
