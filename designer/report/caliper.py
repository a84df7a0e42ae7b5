"""What to measure on a printed target with a caliper: lengths, their design values, and what a deviation means."""

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from designer.kinds.faces import PARALLEL, opposite_faces
from designer.make.bed import bed_from_target
from designer.produce import Design
from designer.target import TargetGeometry

REACH_MM = 150.0
"""Of the usual caliper."""
UPRIGHT = "along z"


@dataclass(frozen=True)
class Caliper:
    """One length that a caliper reaches."""

    what: str  # "face 0 to face 15"
    length_mm: float  # of the design
    how: str  # which axis of the printer it shows; "": that does not matter
    option: str = ""  # the name in `calib measure --length NAME:VALUE`; "": not one of its lengths
    error_source: str = ""  # what is off at both of its ends, of the error models' sources
    is_modelled: bool = True  # whether the error models tell how far it usually is off


def caliper_lengths(design: Design) -> tuple[Caliper, ...]:
    """The lengths worth measuring on this target."""
    if design.target.is_planar:
        return _board_lengths(design)
    return _solid_lengths(design)


def _solid_lengths(design: Design) -> tuple[Caliper, ...]:
    """All pairs of opposite faces; where they are out of reach of a caliper, also the sides of the topmost face."""
    up = bed_from_target(design.target, design.job.printing)[2, :3]
    normals = design.target.target_from_face[:, :3, 2]
    rows = []
    for first, second in opposite_faces(design.target):
        lean = math.degrees(math.acos(min(abs(float(normals[first] @ up)), 1.0)))
        how = UPRIGHT if lean < 1 else f"{lean:.1f}° off z"
        if not design.job.printing.is_two_filament:  # nobody knows how the body lay
            how = ""
        name = f"face {first} to face {second}"
        rows.append(Caliper(name, face_to_face_mm(design.target, first, second), how, name, "face_offset"))
    # Of stickers the length of a row is that of the sheet, not that of the body.
    if design.job.printing.is_two_filament and all(needs_rule(design.target, one) for one in rows):
        rows += _sides_of_face(design.target, int(np.argmax(normals @ up)))
    return tuple(rows)


def _sides_of_face(target: TargetGeometry, face: int) -> list[Caliper]:
    """From corner to corner of a face, between the rings that lie there."""
    (rings,) = np.nonzero(target.ring_face == face)
    place, outline = target.center_in_face_mm[rings, :2], target.outline_mm[face]
    nearest = rings[np.linalg.norm(place[:, None] - outline, axis=2).argmin(axis=0)].tolist()
    # Counter-clockwise from the code corner on, which is held up.
    names = ("code", "left", "right") if len(outline) == 3 else ("code", "left", "lowest", "right")
    return [
        _between_rings(target, f"top face ({face}), {a} corner to {b} corner", first, second)
        for (a, first), (b, second) in combinations(zip(names, nearest, strict=True), 2)
    ]


def face_to_face_mm(target: TargetGeometry, first: int, second: int) -> float:
    """Distance of two opposite faces along the first one's normal."""
    frame = target.target_from_face
    return float(frame[first, :3, 2] @ (frame[first, :3, 3] - frame[second, :3, 3]))


def skew_effect_mm(design: Design, skew_rad: float) -> float:
    """By how much one skewed angle of the printer's axes changes the length of the pair of faces that shows it most.

    Two planes n.x = +-r stay parallel under x -> K x and come to lie 2 r / |K^-T n| apart, which for small angles
    is 2 r (1 + n.(K - 1) n).
    """
    axes = bed_from_target(design.target, design.job.printing)[:3, :3]
    normals = design.target.target_from_face[:, :3, 2] @ axes.T
    distance = max(c.length_mm for c in caliper_lengths(design))
    products = [normals[:, a] * normals[:, b] for a, b in ((0, 1), (0, 2), (1, 2))]
    return float(distance * math.tan(skew_rad) * np.abs(products).max())


def _board_lengths(design: Design) -> tuple[Caliper, ...]:
    """Outer size, and the distances of the four rings in the corners."""
    corners = corner_rings(design.target)
    is_printed = design.job.printing.is_two_filament  # else a hand or a shop cuts the plate
    width, height = np.ptp(design.target.outline_mm[0], axis=0).tolist()
    rows = [
        Caliper("width of the plate", width, "", is_modelled=is_printed),
        Caliper("height of the plate", height, "", is_modelled=is_printed),
        Caliper("thickness of the plate", design.job.target.depth_mm, "", is_modelled=False),
    ]
    names = ("lower row", "right column", "upper row", "left column", "diagonal up right", "diagonal up left")
    pairs = ((0, 1), (1, 2), (2, 3), (3, 0), (0, 2), (1, 3))
    for name, (a, b) in zip(names, pairs, strict=True):
        first, second = corners[a], corners[b]
        rows.append(_between_rings(design.target, name, first, second))
    inside = _within_reach(design.target)
    if inside != corners[0] and all(needs_rule(design.target, one) for one in rows if one.option):
        rows.append(_between_rings(design.target, "part of the lower row", corners[0], inside))
    return tuple(rows)


def _between_rings(target: TargetGeometry, name: str, first: int, second: int) -> Caliper:
    option = f"ring {first} to ring {second}"
    return Caliper(f"{name}: {option}", ring_to_ring_mm(target, first, second), "", option, "ring_jitter")


def _within_reach(target: TargetGeometry) -> int:
    """The ring of the lower row farthest from its first that a caliper still takes over both outer edges."""
    first = corner_rings(target)[0]
    place = target.center_in_face_mm
    (row,) = np.nonzero(np.abs(place[:, 1] - place[first, 1]) < PARALLEL)
    distance = np.linalg.norm(place[row] - place[first], axis=1)
    over_edges = distance + target.radius_outer_mm[row] + target.radius_outer_mm[first]
    return int(row[np.argmax(np.where(over_edges <= REACH_MM, distance, 0.0))])


def needs_rule(target: TargetGeometry, one: Caliper) -> bool:
    """Whether a length is out of the usual caliper's reach; of rings, over their outer edges."""
    return one.length_mm + (2 * float(target.radius_outer_mm.max()) if "ring" in one.option else 0.0) > REACH_MM


def corner_rings(target: TargetGeometry) -> tuple[int, int, int, int]:
    """The rings nearest the corners of a board, counter-clockwise from the lower left."""
    place: NDArray[np.float64] = target.center_in_face_mm[:, :2]
    ways = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    a, b, c, d = (int(np.argmax(place @ np.array(way, dtype=float))) for way in ways)
    return a, b, c, d


def ring_to_ring_mm(target: TargetGeometry, first: int, second: int) -> float:
    """Distance of two rings' centres."""
    return float(np.linalg.norm(target.center_mm[first] - target.center_mm[second]))


def skew_per_mm_deg(target: TargetGeometry) -> float:
    """The skew that makes a board's two diagonals differ by 1 mm.

    With sides w and h and a lean a, the squares of the diagonals differ by 4 w h sin a.
    """
    a, b, c, _ = corner_rings(target)
    width, height = ring_to_ring_mm(target, a, b), ring_to_ring_mm(target, b, c)
    diagonal = ring_to_ring_mm(target, a, c)
    return math.degrees(2 * diagonal / (4 * width * height))
