"""What to measure on a print, what deviations mean, and what to type next, for a design's page."""

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from designer.base.units import NO_SKEW, format_skew
from designer.kinds.layout import PARALLEL, opposite_faces
from designer.make.bed import bed_from_target
from designer.page.blocks import Block, Cell, Column, Command, Leaf, Paragraph, Steps, Table
from designer.produce import Design
from designer.report.making import two_digits
from designer.spec.spec import Build
from designer.target import TargetGeometry, bounding_radius_mm
from designer.tolerance.error_file import error_model
from designer.tolerance.made import ERRORS_OF_BUILD
from designer.tolerance.model import ErrorModel

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


_CALIPER_MM = 0.02
_LEAST_EFFECT_MM = 0.005
_SHEET_FIRST = "Measure the sheet on its carrier, as it will be used."
READING = "READING"
"""What stands in the commands where a person's reading belongs: calib measure refuses it."""
_LEAST_RING_PX = 10
SIMULATED_CAMERA = "machine-vision"
"""The camera template that calib render takes unless told otherwise."""
IMAGE_HALF_HEIGHT = 0.4096
"""Of that camera, at distance 1: tangents of half its angles of view, over the height and over the diagonal."""
IMAGE_HALF_DIAGONAL = 0.6383
_SIMULATED_VIEWS = 24
_AIM_SHARE, _PLANAR_AIM_SHARE = 0.8, 0.7
"""How far the camera looks past the target, of the distance from the image's middle to its corners: so far that rings
come into the corners, and that nothing with one face loses the dots that name its rings."""


@dataclass(frozen=True)
class Usual:
    """How far a way of making is usually off: one standard deviation each."""

    template: str
    title: str
    scale: float
    axis_scale: float
    skew_rad: float
    model: ErrorModel

    def of_length_mm(self, one: Caliper) -> float:
        """Standard deviation of a length: scales along it, and what is off at its two ends."""
        ends = self.model.amount(one.error_source).sigma if one.error_source else 0.0
        return math.sqrt(one.length_mm**2 * (self.scale**2 + self.axis_scale**2) + 2 * ends**2)


def usual_errors(build: Build) -> Usual:
    """From the error template of a build."""
    name = ERRORS_OF_BUILD[build]
    model = error_model(name)
    sigma = {source: model.amount(source).sigma for source in ("scale", "axis_scale", "skew")}
    return Usual(name, model.title, sigma["scale"], sigma["axis_scale"], sigma["skew"], model)


def measure_blocks(design: Design) -> tuple[Block, ...]:
    """The lengths, what a deviation means, and the commands that use them."""
    usual = usual_errors(design.job.printing.build)
    meaning = (_board_meaning if design.target.is_planar else _solid_meaning)(design, usual)
    return (_length_table(design), _hints(design), meaning, *_measure_commands(design))


def _length_table(design: Design) -> Table:
    """Design values, and between which values a print usually lies."""
    usual = usual_errors(design.job.printing.build)
    columns = (
        Column("length", is_number=False),
        Column("design, mm", note="what a perfect print has after cooling"),
        Column("usual, mm", note=f"two standard deviations of the error template {usual.template}"),
    )
    lengths = caliper_lengths(design)
    has_long = any(needs_rule(design.target, one) for one in lengths)
    long_words = f"* longer than a caliper of {REACH_MM:g} mm reaches." if has_long else ""
    how_words = "z is the printer's upright axis." if any(one.how for one in lengths) else ""
    rows = tuple(
        (
            Cell(f"{one.what}, {one.how}" if one.how else one.what),
            Cell(f"{one.length_mm:.2f}{' *' * needs_rule(design.target, one)}", one.length_mm),
            Cell(_usual_words(usual, one), 2 * usual.of_length_mm(one) if one.is_modelled else None),
        )
        for one in lengths
    )
    note = " ".join(filter(None, (long_words, how_words)))
    return Table("Lengths for the caliper", columns, rows, note=note, visible_rows=13)


def _usual_words(usual: Usual, one: Caliper) -> str:
    """Two standard deviations, where they are known."""
    return f"± {2 * usual.of_length_mm(one):.2f}" if one.is_modelled else ""


def _hints(design: Design) -> Leaf:
    """How to lay the caliper on."""
    if not design.target.is_planar:
        return Steps((
            "Let the print cool to the room. Cut brim and blobs off.",
            *_reach_words(design),
            "Close the jaws flat on two opposite faces, in their middles, and turn the part a little for the least "
            "reading.",
            "Measure as many of the pairs as you can: their mean is the size, their differences are the shape. Over "
            "the corners a caliper reads too little: print rounds them.",
        ))  # fmt: skip
    return Steps((
        "Let the print cool to the room." if design.job.printing.is_two_filament else _SHEET_FIRST,
        _ring_words(design),
        "The plate: outside, at both ends and in the middle; its thickness at the four corners.",
        "Lay the board down and the tips of the jaws on it, without pressing.",
        "A straight edge along both diagonals shows how bent the plate is: light under it is an error of the target.",
    ))  # fmt: skip


def _ring_words(design: Design) -> str:
    """How the distance of two rings is taken."""
    example, diameter = _example(design), 2 * float(design.target.radius_outer_mm.max())
    return (
        "Ring to ring is centre to centre: measure over the two outer edges, then between the edges that face each "
        f"other, and take the mean; bleeding ink cancels out. Of {example.option} these are "
        f"{example.length_mm + diameter:.2f} and {example.length_mm - diameter:.2f} mm."
    )


def _reach_words(design: Design) -> tuple[str, ...]:
    """What to do where opposite faces are too far apart for the usual caliper."""
    pairs = [one for one in caliper_lengths(design) if one.option.startswith("face")]
    if not all(needs_rule(design.target, one) for one in pairs):
        return ()
    across = f"Across the faces it is {pairs[0].length_mm:.2f} mm: that takes a caliper of 200 mm or more"
    if _example(design).option.startswith("face"):
        return (f"{across}, or a height gauge.",)
    return (
        f"{across}, and is the better length: 'face-to-face' in the commands below. With one of {REACH_MM:g} mm "
        "measure the sides of the top face, the one opposite the face on the bed; left and right are those of that "
        f"face seen from outside, its code corner up. {_ring_words(design)}",
    )


def _solid_meaning(design: Design, usual: Usual) -> Leaf:
    length = max(one.length_mm for one in caliper_lengths(design))
    skew = skew_effect_mm(design, usual.skew_rad)
    tell = "Photos tell the three angles: calib measure, then --skew-compensation"
    if skew > _LEAST_EFFECT_MM:
        leans = f"a usual skew of {math.degrees(usual.skew_rad):.2g} deg changes a pair by up to {skew:.2f} mm"
        differ = f"skewed axes of the printer: {leans}. {tell}"
    else:
        differ = f"axes of the printer that are off one by one; a skew changes none of these lengths. {tell}"
    rows = [
        ("all pairs off alike", f"size: 0.1 mm is {10 / length:.2g} %. {_remedy(design)}"),
        ("pairs differ", differ),
    ]
    upright = [one.what for one in caliper_lengths(design) if one.how == UPRIGHT]
    if upright:
        rows.append((f"only {upright[0]}", "height: first layer squeezed, or the z axis. calib measure tells the axes"))
    if design.job.printing.build == "stickers":
        rows.append(("one pair too long", "glue, bubbles, or a seam below a sticker"))
    return _meanings(rows)


def _board_meaning(design: Design, usual: Usual) -> Leaf:
    example, skew_deg = _example(design), skew_per_mm_deg(design.target)
    percent, usual_deg = 10 / example.length_mm, math.degrees(usual.skew_rad)
    one_axis = "carriage or feed of the printer alone: calib measure tells it"
    if design.job.printing.is_two_filament:
        one_axis = "one axis of the printer alone: calib measure tells it, the slicer's scale of that axis corrects it"
    diagonals = f"skew: each 0.1 mm between the two is {0.1 * skew_deg:.2g} deg; {usual_deg:.2g} deg is usual"
    return _meanings([
        ("all lengths off alike", f"size: 0.1 mm of {example.option} is {percent:.2g} %. {_remedy(design)}"),
        ("rows off, columns not", one_axis),
        ("diagonals differ", diagonals),
        ("light under the edge", "the plate is bent. calib measure takes a bow back, but not one that changes"),
    ])  # fmt: skip


def _meanings(rows: list[tuple[str, str]]) -> Leaf:
    """What is seen and what it means."""
    columns = (Column("what you find", is_number=False), Column("what it means", is_number=False))
    cells = tuple((Cell(found), Cell(meaning[0].upper() + meaning[1:])) for found, meaning in rows)
    return Table("Deviations", columns, cells)


def _remedy(design: Design) -> str:
    """What is done about a wrong size."""
    if design.job.printing.build == "sheet":
        return "Give the length to calib measure; a new sheet is not needed"
    made = design.job.printing.shrink_compensation_percent
    had = f" (this one has {made:g}%)" if made else ""
    return (
        "Give the length to calib measure, which also tells the --shrink-compensation of the next print"
        f"{had}; photos alone never tell size"
    )


def example_length(design: Design) -> str:
    """A length as calib measure reads it, once a reading stands in its place."""
    example = _example(design)
    name = "face-to-face" if example.option.startswith("face") else example.option
    return f"{name}:{READING}mm+-{_CALIPER_MM:g}mm"


def _example(design: Design) -> Caliper:
    """The longest length within a caliper's reach; where there is none, the shortest."""
    named = [one for one in caliper_lengths(design) if one.option]
    within = [one for one in named if not needs_rule(design.target, one)]
    if within:
        return max(within, key=lambda one: round(one.length_mm, 6))
    return min(named, key=lambda one: round(one.length_mm, 6))


def _measure_commands(design: Design) -> tuple[Leaf, ...]:
    name, length = design.job.name, example_length(design)
    what = "the mean of your readings of all pairs" if length.startswith("face") else "your reading"
    printing = design.job.printing
    percent = printing.shrink_compensation_percent
    made = shrunk = f" --shrink-compensation {percent:g}%" if percent else ""
    if printing.skew_compensation_rad != NO_SKEW:
        made += f' --skew-compensation "{format_skew(printing.skew_compensation_rad)}"'
    return (
        Paragraph(
            f"Put {what} in place of {READING}, as in 12.34mm. The measured target file is then used instead of "
            f"{name}.target.json, and no new print is needed."
        ),
        Command(
            f'calib measure {name}.target.json --measured-length "{length}"{shrunk} -o measured/{name}.target.json',
            "the quick way: the size from one length, the shape as designed",
        ),
        Command(
            f'calib measure {name}.target.json camera/detections.csv --length "{length}"{made} '
            f"-o measured/{name}.target.json",
            "the thorough way, after calib run: size, shape and every face, from the photos and one length",
        ),
        Command(
            f"calib run measured/{name}.target.json photos -o camera",
            "the camera again, from the target as it was printed",
        ),
    )


def photo_blocks(design: Design) -> tuple[Block, ...]:
    """How to take the photos, and the commands that follow, run in the folder of the page."""
    name = design.job.name
    rules = [
        "Fix focus, zoom and aperture; no image stabilisation, full resolution, no lens correction in the camera.",
        "Even, soft light: where a lamp is mirrored, rings are lost.",
        _photo_count(is_solid=not design.target.is_planar),
        "Fill the image: rings up to its edges and corners in some photos, two or more distances.",
        f"Near enough that a ring is {_LEAST_RING_PX} pixels or more across: no farther than "
        f"{1000 * design.job.target.ring_diameter_mm / _LEAST_RING_PX:.0f} mm for each 1000 pixels of focal length.",
        "The photos of one camera in a folder photos beside this page.",
    ]
    return (Steps(tuple(rules)), *_next_commands(design, name))


def _photo_count(*, is_solid: bool) -> str:
    if is_solid:
        return (
            "20 to 30 photos from all sides; turn the target between them. One can be solved, but hardly checked; to "
            "measure the print takes 20 or more."
        )
    return (
        "20 to 30 photos, tilted by 20 to 50 degrees about different axes, and a few straight on. Fewer than 6 cannot "
        "be checked."
    )


def simulated_line(design: Design) -> str:
    """The command that takes simulated photos as one should: near and far, turned, and into the image's corners.

    From the nearest place the target's outline fills the height of the image.
    """
    nearest = bounding_radius_mm(design.target) / IMAGE_HALF_HEIGHT
    is_planar = design.target.is_planar
    aim = (_PLANAR_AIM_SHARE if is_planar else _AIM_SHARE) * IMAGE_HALF_DIAGONAL * nearest
    near, far, aside = (two_digits(length) for length in (nearest, 2 * nearest, aim))
    cap = " --cap-angle 45deg" if is_planar else ""
    return (
        f"calib render {design.job.name}.target.json -o simulated --views {_SIMULATED_VIEWS} "
        f"--distance {near}mm..{far}mm --aim-offset {aside}mm --random-roll{cap} --blur 0.7px --contrast-to-noise 50"
    )


def _next_commands(design: Design, name: str) -> tuple[Leaf, ...]:
    errors = ERRORS_OF_BUILD[design.job.printing.build]
    return (
        Command(f"calib run {name}.target.json photos -o camera", "from the photos to the camera, with a verdict"),
        Command(simulated_line(design), "no print yet: simulated photos with known truth"),
        Command(f"calib run {name}.target.json simulated -o simulated-camera", "and the camera that they give"),
        Command(
            f"design tolerance {name}.target.json --errors {errors} --linear -o tolerance",
            f"what usual errors would cost, in seconds: {usual_errors(design.job.printing.build).title}",
        ),
        Command(f"design make {name}.toml -o .", "all files of this folder again, byte for byte"),
    )
