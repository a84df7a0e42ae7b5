"""A target that others made, from a table of its points: a cube, or a room with sheets on its walls.

The table is a CSV with X, Y, Z in mm, and may hold the plane that each point lies in and an id, a whole number by which
tables of observations name it. The planes are fitted, or stand in a table of their own: plane,nx,ny,nz,d with the
normal n on the side that is seen, and n X = d.

Kalibr's target files: `target_type` aprilgrid, checkerboard or circlegrid, lengths in metres (its ConfigReader).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.cameras.formats.parsing import mapping, number, parse_yaml, required
from calib.core.csv_table import CsvTable, column_fault, read_table, read_text
from calib.core.types import KnownPoints
from designer.base.arrays import Array, Rows
from designer.base.errors import InputError
from designer.base.files import read_small_text
from designer.base.words import first_few, shown, suggestion_or_all
from designer.marks.aprilgrid import AprilGrid
from designer.marks.chessboard import Chessboard
from designer.marks.circles import Circles
from designer.marks.face_marks import FaceMarks
from designer.target import MAX_INDEX, TargetGeometry

MAX_FILE_BYTES = 64 * 2**20
MAX_POINTS, MAX_PLANES = 100_000, 200
MAX_PLACES = 400_000
"""Points times planes: what errors of every plane do to every point takes about 500 bytes for each, 200 MB in all."""
MAX_LENGTH_MM = 1e6
SAME_MM = 1e-3
"""Two points that are nearer are one."""
OFF_PLANE = 0.01
"""Of a plane's extent: a point that is farther off does not lie in it."""
THIN = 1e-3
"""Points this much thinner than long lie on a line, and tell no plane."""
FLAT, UNEVEN = 1e-6, 1e-3
"""Points lie in one plane if none is farther off than this share of their extent; a face is worth a remark beyond."""
THINNEST = 1e-6
"""As `THIN`, of points whose plane only tells the sides they are seen from."""
MAX_FACE = 9999
WHICH = "which plane it is said to lie in"
SEVERAL = "whether all lie in one plane; else name each point's in a column plane"
_POINT_COLUMNS, _PLANE_COLUMNS = ("X", "Y", "Z"), ("plane", "nx", "ny", "nz", "d")


@dataclass(frozen=True, eq=False)
class PointTable:
    """R points as a table has them."""

    position_mm: Array  # (R, 3)
    plane: tuple[str, ...]  # (R,) its name; "" for all where there is no such column
    ids: Rows  # (R,) without such a column: the row
    unused: tuple[str, ...] = ()  # columns of the table that say nothing to a target

    @property
    def names(self) -> tuple[str, ...]:
        """Of the planes, in the order in which they come."""
        return tuple(dict.fromkeys(self.plane))


@dataclass(frozen=True, eq=False)
class Plane:
    """n X = d, with the unit normal n on the side that is seen."""

    normal: Array  # (3,)
    offset_mm: float

    @property
    def row(self) -> Array:
        """Normal and offset.  # (4,)"""
        return np.append(self.normal, self.offset_mm)

    def off_mm(self, position_mm: Array) -> float:
        """The largest distance of points (N, 3) from it."""
        return float(np.abs(position_mm @ self.normal - self.offset_mm).max())


def _least_squares_plane(position: Array, thin: float) -> Plane | None:
    """The plane with the least squares of distances; its normal's largest component is positive.

    None: the points lie on a line, to a share of their length, and tell no plane.
    """
    if len(position) < 3:
        return None
    middle = position.mean(axis=0)
    _, singular, axes = np.linalg.svd(position - middle, full_matrices=False)
    if not singular[1] > thin * singular[0]:
        return None
    normal = axes[2] * np.sign(axes[2][np.argmax(np.abs(axes[2]))])
    return Plane(normal, float(normal @ middle))


def target_from_points(
    points: PointTable, planes: dict[str, Plane] | None = None, *, diameter_mm: float = 0.0, inside: bool = False
) -> TargetGeometry:
    """A target of points on planes; of one plane, of which no name is needed, too.

    A face's outline is the rectangle around its points, half their usual distance beyond them. A feature's lattice
    index is its id and 0.

    Args:
        points: which, and on which planes.
        planes: by the points' names of them; None: fitted, the side that is seen away from the middle of all points.
        diameter_mm: of the black dots at the points; 0: there is nothing to draw or to detect.
        inside: of fitted planes the other side is seen, as of a room's walls.

    Raises:
        InputError: a plane that its points do not tell, or that they do not lie in.
    """
    names = points.names
    number = {name: face for face, name in enumerate(names)}
    face = np.array([number[name] for name in points.plane], dtype=np.int64)
    middle = points.position_mm.mean(axis=0)
    frames, outlines, steps = [], [], []
    for name, index in number.items():
        position = points.position_mm[face == index]
        called = f"plane {shown(name)}" if name else "the points' plane"
        if len(position) < 3:
            raise InputError(f"{called}: {len(position)} points; a plane has 3 or more that lie on no line")
        if planes is not None and name not in planes:
            some = ", ".join(map(shown, list(planes)[:10]))
            raise InputError(f"{called}: not in the table of planes, which has {some}; add it there")
        plane = _fitted(position, called, middle, inside=inside) if planes is None else planes[name]
        off_mm = np.abs(position @ plane.normal - plane.offset_mm)
        most_mm, worst = OFF_PLANE * float(np.linalg.norm(np.ptp(position, axis=0))), int(np.argmax(off_mm))
        if off_mm[worst] > most_mm:
            raise InputError(
                f"{called}: point {points.ids[face == index][worst]} is {off_mm[worst]:.3g} mm off it, {most_mm:.3g} "
                f"mm are allowed (1 % of its extent); check the point, and {SEVERAL if not name else WHICH}"
            )
        frame, outline, step = _face(plane, position, diameter_mm)
        frames.append(frame)
        outlines.append(outline)
        steps.append(step * np.eye(2))
    count = len(face)
    return TargetGeometry(
        source="nominal",
        spec=None,
        ring_face=face,
        ring_index=np.column_stack([points.ids, np.zeros(count, dtype=np.int64)]),
        center_mm=points.position_mm,
        radius_outer_mm=np.full(count, 0.5 * diameter_mm),
        radius_inner_mm=np.zeros(count),
        is_dot=np.ones(count, dtype=bool),
        target_from_face=np.array(frames),
        outline_mm=np.array(outlines),
        window_mm=np.array(outlines),
        face_code=np.full(len(names), -1),
        lattice_mm=np.array(steps),
    )


def ids_of(target: TargetGeometry) -> Rows:
    """By what tables of observations name a target's features: a point's id, a designed feature's row.  # (R,)"""
    ids = target.ring_index[:, 0]
    is_points = target.spec is None and not target.ring_index[:, 1].any() and len(np.unique(ids)) == len(ids)
    return ids if is_points else np.arange(target.ring_count)


def read_points(path: Path) -> PointTable:
    """Read a table of points; InputError: it cannot be read, or a line breaks a rule; the message names it."""
    from scipy.spatial import cKDTree

    table = _table(path, _POINT_COLUMNS, "a table of points", MAX_POINTS)
    position = table.columns(_POINT_COLUMNS)
    table.require(np.abs(position).max(axis=1) <= MAX_LENGTH_MM, f"X, Y or Z is beyond {MAX_LENGTH_MM:g} mm")
    distance, near = cKDTree(position).query(position, k=2) if len(position) > 1 else (np.ones((1, 2)), [[0, 0]])
    nearest = int(np.argmin(distance[:, 1]))
    if distance[nearest, 1] < SAME_MM:
        first, again = sorted(table.lines[row] for row in near[nearest])
        raise InputError(f"{path}: line {again}: the same point as on line {first}, to {SAME_MM:g} mm; keep one")
    if "id" in table.cells:
        ids = table.whole_numbers("id")
        table.require((ids >= 0) & (ids <= MAX_INDEX), f"id must be from 0 to {MAX_INDEX}")
        first_row = np.zeros(len(ids), dtype=bool)
        first_row[np.unique(ids, return_index=True)[1]] = True
        table.require(first_row, "the id is that of an earlier line; give each point its own")
    else:
        ids = np.arange(len(position))
    plane = tuple(name.strip() for name in table.cells.get("plane", ("",) * len(position)))
    if "plane" in table.cells:
        table.require_filled("plane")
    unused = tuple(name for name in table.cells if name not in (*_POINT_COLUMNS, "plane", "id"))
    found = PointTable(position, plane, ids, unused)
    if len(found.names) > MAX_PLANES:
        raise InputError(f"{path}: {len(found.names)} planes; at most {MAX_PLANES} can be used; leave some out")
    if len(position) * len(found.names) > MAX_PLACES:
        most = MAX_PLACES // len(found.names)
        raise InputError(
            f"{path}: {len(position)} points on {len(found.names)} planes; on so many planes at most {most} points can "
            "be used; leave out points or planes"
        )
    return found


def read_planes(path: Path) -> dict[str, Plane]:
    """Read a table of planes; InputError: it cannot be read, or a line breaks a rule; the message names it."""
    table = _table(path, _PLANE_COLUMNS, "a table of planes", MAX_PLANES)
    names = [name.strip() for name in table.cells["plane"]]
    table.require(np.array([names.index(name) == row for row, name in enumerate(names)]), "the plane a second time")
    normal, offset = table.columns(("nx", "ny", "nz")), table.reals("d")
    with np.errstate(over="ignore"):
        length = np.linalg.norm(normal, axis=1)
    table.require((length > 1e-6) & (length < 1e6), "nx, ny, nz must be a direction, its length best 1")
    return {
        name: Plane(n / size, float(d / size)) for name, n, d, size in zip(names, normal, offset, length, strict=True)
    }


def _table(path: Path, columns: Sequence[str], kind: str, most: int) -> CsvTable:
    """The rows of a file."""
    wanted = f"{kind} has the columns {','.join(columns)}"
    table = read_table(path, read_text(path, kind, MAX_FILE_BYTES), lambda names: column_fault(names, columns, wanted))
    if not 1 <= len(table.lines) <= most:
        raise InputError(f"{path}: {len(table.lines)} rows; {kind} has 1 to {most}")
    return table


def _fitted(position: Array, called: str, middle: Array, *, inside: bool) -> Plane:
    """The plane of least squares, its normal away from the middle of all points, or towards it."""
    plane = _least_squares_plane(position, THIN)
    if plane is None:
        raise InputError(f"{called}: its {len(position)} points lie on a line; add some beside it")
    outwards = plane.offset_mm - float(plane.normal @ middle)
    extent = float(np.linalg.svd(position - position.mean(axis=0), compute_uv=False)[0])
    if abs(outwards) <= THIN * extent or (outwards > 0) != inside:
        return plane  # also if all points lie in one plane
    return Plane(-plane.normal, -plane.offset_mm)


def _face(plane: Plane, position: Array, diameter_mm: float) -> tuple[Array, Array, float]:
    """The frame (4, 4) of a face, its outline (4, 2) in it, and the usual distance of its points."""
    from scipy.spatial import cKDTree

    axis = np.eye(3)[int(np.argmin(np.abs(plane.normal)))]
    y_axis = np.cross(plane.normal, axis)
    y_axis /= np.linalg.norm(y_axis)
    turn = np.column_stack([np.cross(y_axis, plane.normal), y_axis, plane.normal])
    inside = position @ turn
    low, high = inside[:, :2].min(axis=0), inside[:, :2].max(axis=0)
    step = float(np.median(cKDTree(inside).query(inside, k=2)[0][:, 1]))
    half = 0.5 * (high - low) + max(0.5 * step, 0.75 * diameter_mm)
    frame = np.eye(4)
    frame[:3, :3] = turn
    frame[:3, 3] = turn @ np.append(0.5 * (low + high), plane.offset_mm)
    outline = half * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    return frame, outline, step


def points_with_planes(position_mm: Array, face: Rows | None) -> tuple[KnownPoints, tuple[str, ...]]:
    """The points with the one plane that they all lie in, else with the planes of their faces.

    Args:
        position_mm: the points (K, 3).
        face: the number of the face that each lies in (K,), -1 for none; None: not known.

    Returns:
        The points, and remarks: their extent, and faces that are no planes.
    """
    extent = np.ptp(position_mm, axis=0)
    said = [f"X, Y, Z are taken as mm: the points span {' x '.join(f'{side:.6g}' for side in extent)} mm"]
    whole = _least_squares_plane(position_mm, THINNEST)
    if whole is not None and whole.off_mm(position_mm) <= FLAT * float(np.linalg.norm(extent)):
        # Either side of a plane may be seen: the mirror image gives as good a camera, its centre at height - 1 - cy.
        said[0] += "; v is taken as counted downwards, which points in one plane do not tell"
        return KnownPoints(position_mm, np.zeros(len(position_mm), dtype=np.int64), whole.row[None]), tuple(said)
    if face is None:
        return KnownPoints(position_mm, np.full(len(position_mm), -1), np.zeros((0, 4))), tuple(said)
    count = int(face.max(initial=-1)) + 1
    known = np.full(len(position_mm), -1)
    planes = np.tile([0.0, 0.0, 1.0, 0.0], (count, 1))  # stays so for numbers that no plane has
    uneven: list[str] = []
    order = np.argsort(face, kind="stable")
    for row, rows in enumerate(np.split(order, np.searchsorted(face[order], np.arange(count + 1)))[1:-1]):
        plane = _least_squares_plane(position_mm[rows], THINNEST)
        if plane is None:
            continue
        planes[row], known[rows] = plane.row, row
        if (off_mm := plane.off_mm(position_mm[rows])) > UNEVEN * float(
            np.linalg.norm(np.ptp(position_mm[rows], axis=0))
        ):
            uneven.append(f"{row} by {off_mm:.3g} mm")
    if uneven:
        said.append(f"faces whose points are off their mean plane: {first_few(uneven)}")
    return KnownPoints(position_mm, known, planes), tuple(said)


MAX_YAML_BYTES = 2**20
FIELDS: Mapping[str, tuple[str, ...]] = {
    "aprilgrid": ("tagCols", "tagRows", "tagSize", "tagSpacing"),
    "checkerboard": ("targetCols", "targetRows", "rowSpacingMeters", "colSpacingMeters"),
    "circlegrid": ("targetCols", "targetRows", "spacingMeters"),
}
"""What each type has."""


def read_kalibr_target(path: Path, diameter_mm: float | None) -> tuple[FaceMarks, tuple[str, ...]]:
    """The marks of a file, and remarks on what it does not say.

    Args:
        path: the YAML file.
        diameter_mm: of circles, which Kalibr does not ask for.

    Raises:
        InputError: it cannot be read, or breaks a rule; the message names it.
    """
    origin = str(path)
    tree = mapping(
        parse_yaml(read_small_text(path, MAX_YAML_BYTES, "Kalibr's target file"), origin), "the file", origin
    )
    kind = required(tree, ("target_type",), origin)
    if not isinstance(kind, str) or kind not in FIELDS:
        raise InputError(f"{origin}: target_type {shown(kind)} is unknown{suggestion_or_all(kind, FIELDS)}")
    values = [number(required(tree, (name,), origin), name, origin) for name in FIELDS[kind]]
    for name, value in zip(FIELDS[kind][:2], values[:2], strict=True):
        if value != int(value):
            raise InputError(f"{origin}: {name} {value:g}: must be a whole number")
    if (diameter_mm is None) != (kind != "circlegrid"):
        raise InputError(
            f"{origin}: does not say how large the circles are; give --diameter" if kind == "circlegrid"
            else f"--diameter: of circles; {origin} is of an {kind}; leave it out"
        )  # fmt: skip
    unused = [shown(one) for one in tree if one not in ("target_type", "asymmetricGrid", *FIELDS[kind])]
    said = (f"{origin}: not used: {', '.join(unused)}",) if unused else ()
    counts, lengths = (int(values[0]), int(values[1])), [1000 * value for value in values[2:]]
    try:
        if kind == "aprilgrid":
            return AprilGrid(counts, lengths[0], values[3]), said
        if kind == "circlegrid":
            step = 2 if str(tree.get("asymmetricGrid")).lower() in ("true", "1") else 1
            return Circles(counts, step * lengths[0], diameter_mm or 0.0, asymmetric=step == 2), said
        if not math.isclose(*lengths, rel_tol=1e-9):
            raise ValueError(f"rectangles of {lengths[1]:g} x {lengths[0]:g} mm: must be squares")
        squares = (counts[0] + 1, counts[1] + 1)
        corners = "Kalibr's rows and columns are inner corners; the upper left square is taken for dark"
        return Chessboard(squares, lengths[0]), (corners, *said)
    except ValueError as error:
        raise InputError(f"{origin}: {error}") from None
