"""Face numbers and the target id, as stencil letters that no border following can take for a ring.

A closed loop of ink (0, 8, A) around white would be a ring to the detector, so every loop has a gap. Letters
stand on a grid of strokes: 5 wide, 7 high, 1 apart; b and d are small letters, as on a seven-segment display.
"""

from dataclasses import dataclass

import numpy as np

from designer.base.arrays import Array
from designer.kinds.layout import inset_per_depth, sticker_inset_mm
from designer.spec.spec import PrintSpec
from designer.target import TargetGeometry

SAME_HEIGHT_MM = 1e-3
WIDTH, HEIGHT, GAP = 5, 7, 1  # in strokes
MAX_STROKE_MM = 0.6
CHAMFER_LAYERS = 2
"""At the edge of a flat piece that lies on the bed: elephant feet bulge in the first layers (an assumption)."""
EDGE_CLEARANCE_MM = 1.0
"""Least distance of letters from a plain board's edge, where it is cut or rounded."""
ID_DIGITS = 8
"""Of the target id that are written."""
PAPER_STROKE_MM = 0.15
"""Thinnest letter stroke that an office printer holds."""

# Each glyph as filled cells, row by row from the top.
_CELLS: dict[str, tuple[str, ...]] = {
    "0": ("##.##", "#...#", "#...#", "#...#", "#...#", "#...#", "##.##"),
    "1": ("..#..", ".##..", "..#..", "..#..", "..#..", "..#..", ".###."),
    "2": ("#####", "....#", "....#", "#####", "#....", "#....", "#####"),
    "3": ("#####", "....#", "....#", ".####", "....#", "....#", "#####"),
    "4": ("#...#", "#...#", "#...#", "#####", "....#", "....#", "....#"),
    "5": ("#####", "#....", "#....", "#####", "....#", "....#", "#####"),
    "6": ("#####", "#....", "#....", "#####", "#...#", "#...#", "##.##"),
    "7": ("#####", "....#", "....#", "....#", "....#", "....#", "....#"),
    "8": ("##.##", "#...#", "#...#", "##.##", "#...#", "#...#", "##.##"),
    "9": ("##.##", "#...#", "#...#", "#####", "....#", "....#", "#####"),
    "A": ("##.##", "#...#", "#...#", "#####", "#...#", "#...#", "#...#"),
    "B": ("#....", "#....", "#....", "#####", "#...#", "#...#", "##.##"),
    "C": ("#####", "#....", "#....", "#....", "#....", "#....", "#####"),
    "D": ("....#", "....#", "....#", "#####", "#...#", "#...#", "##.##"),
    "E": ("#####", "#....", "#....", "####.", "#....", "#....", "#####"),
    "F": ("#####", "#....", "#....", "####.", "#....", "#....", "#...."),
}


LETTERS = frozenset(_CELLS)
"""All that can be written, besides blanks."""


@dataclass(frozen=True)
class Lettering:
    """The letters of each face as counter-clockwise contours, and a line for the person about them."""

    contours: tuple[tuple[Array, ...], ...]  # per face
    remark: str


def letter_faces(target: TargetGeometry, printing: PrintSpec, scale: float) -> Lettering:
    """Write the face number and the target id on every face, where they fit.

    On a face with a border they stand white in the border's strip along the lowest side; on a plain board, dark
    between the rings and the lower edge, a quarter of a ring's diameter away from the rings.

    Args:
        target: the nominal geometry.
        printing: gives the finest stroke, and whether letters are wanted.
        scale: the size of the printed part over the design's; letters stand on the printed part.
    """
    nothing: tuple[tuple[Array, ...], ...] = ((),) * target.face_count
    if not printing.labels:
        return Lettering(nothing, "labels: off")
    if printing.way.is_in_parts and target.is_plate:  # seams would cut them
        return Lettering(nothing, "labels: on the backs of the pieces")
    finest = printing.printer.line_width_mm if printing.way.is_two_filament else PAPER_STROKE_MM
    strips = [_strip(target, printing, finest, scale, face) for face in range(target.face_count)]
    narrowest = min(high - low for low, high in strips)
    stroke = min(narrowest / HEIGHT, MAX_STROKE_MM)
    if stroke < finest:
        room, needed = max(narrowest, 0.0), HEIGHT * finest
        where = "margin" if np.array_equal(target.window_mm, target.outline_mm) else "border"
        why = f"there is room for {room:.2f}mm and they are {needed:.2f}mm high"
        if printing.way.is_in_parts:
            return Lettering(nothing, "labels: on the backs of the tiles")
        return Lettering(nothing, f"labels: left out, {why}; a wider {where} takes them")
    target_id = target.geometry_id[:ID_DIGITS].upper()
    faces = []
    for face, (low, high) in enumerate(strips):
        baseline = (low + high - HEIGHT * stroke) / 2
        outline, top = scale * target.outline_mm[face], baseline + HEIGHT * stroke
        lowest = float(outline[:, 1].min())
        side = outline[outline[:, 1] < lowest + SAME_HEIGHT_MM, 0]
        # At most: above a triangle's lowest side a line is shorter by twice the height over tan 60 deg, at both ends.
        room = float(np.ptp(side)) - 4 * (top - lowest)
        number = str(face)
        choices = [target_id] if target.is_planar else [f"{number} {target_id}", number]
        fitting = [text for text in choices if text_width(text) * stroke <= room]
        middle = round(float(side.min() + side.max()) / 2, 6)
        faces.append(text_contours(fitting[0], stroke, baseline, middle) if fitting else ())
    if not any(faces):
        return Lettering(nothing, f"labels: left out, {max(room, 0.0):.1f}mm is too short a line")
    what = f"target id {target_id}" if target.is_planar else "face numbers"
    return Lettering(tuple(faces), f"labels: {what}, {HEIGHT * stroke:.1f}mm high")


def _strip(
    target: TargetGeometry, printing: PrintSpec, clear_mm: float, scale: float, face: int
) -> tuple[float, float]:
    """From which y to which y letters may stand on a face, in the face frame of the printed part."""
    edge = scale * float(target.outline_mm[face, :, 1].min())
    border_top = scale * float(target.window_mm[face, :, 1].min())
    if border_top > edge:
        # Below the face, the border ends where the neighbour's begins; a sticker is cut there.
        mitre = inset_per_depth(target) * printing.inlay_mm
        if printing.way.has_stickers:
            mitre = sticker_inset_mm(target, printing)
        if printing.way.is_in_parts:  # which are cut back by half the clearance, and chamfered
            mitre += printing.printer.clearance_mm + CHAMFER_LAYERS * printing.printer.layer_height_mm
        return edge + mitre + clear_mm, border_top + printing.ink_offset_mm - clear_mm
    lowest = scale * float((target.center_in_face_mm[:, 1] - 1.5 * target.radius_outer_mm).min())
    if target.spec is not None and len(marks := target.spec.marks_mm):
        lowest = min(lowest, scale * float(marks[..., 1].min()) - clear_mm)
    if target.marks is not None:
        lowest = min(lowest, -0.5 * scale * target.marks[face].size_mm[1] - clear_mm)
    return edge + max(2 * clear_mm, EDGE_CLEARANCE_MM), lowest


def text_width(text: str) -> int:
    """Width of a line in strokes."""
    return len(text) * (WIDTH + GAP) - GAP


def text_contours(text: str, stroke_mm: float, baseline_mm: float, middle_mm: float = 0.0) -> tuple[Array, ...]:
    """A line of text as counter-clockwise contours."""
    left = -text_width(text) / 2
    contours = []
    for place, letter in enumerate(text):
        for outline in glyph_outlines(letter):
            corner = outline + np.array([left + place * (WIDTH + GAP), 0.0])
            contours.append(corner * stroke_mm + np.array([middle_mm, baseline_mm]))
    return tuple(contours)


def glyph_outlines(letter: str) -> tuple[Array, ...]:
    """The letter's contours in strokes, lower left at (0, 0); a blank has none."""
    if letter == " ":
        return ()
    rows = _CELLS[letter]
    filled = {(x, HEIGHT - 1 - y) for y, row in enumerate(rows) for x, cell in enumerate(row) if cell == "#"}
    edges: dict[tuple[int, int], tuple[int, int]] = {}
    for x, y in filled:
        # The sides of a cell that no neighbour shares, counter-clockwise.
        if (x, y - 1) not in filled:
            edges[x, y] = (x + 1, y)
        if (x + 1, y) not in filled:
            edges[x + 1, y] = (x + 1, y + 1)
        if (x, y + 1) not in filled:
            edges[x + 1, y + 1] = (x, y + 1)
        if (x - 1, y) not in filled:
            edges[x, y + 1] = (x, y)
    return tuple(_chains(edges))


def _chains(edges: dict[tuple[int, int], tuple[int, int]]) -> list[Array]:
    """Follow unit edges into closed contours, keeping only the corners."""
    chains = []
    while edges:
        start = min(edges)
        chain = [start]
        while (after := edges.pop(chain[-1])) != start:
            chain.append(after)
        points = np.array(chain, dtype=float)
        step, step_before = np.roll(points, -1, axis=0) - points, points - np.roll(points, 1, axis=0)
        turns = step[:, 0] * step_before[:, 1] != step[:, 1] * step_before[:, 0]
        chains.append(points[turns])
    return chains
