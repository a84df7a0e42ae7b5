"""Sightings of unknown points from a table: camera,frame,point,u,v and how sure each is, in any order."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.cameras.rig import Rig
from calib.observe.correspondences import is_far_outside
from calib.observe.csv_table import CsvTable, column_fault, column_names, read_table, read_text
from calib.space.sightings import PointSightings, of_rows
from designer.base.words import shown, suggestion

REQUIRED = ("camera", "frame", "point", "u", "v")
SIGMA = "sigma_px"
MAX_FILE_BYTES = 256 * 2**20
LONGEST_NAME = 200


def read_point_table(path: Path, rig: Rig) -> PointSightings:
    """The sightings in a table: `read_point_table(Path("sightings.csv"), rig)`.

    Raises:
        InputError: it cannot be read, or a line breaks a rule; the message names the line.
    """
    table = read_table(
        path,
        read_text(path, "a table of sightings", MAX_FILE_BYTES),
        lambda names: column_fault(names, REQUIRED, f"the columns must be {','.join(REQUIRED)}, and may be {SIGMA}"),
        holds="sightings; a line is such as left,shot1,corner7,812.3,455.1",
    )
    camera, center = _cameras(table, rig), table.columns("uv")
    size = np.array([one.image_size for one in rig.cameras])[camera]
    table.require(~is_far_outside(center, size), "u, v lie far outside the camera's image; is it another camera's?")
    frames, points = table.cells["frame"], table.cells["point"]
    table.require(np.array([0 < len(name) <= LONGEST_NAME for name in points]), "point needs a name")
    table.require(np.array([len(name) <= LONGEST_NAME for name in frames]), "frame has too long a name")
    seen = of_rows(camera, frames, points, center, table.variances(SIGMA) if SIGMA in table.cells else None)
    table.sorted_once(seen.camera, seen.place, "the same point of the same frame and camera a second time; keep one")
    return seen


def has_known_points(path: Path) -> bool:
    """Whether a table is of a target's points, by their coordinates or ids, and not of unknown points by name."""
    columns = column_names(path, "a table of sightings")
    return "point" not in columns and (columns >= {"X", "Y", "Z"} or "id" in columns)


def _cameras(table: CsvTable, rig: Rig) -> NDArray[np.int64]:
    """The row in the rig of each line's camera.  # (M,)"""
    row = {name: number for number, name in enumerate(rig.names)}
    camera = np.array([row.get(name, -1) for name in table.cells["camera"]], dtype=np.int64)
    if (camera < 0).any():
        name = table.cells["camera"][int(np.argmax(camera < 0))]
        hint = suggestion(name, list(rig.names)) or "; there are " + ", ".join(map(shown, rig.names))
        table.require(camera >= 0, f"camera {shown(name)} is not in the rig{hint}")
    return camera
