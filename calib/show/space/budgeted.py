"""What `calib budget` tells: how large errors in space are to be expected, where, by what, and what would help."""

import math
from pathlib import Path

from calib.core.number_text import figure as digits
from calib.records.budget_file import BUDGET, BUDGET_FILE, GRID_FILE, BudgetRecord
from calib.show.parts.folder_blocks import files_section, number, title_of
from calib.show.parts.origin import Origin
from calib.space.error_size import PointErrors
from designer.base.words import capital, printable
from designer.page.blocks import (
    Block,
    Cell,
    Column,
    Command,
    Facts,
    Figure,
    Finding,
    Findings,
    Headline,
    Page,
    Section,
    Table,
    View3d,
)

FILES = (
    (GRID_FILE, "an even lattice over the volume: each point with its covariance, by noise, by the rig, and both"),
    (BUDGET_FILE, "what this page is built from"),
)
FRAMES = (
    "The error of a point is the root mean square of its length in space. In the rig's frame, it holds what turns or "
    "shifts all points together; with the best rigid motion of the whole volume taken off, only what bends or scales "
    "shapes is left. A length does not depend on the frame."
)
CONDITION = (
    "If one part were known exactly, and the others as well as they then were: so large would the errors be. Parts go "
    "together, so what they cost does not add up."
)
ALIKE = "By the same computation with a changed rig; what each change assumes stands below."
_LEFT = 0.98
"""Of the errors: what leaves more than that is no part to name."""


def budget_page(folder: Path, origin: Origin) -> Page:
    """The page of a budget's folder.

    Raises:
        InputError: `budget.json` cannot be read; the message names it.
    """
    record = BUDGET.read(folder / BUDGET_FILE)
    figures: tuple[Block, ...] = _figures(record)
    again = files_section(folder, FILES, Command("calib report .", "makes this page again"))
    errors, *others = sections_of(record)
    where = (Section("Where", figures, lead="Grey: too few cameras see it."),) if figures else ()
    return Page(
        title_of(folder), "Budget", headline_of(record), (errors, *where, *others, again),
        lead=(_scene(record), Facts(facts_of(record))), made_by=origin.command, program=origin.program,
    )  # fmt: skip


def headline_of(record: BudgetRecord) -> Headline:
    """The number, and what it comes from."""
    place = record.position
    sentence = (
        f"Half of the volume is measured to {_mm(place.median_mm)} or better, 95 % of it to {_mm(place.most_mm)} (RMS "
        f"of a point's error in space){_because(record)}."
    )
    return Headline("note", _mm(place.median_mm), sentence)


def _because(record: BudgetRecord) -> str:
    """What makes it, in the volume's median point."""
    if math.isnan(record.by_calibration.median_mm):
        return "; by the noise of the pixels alone, for the rig's own errors are not known"
    made = (
        f"; pixel noise alone makes {_mm(record.by_noise.median_mm)}, the rig's own errors "
        f"{_mm(record.by_calibration.median_mm)}"
    )
    parts = [one for one in record.known if one.part in ("the lenses", "the rotations", "the positions")]
    least = min(parts, key=lambda one: one.position.median_mm, default=None)
    if least is None or least.position.median_mm > _LEFT * record.position.median_mm:
        return made
    return f"{made}. Were {least.part} known exactly, half were at {_mm(least.position.median_mm)} or better"


def _mm(value: float) -> str:
    return f"{digits(value, 2)} mm"


def facts_of(record: BudgetRecord) -> tuple[tuple[str, str], ...]:
    """Of what, and where."""
    noise = ", ".join(dict.fromkeys(f"{digits(value, 2)} px" for value in record.noise_px.tolist()))
    rig = f"{len(record.rig.names)} cameras: {', '.join(map(printable, record.rig.names))}"
    return (
        ("rig", rig), *((printable(name), printable(text)) for name, text in record.settings.items()),
        ("volume", printable(record.volume.words)),
        ("seen", f"{100 * record.share:.0f} % of its box, by {record.seen_by} cameras or more; {record.points} points"),
        ("noise", f"{noise}, of a coordinate in the image"),
    )  # fmt: skip


def sections_of(record: BudgetRecord) -> tuple[Section, ...]:
    """All that is told in tables, for page and terminal alike."""
    remarks = Findings(tuple(Finding("note", "", capital(printable(line))) for line in record.remarks))
    sections = [Section("How large are the errors?", (errors_table(record), remarks), lead=FRAMES)]
    if record.known:
        sections.append(Section("What they come from", (known_table(record),), lead=CONDITION))
    if record.changes:
        assumed = Facts(tuple((printable(one.change), printable(one.assumes)) for one in record.changes))
        sections.append(Section("What would help", (changes_table(record), assumed), lead=ALIKE))
    return tuple(sections)


def errors_table(record: BudgetRecord) -> Table:
    """Positions, shapes and lengths."""
    heads = (
        Column("error", is_number=False), Column("median mm"), Column("95 % mm", note="95 % of the volume is better"),
        Column("worst mm"), Column("by noise mm", note="median"),
        Column("by the rig mm", note="median, by the rig's own errors"),
    )  # fmt: skip
    rows: list[tuple[str, PointErrors, PointErrors, PointErrors]] = [
        ("of a point, in the rig's frame", record.position, record.by_noise, record.by_calibration),
        ("of a point, rigid motion taken off", record.shape, record.by_noise, record.shape_by_calibration),
    ]
    for one in record.lengths:
        name = f"of a length of {record.length_mm:g} mm {one.direction} (sigma)"
        rows.append((name, one.total, one.by_noise, one.by_calibration))
    return Table("", heads, tuple(
        (Cell(name), *_three(total), number(noise.median_mm, 2), _known(shared.median_mm))
        for name, total, noise, shared in rows
    ))  # fmt: skip


def _three(errors: PointErrors) -> tuple[Cell, Cell, Cell]:
    return _known(errors.median_mm), _known(errors.most_mm), _known(errors.worst_mm)


def _known(value: float) -> Cell:
    return number(value, 2) if math.isfinite(value) else Cell("not known")


def known_table(record: BudgetRecord) -> Table:
    """How large errors would be without their parts."""
    heads = (
        Column("if known exactly", is_number=False), Column("median mm", note="of a point in the rig's frame"),
        Column("95 % mm", note="likewise"), Column("shape, median mm", note="rigid motion taken off"),
        Column("shape, 95 % mm", note="likewise"),
    )  # fmt: skip
    rows = [("nothing: as it is", record.position, record.shape)]
    rows += [(printable(one.part), one.position, one.shape) for one in record.known]
    return Table("", heads, tuple(
        (Cell(name), number(position.median_mm, 2), number(position.most_mm, 2), _known(shape.median_mm),
         _known(shape.most_mm))
        for name, position, shape in rows
    ))  # fmt: skip


def changes_table(record: BudgetRecord) -> Table:
    """What changes of the rig would buy."""
    heads = (
        Column("with", is_number=False), Column("median mm", note="of a point in the rig's frame"), Column("95 % mm"),
        Column("shape, median mm", note="rigid motion taken off"), Column("seen", note="share of the box"),
    )  # fmt: skip
    rows = [("nothing changed", record.position, record.shape, record.share)]
    rows += [(one.change, one.position, one.shape, one.share) for one in record.changes]
    return Table("", heads, tuple(
        (Cell(printable(name)), number(position.median_mm, 2), number(position.most_mm, 2), _known(shape.median_mm),
         Cell(f"{100 * share:.0f} %", share))
        for name, position, shape, share in rows
    ))  # fmt: skip


def _figures(record: BudgetRecord) -> tuple[Figure, ...]:
    """Depth over distance, and the planes through the volume."""
    from calib.figures.space import depth_drawing, slice_drawing
    from calib.figures.style import panel_height_in, svg_panel
    from designer.page.pictures import drawing_of_svg

    drawings = [slice_drawing(one) for one in record.slices]
    if record.depth is not None:
        drawings.insert(0, depth_drawing(record.depth))
    figures = []
    for one in drawings:
        height = {} if one.image_size is None else {"height_in": panel_height_in(one.image_size, has_bar=True)}
        svg = drawing_of_svg(svg_panel(one.draw, has_bar=one.has_bar, **height))
        figures.append(Figure(one.title, svg, one.words, f"{one.words}."))
    return tuple(figures)


def _scene(record: BudgetRecord) -> View3d:
    """The rig and some points of the volume."""
    from calib.show.space.rig_scene import CAMERA, POINT, error_axes, looked_at, rig_layer, scene_size_mm

    size_mm = scene_size_mm(record.rig, record.drawn_mm)
    points, enlarged = error_axes(record.drawn_mm, record.drawn_mm2, size_mm)
    legend = (CAMERA, "camera"), (POINT, "expected error")
    return View3d(
        "The rig and its volume", looked_at(record.rig, (rig_layer(record.rig, size_mm), points), legend),
        headline_of(record).sentence,
        f"Points of the volume, each drawn as the axes of the error to be expected, {enlarged:g} times enlarged. Point "
        "at a camera for its name.",
    )  # fmt: skip
