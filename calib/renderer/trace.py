"""Ray tracing of one face: every pixel's ray is cut with the face's plane, and the texture read there.

A ray `d` of length one in the camera frame meets the plane z = h of the face frame at
`o + (h - oz) (a, b, 1) / w` with `(a, b, w) = face_from_cam @ d` and `o` the camera in the face frame.

Away from edges one ray stands for the pixel. Where an edge may cross, the pixel is cut into cells, and each cell is
covered by the half-plane that its signed distance to the edge and the distance's gradient give; for a circle the
mean of the curved distance over the cell is used, so that coverage is exact to the fourth order of the cell's size.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from calib.core.jit import jit
from designer.base.arrays import Array

Image = NDArray[np.float32]

CELLS, CELLS_SMALL_RING, CELLS_CORNER = 4, 8, 16
"""Cells along a pixel's side: at one edge, at a ring of a few pixels, and where several edges meet or a ring is less
than a pixel."""
REACH = 0.75
"""Half a pixel's diagonal, with a margin for the change of scale within it."""
SMALL_RING, TINY_RING = 2.5, 1.0
"""Radius over reach below which more cells are used."""


class FaceArrays(NamedTuple):
    """One side of a face, in the face frame. Half-planes are rows (nx, ny, c): inside where nx x + ny y < c."""

    outline: Array  # (K, 3) half-planes
    window: Array  # (K, 3) half-planes of the white inside the border
    has_border: bool  # the window differs from the outline
    is_plain: bool  # nothing is printed on this side
    ring: Array  # (R, 5) x, y, z, outer and inner radius
    raster: NDArray[np.int32]  # (rows, columns) row of the ring whose edge is nearest or encloses; -1: none near
    raster_origin: Array  # (2,) corner of the first cell
    cell_mm: float
    lone_mm: float  # an edge within this of a point belongs to the raster's ring there, and not to its neighbour
    black: float  # light of the ink
    white: float  # light of the white


class PixelRay(NamedTuple):
    """A pixel's ray in the face frame, its derivatives by u and v, and those of the point it meets."""

    a: float
    b: float
    w: float
    au: float
    av: float
    bu: float
    bv: float
    wu: float
    wv: float
    xu: float  # mm per px
    xv: float
    yu: float
    yv: float
    reach: float  # mm: an edge farther than this from the pixel's centre does not cross it


@jit
def half_plane_coverage(distance: float, across: float, along: float, side: float) -> float:
    """Share of a square that lies inside a half-plane, whose edge is so far from its centre, positive outside.

    `across` is the larger component of the edge's unit normal, `along` the smaller one, both without sign.
    """
    outer, inner = 0.5 * side * (across + along), 0.5 * side * (across - along)
    size = abs(distance)
    if size >= outer:
        share = 0.0
    elif size <= inner:
        share = 0.5 - size / (across * side)
    else:
        share = (outer - size) ** 2 / (2 * across * along * side * side)
    return share if distance > 0 else 1.0 - share


@jit
def _covered(distance: float, nx: float, ny: float, p: PixelRay, side: float) -> float:
    """Share of a cell inside an edge, from the distance (mm) at its centre and the edge's outward normal."""
    if abs(distance) >= p.reach * side:
        return 0.0 if distance > 0 else 1.0
    gradient_u, gradient_v = nx * p.xu + ny * p.yu, nx * p.xv + ny * p.yv
    norm = math.sqrt(gradient_u * gradient_u + gradient_v * gradient_v)
    if norm == 0:
        return 0.0 if distance > 0 else 1.0
    u, v = abs(gradient_u) / norm, abs(gradient_v) / norm
    return half_plane_coverage(distance / norm, max(u, v), min(u, v), side)


@jit
def polygon_distance(plane: Array, x: float, y: float) -> float:
    """Signed distance to a convex polygon's nearest edge line, negative inside."""
    distance = -np.inf
    for k in range(len(plane)):
        distance = max(distance, plane[k, 0] * x + plane[k, 1] * y - plane[k, 2])
    return distance


@jit
def _near_edges(plane: Array, x: float, y: float, reach: float) -> int:
    """How many of a polygon's edge lines pass within reach."""
    count = 0
    for k in range(len(plane)):
        if abs(plane[k, 0] * x + plane[k, 1] * y - plane[k, 2]) < reach:
            count += 1
    return count


@jit
def _polygon_coverage(plane: Array, x: float, y: float, p: PixelRay, side: float) -> float:
    """Share of a cell inside a convex polygon, as the product over its edges."""
    share = 1.0
    for k in range(len(plane)):
        nx, ny = plane[k, 0], plane[k, 1]
        share *= _covered(nx * x + ny * y - plane[k, 2], nx, ny, p, side)
    return share


@jit
def _nearest_ring(raster: NDArray[np.int32], origin: Array, cells_per_mm: float, x: float, y: float) -> int:
    """Row of the ring at a point of the face, -1 if none is near."""
    i, j = int((x - origin[0]) * cells_per_mm), int((y - origin[1]) * cells_per_mm)
    if i < 0 or j < 0 or i >= raster.shape[1] or j >= raster.shape[0]:
        return -1
    return int(raster[j, i])


@jit
def _annulus_coverage(x: float, y: float, outer: float, inner: float, p: PixelRay, side: float) -> float:
    """Share of a cell that a ring's ink covers; (x, y) is the cell's centre from the ring's, in mm."""
    radius = math.sqrt(x * x + y * y)
    if radius < 1e-9 * outer:
        return 0.0 if inner > 0 else 1.0
    nx, ny = x / radius, y / radius
    tu, tv = nx * p.yu - ny * p.xu, nx * p.yv - ny * p.xv
    bend = side * side / 24 * (tu * tu + tv * tv) / radius
    share = _covered(radius - outer + bend, nx, ny, p, side)
    if inner > 0:
        share -= _covered(radius - inner + bend, nx, ny, p, side)
    return max(share, 0.0)


@jit
def _turned(
    r: Array, ray: Array, row: int, column: int, middle_row: int, middle_column: int
) -> tuple[float, float, float]:
    """A ray of an array, cut with the plane through the tip of another and across it, in another frame."""
    x, y, z = ray[row, column, 0], ray[row, column, 1], ray[row, column, 2]
    m, n = middle_row, middle_column
    scale = 1.0 / (x * ray[m, n, 0] + y * ray[m, n, 1] + z * ray[m, n, 2])
    x, y, z = scale * x, scale * y, scale * z
    return (
        r[0, 0] * x + r[0, 1] * y + r[0, 2] * z,
        r[1, 0] * x + r[1, 1] * y + r[1, 2] * z,
        r[2, 0] * x + r[2, 1] * y + r[2, 2] * z,
    )


@jit
def pixel_ray(ray: Array, row: int, column: int, rotation: Array, height: float) -> PixelRay:
    """The ray of a pixel in the face frame, from the rays of the pixel and its neighbours."""
    a, b, w = _turned(rotation, ray, row + 1, column + 1, row + 1, column + 1)
    # Half the differences of neighbouring rays are their derivatives, exact for a pinhole.
    a0, b0, w0 = _turned(rotation, ray, row + 1, column, row + 1, column + 1)
    a1, b1, w1 = _turned(rotation, ray, row + 1, column + 2, row + 1, column + 1)
    au, bu, wu = 0.5 * (a1 - a0), 0.5 * (b1 - b0), 0.5 * (w1 - w0)
    a0, b0, w0 = _turned(rotation, ray, row, column + 1, row + 1, column + 1)
    a1, b1, w1 = _turned(rotation, ray, row + 2, column + 1, row + 1, column + 1)
    av, bv, wv = 0.5 * (a1 - a0), 0.5 * (b1 - b0), 0.5 * (w1 - w0)
    s, t, f = a / w, b / w, -height / w
    gxu, gxv, gyu, gyv = f * (au - s * wu), f * (av - s * wv), f * (bu - t * wu), f * (bv - t * wv)
    reach = REACH * math.sqrt(gxu * gxu + gxv * gxv + gyu * gyu + gyv * gyv)
    return PixelRay(a, b, w, au, av, bu, bv, wu, wv, gxu, gxv, gyu, gyv, reach)


@jit
def _cells(
    face: FaceArrays, origin: Array, p: PixelRay, cells: int, at_outline: bool, from_window: float
) -> tuple[float, float]:
    """Share of a pixel that the face covers, and share that is white, cell by cell."""
    outline, window, ring, raster, raster_origin = face.outline, face.window, face.ring, face.raster, face.raster_origin
    has_window, cells_per_mm = face.has_border and not face.is_plain, 1 / face.cell_mm
    at_window = has_window and abs(from_window) < p.reach
    in_border = has_window and from_window >= p.reach
    side = 1.0 / cells
    covered, white = 0.0, 0.0
    for m in range(cells):
        dv = (m + 0.5) * side - 0.5
        for n in range(cells):
            du = (n + 0.5) * side - 0.5
            w = p.w + p.wu * du + p.wv * dv
            s, t = (p.a + p.au * du + p.av * dv) / w, (p.b + p.bu * du + p.bv * dv) / w
            x, y = origin[0] - origin[2] * s, origin[1] - origin[2] * t
            inside = _polygon_coverage(outline, x, y, p, side) if at_outline else 1.0
            in_window = 0.0 if in_border else inside
            if at_window:
                in_window = min(inside, _polygon_coverage(window, x, y, p, side))
            k = -1 if face.is_plain else _nearest_ring(raster, raster_origin, cells_per_mm, x, y)
            ink = 0.0
            if k >= 0:
                qx, qy = x + ring[k, 2] * s - ring[k, 0], y + ring[k, 2] * t - ring[k, 1]
                ink = _annulus_coverage(qx, qy, ring[k, 3], ring[k, 4], p, side)
            covered += inside
            white += in_window * (1.0 - ink)
    return covered * side * side, white * side * side


@jit
def meet_plane(ray: Array, face_from_cam: Array, point: Array) -> None:
    """Where rays (H, W, 3) meet a face's plane, in its frame (H, W, 2); nan where they leave it behind them."""
    r = face_from_cam
    for row in range(point.shape[0]):
        for column in range(point.shape[1]):
            x, y, z = ray[row, column, 0], ray[row, column, 1], ray[row, column, 2]
            length = -r[2, 3] / (r[2, 0] * x + r[2, 1] * y + r[2, 2] * z)
            length = length if length > 0 else np.nan
            point[row, column, 0] = r[0, 3] + length * (r[0, 0] * x + r[0, 1] * y + r[0, 2] * z)
            point[row, column, 1] = r[1, 3] + length * (r[1, 0] * x + r[1, 1] * y + r[1, 2] * z)


@jit
def pixel_reach(point: Array, row: int, column: int) -> float:
    """Distance (mm) beyond which no edge crosses a pixel; 0 at the rim of the lens's image."""
    xu, yu = (
        point[row, column + 1, 0] - point[row, column - 1, 0],
        point[row, column + 1, 1] - point[row, column - 1, 1],
    )
    xv, yv = (
        point[row + 1, column, 0] - point[row - 1, column, 0],
        point[row + 1, column, 1] - point[row - 1, column, 1],
    )
    reach = 0.5 * REACH * math.sqrt(xu * xu + yu * yu + xv * xv + yv * yv)
    return reach if reach < np.inf else 0.0


@jit
def trace_face(ray: Array, face_from_cam: Array, face: FaceArrays, is_binary: bool, light: Image, cover: Image) -> None:
    """Add one face to an image of light and to the share of each pixel that is covered.

    Args:
        ray: (H + 2, W + 2, 3), unit vectors of the pixels and of one more on each side.
        face_from_cam: (4, 4).
        face: what to see there.
        is_binary: one ray a pixel and no more.
        light: (H, W), added to.
        cover: (H, W), added to; what is covered already hides this face.
    """
    rotation, origin = face_from_cam[:3, :3], face_from_cam[:3, 3].copy()
    # Taken out of the loop: reading an array from a tuple counts references.
    outline, window, ring, raster, raster_origin = face.outline, face.window, face.ring, face.raster, face.raster_origin
    has_window, cells_per_mm = face.has_border and not face.is_plain, 1 / face.cell_mm
    diagonal, lone = math.sqrt(2) * face.cell_mm, face.lone_mm
    point = np.empty((ray.shape[0], ray.shape[1], 2))
    meet_plane(ray, face_from_cam, point)
    for row in range(light.shape[0]):
        for column in range(light.shape[1]):
            x, y = point[row + 1, column + 1, 0], point[row + 1, column + 1, 1]
            from_outline = polygon_distance(outline, x, y)
            if cover[row, column] >= 1 or not x < np.inf:
                continue
            reach = 0.0 if is_binary else pixel_reach(point, row + 1, column + 1)
            if from_outline >= reach:
                continue
            from_window = polygon_distance(window, x, y) if has_window else from_outline
            from_outer, from_inner, smallest = np.inf, np.inf, np.inf
            k = -1 if face.is_plain else _nearest_ring(raster, raster_origin, cells_per_mm, x, y)
            if k >= 0:
                shift = ring[k, 2] / origin[2]  # a ring above or below the plane is seen elsewhere
                qx, qy = x + shift * (origin[0] - x) - ring[k, 0], y + shift * (origin[1] - y) - ring[k, 1]
                radius = math.sqrt(qx * qx + qy * qy)
                from_outer, smallest = radius - ring[k, 3], ring[k, 3]
                if ring[k, 4] > 0:
                    from_inner, smallest = radius - ring[k, 4], ring[k, 4]
            # A pixel wide enough to touch two rings may cross the edge of the farther one.
            farther = reach + diagonal if reach > lone else reach
            near = 1 if abs(from_inner) < reach or -reach < from_outer < farther else 0
            if abs(from_outline) < reach or abs(from_window) < reach:
                near += _near_edges(outline, x, y, reach) + (_near_edges(window, x, y, reach) if has_window else 0)
            if near == 0:
                covered, white = 1.0, 0.0 if from_window >= 0 or (from_outer < 0 and from_inner > 0) else 1.0
            else:
                pixel = pixel_ray(ray, row, column, rotation, origin[2])
                cells = CELLS_SMALL_RING if smallest < SMALL_RING * reach or reach > lone else CELLS
                if near > 1 or smallest < TINY_RING * reach:
                    cells = CELLS_CORNER
                covered, white = _cells(face, origin, pixel, cells, from_outline > -reach, from_window)
            if covered > 0:
                share = min(1.0, (1.0 - cover[row, column]) / covered)
                light[row, column] += share * (face.black * covered + (face.white - face.black) * white)
                cover[row, column] += share * covered


@jit
def set_depth(ray: Array, face_from_cam: Array, outline: Array, is_range: bool, depth: Image) -> None:
    """Write the depth (mm along the camera's axis), or the range, of one face; `ray` as in `trace_face`."""
    r = face_from_cam
    for row in range(depth.shape[0]):
        for column in range(depth.shape[1]):
            dx, dy, dz = ray[row + 1, column + 1, 0], ray[row + 1, column + 1, 1], ray[row + 1, column + 1, 2]
            length = -r[2, 3] / (r[2, 0] * dx + r[2, 1] * dy + r[2, 2] * dz)
            away = length if is_range else length * dz
            if not (length > 0 and 0 < away < np.inf):
                continue
            x = r[0, 3] + length * (r[0, 0] * dx + r[0, 1] * dy + r[0, 2] * dz)
            y = r[1, 3] + length * (r[1, 0] * dx + r[1, 1] * dy + r[1, 2] * dz)
            if polygon_distance(outline, x, y) < 0:
                depth[row, column] = away
