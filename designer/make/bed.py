"""How the target lies on the printer's bed: its last face down, in the middle or as near to it as the bed is free.

What lies on the printer's bed at a time.

What changes of filament throw away: purge, and the tower that is printed of it beside the part.

    >>> purged(estimate.changing, printer).volume_mm3

The tower is PrusaSlicer's (`GCode/WipeTower.cpp`, of which those of Bambu Studio and OrcaSlicer descend): a box around
lines of purge, from a solid foot with a brim up to the last change. The first three lines of a change are slow, since
the filament has just been loaded. What other slicers do for towers that are high and thin is not in it.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from manifold3d import CrossSection

from designer.base.arrays import Array
from designer.base.units import NO_SKEW, skew_matrix
from designer.kinds.board_cuts import strip_mm
from designer.kinds.layout import face_down, is_turned, lip_of
from designer.make.mesh import Part
from designer.spec.machine import BRIM_MM, TOWER_DEPTH_MM, Area
from designer.spec.spec import PrinterProfile, PrintSpec, beside
from designer.target import TargetGeometry, corners_mm

_ALIKE = 1e-6
"""Normals differ by more."""
_ROUNDING_MM = 1e-6
"""Lengths of a part come out of turns of the design."""
QUARTER_TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def bed_from_target(target: TargetGeometry, printing: PrintSpec) -> Array:
    """The rigid motion that puts the printed part on the bed.

    The outward normal of the last face turns to -z (a board has only one), the lowest point comes to z = 0, and the
    longer of the two horizontal extents runs along the bed's longer side. It lies in the bed's middle, or as near to it
    as a prime tower and what the printer excludes of its bed allow. Skew compensation does not turn the part.

    Returns:
        bed_from_target, from the target frame in millimetres to the bed with its origin in a corner.  # (4, 4)
    """
    rotation = _bed_axes(target, printing)
    turned = printed_corners_mm(target, printing) @ rotation.T
    low, (width, depth, _) = turned.min(axis=0), np.ptp(turned, axis=0).tolist()
    motion = np.eye(4)
    motion[:3, :3] = rotation
    strip = strip_mm(printing.printer) if len(printing.filament_colours) > 1 else np.zeros(2)
    motion[:3, 3] = [*printing.printer.laid_mm((width, depth), (float(strip[0]), float(strip[1]))), 0.0] - low
    return motion


def against_skew(target: TargetGeometry, printing: PrintSpec, points_mm: Array) -> Array:
    """Points of the target frame where the printed files have them: K^-1 along the bed's axes, about the origin.

    K is the `skew_matrix` of the compensation, so a printer with this skew puts them where the design has them.

    Args:
        target: the design.
        printing: gives the compensation; with none the points stay as they are.
        points_mm: in the target frame.  # (N, 3)
    """
    return against_skew_along(_bed_axes(target, printing), printing, points_mm)


def against_skew_along(bed_axes: Array, printing: PrintSpec, points_mm: Array) -> Array:
    """Points of a piece's frame where the printed files have them; `bed_axes` turn it to the bed's axes.  # (3, 3)"""
    if printing.skew_compensation_rad == NO_SKEW:
        return points_mm
    shear = bed_axes.T @ np.linalg.inv(skew_matrix(printing.skew_compensation_rad)) @ bed_axes
    return mapped(points_mm, shear)


def mapped(points_mm: Array, matrix: Array) -> Array:
    """A (3, 3) matrix times each point; like points stay alike to the bit, as the parts of a print need.  # (N, 3)

    Matrix products of libraries do not promise that: their rounding depends on a point's place in the array.
    """
    x, y, z = (points_mm[:, k, None] * matrix[:, k] for k in range(3))
    return x + y + z


def printed_size_mm(target: TargetGeometry, printing: PrintSpec) -> tuple[float, float, float]:
    """The part's bounding box along the bed's axes, as `bed_from_target` lays it."""
    corners = printed_corners_mm(target, printing)
    x, y, z = np.ptp(corners @ _bed_axes(target, printing).T, axis=0).tolist()
    return x, y, z


def bed_words(printer: PrinterProfile) -> str:
    """`the bed of bambu-p1s has 256 x 256 x 256 mm, of which 18 x 28 mm in front left may not be printed on`."""
    room = " x ".join(f"{length:g}" for length in printer.bed_mm)
    but = f", of which {printer.excluded_words} may not be printed on" if printer.machine.excluded_mm else ""
    return f"the bed of {printer.name} has {room} mm{but}"


def overhang(target: TargetGeometry, printing: PrintSpec) -> tuple[int, float] | None:
    """How many faces hang over most, and how steeply they rise from the bed (rad); None: none does."""
    up = bed_from_target(target, printing)[2, :3]
    downward = -(target.target_from_face[:, :3, 2] @ up)
    over = downward[(downward > _ALIKE) & (downward < 1 - _ALIKE)]
    if not len(over):
        return None
    return int((over > over.max() - _ALIKE).sum()), math.acos(float(over.max()))


def printed_corners_mm(target: TargetGeometry, printing: PrintSpec) -> Array:
    """Corners of the printed solid in the target frame, with shrinkage and skew compensation and without stickers.

    A target made by others (without a spec) counts as flat faces.  # (N, 3)
    """
    return against_skew(target, printing, _straight_corners_mm(target, printing))


def _bed_axes(target: TargetGeometry, printing: PrintSpec) -> Array:
    """Rotation from the target's axes to the bed's, from the part before it is sheared.  # (3, 3)"""
    bed_x, bed_y, _ = printing.printer.bed_mm
    rotation = face_down(target)
    return QUARTER_TURN @ rotation if is_turned(target, is_bed_deep=bed_y > bed_x) else rotation


def _straight_corners_mm(target: TargetGeometry, printing: PrintSpec) -> Array:
    """Corners of the printed solid, not yet sheared.  # (N, 3)"""
    corners, spec = corners_mm(target), target.spec
    if spec is not None and spec.body is None:
        corners = np.concatenate([corners, corners - spec.depth_mm * target.target_from_face[:, None, :3, 2]])
    elif spec is not None and spec.solid is not None and printing.way.has_stickers:
        inradius, thickness = spec.solid.inradius_mm, printing.sticker_thickness_mm
        corners = corners * (1 - thickness / inradius)
        if printing.lip:  # but on the face that lies on the bed
            down, lowest = target.target_from_face[-1, :3, 2], inradius - thickness
            corners = corners_mm(target) * (1 + lip_of(target, printing).rise_mm / inradius)
            corners = corners - np.maximum(corners @ down - lowest, 0.0)[..., None] * down
    elif spec is not None and spec.solid is None and spec.body is not None:  # its bare faces, too
        corners = spec.body.corners_mm(below_mm=printing.sticker_thickness_mm * printing.way.has_stickers)
    printed: Array = corners.reshape(-1, 3) * (1 + printing.shrink_compensation_percent / 100)
    if spec is not None and printing.way.ink == "raised":  # the target's plane is half-way up the walls
        above = printing.inlay_mm / 2
        printed[:, 2] = np.where(printed[:, 2] < 0, -above - printing.below_raised_mm(spec.depth_mm), above)
    return printed


@dataclass(frozen=True, eq=False)
class Piece:
    """A part and where it lies; slicers show it as one object."""

    name: str
    part: Part  # in a frame of its own
    bed_from_part: Array  # (4, 4) a rigid motion; the bed's origin is a corner

    @property
    def as_it_lies(self) -> Part:
        """The part on its bed, for files that say nothing of motions."""
        motion = self.bed_from_part
        return self.part.placed(lambda points: mapped(points, motion[:3, :3]) + motion[:3, 3])


@dataclass(frozen=True)
class Plate:
    """The pieces of one print."""

    name: str  # part of its files' names, such as "plate-1"; "" where there is but one plate
    pieces: tuple[Piece, ...]
    words: str = ""  # what it holds, such as "tiles 0 to 6"
    tower_area: Area | None = None  # what of the bed is left free for a prime tower

    @property
    def title(self) -> str:
        """`plate 1, tiles 0 to 6`: letters that a file's name may hold, as slicers ask of a plate's name."""
        return ", ".join(part for part in (self.name.replace("-", " "), self.words) if part)

    @property
    def is_two_filament(self) -> bool:
        """Whether there is ink on it."""
        return any(piece.part.ink is not None for piece in self.pieces)

    @property
    def is_raised(self) -> bool:
        """Whether all ink is above all body, so that the filament changes once."""
        return any(piece.part.fused is not None for piece in self.pieces)

    def change_z_mm(self, layer_mm: float) -> float | None:
        """The top of the first layer of raised ink, above the bed; None: the filament changes elsewhere or never."""
        ink = [piece.as_it_lies.ink for piece in self.pieces if piece.part.fused is not None]
        lowest = [float(one.vertices_mm[:, 2].min()) for one in ink if one is not None]
        return round(min(lowest) + layer_mm, 6) if lowest else None

    @property
    def in_turn(self) -> "tuple[Plate, Plate, float]":
        """Raised ink apart from its body, both down on the bed where they lie together, and the body's height there."""
        (piece,) = self.pieces
        body, ink, lies = piece.part.body, piece.part.ink, piece.as_it_lies.ink
        assert ink is not None  # noqa: S101 - it is raised
        assert lies is not None  # noqa: S101
        height_mm, lowered = float(lies.vertices_mm[:, 2].min()), piece.bed_from_part.copy()
        lowered[2, 3] -= height_mm
        below = Piece(f"{piece.name} body", Part(body, None), piece.bed_from_part)
        above = Piece(f"{piece.name} pattern", Part(ink, None), lowered)
        return Plate("body", (below,)), Plate("pattern", (above,)), round(height_mm, 6)

    def tower_mm(self, width_mm: float, depth_mm: float) -> tuple[float, float] | None:
        """The front left corner of a prime tower in the middle of the place left free for it, a brim off the rim."""
        if self.tower_area is None:
            return None
        left, front, right, rear = self.tower_area
        return max((left + right - width_mm) / 2, left + BRIM_MM), max((front + rear - depth_mm) / 2, front + BRIM_MM)


APART_MM = 8.0
"""Between pieces in rows: room for two brims."""


def lying(name: str, part: Part, axes: Array, printing: PrintSpec) -> Piece:
    """A part with shrinkage compensation, and sheared against the printer's skew, as it lies but not yet where."""
    scale, motion = 1 + printing.shrink_compensation_percent / 100, np.eye(4)
    motion[:3, :3] = axes
    return Piece(name, part.placed(lambda points: against_skew_along(axes, printing, scale * points)), motion)


def in_rows(
    pieces: Sequence[Piece], width_mm: float, place: Callable[[tuple[float, float]], tuple[float, float] | None]
) -> Iterator[tuple[Piece, ...]]:
    """Pieces side by side in rows from the left front, moved together to their place, on as many beds as they take.

    Args:
        pieces: as they lie.
        width_mm: of the rows.
        place: the front left corner of a rectangle of a size; None: there is no room for it.
    """
    row: list[Piece] = []
    at, deepest, together = np.zeros(2), 0.0, (0.0, 0.0)

    def moved() -> tuple[Piece, ...]:
        step, corner = np.zeros((4, 4)), place(together)
        assert corner is not None  # noqa: S101 - they were put together so
        step[:2, 3] = corner
        return tuple(replace(piece, bed_from_part=piece.bed_from_part + step) for piece in row)

    for piece in pieces:
        turned = piece.part.body.vertices_mm @ piece.bed_from_part[:3, :3].T
        low, (width, depth, _) = turned.min(axis=0), np.ptp(turned, axis=0).tolist()
        if row and at[0] + width > width_mm + _ROUNDING_MM:
            at, deepest = np.array([0.0, at[1] + deepest + APART_MM]), 0.0
        larger = (max(together[0], float(at[0]) + width), float(at[1]) + max(deepest, depth))
        if row and place(larger) is None:
            yield moved()
            row, at, deepest, larger = [], np.zeros(2), 0.0, (width, depth)
        motion, together = piece.bed_from_part.copy(), larger
        motion[:3, 3] = [at[0] - low[0], at[1] - low[1], -low[2]]
        row.append(replace(piece, bed_from_part=motion))
        at, deepest = at + np.array([width + APART_MM, 0.0]), max(deepest, depth)
    if row:
        yield moved()


def numbered(
    inked: Iterable[tuple[Piece, ...]], others: Iterable[tuple[Piece, ...]], tower: Area,
    words: Callable[[tuple[Piece, ...]], str],
) -> tuple[Plate, ...]:  # fmt: skip
    """Plates in the order to print: those with ink leave room for a tower."""
    groups = [*((group, tower) for group in inked), *((group, None) for group in others)]
    return tuple(Plate(f"plate-{number}", group, words(group), area) for number, (group, area) in enumerate(groups, 1))


def tower_area(corners_mm: Array, printer: PrinterProfile) -> Area | None:
    """The widest place for a prime tower beside a part, else a square at a corner of the bed that is clear of it.

    Args:
        corners_mm: of the part on the bed.  # (N, 2)
        printer: whose bed it is.
    """
    (left, front), (right, rear) = corners_mm.min(axis=0).tolist(), corners_mm.max(axis=0).tolist()
    rooms = printer.rooms_mm()
    strips = [part for room in rooms for part in beside(room, (left, front, right, rear))]
    wide = [part for part in strips if min(part[2] - part[0], part[3] - part[1]) >= TOWER_DEPTH_MM]
    if wide:
        return max(wide, key=lambda part: (min(part[2] - part[0], part[3] - part[1]), part[2] - part[0]))
    shadow = CrossSection.hull_points(corners_mm)
    for side in (TOWER_MM, (TOWER_MM + TOWER_DEPTH_MM) / 2, TOWER_DEPTH_MM):
        for x, y in ((x, y) for room in rooms for x in (room[0], room[2] - side) for y in (room[1], room[3] - side)):
            if (CrossSection.square((side, side)).translate((x, y)) ^ shadow).is_empty():
                return x, y, x + side, y + side
    return None


TOWER_MM, TOWER_BRIM_MM = 60.0, 2.0
"""Width of PrusaSlicer's wipe tower, and its brim; others are narrower and deeper."""
_FIRST_LINES, _NEXT_LINE = (0.33, 0.375, 0.458), 0.875
"""How fast the lines of a change are, as shares of the full speed; those that follow approach it."""
_GAIN_MM_S = 50 / 60
"""By how much a line is faster than the one before it."""
_BOX = 2900 / 4800
"""How fast the box is, as a share of the full speed."""


@dataclass(frozen=True)
class Purged:
    """What all changes of a print purge."""

    volume_mm3: float
    time_s: float


def purged(changing: Sequence[int], printer: PrinterProfile) -> Purged:
    """By the layers that change filament: first to the ink, then back to the body, and so on."""
    machine, change = printer.machine, printer.machine.change
    flow_mm3_s = min(change.purge_flow_mm3_s, machine.flow_mm3_s)
    volumes = [change.purge_to_body_mm3 if k % 2 else change.purge_to_ink_mm3 for k in range(len(changing))]
    if not changing or not change.has_tower:
        return Purged(sum(volumes), sum(volumes) / flow_mm3_s)
    line_mm2 = printer.line_width_mm * printer.layer_height_mm
    speed_mm_s, layers = flow_mm3_s / line_mm2, changing[-1] + 1
    laid = [min(volume, change.most_on_tower_mm3) for volume in volumes]
    most_mm3 = min(max(change.purge_to_ink_mm3, change.purge_to_body_mm3), change.most_on_tower_mm3)
    deep_mm = most_mm3 / (TOWER_MM * printer.layer_height_mm)
    # Purge fills the box line by line: it is rounded up to whole ones, half a line on the mean; the ends are walls.
    walls_mm = (2 * deep_mm + TOWER_MM / 2) * layers
    # The foot is solid; a change in the first layer is a part of it.
    foot_mm = TOWER_MM * deep_mm * printer.layer_height_mm / line_mm2 - (laid[0] / line_mm2 if changing[0] == 0 else 0)
    brim_mm = 2 * (TOWER_MM + deep_mm) * TOWER_BRIM_MM * printer.layer_height_mm / line_mm2
    # Some of the purge is laid down as the box.
    box_mm = 2 * (TOWER_MM + deep_mm) * layers
    lines_mm = max(sum(laid) / line_mm2 + walls_mm - box_mm, 0.0) / len(changing)
    first_mm_s = min(machine.speeds.first_layer_mm_s, speed_mm_s)
    time_s = (
        (sum(volumes) - sum(laid)) / flow_mm3_s
        + len(changing) * _lines_s(lines_mm, speed_mm_s)
        + box_mm / (_BOX * speed_mm_s)
        + (foot_mm + brim_mm) / first_mm_s
    )
    return Purged(sum(volumes) + (walls_mm + foot_mm + brim_mm) * line_mm2, time_s)


def _lines_s(length_mm: float, speed_mm_s: float) -> float:
    """The lines of one change, as long together as told."""
    after = max(math.ceil(length_mm / TOWER_MM) - len(_FIRST_LINES), 0)
    speeds = [*(share * speed_mm_s for share in _FIRST_LINES)]
    speeds += [min(_NEXT_LINE * speed_mm_s + k * _GAIN_MM_S, speed_mm_s) for k in range(after)]
    lengths = np.clip(length_mm - TOWER_MM * np.arange(len(speeds)), 0, TOWER_MM)
    return float((lengths / np.array(speeds)).sum())
