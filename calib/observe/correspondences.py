"""Correspondences from elsewhere, and what kind of file they are in.

A CSV holds image,u,v,X,Y,Z in any order, and may hold a face (a plane that points lie in), and sigma, suu,suv,svv or a
weight, which is 1/sigma in units that nobody knows, as of mrcal's corners. A diameter_mm says that the centre of a
circle's image was measured, 0 that the point itself was; dots of a target file say that too.
Points are told apart by X, Y, Z. With a target file its points are meant: those with the ids of a column id, or those
that are nearest to X, Y, Z. The image size stands in a comment, `# image_size 2448 x 2048`, or is given.
"""

import re
import stat
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calib.core.csv_table import COVARIANCE, CsvTable, column_fault, read_table, read_text
from calib.core.types import KnownPoints, Observations
from calib.observe.dataset import FIRST_LINE, MAX_SIDE_PX, read_detections
from calib.observe.observations import known_points, knows_fronts, observations_from_detections, prepare
from calib.observe.point_target import MAX_FACE, ids_of, points_with_planes
from designer.base.arrays import Array, Flags, Rows
from designer.base.errors import InputError
from designer.base.words import shown
from designer.target import TargetGeometry, load_target

if TYPE_CHECKING:
    from calib.observe.corners_vnl import PointGrid

Size = tuple[int, int]

SEEN, ID = ("image", "u", "v"), "id"
DIAMETER = "diameter_mm"
OPTIONAL = ("face", DIAMETER, "sigma", "weight", *COVARIANCE)
POINTS, CIRCLE = ("corner", "ring", "circle"), "circle"
"""What a point is: a corner of squares, a ring whose centre's image was measured, a circle whose image's centre was."""
MAX_FILE_BYTES = 128 * 2**20
"""As text in memory a table takes about ten times as much."""
MAX_LENGTH_MM = 1e7
OUTSIDE = 0.1
"""Share of a side that a point may lie outside the image; beyond, the size is not that of the photos."""
SAME_POINT = 0.25
"""A point that is farther off, of the distance between the target's points, may be another one."""
MAX_WEIGHT = 1e4

_SIZE = re.compile(r"#\s*image_size\s*[:=]?\s*(\d{1,7})\s*[x×, ]\s*(\d{1,7})\s*(?:px)?\s*", re.IGNORECASE)
_OURS = FIRST_LINE.split(",")[0]
_PEEKED = 1 << 16


def read_observations(
    path: Path,
    target: TargetGeometry | Path | None = None,
    *,
    image_size: Size | None = None,
    grid: "PointGrid | None" = None,
    points: str | None = None,
    diameter_mm: float | None = None,
) -> Observations:
    """What a camera is solved from, of a file of any of the three kinds; its first lines tell which.

    It takes what `calib.load_observations` does, of a detections.csv, a CSV with image,u,v,X,Y,Z, or a corners.vnl.

    Raises:
        InputError: the file is not to be read, something else is needed or does not belong, or nothing is left.
    """
    from calib.observe.corners_vnl import is_corners, observations_from_corners

    start = _start_of(path)
    require_kind(points, diameter_mm)
    if is_detections(path):
        if points is not None:
            raise InputError(f"{path}: detections are the images of rings' centres; leave --points out")
        if target is None:
            raise InputError(f"{path}: detections need the target they show; give --target NAME.target.json")
        if image_size is not None or grid is not None:
            raise InputError(f"{path}: detections hold image sizes and points; leave --image-size and --grid out")
        geometry, name = (load_target(target), target) if isinstance(target, Path) else (target, Path("the target"))
        return observations_from_detections(
            read_detections(path, geometry, target_path=name), geometry, origin=str(path)
        )
    if is_corners(path, start):
        if points not in (None, "corner"):
            raise InputError(f"{path}: holds corners; leave --points {points} out")
        if target is not None:
            raise InputError(f"{path}: corners lie on their own grid; leave --target out")
        text = read_text(path, "a corners.vnl", MAX_FILE_BYTES)
        every = observations_from_corners(path, text, grid=grid, image_size=image_size)
        require_inside(every, str(path))
        return prepare(every, has_fronts=False, origin=str(path))
    if grid is not None:
        raise InputError(f"{path}: no corners.vnl, so its points have coordinates; leave --grid out")
    of_points = load_target(target) if isinstance(target, Path) else target
    return read_correspondences(path, image_size=image_size, target=of_points, points=points, diameter_mm=diameter_mm)


def require_kind(points: str | None, diameter_mm: float | None) -> None:
    """Refuse what no point is; InputError: no such kind, or a diameter of what is none."""
    if points not in (None, *POINTS):
        raise InputError(f"--points {shown(str(points))}: give corner, ring, or circle:13mm, circles of that diameter")
    if diameter_mm is not None and (points != CIRCLE or not 0 < diameter_mm <= MAX_LENGTH_MM):
        raise InputError(f"diameter {diameter_mm:g} mm: is of circles, and more than 0; give --points circle:13mm")


def read_correspondences(
    path: Path,
    *,
    image_size: Size | None = None,
    target: TargetGeometry | None = None,
    points: str | None = None,
    diameter_mm: float | None = None,
) -> Observations:
    """Read a CSV with image,u,v,X,Y,Z, or of a target's points image,u,v,id.

    Raises:
        InputError: it cannot be read, a line breaks a rule, or nothing is left to solve from.
    """
    text = read_text(path, "a table of correspondences", MAX_FILE_BYTES)
    of_target, stated = target is not None, set[Size]()

    def comment(number: int, line: str) -> None:
        if match := _SIZE.fullmatch(line):
            given = int(match[1]), int(match[2])
            stated.add(given)
            if not all(1 <= side <= MAX_SIDE_PX for side in given) or len(stated) > 1:
                rule = f"there is one, each side has 1 to {MAX_SIDE_PX} px"
                raise InputError(f"{path}: line {number}: image_size {given[0]} x {given[1]}: {rule}")

    table = read_table(
        path, text, lambda names: points_fault(names, SEEN, DIAMETER, of_target=of_target), comment=comment,
        holds="correspondences; a line is such as a.png,812.3,455.1,20,40,0",
    )  # fmt: skip
    size = next(iter(stated), image_size)
    if size is not None and image_size not in (None, size):
        raise InputError(
            f"{path}: the file says {size[0]} x {size[1]} px, --image-size {image_size[0]} x {image_size[1]}; "
            "leave one out"
        )
    if size is None:
        raise InputError(
            f"{path}: the image size is not known; add a line '# image_size 2448 x 2048' at the top, or give "
            "--image-size 2448x2048"
        )
    every = rows_of_table(table, size, target, points, diameter_mm)
    require_inside(every, str(path))
    used = (*SEEN, *"XYZ", *OPTIONAL, *([ID] if of_target else []))
    every = replace(every, remarks=(*every.remarks, *table.unused(used)))
    return prepare(every, has_fronts=knows_fronts(target), origin=str(path))


def is_detections(path: Path) -> bool:
    """Whether a file opens as detections.csv does."""
    return _start_of(path).startswith(_OURS)


def _start_of(path: Path) -> str:
    """The first lines of a file, whatever it holds."""
    try:
        # Asked before it is opened: a pipe would wait, a device would never end.
        if stat.S_ISREG(path.stat().st_mode):
            with path.open("rb") as stream:
                return stream.read(_PEEKED).decode("utf-8", "replace").removeprefix("\ufeff")
    except (OSError, ValueError):
        pass  # said when it is read
    return ""


def points_fault(columns: tuple[str, ...], seen: Sequence[str], more: str, *, of_target: bool) -> str:
    """What is wrong with the names of the columns, of what was seen and of the points; "" if nothing.

    Args:
        columns: that there are.
        seen: that there must be, of what was seen.
        more: that there may be, beside those of points and accuracies.
        of_target: points may be named by ids.
    """
    required = (*seen, ID) if of_target and ID in columns else (*seen, *"XYZ")
    may = f"{more}, face, sigma, weight or {','.join(COVARIANCE)}"
    if fault := column_fault(columns, required, f"the columns must be {','.join(required)}, and may be {may}"):
        return fault
    some = [name for name in COVARIANCE if name in columns]
    if len(some) % len(COVARIANCE) or bool(some) + ("sigma" in columns) + ("weight" in columns) > 1:
        return "the accuracy is sigma, weight, or suu,suv,svv: one of them, and not a part"
    return ""


def rows_of_table(
    table: CsvTable,
    size: Size,
    target: TargetGeometry | None,
    kind: str | None = None,
    diameter_mm: float | None = None,
) -> Observations:
    """The table's rows in order, with remarks on its points."""
    center = table.columns("uv")
    table.require(np.abs(center).max(axis=1, initial=0) <= MAX_SIDE_PX, f"u or v is beyond {MAX_SIDE_PX} px")
    table.require_filled("image")
    covariance = _covariance(table)
    names = list(dict.fromkeys(table.cells["image"]))
    view_of = {name: number for number, name in enumerate(names)}
    view = np.array([view_of[name] for name in table.cells["image"]], dtype=np.int64)
    point, points, remarks = (
        _own_points(table) if target is None else (_points_of(table, target), known_points(target), ())
    )
    points = replace(points, circle_mm=_circles(table, point, points, target, kind, diameter_mm))
    order = table.sorted_once(view, point, "the same point of the same image a second time; keep one")
    return Observations(
        size, tuple(names), view[order], point[order], center[order],
        None if covariance is None else covariance[order], points, remarks,
    )  # fmt: skip


def _positions(table: CsvTable) -> Array:
    """X, Y, Z of the rows.  # (M, 3)"""
    position = table.columns("XYZ")
    table.require(np.abs(position).max(axis=1, initial=0) <= MAX_LENGTH_MM, f"X, Y or Z is beyond {MAX_LENGTH_MM:g} mm")
    return position


def _own_points(table: CsvTable) -> tuple[Rows, KnownPoints, tuple[str, ...]]:
    """The point of each row (M,), the points of a table that shows no target, and remarks on them."""
    unique, first, point = np.unique(_positions(table), axis=0, return_index=True, return_inverse=True)
    point = point.reshape(-1)
    face = None
    if "face" in table.cells:
        each = table.whole_numbers("face")
        table.require((each >= -1) & (each <= MAX_FACE), f"face must be from 0 to {MAX_FACE}, or -1 for none")
        face = each[first]
        table.require(each == face[point], "the point has another face on an earlier line; a point lies on one face")
    return point, *points_with_planes(unique, face)


def _points_of(table: CsvTable, target: TargetGeometry) -> Rows:
    """The row of the target's point that each row shows.  # (M,)"""
    from scipy.spatial import cKDTree

    if ID in table.cells:
        ids, known = table.whole_numbers(ID), ids_of(target)
        order = np.argsort(known)
        place = order[np.minimum(np.searchsorted(known, ids, sorter=order), len(known) - 1)]
        table.require(known[place] == ids, "the target has no point with this id")
        return np.asarray(place, dtype=np.int64)
    tree = cKDTree(target.center_mm)
    off, nearest = tree.query(_positions(table))
    alone = tree.query(target.center_mm, k=2)[0][:, 1]
    table.require(
        off < SAME_POINT * alone[nearest],
        f"X, Y, Z are no point of the target: the nearest is farther than {SAME_POINT:g} of the way to its neighbour; "
        "check the target, or name the points in a column id",
    )
    return np.asarray(nearest, dtype=np.int64)


def _circles(
    table: CsvTable, point: Rows, points: KnownPoints, target: TargetGeometry | None,
    kind: str | None, diameter_mm: float | None,
) -> Array:  # fmt: skip
    """The diameters (K,) of the circles whose images' centres were measured: 0 of points, nan where nobody says it.

    Raises:
        InputError: it is said twice, or circles have no diameter, or one that makes them overlap.
    """
    circle_mm = np.full(len(points.face), np.nan)
    if DIAMETER in table.cells:
        each = table.reals(DIAMETER)
        if kind is not None and (kind != CIRCLE or diameter_mm is not None):
            raise InputError(f"{table.path}: its column {DIAMETER} says what the points are; leave --points out")
        table.require((each >= 0) & (each <= MAX_LENGTH_MM), f"{DIAMETER} must be 0 (no circle) to {MAX_LENGTH_MM:g}")
        circle_mm[point] = each
        table.require(each == circle_mm[point], f"the point has another {DIAMETER} on another line")
    elif kind is not None and kind != CIRCLE:
        circle_mm[:] = 0.0
    elif diameter_mm is not None:
        circle_mm[:] = diameter_mm
    elif target is not None and target.has_marks and (target.is_dot.all() or kind == CIRCLE):
        circle_mm = 2 * target.radius_outer_mm
    elif kind == CIRCLE:
        raise InputError(
            f"{table.path}: the circles' diameter is not known; give --points circle:13mm, or a column {DIAMETER}"
        )
    seen = np.flatnonzero(np.bincount(point, minlength=len(circle_mm)))
    largest = float(np.nanmax(circle_mm[seen], initial=0.0))
    if largest > 0 and len(seen) > 1:
        from scipy.spatial import cKDTree

        apart = float(np.median(cKDTree(points.position_mm[seen]).query(points.position_mm[seen], k=2)[0][:, 1]))
        if largest > apart:
            raise InputError(
                f"{table.path}: circles of {largest:g} mm overlap if {apart:g} mm apart, as the points are; check it"
            )
    return circle_mm


def _covariance(table: CsvTable) -> Array | None:
    """The covariances of the rows, if the table has any.  # (M, 2, 2)"""
    if "sigma" in table.cells:
        return table.variances("sigma")
    if "weight" in table.cells:
        weight = table.reals("weight")
        table.require(
            (weight >= 1 / MAX_WEIGHT) & (weight <= MAX_WEIGHT),
            f"weight must be from {1 / MAX_WEIGHT:g} to {MAX_WEIGHT:g}; leave out lines that are not to count",
        )
        return np.asarray(weight[:, None, None] ** -2.0 * np.eye(2))
    return table.covariances() if COVARIANCE[0] in table.cells else None


def is_far_outside(center_px: Array, size: Rows) -> Flags:
    """Which pixels lie far outside an image: its size is then another one.  # (M, 2), (2,) or (M, 2) -> (M,)"""
    outside = np.maximum(-0.5 - center_px, center_px - size + 0.5) > OUTSIDE * size
    return np.asarray(outside.any(axis=1))


def require_inside(every: Observations, origin: str) -> None:
    """Refuse points far outside the image."""
    size = np.array(every.image_size)
    outside = is_far_outside(every.center_px, size)
    if outside.any():
        row = int(np.argmax(outside))
        u, v = every.center_px[row]
        beyond = (np.maximum(-0.5 - every.center_px, every.center_px - size[::-1] + 0.5) > 0).any(axis=1)
        on_side = f"{size[1]} x {size[0]} px"
        turned = (
            f"; all fit {on_side}: are u and v exchanged, or width and height?"
            if not beyond.any()
            else f"; this photo fits {on_side}: was it turned on its side?"
            if not beyond[every.view == every.view[row]].any()
            else ""
        )
        raise InputError(
            f"{origin}: {every.view_names[every.view[row]]}: a point at u {u:g}, v {v:g} is far outside an image "
            f"of {size[0]} x {size[1]} px; check the image size{turned}"
        )
