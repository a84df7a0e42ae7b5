"""The target as the tracing kernels read it: faces as half-planes, rings found through a raster of each face."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.core.jit import jit
from calib.renderer.polygons import Patches, patches_of
from calib.renderer.trace import FaceArrays
from designer.base.arrays import Array, Rows
from designer.base.errors import InputError
from designer.marks.face_marks import FaceMarks
from designer.target import TargetGeometry

CELLS_PER_RADIUS, CELLS_PER_GAP = 4, 3
MAX_CELLS = 1_000_000  # a face
NEIGHBOURHOOD = 2.5
"""Half width, in outer radii, of the square in which a ring looks for cells."""


@dataclass(frozen=True, eq=False)
class Face:
    """One face in its own frame."""

    number: int
    target_from_face: Array  # (4, 4)
    corner_mm: Array  # (K, 2) counter-clockwise
    arrays: FaceArrays  # of its printed side, black and white as 0 and 1
    polygons_mm: tuple[Array, ...]  # (K, 3) what else is black
    patches: Patches | None  # the same, if it is flat
    is_light: bool  # its circles are white on black


@dataclass(frozen=True, eq=False)
class RenderScene:
    """The faces and rings of a target."""

    faces: tuple[Face, ...]
    is_convex: bool  # a face seen from behind is then hidden by others
    ring: Array  # (R, 5) x, y, z of the centre in the face frame, outer and inner radius; all in mm
    ring_face: Rows  # (R,)
    reach_mm: Array  # (R,) outer radius; of a corner, how far its edges reach
    center_mm: Array  # (R, 3) in the target frame
    normal: Array  # (R, 3) outward, in the target frame


def scene_from_target(target: TargetGeometry) -> RenderScene:
    """Flatten a target for the kernels."""
    ring = np.column_stack([target.center_in_face_mm, target.radius_outer_mm, target.radius_inner_mm])
    faces = tuple(_face(target, number, ring) for number in range(target.face_count))
    return RenderScene(
        faces=faces,
        is_convex=_is_convex(target),
        ring=ring,
        ring_face=target.ring_face,
        reach_mm=target.reach_mm,
        center_mm=target.center_mm,
        normal=target.target_from_face[target.ring_face, :3, 2],
    )


def _face(target: TargetGeometry, number: int, ring: Array) -> Face:
    corners = target.outline_mm[number]
    rows = np.flatnonzero((target.ring_face == number) & (ring[:, 3] > 0))
    marks = None if target.marks is None else target.marks[number]
    polygons = () if marks is None else _polygons_mm(marks, target.center_in_face_mm[target.ring_face == number])
    lower, upper = corners.min(axis=0), corners.max(axis=0)
    size = upper - lower
    gap = _gap_mm(target.lattice_mm[number], ring[rows])
    finest = min(gap / CELLS_PER_GAP, _least_radius_mm(ring[rows]) / CELLS_PER_RADIUS, float(size.max()))
    cell = max(float(np.sqrt(np.prod(size) / MAX_CELLS)), finest)
    raster = np.full((int(size[1] / cell) + 1, int(size[0] / cell) + 1), -1, dtype=np.int32)
    _paint_nearest(ring, rows, lower, cell, raster)
    return Face(
        number=number,
        target_from_face=target.target_from_face[number],
        corner_mm=corners,
        polygons_mm=polygons,
        patches=None if any(polygon[:, 2].any() for polygon in polygons) else patches_of([p[:, :2] for p in polygons]),
        is_light=marks is not None and marks.is_light,
        arrays=FaceArrays(
            outline=_half_planes(corners),
            window=_half_planes(target.window_mm[number]),
            has_border=not np.array_equal(target.window_mm[number], corners),
            is_plain=False,
            ring=ring,
            raster=raster,
            raster_origin=lower,
            cell_mm=cell,
            # The raster knows the nearest ring at its cells' centres: elsewhere it may be off by a diagonal.
            lone_mm=max(0.0, (gap - np.sqrt(2) * cell) / 2),
            black=0.0,
            white=1.0,
        ),
    )


def _polygons_mm(marks: FaceMarks, point_mm: Array) -> tuple[Array, ...]:
    """The black polygons (K, 3) of marks whose points (R, 3) may have moved: their corners move as the points do."""
    if not marks.polygons_mm:
        return ()
    corner = np.concatenate(marks.polygons_mm)
    nominal = marks.position_mm
    moved = point_mm - np.column_stack([nominal, np.zeros(len(nominal))])
    at = np.column_stack([corner, np.zeros(len(corner))])
    if np.abs(moved).max() > 1e-9:
        from scipy.interpolate import RBFInterpolator

        at += RBFInterpolator(nominal, moved, kernel="thin_plate_spline")(corner)
    return tuple(np.split(at, np.cumsum([len(polygon) for polygon in marks.polygons_mm])[:-1]))


def _gap_mm(lattice_mm: Array, ring: Array) -> float:
    """White between neighbouring rings of a lattice; infinite without rings."""
    if not len(ring):
        return np.inf
    first, second = lattice_mm
    pitch = min(float(np.linalg.norm(step)) for step in (first, second, first - second, first + second))
    return max(pitch - 2 * float(ring[:, 3].max()), 0.02 * pitch)


def _least_radius_mm(ring: Array) -> float:
    return float(ring[:, 3].min()) if len(ring) else np.inf


def _half_planes(corner_mm: Array) -> Array:
    """The half-planes (K, 3) whose intersection is a convex polygon; repeated corners give none."""
    corner = corner_mm if _area(corner_mm) > 0 else corner_mm[::-1]
    step = np.roll(corner, -1, axis=0) - corner
    length = np.linalg.norm(step, axis=1)
    corner, step, length = corner[length > 0], step[length > 0], length[length > 0]
    normal = np.column_stack([step[:, 1], -step[:, 0]]) / length[:, None]
    plane = np.column_stack([normal, (normal * corner).sum(axis=1)])
    excess = (normal @ corner.T - plane[:, 2:]).max()
    if excess > 1e-6 * length.sum():
        raise InputError("a face's outline or window is not convex; the renderer draws convex faces only")
    return plane


def _area(corner_mm: Array) -> float:
    """Twice the signed area of a polygon (K, 2)."""
    x, y = corner_mm.T
    return float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum())


def _is_convex(target: TargetGeometry) -> bool:
    """Whether the faces bound a convex body: each lies behind the planes of all others."""
    if target.is_planar:
        return False
    frame = target.target_from_face
    corner = np.einsum("fij,fkj->fki", frame[:, :3, :2], target.outline_mm) + frame[:, None, :3, 3]
    normal, middle = frame[:, :3, 2], frame[:, :3, 3]
    above = np.einsum("fi,gki->fgk", normal, corner) - (normal * middle).sum(axis=1)[:, None, None]
    extent = np.linalg.norm(corner, axis=2).max()
    return bool(above.max() < 0.01 * extent)


@jit
def _paint_nearest(ring: Array, rows: Rows, origin: Array, cell: float, raster: NDArray[np.int32]) -> None:
    """Give each cell the ring with the least `distance to the centre - outer radius`."""
    for row in rows:
        x, y, radius = ring[row, 0], ring[row, 1], ring[row, 3]
        reach = NEIGHBOURHOOD * radius
        first_i = max(0, int((x - reach - origin[0]) / cell))
        last_i = min(raster.shape[1] - 1, int((x + reach - origin[0]) / cell))
        first_j = max(0, int((y - reach - origin[1]) / cell))
        last_j = min(raster.shape[0] - 1, int((y + reach - origin[1]) / cell))
        for j in range(first_j, last_j + 1):
            for i in range(first_i, last_i + 1):
                px, py = origin[0] + (i + 0.5) * cell, origin[1] + (j + 0.5) * cell
                old = raster[j, i]
                if old >= 0:
                    there = np.hypot(px - ring[old, 0], py - ring[old, 1]) - ring[old, 3]
                    if there <= np.hypot(px - x, py - y) - radius:
                        continue
                raster[j, i] = row
