"""A target of few triangles with a picture of its artwork on them, as simulators and colour printers take it.

The faces stand in the picture side by side, each as its frame has it, with black going on beyond its edges, so that a
viewer that mixes pixels mixes no white into a border. A pixel has the share of ink that lies in it, mixed in linear
light: however it is seen, from near or far, a ring's centre stays where it is.
"""

import io
import math
from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageColor, ImageDraw

from designer.base.arrays import Array, Rows
from designer.make.mesh import Mesh
from designer.make.pattern import FacePattern, Pattern
from designer.spec.spec import Spec

SIDE_PX = 4096
"""Of the picture at most, as every graphics card takes it."""
MOST_BYTES = 1_000_000
GUTTER_PX = 6
"""Around each face: mixed down eight times, a face still meets none of its neighbours."""
PATCH_PX = 16
"""Of the patch of plain body colour, for what has no face."""
_OVERSAMPLING = 8
"""Of letters; rings and edges are computed."""


@dataclass(frozen=True, eq=False)
class TexturedMesh:
    """Triangles, counter-clockwise from outside, of which each corner has a place in the picture."""

    corner_mm: Array  # (N, 3) in the target's frame
    normal: Array  # (N, 3)
    place: Array  # (N, 2) in the picture, 0 to 1, from its lower left
    triangles: Rows  # (T, 3)
    picture: bytes  # PNG

    @property
    def solid(self) -> Mesh:
        """The surface without its picture."""
        return Mesh(self.corner_mm, self.triangles.astype(np.int32))


def textured(pattern: Pattern, spec: Spec, colours: tuple[str, str]) -> TexturedMesh:
    """The target with its artwork.

    Args:
        pattern: on all faces, uncompensated.
        spec: of the target.
        colours: of body and ink, "#rrggbb".
    """
    side_px = SIDE_PX
    while True:
        sheet = _Sheet.of(pattern, side_px)
        picture = sheet.picture(pattern, colours)
        if len(picture) <= MOST_BYTES or side_px <= SIDE_PX // 8:
            break
        side_px = side_px * 3 // 4
    parts = [_face(sheet, row, face, frame) for row, (face, frame) in
             enumerate(zip(pattern.faces, pattern.target_from_face, strict=True))]  # fmt: skip
    if spec.body is None:
        parts += _plate_sides(sheet, pattern, spec.depth_mm)
    else:
        corners = spec.body.corners_mm()
        parts += [(corners[list(face)], np.tile(sheet.patch, (len(face), 1))) for face in spec.body.bare]
    starts = np.cumsum([0, *(len(corner) for corner, _ in parts)])
    corner = np.concatenate([corner for corner, _ in parts])
    triangles = np.concatenate([
        start + np.array([(0, k, k + 1) for k in range(1, len(corner) - 1)])
        for start, (corner, _) in zip(starts.tolist(), parts, strict=False)
    ])  # fmt: skip
    normal = np.concatenate([np.tile(_normal(points), (len(points), 1)) for points, _ in parts])
    return TexturedMesh(corner, normal, np.concatenate([place for _, place in parts]), triangles, picture)


@dataclass(frozen=True, eq=False)
class _Sheet:
    """Where the faces stand in the picture."""

    px_per_mm: float
    corner_px: Array  # (F, 2) upper left of each face's cell, from the picture's upper left
    cell_px: tuple[int, int]  # width, height of a cell
    low_mm: Array  # (F, 2) lower left of each face's outline in its frame
    high_mm: Array  # (F, 2)
    size_px: tuple[int, int]  # width, height

    @classmethod
    def of(cls, pattern: Pattern, side_px: int) -> "_Sheet":
        """As many faces beside each other as make it about square."""
        low = np.array([face.outline.min(axis=0) for face in pattern.faces])
        high = np.array([face.outline.max(axis=0) for face in pattern.faces])
        wide, tall = (high - low).max(axis=0).tolist()
        count = len(pattern.faces)
        columns = min(range(1, count + 1), key=lambda each: max(each * wide, math.ceil(count / each) * tall))
        rows = math.ceil(count / columns)
        gutters = 2 * GUTTER_PX + 1
        scale = min((side_px / columns - gutters) / wide, ((side_px - PATCH_PX) / rows - gutters) / tall)
        cell = math.ceil(wide * scale) + 2 * GUTTER_PX, math.ceil(tall * scale) + 2 * GUTTER_PX
        place = np.array([(row % columns * cell[0], row // columns * cell[1]) for row in range(count)])
        return cls(scale, place, cell, low, high, (columns * cell[0], rows * cell[1] + PATCH_PX))

    def place_of(self, face: int, points_mm: Array) -> Array:
        """Points of a face in the picture, 0 to 1 from its lower left.  # (N, 2)"""
        x, y = (self.px_per_mm * (points_mm - self.low_mm[face])).T
        left, top = self.corner_px[face] + GUTTER_PX
        height = self.px_per_mm * (self.high_mm[face] - self.low_mm[face])[1]
        return np.column_stack([(left + x) / self.size_px[0], 1 - (top + height - y) / self.size_px[1]])

    @property
    def patch(self) -> Array:
        """The middle of the patch of body colour, likewise.  # (2,)"""
        return np.array([PATCH_PX / 2 / self.size_px[0], PATCH_PX / 2 / self.size_px[1]])

    def picture(self, pattern: Pattern, colours: tuple[str, str]) -> bytes:
        """As a PNG file."""
        width, height = self.size_px
        ink = np.zeros((height, width))
        for row, face in enumerate(pattern.faces):
            left, top = self.corner_px[row]
            ink[top : top + self.cell_px[1], left : left + self.cell_px[0]] = self._ink(row, face, pattern)
        ramp = _ramp(*colours)[np.round(255 * ink).astype(np.uint8)]
        is_grey = (ramp[..., 0] == ramp[..., 1]).all() and (ramp[..., 0] == ramp[..., 2]).all()
        buffer = io.BytesIO()
        Image.fromarray(np.ascontiguousarray(ramp[..., 0]) if is_grey else ramp).save(buffer, "PNG", optimize=True)
        return buffer.getvalue()

    def _ink(self, row: int, face: FacePattern, pattern: Pattern) -> Array:
        """The share of ink in each pixel of a face's cell."""
        width, height = self.cell_px
        x = self.low_mm[row, 0] + (np.arange(width) + 0.5 - GUTTER_PX) / self.px_per_mm
        y = self.high_mm[row, 1] - (np.arange(height) + 0.5 - GUTTER_PX) / self.px_per_mm
        return ink_share(face, pattern, x, y)


def ink_share(face: FacePattern, pattern: Pattern, x_mm: Array, y_mm: Array) -> Array:
    """The share of ink in each pixel of a grid over a face, with a border's ink going on beyond its outline.  # (H, W)

    Args:
        face: of the pattern.
        pattern: all of it.
        x_mm: middles of the columns in the face's frame, left to right (W,).
        y_mm: middles of the rows, downwards (H,).
    """
    px_per_mm = 1 / float(x_mm[1] - x_mm[0])

    def covered(inside_mm: Array) -> Array:
        return np.clip(0.5 + inside_mm * px_per_mm, 0.0, 1.0)

    ink = np.zeros((len(y_mm), len(x_mm)))
    if face.window is not None:
        ink = covered(_outside_mm(face.window[::-1], x_mm, y_mm))
    for number, middle in zip(face.stamp.tolist(), face.position_mm.tolist(), strict=True):
        stamp = pattern.stamps[number]
        reach = stamp.outer_radius_mm + 1 / px_per_mm
        columns, rows = (np.flatnonzero(np.abs(at - to) <= reach) for at, to in zip((x_mm, y_mm), middle, strict=True))
        window = np.ix_(rows, columns)
        away = np.hypot(x_mm[columns] - middle[0], (y_mm[rows] - middle[1])[:, None])
        hole = covered(stamp.inner_radius_mm - away) if stamp.inner_radius_mm > 0 else 0.0
        ink[window] = np.maximum(ink[window], covered(stamp.outer_radius_mm - away) - hole)
    for contours, share in ((face.dark_text, 1.0), (face.light_text, 0.0)):
        for contour in contours:
            _paint_letter(ink, contour, share, x_mm, y_mm)
    return ink


def _paint_letter(ink: Array, contour: Array, share: float, x_mm: Array, y_mm: Array) -> None:
    """Paint a polygon."""
    px_per_mm = 1 / float(x_mm[1] - x_mm[0])
    low, high = contour.min(axis=0) - 1 / px_per_mm, contour.max(axis=0) + 1 / px_per_mm
    columns, rows = (np.flatnonzero((at > a) & (at < b)) for at, a, b in zip((x_mm, y_mm), low, high, strict=True))
    if not (len(columns) and len(rows)):
        return
    mask = Image.new("L", (len(columns) * _OVERSAMPLING, len(rows) * _OVERSAMPLING))
    step, half = px_per_mm * _OVERSAMPLING, (_OVERSAMPLING - 1) / 2
    corners = [((u - x_mm[columns[0]]) * step + half, (y_mm[rows[0]] - v) * step + half) for u, v in contour.tolist()]
    ImageDraw.Draw(mask).polygon(corners, fill=255)
    window = np.ix_(rows, columns)
    ink[window] += np.asarray(mask.reduce(_OVERSAMPLING), dtype=np.float64) / 255 * (share - ink[window])


def _outside_mm(polygon: Array, x: Array, y: Array) -> Array:
    """How far pixels lie outside a convex polygon that runs counter-clockwise; below zero inside.  # (H, W)"""
    most = np.full((len(y), len(x)), -np.inf)
    for start, end in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        along = (end - start) / np.linalg.norm(end - start)
        np.maximum(most, along[1] * (x - start[0]) - along[0] * (y - start[1])[:, None], out=most)
    return most


def linear_light(colour: str) -> Array:
    """Red, green and blue of a colour, "#rrggbb" in sRGB (IEC 61966-2-1), as shares of light.  # (3,)"""
    encoded = np.array(ImageColor.getrgb(colour)[:3]) / 255
    linear: Array = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    return linear


def _ramp(body: str, ink: str) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """Colours from body to ink in 256 steps that are even in linear light.  # (256, 3)"""
    mixed = linear_light(body) + np.linspace(0, 1, 256)[:, None] * (linear_light(ink) - linear_light(body))
    back = np.where(mixed <= 0.0031308, 12.92 * mixed, 1.055 * mixed ** (1 / 2.4) - 0.055)
    steps: np.ndarray[tuple[int, ...], np.dtype[np.uint8]] = np.round(255 * back).astype(np.uint8)
    return steps


def _face(sheet: _Sheet, row: int, face: FacePattern, frame: Array) -> tuple[Array, Array]:
    """Corners of a face, and their places in the picture."""
    corner: Array = face.outline @ frame[:3, :2].T + frame[:3, 3]
    return corner, sheet.place_of(row, face.outline)


def _plate_sides(sheet: _Sheet, pattern: Pattern, depth_mm: float) -> list[tuple[Array, Array]]:
    """The sides of a plate and, if it has one face only, its back: of body colour."""
    frame = pattern.target_from_face[0]
    front: Array = pattern.faces[0].outline @ frame[:3, :2].T + frame[:3, 3]
    back = front - depth_mm * frame[:3, 2]
    count = len(front)
    polygons = [np.stack([back[k], back[k - 1], front[k - 1], front[k]])[::-1] for k in range(count)]
    if len(pattern.faces) == 1:
        polygons.append(back[::-1])
    return [(corner, np.tile(sheet.patch, (len(corner), 1))) for corner in polygons]


def _normal(corner: Array) -> Array:
    """Of a flat polygon, counter-clockwise from outside."""
    across: Array = np.cross(corner, np.roll(corner, -1, axis=0)).sum(axis=0)
    return across / np.linalg.norm(across)
