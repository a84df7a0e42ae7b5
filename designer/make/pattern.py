"""The ink on each face as polygons: what is printed, after ink offset and shrinkage compensation.

A closed contour runs with the ink on its left: the rim of a disc counter-clockwise, a hole clockwise.
"""

import math
from dataclasses import dataclass

import numpy as np

from designer.base.arrays import Array, Rows
from designer.base.errors import InputError
from designer.kinds.layout import DECIMALS, narrowest_widths, true_corners
from designer.make.lettering import Lettering, letter_faces
from designer.marks.face_marks import FaceMarks, black_cells_mm
from designer.spec.spec import PrintSpec
from designer.target import TargetGeometry

Contour = Array  # (N, 2)

HAIR_MM = 0.002
"""Between two black places that touch: slicers close gaps below a tenth of a millimetre, and no printer makes it."""
MAX_POINTS = 400_000
"""Of a printed pattern: about eight times as many triangles, and a 3MF file of 50 MB."""


@dataclass(frozen=True)
class Stamp:
    """One shape of ring or dot; many features share it."""

    outer_radius_mm: float
    inner_radius_mm: float  # 0: a dot
    rim: Contour  # counter-clockwise
    hole: Contour | None  # clockwise

    @property
    def contours(self) -> tuple[Contour, ...]:
        """Rim and, for a ring, hole."""
        return (self.rim,) if self.hole is None else (self.rim, self.hole)


@dataclass(frozen=True)
class FacePattern:
    """The ink of one face, in the face frame."""

    outline: Contour  # counter-clockwise
    window: Contour | None  # inner edge of the border, clockwise; None: no border
    stamp: Rows  # (N,) row of Pattern.stamps
    position_mm: Array  # (N, 2)
    dark_text: tuple[Contour, ...]  # letters and other marks of ink on white, counter-clockwise
    light_text: tuple[Contour, ...]  # white in the border, clockwise


@dataclass(frozen=True)
class Pattern:
    """The ink of all faces."""

    stamps: tuple[Stamp, ...]
    faces: tuple[FacePattern, ...]
    target_from_face: Array  # (F, 4, 4)
    lettering: Lettering  # what was written, or why nothing was


def make_pattern(target: TargetGeometry, printing: PrintSpec, *, scale: float = 1.0) -> Pattern:
    """The printed ink of a target.

    Args:
        target: the nominal geometry.
        printing: gives ink offset, chord error and labels.
        scale: the size of the printed part over the design's, from shrinkage compensation.

    Raises:
        InputError: an ink offset that closes a ring or opens a stroke.
    """
    offset = printing.ink_offset_mm
    _check_offset(target, printing, scale)
    is_stamped = target.radius_outer_mm > 0  # no corners of other makers' marks
    radii = np.stack([target.radius_outer_mm, target.radius_inner_mm], axis=1)[is_stamped] * scale
    distinct, stamp = np.unique(radii, axis=0, return_inverse=True)
    stamps = tuple(_make_stamp(outer, inner, offset, printing.chord_error_mm) for outer, inner in distinct.tolist())
    inked = [_marks_ink(one, scale, offset) for one in target.marks or ()] or [()] * target.face_count
    _check_size(stamps, stamp, printing, 4 * sum(map(len, inked)))
    # Rounded, so that faces with the same lattice have the same numbers after the way through the target frame.
    position = np.round(target.center_in_face_mm[:, :2] * scale, 7) + 0.0
    lettering = letter_faces(target, printing, scale)
    marks = () if target.spec is None else tuple(moved_in(mark * scale, -offset) for mark in target.spec.marks_mm)
    faces = []
    for face in range(target.face_count):
        mine = (target.ring_face == face) & is_stamped
        has_border = not np.array_equal(target.window_mm[face], target.outline_mm[face])
        outline, opening = (each[true_corners(each)] for each in (target.outline_mm[face], target.window_mm[face]))
        window = moved_in(opening * scale, offset)[::-1] if has_border else None
        text = lettering.contours[face]
        faces.append(
            FacePattern(
                outline=outline * scale,
                window=window,
                stamp=stamp[mine[is_stamped]],
                position_mm=position[mine],
                dark_text=(*marks, *inked[face]) if has_border else (*marks, *inked[face], *text),
                light_text=tuple(contour[::-1] for contour in text) if has_border else (),
            )
        )
    frames = target.target_from_face.copy()
    frames[:, :3, 3] *= scale
    return Pattern(stamps, tuple(faces), frames, lettering)


def _check_offset(target: TargetGeometry, printing: PrintSpec, scale: float) -> None:
    """An ink offset may close no stroke, no white centre, no gap and no margin; nor may a circle's corners."""
    offset, chord_error = printing.ink_offset_mm, printing.chord_error_mm
    least, most = (scale * limit for limit in narrowest_widths(target).ink_offset_range_mm)
    if offset != 0 and not least < offset < most:
        raise InputError(
            f"ink offset {offset:g}mm closes strokes or lets ink touch ink; "
            f"use one above {least:.6g}mm and below {most:.6g}mm"
        )
    room = min(offset - least, most - offset)
    if chord_error >= room:
        raise InputError(f"chord error {chord_error:g}mm lets polygons touch each other; use less than {room:.3g}mm")


def _marks_ink(marks: FaceMarks, scale: float, offset: float) -> tuple[Contour, ...]:
    """What is black of other makers' marks as rectangles a hair apart.

    Squares of a chessboard touch in their corners, cells of a marker along their sides: as one closed surface that is
    no solid, and as many they must not touch. Half a hair is taken off each side, so that no corner moves.
    """
    rectangles = [polygon * scale for polygon in marks.polygons_mm]
    if offset and rectangles:
        from shapely import Polygon, contains_xy, prepare, union_all

        ink = union_all([Polygon(corner) for corner in rectangles]).buffer(offset, join_style="mitre")
        prepare(ink)
        x, y = (
            np.unique(np.round([side + k * offset for side in sides for k in (-1, 1)], DECIMALS))
            for sides in np.concatenate(rectangles).T
        )
        middle_x, middle_y = np.meshgrid((x[1:] + x[:-1]) / 2, (y[1:] + y[:-1])[::-1] / 2)
        rectangles = black_cells_mm(contains_xy(ink, middle_x, middle_y), x, y)
    return tuple(np.round(moved_in(corner, HAIR_MM / 2), 7) + 0.0 for corner in rectangles)


def _check_size(stamps: tuple[Stamp, ...], stamp: Rows, printing: PrintSpec, more: int) -> None:
    """Keep meshes within what slicers load and memories hold."""
    points = more + sum(sum(len(contour) for contour in stamps[row].contours) for row in stamp.tolist())
    if printing.way.is_two_filament and points > MAX_POINTS:
        # The number of points falls with the root of the chord error.
        coarser = printing.chord_error_mm * (points / MAX_POINTS) ** 2
        raise InputError(
            f"circles within {printing.chord_error_mm:g}mm take {points} points, more than {MAX_POINTS}; "
            f"use --chord-error {math.ceil(1100 * coarser)}um, or fewer rings"
        )


def _make_stamp(outer: float, inner: float, offset: float, chord_error: float) -> Stamp:
    """A ring or dot, its ink grown by `offset` on every side."""
    is_dot = inner == 0
    grown_outer, grown_inner = outer + offset, 0.0 if is_dot else inner - offset
    hole = None if is_dot else circle_polygon(grown_inner, chord_error)[::-1]
    return Stamp(grown_outer, grown_inner, circle_polygon(grown_outer, chord_error), hole)


def circle_polygon(radius_mm: float, chord_error_mm: float) -> Contour:
    """A regular polygon of the circle's area that strays from it by at most `chord_error_mm`, counter-clockwise.

    With n corners at angle steps t = 2 pi / n, equal area asks for the corner radius R sqrt(t / sin t); the
    corners then lie about R t^2 / 12 outside and the edges' middles R t^2 / 24 inside the circle.
    """
    count = 12
    while radius_mm * (_corner_over_radius(count) - 1) > chord_error_mm:
        count += 4
    turn = 2 * np.pi / count * np.arange(count)
    return radius_mm * _corner_over_radius(count) * np.stack([np.cos(turn), np.sin(turn)], axis=1)


def _corner_over_radius(count: int) -> float:
    """Corner radius of the regular polygon with the unit circle's area."""
    step = 2 * math.pi / count
    return math.sqrt(step / math.sin(step))


def moved_in(polygon: Contour, distance: float) -> Contour:
    """A convex counter-clockwise polygon with every side moved inwards."""
    edge = np.roll(polygon, -1, axis=0) - polygon
    inward = np.stack([-edge[:, 1], edge[:, 0]], axis=1) / np.linalg.norm(edge, axis=1, keepdims=True)
    before = np.roll(inward, 1, axis=0)
    # A corner moves to where the two moved sides meet: n1.x = n2.x = distance.
    shift = (inward + before) / (1 + (inward * before).sum(axis=1, keepdims=True))
    moved: Contour = polygon + distance * shift
    return moved
