"""What to measure on a print, what deviations mean, and what to type next, for a design's page."""

import math
from dataclasses import dataclass

from designer.page.blocks import Block, Cell, Column, Command, Leaf, Paragraph, Steps, Table
from designer.produce import Design
from designer.report.caliper import (
    UPRIGHT,
    Caliper,
    caliper_lengths,
    needs_rule,
    skew_effect_mm,
    skew_per_mm_deg,
)
from designer.skew import NO_SKEW, format_skew
from designer.spec import Build
from designer.tolerance.error_file import error_model
from designer.tolerance.model import ErrorModel

ERRORS_OF_BUILD: dict[Build, str] = {
    "solid": "fdm-dual",
    "printed": "fdm-board",
    "stickers": "hand-stickers",
    "sheet": "sheet-print",
}
"""The error template that says how a build usually comes out."""
_CALIPER_MM = 0.02
_SHEET_FIRST = "Measure the sheet on its carrier, as it will be used."
_LONG_TOOL = "longer than a 150 mm caliper"
_LEAST_RING_PX = 10


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
    meaning = _solid_meaning(design, usual) if design.target.face_count > 1 else _board_meaning(design, usual)
    return (_length_table(design), _hints(design), meaning, *_measure_commands(design))


def _length_table(design: Design) -> Table:
    """Design values, and between which values a print usually lies."""
    usual = usual_errors(design.job.printing.build)
    columns = (
        Column("length", is_number=False),
        Column("design, mm", note="what a perfect print has after cooling"),
        Column("usual, mm", is_number=False, note=f"two standard deviations of the error template {usual.template}"),
        Column("how", is_number=False),
    )
    rows = tuple(
        (
            Cell(one.what),
            Cell(f"{one.length_mm:.2f}", one.length_mm),
            Cell(_usual_words(usual, one)),
            Cell(f"{one.how}; {_LONG_TOOL}" if needs_rule(design.target, one) else one.how),
        )
        for one in caliper_lengths(design)
    )
    return Table("Lengths for the caliper", columns, rows, visible_rows=12)


def _usual_words(usual: Usual, one: Caliper) -> str:
    """Two standard deviations, where they are known."""
    return f"± {2 * usual.of_length_mm(one):.2f}" if one.is_modelled else ""


def _hints(design: Design) -> Leaf:
    """How to lay the caliper on."""
    if design.target.face_count > 1:
        return Steps((
            "Let the print cool to the room. Cut brim and blobs off.",
            "Close the jaws flat on two opposite faces, in their middles, and turn the part a little for the least "
            "reading.",
            "Measure as many of the pairs as you can: their mean is the size, their differences are the shape. Over "
            "the corners a caliper reads too little: print rounds them.",
        ))  # fmt: skip
    example, diameter = _example(design), 2 * float(design.target.radius_outer_mm.max())
    return Steps((
        "Let the print cool to the room." if design.job.printing.is_two_filament else _SHEET_FIRST,
        "Centre to centre: measure two rings over their outer edges, then between the edges that face each other, and "
        f"take the mean; bleeding ink cancels out. Of {example.option} these are "
        f"{example.length_mm + diameter:.2f} and {example.length_mm - diameter:.2f} mm.",
        "Lay the board down and the tips of the jaws on it, without pressing.",
        "A straight edge along both diagonals shows how bent the plate is: light under it is an error of the target.",
    ))  # fmt: skip


def _solid_meaning(design: Design, usual: Usual) -> Leaf:
    length = max(one.length_mm for one in caliper_lengths(design))
    skew = skew_effect_mm(design, usual.skew_rad)
    rows = [
        ("all pairs off alike", f"size: 0.1 mm is {10 / length:.2g} %. {_remedy(design)}"),
        (
            "pairs differ",
            f"skewed axes of the printer: a usual skew of {math.degrees(usual.skew_rad):.2g} deg changes a pair "
            f"by up to {skew:.2f} mm. Photos tell the three angles: calib measure, then --skew-compensation",
        ),
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
    """A length as calib measure reads it, with the design's value in place of a reading."""
    example = _example(design)
    name = example.option if design.target.face_count == 1 else "face-to-face"
    return f"{name}:{example.length_mm:.2f}mm+-{_CALIPER_MM:g}mm"


def _example(design: Design) -> Caliper:
    """The longest length within a caliper's reach; where there is none, the shortest."""
    named = [one for one in caliper_lengths(design) if one.option]
    within = [one for one in named if not needs_rule(design.target, one)]
    if within:
        return max(within, key=lambda one: round(one.length_mm, 6))
    return min(named, key=lambda one: round(one.length_mm, 6))


def _measure_commands(design: Design) -> tuple[Leaf, ...]:
    name, length = design.job.name, example_length(design)
    what = "the mean of all pairs" if design.target.face_count > 1 else "your reading"
    printing = design.job.printing
    made = ""
    if printing.shrink_compensation_percent:
        made = f" --shrink-compensation {printing.shrink_compensation_percent:g}%"
    if printing.skew_compensation_rad != NO_SKEW:
        made += f' --skew-compensation "{format_skew(printing.skew_compensation_rad)}"'
    return (
        Paragraph(
            f"Put {what} in place of the design's value. The measured target file is then used instead of "
            f"{name}.target.json, and no new print is needed."
        ),
        Command(
            f'calib measure {name}.target.json --measured-length "{length}" -o measured/{name}.target.json',
            "the quick way: the size from one length, the shape as designed",
        ),
        Command(
            f'calib measure {name}.target.json camera/detections.csv --length "{length}"{made} '
            f"-o measured/{name}.target.json",
            "the thorough way: size, shape and every face, from 20 or more photos from all sides and one length",
        ),
    )


def photo_blocks(design: Design) -> tuple[Block, ...]:
    """How to take the photos, and the commands that follow, run in the folder of the page."""
    is_solid = design.target.face_count > 1
    name = design.job.name
    rules = [
        "Fix focus, zoom and aperture; no image stabilisation, full resolution, no lens correction in the camera.",
        "Even, soft light: where a lamp is mirrored, rings are lost.",
        _photo_count(is_solid=is_solid),
        "Fill the image: rings up to its edges and corners in some photos, two or more distances.",
        f"Near enough that a ring is {_LEAST_RING_PX} pixels or more across: no farther than "
        f"{1000 * design.job.target.ring_diameter_mm / _LEAST_RING_PX:.0f} mm for each 1000 pixels of focal length.",
        "The photos of one camera in a folder photos beside this page.",
    ]
    return (Steps(tuple(rules)), *_next_commands(design, name))


def _photo_count(*, is_solid: bool) -> str:
    if is_solid:
        return "10 to 30 photos; turn the target between them. One can be solved, but hardly checked."
    return (
        "15 to 30 photos, tilted by 20 to 50 degrees about different axes, and a few straight on. Fewer than 6 cannot "
        "be checked."
    )


def _next_commands(design: Design, name: str) -> tuple[Leaf, ...]:
    errors = ERRORS_OF_BUILD[design.job.printing.build]
    return (
        Command(f"calib run {name}.target.json photos -o camera", "from the photos to the camera, with a verdict"),
        Command(
            f"calib render {name}.target.json -o photos --views 20 --blur 0.7px --contrast-to-noise 50",
            "no print yet: simulated photos with known truth",
        ),
        Command(
            f"design tolerance {name}.target.json --errors {errors} --linear -o tolerance",
            f"what usual errors would cost, in seconds: {usual_errors(design.job.printing.build).title}",
        ),
        Command(f"design make {name}.toml -o .", "all files of this folder again, byte for byte"),
    )
