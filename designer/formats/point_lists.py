"""A target's points for other tools: an entry here for each, which another's reader takes.

A point's id is the row of the target's arrays, the `ring` of `detections.csv`. Help reads the names here, so NumPy is
loaded by what writes.
"""

import csv
import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from designer.base.errors import InputError

if TYPE_CHECKING:
    from designer.target import TargetGeometry

M_PER_MM = 0.001
SQUARE = 1e-6
"""Of a lattice's step: steps that differ by less are alike, and stand on each other."""


@dataclass(frozen=True)
class PointFormat:
    """A file of a target's points."""

    title: str  # for whom
    file_name: str  # the usual end of its name
    write: "Callable[[TargetGeometry], str]"
    use: str  # what to do with it


def _rows(header: tuple[str, ...], rows: list[tuple[object, ...]], mark: str = "") -> str:
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    stream.write(mark)
    writer.writerow(header)
    writer.writerows(rows)
    return stream.getvalue()


def _table(target: "TargetGeometry") -> str:
    """All that a table can hold."""
    dot = "dot" if target.has_marks else "point"
    if target.marks is not None:
        dot = target.feature_word[:-1]
    kinds = [dot if is_dot else "ring" for is_dot in target.is_dot.tolist()]
    diameters = (2 * target.radius_outer_mm).tolist()
    rows: list[tuple[object, ...]] = [
        (number, name, *map(repr, place), face, kind, repr(diameter))
        for number, (name, place, face, kind, diameter) in enumerate(
            zip(target.point_names, target.center_mm.tolist(), target.ring_face.tolist(), kinds, diameters, strict=True)
        )
    ]
    return _rows(("id", "name", "X", "Y", "Z", "plane", "kind", "diameter_mm"), rows)


def _labels(target: "TargetGeometry") -> str:
    """Label and place in metres, as programs of photogrammetry import control points."""
    places = (M_PER_MM * target.center_mm).round(12).tolist()
    return _rows(
        ("label", "x", "y", "z"),
        [(name, *map(repr, place)) for name, place in zip(target.point_names, places, strict=True)], "#",
    )  # fmt: skip


def _colmap(target: "TargetGeometry") -> str:
    """Points of `points3D.txt`, black for ink, of which no photo is known; ids count from 1."""
    lines = [
        "# 3D point list with one line of data per point:",
        "#   POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)",
        f"# millimetres; POINT3D_ID - 1 is the row of target {target.geometry_id}",
    ]
    lines += [f"{row + 1} {x!r} {y!r} {z!r} 0 0 0 0" for row, (x, y, z) in enumerate(target.center_mm.tolist())]
    return "\n".join(lines) + "\n"


def _opencv(target: "TargetGeometry") -> str:
    """FileStorage: `object_points`, N x 3 in mm, a row an id."""
    values = ", ".join(f"{value!r}" for value in target.center_mm.ravel().tolist())
    names = "".join(f'   - "{name}"\n' for name in target.point_names)
    return (
        f'%YAML:1.0\n---\ngeometry_id: "{target.geometry_id}"\nobject_points: !!opencv-matrix\n'
        f"   rows: {target.ring_count}\n   cols: 3\n   dt: d\n   data: [ {values} ]\nnames:\n{names}"
    )


def _kalibr(target: "TargetGeometry") -> str:
    """A grid of circles, or another maker's board that Kalibr finds, in metres.

    Raises:
        InputError: it is none: it has several faces, or its lattice is not square and full.
    """
    import numpy as np

    if target.marks is not None:
        fields = target.marks[0].kalibr_fields if target.is_planar else {}
        if not fields:
            raise InputError(f"--to kalibr: finds none like {target.words}; use --to csv")
        return "".join(f"{name}: {value}\n" for name, value in fields.items())
    lattice = None if target.lattice_mm is None else target.lattice_mm[0]
    index = target.ring_index - target.ring_index.min(axis=0)
    columns, rows = (index.max(axis=0) + 1).tolist()
    is_square = lattice is not None and (
        abs(float(lattice[0] @ lattice[1])) < SQUARE * float(lattice[0] @ lattice[0])
        and abs(float(np.linalg.norm(lattice[0]) / np.linalg.norm(lattice[1])) - 1) < SQUARE
    )
    if not (target.is_planar and is_square and columns * rows == target.ring_count and lattice is not None):
        raise InputError("--to kalibr: holds one full square grid of circles, and this target is none; use --to csv")
    spacing_m = M_PER_MM * float(np.linalg.norm(lattice[0]))
    return (
        f"target_type: 'circlegrid'\ntargetCols: {columns}\ntargetRows: {rows}\nspacingMeters: {spacing_m:.9g}\n"
        "asymmetricGrid: False\n"
    )


POINT_FORMATS: Mapping[str, PointFormat] = {
    "csv": PointFormat(
        "a table of all points: id,name,X,Y,Z,plane,kind,diameter_mm in mm", ".points.csv", _table,
        "calib target --from reads it back",
    ),
    "metashape": PointFormat(
        "Metashape and RealityCapture: label,x,y,z in m", ".markers.csv", _labels,
        "import it as reference of markers, or as ground control points",
    ),
    "colmap": PointFormat("COLMAP: points3D.txt, in mm", ".points3D.txt", _colmap, "a text model's points"),
    "opencv": PointFormat(
        "OpenCV: object_points in mm (cv2.FileStorage)", ".points.yml", _opencv,
        "row k belongs to ring k of detections.csv",
    ),
    "kalibr": PointFormat(
        "Kalibr: a grid of circles, of boards; or an AprilGrid, a chessboard", ".kalibr.yaml", _kalibr,
        "give it by --target; rings and dots have the outer edge for its detector of circles: try a photo first",
    ),
}  # fmt: skip
"""By what `--to` calls them."""
