"""What to measure on a print with a caliper, what deviations mean, and what to type next, for a design's page."""

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from designer.base.arrays import Array
from designer.base.units import NO_SKEW, format_skew
from designer.base.words import capital
from designer.builds.design import Design
from designer.kinds.layout import advised_photos, opposite_faces, true_corners
from designer.make.bed import bed_from_target
from designer.page.blocks import Block, Cell, Column, Command, Fold, Paragraph, Steps, Table, text_table
from designer.spec.spec import PrintSpec
from designer.target import PARALLEL, TargetGeometry
from designer.tolerance.error_file import error_model
from designer.tolerance.model import ErrorModel

REACH_MM = 150.0
"""Of the usual caliper."""
_CALIPER_MM = 0.02
"""Limit of error of a caliper that shows 0.01 mm, up to 100 mm (DIN 862); a reading by hand is assumed as good."""
_LEAST_EFFECT_MM = 0.005
READING = "READING"
"""What stands in the commands where a person's reading belongs: calib measure refuses it."""
_LEAST_RING_PX = 10
SIMULATED_CAMERA = "machine-vision"
"""The camera template that calib render takes unless told otherwise."""
_SIMULATED_VIEWS = 24


@dataclass(frozen=True)
class Caliper:
    """One length that a caliper measures."""

    what: str  # "face 0 to face 15"
    length_mm: float  # of the design
    is_upright: bool = False  # it shows the printer's z axis alone
    option: str = ""  # the name in `calib measure --length NAME:VALUE`; "": not one of its lengths
    error_source: str = ""  # what is off at both of its ends, of the error models' sources
    is_modelled: bool = True  # whether the error models tell how far it usually is off
    is_long: bool = False  # out of reach of the usual caliper; of rings over their outer edges


@dataclass(frozen=True)
class _Measuring:
    """A design, its lengths, and how its way of making usually comes out."""

    design: Design

    @cached_property
    def lengths(self) -> tuple[Caliper, ...]:
        """Worth measuring."""
        return caliper_lengths(self.design)

    @cached_property
    def errors(self) -> ErrorModel:
        """Of the build."""
        target = self.design.target
        name = self.design.job.printing.way.errors_of(target.form, target.face_count, has_lip=target.has_lip)
        assert name is not None  # noqa: S101 - a design has a build of its form
        return error_model(name)

    def sigma(self, source: str) -> float:
        """Standard deviation of an error source."""
        return self.errors.amount(source).sigma

    def usual_mm(self, one: Caliper) -> float:
        """Two standard deviations of a length: scales along it, and what is off at its two ends."""
        ends = self.sigma(one.error_source) if one.error_source else 0.0
        along = one.length_mm**2 * (self.sigma("scale") ** 2 + self.sigma("axis_scale") ** 2)
        return 2 * math.sqrt(along + 2 * ends**2)

    @cached_property
    def example(self) -> Caliper:
        """The longest length within a caliper's reach; where there is none, the shortest."""
        named = [one for one in self.lengths if one.option]
        within = [one for one in named if not one.is_long]
        choose, among = (max, within) if within else (min, named)
        return choose(among, key=lambda one: round(one.length_mm, 6))

    @property
    def is_face_to_face(self) -> bool:
        """Whether the example is a pair of faces, of which all count alike."""
        return self.example.option.startswith("face")


def caliper_lengths(design: Design) -> tuple[Caliper, ...]:
    """The lengths worth measuring on this target."""
    return _plate_lengths(design) if design.target.is_plate else _solid_lengths(design)


def _solid_lengths(design: Design) -> tuple[Caliper, ...]:
    """All pairs of opposite faces; where no caliper reaches, sides of the topmost face or an edge too."""
    target, is_printed = design.target, design.job.printing.way.is_two_filament
    up, normals = bed_from_target(target, design.job.printing)[2, :3], target.target_from_face[:, :3, 2]
    is_in_parts = design.job.printing.way.is_in_parts
    rows = []
    for first, second in opposite_faces(target):
        name, length = f"face {first} to face {second}", face_to_face_mm(target, first, second)
        # Nobody knows how the body below stickers lay, and tiles lay flat.
        is_upright = is_printed and not is_in_parts and abs(float(normals[first] @ up)) > math.cos(math.radians(1))
        rows.append(Caliper(name, length, is_upright, name, "face_offset", is_long=length > REACH_MM))
    if not rows and target.spec is not None and target.spec.solid is not None:
        edge_mm = target.spec.solid.edge_mm
        rows.append(
            Caliper("edge, corner to corner", edge_mm, False, "edge", "face_offset", is_long=edge_mm > REACH_MM)
        )
    # Of stickers the length of a row is that of the sheet, not that of the body.
    if (is_printed or not rows) and all(one.is_long or one.option == "edge" for one in rows):
        face = 0 if is_in_parts else int(np.argmax(normals @ up))
        rows += _sides_of_face(target, face, f"{'tile' if is_in_parts else 'top face'} ({face})")
    return tuple(rows)


def _sides_of_face(target: TargetGeometry, face: int, name: str) -> list[Caliper]:
    """From corner to corner of a face, between the rings that lie there."""
    (rings,) = np.nonzero(target.ring_face == face)
    place, outline = target.center_in_face_mm[rings, :2], target.outline_mm[face]
    outline = outline[true_corners(outline)]
    nearest = rings[np.linalg.norm(place[:, None] - outline, axis=2).argmin(axis=0)].tolist()
    return [
        _between_rings(target, f"{name}, corner {a} to {b}", nearest[a], nearest[b])
        for a, b in combinations(range(len(outline)), 2)
        if nearest[a] != nearest[b]
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
    products = [normals[:, a] * normals[:, b] for a, b in combinations(range(3), 2)]
    return float(distance * math.tan(skew_rad) * np.abs(products).max())


def _plate_lengths(design: Design) -> tuple[Caliper, ...]:
    """Outer size, and the distances of the four rings in the corners."""
    target, corners = design.target, corner_rings(design.target)
    is_printed = design.job.printing.way.is_two_filament  # else a hand or a shop cuts the plate
    sides = (*np.ptp(target.outline_mm[0], axis=0).tolist(), design.job.target.depth_mm)
    rows = [
        Caliper(name, length, is_modelled=is_printed and name != "thickness", is_long=length > REACH_MM)
        for name, length in zip(("width", "height", "thickness"), sides, strict=True)
    ]
    pairs = {
        (0, 1): "row", (1, 2): "column", (2, 3): "row", (3, 0): "column", (0, 2): "diagonal", (1, 3): "diagonal",
    }  # fmt: skip
    if not target.is_planar:
        rows[2] = Caliper("thickness: face 0 to face 1", sides[2], False, "face 0 to face 1", "face_offset")
    rings = [_between_rings(target, name, corners[a], corners[b]) for (a, b), name in pairs.items()]
    inside = _within_reach(target)
    if inside != corners[0] and all(one.is_long for one in rings):
        rings.append(_between_rings(target, "part of the lower row", corners[0], inside))
    return (*rows, *rings)


def _between_rings(target: TargetGeometry, name: str, first: int, second: int) -> Caliper:
    option, length = f"ring {first} to ring {second}", ring_to_ring_mm(target, first, second)
    is_long = length + 2 * float(target.radius_outer_mm.max()) > REACH_MM
    return Caliper(f"{name}: {option}", length, False, option, "ring_jitter", is_long=is_long)


def _within_reach(target: TargetGeometry) -> int:
    """The ring of the lower row farthest from its first that a caliper still takes over both outer edges."""
    first = corner_rings(target)[0]
    place = target.center_in_face_mm
    (row,) = np.nonzero((np.abs(place[:, 1] - place[first, 1]) < PARALLEL) & (target.ring_face == 0))
    distance = np.linalg.norm(place[row] - place[first], axis=1)
    over_edges = distance + target.radius_outer_mm[row] + target.radius_outer_mm[first]
    return int(row[np.argmax(np.where(over_edges <= REACH_MM, distance, 0.0))])


def corner_rings(target: TargetGeometry) -> tuple[int, int, int, int]:
    """The rings nearest the corners of a plate's front, counter-clockwise from the lower left."""
    (front,) = np.nonzero(target.ring_face == 0)
    place: Array = target.center_in_face_mm[front, :2]
    ways = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    a, b, c, d = (int(front[np.argmax(place @ np.array(way, dtype=float))]) for way in ways)
    return a, b, c, d


def ring_to_ring_mm(target: TargetGeometry, first: int, second: int) -> float:
    """Distance of two rings' centres."""
    return float(np.linalg.norm(target.center_mm[first] - target.center_mm[second]))


def skew_per_mm_deg(target: TargetGeometry) -> float:
    """The skew that makes a plate's two diagonals differ by 1 mm.

    With sides w and h and a lean a, the squares of the diagonals differ by 4 w h sin a.
    """
    a, b, c, _ = corner_rings(target)
    width, height = ring_to_ring_mm(target, a, b), ring_to_ring_mm(target, b, c)
    diagonal = ring_to_ring_mm(target, a, c)
    return math.degrees(2 * diagonal / (4 * width * height))


def measure_blocks(design: Design) -> tuple[Block, ...]:
    """The lengths, what a deviation means, and the commands that use them."""
    measuring = _Measuring(design)
    is_plate = design.target.is_plate
    hints = _solid_hints(measuring)
    if is_plate:
        hints = Steps((
            "Cooled to the room." if design.job.printing.way.is_two_filament else "On its carrier, as it will be used.",
            _ring_words(measuring),
            "Width, height at both ends and the middle; thickness at the corners.",
        ))  # fmt: skip
    told = [(name, capital(why)) for name, why in (_plate_meaning if is_plate else _solid_meaning)(measuring)]
    deviations = Fold("Deviations", (text_table("", ("found", "means"), told),))
    return (_length_table(measuring), hints, deviations, *_commands(measuring))


def _length_table(measuring: _Measuring) -> Table:
    """Design values, and between which values a print usually lies; lengths that are alike are a row."""
    columns = (Column("length", is_number=False), Column("design, mm"), Column("usual, mm"))
    alike: dict[tuple[str, str, bool], list[Caliper]] = {}
    for one in measuring.lengths:
        alike.setdefault((f"{one.length_mm:.2f}", one.error_source, one.is_upright), []).append(one)
    rows = []
    for lengths in alike.values():
        one, count = lengths[0], len(lengths)
        name = one.what.partition(": ")[0]
        others = (other.what.removeprefix(f"{name}: ").rpartition(", ")[2] for other in lengths[1:])
        what = "; ".join((one.what, *others))
        if count > 1 and one.option.startswith("face"):
            what = f"each of {count} pairs of opposite faces, as {one.what}"
        usual_mm = measuring.usual_mm(one) if one.is_modelled else None
        rows.append((
            Cell(f"{what}{', along z' if one.is_upright else ''}"),
            Cell(f"{one.length_mm:.2f}{' *' * one.is_long}", one.length_mm),
            Cell("" if usual_mm is None else f"± {usual_mm:.2f}", usual_mm),
        ))  # fmt: skip
    notes = (
        f"Usual: two standard deviations of {measuring.errors.name}.",
        f"* takes more than a caliper of {REACH_MM:g} mm." * any(one.is_long for one in measuring.lengths),
    )
    return Table("Lengths for the caliper", columns, tuple(rows), " ".join(filter(None, notes)), visible_rows=13)


def _solid_hints(measuring: _Measuring) -> Steps:
    """How to lay the caliper on."""
    pairs = [one for one in measuring.lengths if one.option.startswith("face")]
    if not pairs:
        return Steps((
            "Let the print cool to the room. Cut brim and blobs off.",
            _ring_words(measuring),
            "No two faces are opposite each other. An edge, corner to corner, comes out short, as print rounds them.",
        ))  # fmt: skip
    reach: tuple[str, ...] = ()
    if all(one.is_long for one in pairs):
        words = "Across the faces it takes a caliper of 200 mm or a height gauge"
        if not measuring.is_face_to_face:
            words += (
                ": the better length, 'face-to-face' in the commands. Else the sides of a face, corners "
                f"counter-clockwise from its code corner, 0. {_ring_words(measuring)}"
            )
        reach = (f"{words.removesuffix('.')}.",)
    between = " between the lips, which stand out" * measuring.design.target.has_lip
    return Steps((
        "Cooled to the room, brim and blobs cut off.",
        *reach,
        f"Jaws flat on the middles of opposite faces{between}; turn for the least reading; corners are rounded.",
        "As many pairs as you can: their mean is the size, their differences the shape.",
    ))  # fmt: skip


def _ring_words(measuring: _Measuring) -> str:
    """How the distance of two rings is taken."""
    if measuring.design.target.marks is not None:
        return (
            "Ring to ring is corner to corner here: over as many squares or tags as the caliper takes; where "
            "corners meet, lay it to the edges of the outermost squares and take off the rest."
        )
    example, diameter = measuring.example, 2 * float(measuring.design.target.radius_outer_mm.max())
    return (
        "Ring to ring is the mean of over the outer and between the inner edges: of "
        f"{example.option} {example.length_mm + diameter:.2f} and {example.length_mm - diameter:.2f} mm."
    )


def _solid_meaning(measuring: _Measuring) -> list[tuple[str, str]]:
    design, skew_rad = measuring.design, measuring.sigma("skew")
    length, skew = max(one.length_mm for one in measuring.lengths), skew_effect_mm(design, skew_rad)
    differ = "axes of the printer that are off one by one; a skew changes none of these lengths"
    if skew > _LEAST_EFFECT_MM:
        usual = f"a usual {math.degrees(skew_rad):.2g} deg changes a pair by up to {skew:.2f} mm"
        differ = f"skewed axes of the printer: {usual}"
    has_pairs = any(one.option.startswith("face") for one in measuring.lengths)
    alike = "pairs" if has_pairs else "lengths"
    size = (f"all {alike} off alike", f"size: 0.1 mm is {10 / length:.2g} %. {_size_remedy(design)}")
    if not has_pairs:
        return [size]
    if design.job.printing.way.is_in_parts:
        badly = "a tile that sits badly (glue, a blob, a bow): calib measure names it"
        return [size, ("one pair too long", badly), ("all pairs too long", "thick glue, or pads that stand proud")]
    rows = [
        size,
        ("pairs differ", f"{differ}; calib measure tells --skew-compensation"),
        *(
            (f"only {one.what}", "height: a squeezed first layer, or the z axis")
            for one in measuring.lengths
            if one.is_upright
        ),
    ]
    if design.job.printing.way.has_stickers:
        rows.append(("one pair too long", "glue, bubbles, or a seam below a sticker"))
    return rows


def _plate_meaning(measuring: _Measuring) -> list[tuple[str, str]]:
    design, example = measuring.design, measuring.example
    one_axis = "carriage or feed of the printer alone: calib measure tells it"
    if design.job.printing.way.is_two_filament:
        one_axis = "one axis of the printer: calib measure tells it, the slicer's scale corrects it"
    size = f"size: 0.1 mm of {example.option} is {10 / example.length_mm:.2g} %. {_size_remedy(design)}"
    usual_deg = math.degrees(measuring.sigma("skew"))
    skew = f"0.1 mm between them is {0.1 * skew_per_mm_deg(design.target):.2g} deg; {usual_deg:.2g} deg is usual"
    return [
        ("all lengths off alike", size),
        ("rows off, columns not", one_axis),
        ("diagonals differ", f"skew: {skew}"),
        ("light under a straight edge", "a bent plate: calib measure takes back a bow that stays"),
    ]


def _size_remedy(design: Design) -> str:
    """What is done about a wrong size."""
    if not design.job.printing.way.has_body:
        return "calib measure takes it back"
    made = design.job.printing.shrink_compensation_percent
    had = f" (this one has {made:g}%)" if made else ""
    return f"calib measure tells --shrink-compensation{had}"


def example_length(design: Design) -> str:
    """A length as calib measure reads it, once a reading stands in its place."""
    measuring = _Measuring(design)
    name = "face-to-face" if measuring.is_face_to_face else measuring.example.option
    return f"{name}:{READING}mm+-{_CALIPER_MM:g}mm"


def _commands(measuring: _Measuring) -> tuple[Block, ...]:
    """From a reading to the measured target file and the camera."""
    job, length = measuring.design.job, example_length(measuring.design)
    what = "the mean of your readings of all pairs" if measuring.is_face_to_face else "yours"
    percent = job.printing.shrink_compensation_percent
    shrunk, made = f" --shrink-compensation {percent:g}%" if percent else "", made_with(job.printing)
    target = f"{job.name}.target.json"
    if measuring.design.target.has_back:
        made = f' --length "face 0 to face 1:{READING}mm+-{_CALIPER_MM:g}mm"{made}'
    return (
        Paragraph(
            f"{READING}: {what}; +-{_CALIPER_MM:g}mm: what your caliper may be off (DIN 862, up to 100 mm)."
        ),
        Command(
            f'calib measure {target} camera/detections.csv --length "{length}"{made} -o measured/{target}',
            "after calib run: size and shape",
        ),
        Command(f"calib run measured/{target} photos -o camera", "the camera again"),
        Fold("Quicker: the size alone", (
            Command(f'calib measure {target} --measured-length "{length}"{shrunk} -o measured/{target}'),
        )),
    )  # fmt: skip


def made_with(printing: PrintSpec) -> str:
    """What was printed larger or sheared, as calib wants to know it: ` --shrink-compensation 0.2%`."""
    percent, skew_rad = printing.shrink_compensation_percent, printing.skew_compensation_rad
    made = f" --shrink-compensation {percent:g}%" if percent else ""
    return made if skew_rad == NO_SKEW else f'{made} --skew-compensation "{format_skew(skew_rad)}"'


def photo_blocks(design: Design) -> tuple[Block, ...]:
    """How to take the photos, and the commands that follow, run in the folder of the page."""
    name, ring_mm = design.job.name, design.job.target.ring_diameter_mm
    what, seen = design.target.feature_word, "rings" if design.target.marks is None else "squares or tags"
    sides = "from within its opening" if design.target.faces_up else "from all sides"
    count = f"20 to 30 {sides}, the target turned between them; fewer than 20 hardly measure the print."
    if design.job.printing.way.is_in_parts:
        count = (
            "20 to 30 from all sides, turned between them; 40, five tiles in each, tell how tiles sit (of 15, "
            "simulated, a tenth stayed unknown)."
        )
    if design.target.is_plate:
        count = "20 to 30, tilted by 20 to 50 degrees about different axes, a few straight on; 6 at the least."
        keep = "its dots in all, or it cannot be named"
        if design.target.marks is None:
            count += f" {capital(keep if design.target.is_dot.any() else 'without dots it may be named turned')}."
    if design.target.has_back:
        count += " Of either side; cameras that face each other need photos of both taken at the same time."
    rules = Steps((
        "Focus, zoom, aperture fixed; no stabilisation or lens correction, full resolution; soft light, no lamp "
        "mirrored.",
        count,
        f"{capital(what)} up to edges and corners in some; two or more distances; {seen} {_LEAST_RING_PX} pixels or "
        f"more across: at most {1000 * ring_mm / _LEAST_RING_PX:.0f} mm away per 1000 pixels of focal length.",
    ))  # fmt: skip
    errors = _Measuring(design).errors
    return (
        rules,
        Command(f"calib run {name}.target.json photos -o camera", "the camera"),
        Fold("Without a print", (
            Command(simulated_line(design), "simulated photos, for calib run"),
            Command(
                f"design tolerance {name}.target.json --errors {errors.name} --linear -o tolerance",
                f"what usual errors cost: {errors.title}",
            ),
        )),
    )  # fmt: skip


def simulated_line(design: Design) -> str:
    """The command that takes simulated photos as one should: near and far, turned, and into the image's corners."""
    photos = advised_photos(design.target)
    near, far = photos.distance_mm
    cap = f" --cap-angle {math.degrees(photos.half_angle_rad):.0f}deg" if design.target.faces_up else ""
    return (
        f"calib render {design.job.name}.target.json -o simulated --views {_SIMULATED_VIEWS} --distance "
        f"{near:g}mm..{far:g}mm --aim-offset {photos.aim_offset_mm:g}mm --random-roll{cap} --blur 0.7px "
        "--contrast-to-noise 50"
    )
