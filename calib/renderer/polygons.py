"""Black polygons on a face, such as a chessboard's squares: the share of each pixel that they cover.

The pixel's corners are cut with the face's plane, the polygons clipped to the quadrilateral between them, and what is
left measured in the pixel: exact, but for how a lens bends an edge within one pixel.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from calib.core.jit import jit
from calib.renderer.trace import PixelRay, meet_plane, pixel_ray, pixel_reach
from designer.base.arrays import Array, Rows

Image = NDArray[np.float32]
MOST_CELLS = 250_000
FULL = 1 - 1e-9


class Patches(NamedTuple):
    """Polygons of a face, cut along the lines of a raster, so that a pixel looks at those of its own cells only."""

    corner: Array  # (N, 2) of all pieces
    first: Rows  # (pieces + 1,) of each piece in `corner`
    cell: Rows  # (cells + 1,) of each cell, row by row, in the pieces
    share: Array  # (rows, columns) of each cell that is black
    origin: Array  # (2,) corner of the first cell
    cell_mm: float


def patches_of(polygons_mm: Sequence[Array]) -> Patches | None:
    """Polygons (K, 2) that do not overlap, ready for `ink_polygons`; None: there are none."""
    if not polygons_mm:
        return None
    low = np.array([polygon.min(axis=0) for polygon in polygons_mm])
    high = np.array([polygon.max(axis=0) for polygon in polygons_mm])
    origin, size = low.min(axis=0), high.max(axis=0) - low.min(axis=0)
    cell_mm = max(float(np.median(high - low)), float(np.sqrt(np.prod(size) / MOST_CELLS)))
    columns, rows = (np.ceil(size / cell_mm - 1e-9).astype(int).clip(min=1)).tolist()
    first = np.cumsum([0, *map(len, polygons_mm)])
    corner, starts, owner, share = _cut(np.concatenate(polygons_mm), first, origin, cell_mm, columns, rows)
    order = np.argsort(owner, kind="stable")
    length = np.diff(starts)[order]
    at = np.repeat(starts[order] - np.cumsum(length) + length, length) + np.arange(length.sum())
    cell = np.concatenate([[0], np.cumsum(np.bincount(owner, minlength=columns * rows))])
    return Patches(corner[at], np.concatenate([[0], np.cumsum(length)]), cell, share, origin, cell_mm)


@jit
def _clip(corner: Array, count: int, nx: float, ny: float, c: float, kept: Array) -> int:
    """Of a polygon the part where nx x + ny y <= c, into `kept`; how many corners it has (Sutherland and Hodgman)."""
    number = 0
    for k in range(count):
        x0, y0 = corner[k, 0], corner[k, 1]
        x1, y1 = corner[(k + 1) % count, 0], corner[(k + 1) % count, 1]
        d0, d1 = nx * x0 + ny * y0 - c, nx * x1 + ny * y1 - c
        if d0 <= 0:
            kept[number, 0], kept[number, 1] = x0, y0
            number += 1
        if (d0 < 0 < d1) or (d1 < 0 < d0):
            share = d0 / (d0 - d1)
            kept[number, 0], kept[number, 1] = x0 + share * (x1 - x0), y0 + share * (y1 - y0)
            number += 1
    return number


@jit
def _clip_to(plane: Array, corner: Array, count: int, work: Array) -> int:
    """Clip a polygon to four half-planes; the result is in `corner`."""
    for k in range(2):
        count = _clip(corner, count, plane[2 * k, 0], plane[2 * k, 1], plane[2 * k, 2], work)
        count = _clip(work, count, plane[2 * k + 1, 0], plane[2 * k + 1, 1], plane[2 * k + 1, 2], corner)
    return count


@jit
def _area(corner: Array, count: int) -> float:
    total = 0.0
    for k in range(count):
        n = (k + 1) % count
        total += corner[k, 0] * corner[n, 1] - corner[n, 0] * corner[k, 1]
    return 0.5 * abs(total)


@jit
def _cut(
    corner: Array, first: Rows, origin: Array, cell_mm: float, columns: int, rows: int
) -> tuple[Array, Rows, Rows, Array]:
    """Polygons cut along a raster's lines: corners, their piece's first one, each piece's cell, and shares of cells."""
    room, pieces, used = 4 * len(corner), 0, 0
    kept, starts, owner = np.empty((room, 2)), np.zeros(room + 1, np.int64), np.empty(room, np.int64)
    share = np.zeros((rows, columns))
    longest = 4 * int(np.diff(first).max()) + 16
    plane, piece, work = np.empty((4, 3)), np.empty((longest, 2)), np.empty((longest, 2))
    for p in range(len(first) - 1):
        own = corner[first[p] : first[p + 1]]
        left, top = int((own[:, 0].min() - origin[0]) / cell_mm), int((own[:, 1].min() - origin[1]) / cell_mm)
        right, bottom = int((own[:, 0].max() - origin[0]) / cell_mm), int((own[:, 1].max() - origin[1]) / cell_mm)
        for row in range(max(top, 0), min(bottom + 1, rows)):
            for column in range(max(left, 0), min(right + 1, columns)):
                x, y = origin[0] + column * cell_mm, origin[1] + row * cell_mm
                plane[0], plane[1] = np.array([-1.0, 0.0, -x]), np.array([1.0, 0.0, x + cell_mm])
                plane[2], plane[3] = np.array([0.0, -1.0, -y]), np.array([0.0, 1.0, y + cell_mm])
                piece[: len(own)] = own
                count = _clip_to(plane, piece, len(own), work)
                part = _area(piece, count) / (cell_mm * cell_mm)
                if part < 1e-12:
                    continue
                while used + count > room or pieces >= room:
                    kept, owner = np.concatenate((kept, kept)), np.concatenate((owner, owner))
                    starts = np.concatenate((starts, starts[:room]))
                    room = 2 * room
                kept[used : used + count] = piece[:count]
                owner[pieces] = row * columns + column
                share[row, column] += part
                used, pieces = used + count, pieces + 1
                starts[pieces] = used
    return kept[:used].copy(), starts[: pieces + 1].copy(), owner[:pieces].copy(), share


@jit
def _contains(corner: Array, first: int, last: int, x: float, y: float) -> bool:
    inside, before = False, last - 1
    for k in range(first, last):
        if (corner[k, 1] > y) != (corner[before, 1] > y):
            along = (y - corner[before, 1]) / (corner[k, 1] - corner[before, 1])
            if x < corner[before, 0] + along * (corner[k, 0] - corner[before, 0]):
                inside = not inside
        before = k
    return inside


@jit
def _quad(p: PixelRay, eye: Array, plane: Array) -> None:
    """The half-planes between a pixel's corners on the face."""
    corner = np.empty((4, 2))
    for k in range(4):
        du, dv = (0.5 if k in (1, 2) else -0.5), (0.5 if k >= 2 else -0.5)
        w = p.w + p.wu * du + p.wv * dv
        corner[k, 0] = eye[0] - eye[2] * (p.a + p.au * du + p.av * dv) / w
        corner[k, 1] = eye[1] - eye[2] * (p.b + p.bu * du + p.bv * dv) / w
    for k in range(4):
        x, y = corner[k]
        nx, ny = corner[(k + 1) % 4, 1] - y, x - corner[(k + 1) % 4, 0]
        across = corner[(k + 2) % 4]
        sign = 1.0 if nx * (across[0] - x) + ny * (across[1] - y) < 0 else -1.0
        plane[k, 0], plane[k, 1], plane[k, 2] = sign * nx, sign * ny, sign * (nx * x + ny * y)


@jit
def _to_pixel(p: PixelRay, eye: Array, corner: Array, count: int) -> None:
    """Points of the face as offsets (px) from the pixel's centre, in place."""
    # (s, t, 1) ~ M (du, dv, 1), whose inverse is the adjugate but for a factor.
    i00, i01, i02 = p.bv * p.w - p.b * p.wv, p.a * p.wv - p.av * p.w, p.av * p.b - p.a * p.bv
    i10, i11, i12 = p.b * p.wu - p.bu * p.w, p.au * p.w - p.a * p.wu, p.a * p.bu - p.au * p.b
    i20, i21, i22 = p.bu * p.wv - p.bv * p.wu, p.av * p.wu - p.au * p.wv, p.au * p.bv - p.av * p.bu
    for k in range(count):
        s, t = (eye[0] - corner[k, 0]) / eye[2], (eye[1] - corner[k, 1]) / eye[2]
        scale = 1.0 / (i20 * s + i21 * t + i22)
        corner[k, 0], corner[k, 1] = scale * (i00 * s + i01 * t + i02), scale * (i10 * s + i11 * t + i12)


@jit
def _even_share(share: Array, is_inside: bool) -> float:
    """0 if cells are white, 1 if they are black, -1 if both are to be seen."""
    lowest, highest = 1.0 if is_inside else 0.0, 0.0
    for j in range(share.shape[0]):
        for i in range(share.shape[1]):
            lowest, highest = min(lowest, share[j, i]), max(highest, share[j, i])
    if lowest > FULL:
        return 1.0
    return 0.0 if highest == 0 else -1.0


@jit
def ink_polygons(
    ray: Array, face_from_cam: Array, patches: Patches, is_binary: bool, contrast: float, light: Image, cover: Image
) -> None:
    """Take the light of polygons off an image, to which their white face is added with `trace_face` after this.

    Args:
        ray: (H + 2, W + 2, 3), unit vectors of the pixels and of one more on each side.
        face_from_cam: (4, 4).
        patches: what is black.
        is_binary: one ray a pixel and no more.
        contrast: light of the white over that of the black.
        light: (H, W), from which is taken.
        cover: (H, W), what nearer faces cover of each pixel.
    """
    rotation, eye = face_from_cam[:3, :3], face_from_cam[:3, 3].copy()
    corner, first, cell, share = patches.corner, patches.first, patches.cell, patches.share
    x0, y0, per_mm = patches.origin[0], patches.origin[1], 1 / patches.cell_mm
    rows, columns = share.shape
    longest = 4 * int(np.diff(first).max()) + 16
    plane, piece, work = np.empty((4, 3)), np.empty((longest, 2)), np.empty((longest, 2))
    point = np.empty((ray.shape[0], ray.shape[1], 2))
    meet_plane(ray, face_from_cam, point)
    for row in range(light.shape[0]):
        for column in range(light.shape[1]):
            x, y = point[row + 1, column + 1, 0], point[row + 1, column + 1, 1]
            if cover[row, column] >= 1 or not x < np.inf:
                continue
            reach = 0.0 if is_binary else pixel_reach(point, row + 1, column + 1)
            low_i, high_i = np.floor((x - reach - x0) * per_mm), np.floor((x + reach - x0) * per_mm)
            low_j, high_j = np.floor((y - reach - y0) * per_mm), np.floor((y + reach - y0) * per_mm)
            if high_i < 0 or high_j < 0 or low_i >= columns or low_j >= rows:
                continue
            left, right = int(max(low_i, 0)), int(min(high_i, columns - 1))
            top, bottom = int(max(low_j, 0)), int(min(high_j, rows - 1))
            is_inside = low_i >= 0 and low_j >= 0 and high_i < columns and high_j < rows
            ink = _even_share(share[top : bottom + 1, left : right + 1], is_inside)
            if ink < 0 and reach == 0:
                ink = 0.0
                for k in range(cell[top * columns + left], cell[top * columns + left + 1]):
                    if _contains(corner, first[k], first[k + 1], x, y):
                        ink = 1.0
            elif ink < 0:
                ink = 0.0
                pixel = pixel_ray(ray, row, column, rotation, eye[2])
                _quad(pixel, eye, plane)
                for j in range(top, bottom + 1):
                    for k in range(cell[j * columns + left], cell[j * columns + right + 1]):
                        count = first[k + 1] - first[k]
                        piece[:count] = corner[first[k] : first[k + 1]]
                        count = _clip_to(plane, piece, count, work)
                        _to_pixel(pixel, eye, piece, count)
                        ink += _area(piece, count)
            light[row, column] -= min(ink, 1.0) * contrast * (1.0 - cover[row, column])
