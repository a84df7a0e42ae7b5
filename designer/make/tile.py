"""One face of a solid as a flat tile with mitred sides, and the keys that let it into its own seat only.

A tile's frame is its face's: z points outwards and the printed face is at z = 0, so that the tile reaches down to
z = -thickness. Two tiles meet in the plane that halves the angle of their faces; each is cut back from it by half the
clearance. All lengths are the design's: shrinkage and skew compensation come with the bed.
"""

import math
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise

import numpy as np
from manifold3d import triangulate

from designer.base.arrays import Array
from designer.base.codes import CODES, code_positions
from designer.base.errors import InputError
from designer.base.solid import Polyhedron, Solid
from designer.make.lettering import CHAMFER_LAYERS, HEIGHT, text_contours, text_width
from designer.make.mesh import CIRCLE_SEGMENTS, Hull, Ids, Part, inlaid, wall_strip
from designer.make.pattern import Contour, Pattern, moved_in
from designer.spec.build import InkSide
from designer.spec.spec import PrinterProfile

THICKNESS_OVER_EDGE = 0.04
MOST_THICKNESS_MM = 4.0
MOST_EDGE_TENTHS = 5000
"""Of a millimetre: edges among which one is looked for that has room for keys."""
"""As in the prints whose hours and grams are known (edge 100 mm); stiff enough to lie flat."""
ENGRAVED_LAYERS = 2
CLOSED_LAYERS = 2
"""Between ink and an engraving or a hole behind it."""
MOST_PIN_MM = 4.0
PEG_MM = 1.75
"""Of a piece of filament, which joins a tile that has no pins."""
LEAST_PIN_LINES = 2
KEY_RADIUS = 0.56
"""Of the circle on which keys stand, over the seat's inradius: inside the pads, outside the number."""
PAD_INSET = 0.3
"""How far the pads' centres lie from the seat's sides, over its inradius."""
PAD_TURNS = (math.pi / 2, 7 * math.pi / 6, 11 * math.pi / 6)
MOST_PUSH_MM = 11.0
PUSH_WALL_LINES = 4
LETTER_STROKE_MM = 1.0
ID_STROKE_MM = 0.6


@dataclass(frozen=True)
class TileSizes:
    """Lengths that all tiles of a solid and their seats share."""

    outline_mm: Contour  # of a face, counter-clockwise from the code's corner on  # (K, 2)
    inset_per_depth: float
    thickness_mm: float
    inlay_mm: float
    clearance_mm: float  # between neighbours, and around a key
    chamfer_mm: float  # at the edge that lies on the bed
    layer_mm: float
    line_mm: float
    key_mm: float  # diameter of pins, or of loose pegs
    engaged_mm: float  # how deep a key stands in its seat
    ink_side: InkSide
    is_on_shell: bool  # the core is thin, and hollow as a whole

    @property
    def has_pins(self) -> bool:
        """Whether pins stand on the back; else there are holes for loose pegs, as the back lies on the bed."""
        return self.ink_side == "down"

    @property
    def glue_gap_mm(self) -> float:
        """Between the back and the seat, as high as the pads."""
        return self.layer_mm

    @property
    def seat_depth_mm(self) -> float:
        """Of the seat below the face."""
        return self.thickness_mm + self.glue_gap_mm

    @property
    def key_hole_mm(self) -> float:
        """Diameter of the holes for keys."""
        return self.key_mm + 2 * self.clearance_mm

    @property
    def peg_depth_mm(self) -> float:
        """Of the holes for loose pegs in a back."""
        return self.thickness_mm - self.inlay_mm - CLOSED_LAYERS * self.layer_mm

    @property
    def peg_length_mm(self) -> float:
        """Of a loose peg."""
        return self.peg_depth_mm + self.glue_gap_mm + self.engaged_mm

    @property
    def cut_back_mm(self) -> float:
        """In the face, from the solid's edge: half the clearance, measured across the mitre."""
        return self.clearance_mm / 2 * math.hypot(1.0, self.inset_per_depth)

    @property
    def seat_inradius_mm(self) -> float:
        """Of the seat."""
        return float(-self.outline_mm[:, 1].min()) - self.inset_per_depth * self.seat_depth_mm

    @property
    def key_radius_mm(self) -> float:
        """Of the circle that keys stand on."""
        return KEY_RADIUS * self.seat_inradius_mm

    @property
    def pad_radius_mm(self) -> float:
        """Of a seat's pads."""
        return min(3.0, 0.1 * self.seat_inradius_mm)

    @property
    def push_radius_mm(self) -> float:
        """Of the hole in a seat's middle, through which a finger, or through a wall a stick, pushes a tile out."""
        if not self.is_on_shell:
            return min(3.0, 0.12 * self.seat_inradius_mm)
        return min(MOST_PUSH_MM, self.key_radius_mm - self.key_hole_mm / 2 - PUSH_WALL_LINES * self.line_mm)

    def outline_at(self, depth_mm: float, extra_mm: float = 0.0) -> Contour:
        """The tile's outline at a depth below its face, moved in a little more.  # (K, 2)"""
        return moved_in(self.outline_mm, self.cut_back_mm + self.inset_per_depth * depth_mm + extra_mm)


def tile_sizes(
    solid: Solid,
    outline_mm: Contour,
    border_mm: float,
    printer: PrinterProfile,
    inlay_mm: float,
    ink_side: InkSide,
    *,
    is_on_shell: bool,
) -> TileSizes:
    """Sizes for a solid.

    Raises:
        InputError: the edge is too small for keys that this printer can make.
    """
    layer, shape = printer.layer_height_mm, solid.polyhedron
    sizes = TileSizes(
        outline_mm=outline_mm, inset_per_depth=shape.inset_per_depth,
        thickness_mm=thickness_mm(solid.edge_mm, inlay_mm, layer), inlay_mm=inlay_mm, clearance_mm=printer.clearance_mm,
        chamfer_mm=min(CHAMFER_LAYERS * layer, border_mm / 4), layer_mm=layer, line_mm=printer.line_width_mm,
        key_mm=PEG_MM, engaged_mm=PEG_MM, ink_side=ink_side, is_on_shell=is_on_shell,
    )  # fmt: skip

    def room_mm(edge_mm: float) -> float:
        """For a key, behind a tile of this edge."""
        outline, thickness = edge_mm / solid.edge_mm * outline_mm, thickness_mm(edge_mm, inlay_mm, layer)
        radius = replace(sizes, outline_mm=outline, thickness_mm=thickness).key_radius_mm
        return 0.9 * radius * 2 * math.pi / spot_count(shape) - 2 * sizes.clearance_mm

    room = room_mm(solid.edge_mm)
    key = PEG_MM if ink_side == "up" else min(MOST_PIN_MM, room)
    least_key = PEG_MM if ink_side == "up" else LEAST_PIN_LINES * printer.line_width_mm
    if room < least_key:
        # Tiles grow thicker by whole layers, which takes room away again: none above the last that fails does.
        tenths = (tenth for tenth in range(MOST_EDGE_TENTHS, 0, -1) if room_mm(tenth / 10) < least_key)
        edge = next(tenths) // 10 + 1
        what = f"keys of {PEG_MM:g}mm filament" if ink_side == "up" else f"pins of two lines ({least_key:g}mm)"
        raise InputError(
            f"edge {solid.edge_mm:g}mm has no room for {what} behind a tile; use an edge of at least {edge}mm, or "
            "build one-piece"
        )
    return replace(sizes, key_mm=round(key, 3), engaged_mm=min(3.0, max(key, 3 * layer)))


def thickness_mm(edge_mm: float, inlay_mm: float, layer_mm: float) -> float:
    """Of the tiles of an edge, in whole layers."""
    least = math.ceil(inlay_mm / layer_mm - 1e-9) + ENGRAVED_LAYERS + 2 * CLOSED_LAYERS
    wanted = round(min(THICKNESS_OVER_EDGE * edge_mm, MOST_THICKNESS_MM) / layer_mm)
    return round(max(least, wanted) * layer_mm, 6)


def spot_count(shape: Polyhedron) -> int:
    """Places for keys on a circle, those of turned tiles included."""
    return shape.sides * len(code_positions(shape.face_code[0]))


@cache
def key_spots(sides: int, positions: int) -> tuple[int, ...]:
    """Which of the circle's `sides * positions` spots stands for each position of a code.

    A turn by one side moves a spot by `positions` of them: spots whose numbers leave different rests by it never fall
    together, however a tile is turned. Of the spots with the right rest, the one farthest from those before is taken.
    """
    count = sides * positions
    chosen = [0]
    for position in range(1, positions):
        copies = range(position, count, positions)
        chosen.append(max(copies, key=lambda spot: min(_around(spot - other, count) for other in chosen)))
    return tuple(chosen)


def _around(step: int, count: int) -> int:
    return min(step % count, -step % count)


def key_places(sizes: TileSizes, code: int) -> Array:
    """Where the keys of a face with this code stand, in its frame: at the spots of the code's dots.  # (3, 2)"""
    sides, positions = len(sizes.outline_mm), code_positions(code)
    spots = key_spots(sides, len(positions))
    turn = 2 * math.pi / (sides * len(positions))
    angles = np.array([turn * spots[row] for row, place in enumerate(positions) if place in CODES[code]])
    return sizes.key_radius_mm * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def pad_places(sizes: TileSizes) -> Array:
    """Where a seat's three pads stand: a third of a turn apart, so far out as leaves a rim.  # (3, 2)"""
    r = sizes.seat_inradius_mm
    inner = moved_in(sizes.outline_mm, float(-sizes.outline_mm[:, 1].min()) - (1 - PAD_INSET) * r)
    edge = np.roll(inner, -1, axis=0) - inner
    inward = np.stack([-edge[:, 1], edge[:, 0]], axis=1) / np.linalg.norm(edge, axis=1, keepdims=True)
    toward = np.stack([np.cos(PAD_TURNS), np.sin(PAD_TURNS)], axis=1)
    # A ray leaves a convex outline through the nearest of the sides that it runs towards.
    rate = -toward @ inward.T
    far = -(inner * inward).sum(axis=1)
    distance = np.where(rate > 1e-9, far / np.where(rate > 1e-9, rate, 1.0), np.inf).min(axis=1)
    places: Array = distance[:, None] * toward
    return places


def number_contours(sizes: TileSizes, number: int) -> tuple[Contour, ...]:
    """A face's number inside the circle of keys, else outside by the code's corner; none where there is no room."""
    text, below = str(number), sizes.push_radius_mm + 2 * sizes.line_mm
    around, margin = sizes.key_hole_mm / 2 + sizes.line_mm, sizes.chamfer_mm + sizes.line_mm
    low = sizes.key_radius_mm + around
    high = float(pad_places(sizes)[0, 1]) - sizes.pad_radius_mm - sizes.line_mm
    for stroke in np.arange(LETTER_STROKE_MM, sizes.line_mm - 1e-9, -0.05).tolist():
        height = HEIGHT * stroke
        if math.hypot(below + height, text_width(text) * stroke / 2) <= sizes.key_radius_mm - around:
            return text_contours(text, stroke, -below - height)
        outside = text_contours(text, stroke, (low + high - height) / 2)
        if low + height <= high and _is_within(outside, sizes.outline_at(sizes.thickness_mm, margin)):
            return outside
    return ()


def _is_within(contours: tuple[Contour, ...], outline: Contour) -> bool:
    """Whether a convex outline holds them all."""
    edge = np.roll(outline, -1, axis=0) - outline
    inward = np.stack([-edge[:, 1], edge[:, 0]], axis=1)
    room = (np.concatenate(contours)[:, None] - outline) * inward
    return bool((room.sum(axis=2) >= 0).all())


def id_contours(sizes: TileSizes, text: str) -> tuple[Contour, ...]:
    """The target id between the keys and the lowest side; none where there is no room for it."""
    high = -sizes.key_radius_mm - sizes.key_mm / 2 - sizes.line_mm
    low = -(sizes.seat_inradius_mm - 2 * sizes.line_mm)
    apart = 2 * (abs(pad_places(sizes)[1, 0]) - sizes.pad_radius_mm - sizes.line_mm)
    stroke = min((high - low) / HEIGHT, apart / text_width(text), ID_STROKE_MM)
    if stroke < sizes.line_mm:
        return ()
    return text_contours(text, stroke, (low + high - HEIGHT * stroke) / 2)


def make_tile(pattern: Pattern, face: int, code: int, target_id: str, sizes: TileSizes) -> Part:
    """One face's tile in its frame.

    Args:
        pattern: the ink of all faces, in the design's size.
        face: its number.
        code: of the face, which its keys repeat.
        target_id: as it is engraved.
        sizes: of all tiles.
    """
    letters = (*number_contours(sizes, face), *id_contours(sizes, target_id))
    key = _pin(sizes) if sizes.has_pins else _peg_hole(sizes)
    steps = [[ring + np.array([x, y, 0.0]) for ring in key] for x, y in key_places(sizes, code).tolist()]
    steps += [_engraved(contour, sizes) for contour in letters]
    return inlaid(*_hull_of(pattern, face, sizes, steps), sizes.inlay_mm)


Steps = list[Array]
"""Rings of equally many points, from a tile's back to the last one, which is closed.  # (N, 3) each"""


def _ring(radius_mm: float, z_mm: float) -> Array:
    """A circle in points, counter-clockwise from outside the face."""
    turn = 2 * np.pi / CIRCLE_SEGMENTS * np.arange(CIRCLE_SEGMENTS)
    ring: Array = np.stack([radius_mm * np.cos(turn), radius_mm * np.sin(turn), np.full(len(turn), z_mm)], axis=1)
    return ring


def _pin(sizes: TileSizes) -> Steps:
    """A pin on the back, its end chamfered."""
    back, radius, length = -sizes.thickness_mm, sizes.key_mm / 2, sizes.glue_gap_mm + sizes.engaged_mm
    tip = min(0.2 * sizes.key_mm, length / 3)
    return [_ring(radius, back), _ring(radius, back + tip - length), _ring(radius - tip, back - length)]


def _peg_hole(sizes: TileSizes) -> Steps:
    """A hole for a loose peg."""
    back, radius = -sizes.thickness_mm, sizes.key_hole_mm / 2
    return [_ring(radius, back), _ring(radius, back + sizes.peg_depth_mm)]


def _engraved(contour: Contour, sizes: TileSizes) -> Steps:
    """A letter, to be read from behind."""
    mirrored, back = (contour * [-1.0, 1.0])[::-1], -sizes.thickness_mm
    depths = (back, back + ENGRAVED_LAYERS * sizes.layer_mm)
    return [np.column_stack([mirrored, np.full(len(mirrored), z)]) for z in depths]


def _back_skin(outline: Contour, steps: list[Steps], outline_id: int, first_id: int) -> Ids:
    """Triangles of a back with its pins and pits, whose points are numbered on from `first_id`.  # (T, 3)"""
    holes = [rings[0][::-1, :2] for rings in steps]
    ids = [np.arange(outline_id, outline_id + len(outline), dtype=np.int32)]
    skin = []
    for rings in steps:
        count = len(rings[0])
        own = np.arange(first_id, first_id + len(rings) * count, dtype=np.int32).reshape(len(rings), count)
        first_id += own.size
        ids.append(own[0, ::-1])
        skin += [wall_strip(upper, lower) for upper, lower in pairwise(own)]
        skin.append(own[-1][triangulate([rings[-1][:, :2]])[:, ::-1]])
    plane = np.concatenate(ids)[triangulate([outline, *holes])[:, ::-1]]
    return np.concatenate([plane, *skin])


def _hull_of(pattern: Pattern, face: int, sizes: TileSizes, steps: list[Steps]) -> tuple[Pattern, Hull]:
    """The face's ink alone, in its own frame, and the prism around it: outlines at four depths, and steps."""
    chamfer, thickness, inlay = sizes.chamfer_mm, sizes.thickness_mm, sizes.inlay_mm
    if sizes.ink_side == "down":
        levels = [(0.0, chamfer), (chamfer, 0.0), (inlay, 0.0), (thickness, 0.0)]
        floor_level = 2
    else:
        levels = [(0.0, 0.0), (inlay, 0.0), (thickness - chamfer, 0.0), (thickness, chamfer)]
        floor_level = 1
    loops = [sizes.outline_at(depth, extra) for depth, extra in levels]
    corners = len(loops[0])
    vertices = np.concatenate(
        [np.column_stack([loop, np.full(corners, -z)]) for loop, (z, _) in zip(loops, levels, strict=True)]
    )
    ids = np.arange(len(vertices), dtype=np.int32).reshape(len(levels), corners)
    strips = [wall_strip(upper, lower) for upper, lower in pairwise(ids)]
    back = _back_skin(loops[-1], steps, int(ids[-1, 0]), len(vertices))
    hull = Hull(
        vertices_mm=np.concatenate([vertices, *(ring for rings in steps for ring in rings)]),
        top=ids[:1], floor=ids[floor_level : floor_level + 1], floor_outline_mm=loops[floor_level][None],
        body_skin=np.concatenate([*strips[floor_level:], back]), rim=np.concatenate(strips[:floor_level]),
    )  # fmt: skip
    mine = replace(pattern.faces[face], outline=loops[0])
    if mine.window is None:
        raise InputError("a tile needs a border; use one of at least two line widths")
    return replace(pattern, faces=(mine,), target_from_face=np.eye(4)[None]), hull
