"""What is said of a coupon: for its page and for the terminal."""

from collections.abc import Callable

from calib.as_built.deviations import Estimate
from calib.records.coupon import CouponRecord
from calib.show.measured.next_print import NextOption, next_options
from calib.show.measured.numbers import degrees, percent, told
from designer.base.units import format_mm
from designer.page.blocks import Cell, Column, Command, Facts, Finding, Findings, Headline, Paragraph, Table
from designer.page.folders import number, whole

SURE_MM = 0.02
"""A bleed that is known to this is worth dialling in."""
FEATURES = {"ring": "stroke of rings", "black line": "black line", "white line": "white line, in black"}


def millimetres(one: Estimate, *, signed: bool = True) -> str:
    """`+0.101 ± 0.005 mm`."""
    return told(one, " mm", signed=signed)


def headline_of(record: CouponRecord) -> Headline:
    """Bleed, shape, and how sure it is."""
    found = record.found
    bleed = found.bleed_mm
    more = "wider" if bleed.value >= 0 else "narrower"
    much = millimetres(Estimate(abs(bleed.value), bleed.sigma), signed=False)
    sure = "" if bleed.is_significant else ", which may be noise"
    parts = [f"Ink is {much} {more} at each edge than designed{sure}"]
    if found.y_beyond_x_mm.is_significant:
        parts.append(f"along x {millimetres(found.black_mm['x'])}, along y {millimetres(found.black_mm['y'])}")
    size = found.whole.known_size
    if size is None:
        parts.append("the size is not known, as no length was given")
    else:
        larger = "larger" if size.value >= 0 else "smaller"
        sure = "" if size.is_significant else ", which may be noise"
        parts.append(f"the print is {percent(Estimate(abs(size.value), size.sigma), signed=False)} {larger}{sure}")
    parts += [f"skew {name} is {degrees(one)}" for name, one in found.whole.skews_rad.items() if one.is_significant]
    sentence = f"{'; '.join(parts)}."
    return Headline("good", "measured", sentence) if bleed.sigma <= SURE_MM else Headline("usable", "rough", sentence)


def facts_of(record: CouponRecord) -> Facts:
    """What it was measured from, and what it was printed with."""
    used = [one for one in record.pictures if not one.fault]
    kinds = (("photo", sum(not one.is_scan for one in used)), ("scan", sum(one.is_scan for one in used)))
    count = ", ".join(f"{number} {name}{'s' * (number != 1)}" for name, number in kinds if number)
    edges, rings = (sum(getattr(one, name) for one in used) for name in ("edges", "rings"))
    rows = [("measured from", f"{count}; {edges} edges, {rings} rings")]
    rows += [(name.replace("-", " "), value) for name, value in record.settings.items() if value]
    return Facts(tuple(rows))


def findings_of(record: CouponRecord) -> Findings:
    """What a person must know, a line each."""
    return Findings(tuple(
        Finding("usable" if line.startswith("left out") else "note", "", line) for line in record.remarks
    ))  # fmt: skip


def bleed_table(record: CouponRecord) -> Table:
    """Ink bleed by axis and colour."""
    found = record.found
    rows = (
        ("black between white, mean", found.bleed_mm),
        *((f"black between white, along {axis}", one) for axis, one in found.black_mm.items()),
        *((f"white between black, along {axis}", one) for axis, one in found.white_mm.items()),
        ("along y beyond along x", found.y_beyond_x_mm),
        ("at white lines beyond black lines", found.white_beyond_black_mm),
    )
    return Table(
        "Ink bleed at each edge", _COLUMNS, tuple(_row(name, one, millimetres) for name, one in rows),
        "Black into white is +. What the picture's tone curve leaves open is in each sigma; in differences it cancels.",
    )  # fmt: skip


def shape_table(record: CouponRecord) -> Table:
    """Size and shape, in the bed's axes."""
    found = record.found.whole
    rows = [] if found.known_size is None else [_row("size, + is too large", found.known_size, percent)]
    rows += [_row(f"axis {name} beyond the mean", one, percent) for name, one in found.axes.items()]
    rows += [_row(f"skew {name}", one, degrees) for name, one in found.skews_rad.items()]
    return Table(
        "Size and shape", _COLUMNS, tuple(rows),
        "Axes are the bed's, with the coupon as design lays it: pattern down. A tilted photo tells little of axes and "
        "skew: take one squarely from above, or several from several sides and turned by a quarter.",
    )  # fmt: skip


_COLUMNS = (
    Column("", is_number=False), Column("value ± sigma"), Column("sigmas from zero"), Column("", is_number=False),
)  # fmt: skip


def _row(name: str, one: Estimate, text: Callable[[Estimate], str]) -> tuple[Cell, ...]:
    is_off = one.is_significant
    return (
        Cell(name), Cell(text(one), one.value), Cell(f"{one.significance:.1f}", one.significance),
        Cell("off" if is_off else "may be noise", level="usable" if is_off else None),
    )  # fmt: skip


def widths_table(record: CouponRecord) -> Table:
    """Strokes and lines as they came out."""
    columns = (
        Column("feature", is_number=False), Column("designed mm"), Column("printed across x mm"),
        Column("printed across y mm"),
    )  # fmt: skip
    rows = tuple(
        (Cell(FEATURES[one.feature]), Cell(f"{one.designed_mm:g}", one.designed_mm),
         *(Cell(told(way, signed=False), way.value) for way in one.printed_mm))
        for one in record.found.widths
    )  # fmt: skip
    return Table("Widths", columns, rows, "What a stroke of a target comes out as.", visible_rows=20)


def pictures_table(record: CouponRecord) -> Table:
    """Each photo, and what it is worth."""
    columns = (
        Column("picture", is_number=False), Column("rings"), Column("edges"), Column("px/mm"), Column("blur px"),
        Column("tone curve", note="its power; a linear file has 1, the usual encoding about 2.2"),
        Column("misfit", note="of the edges' profile; 1 or less is good"), Column("rings off px"),
        Column("tilt deg"),
        Column("left out", is_number=False),
    )  # fmt: skip
    rows = tuple(
        (Cell(one.name, level="usable" if one.fault else None), whole(one.rings), whole(one.edges),
         *(number(value) for value in (one.px_per_mm, one.blur_px, one.gamma, one.misfit, one.rings_px, one.tilt_deg)),
         Cell(one.fault))
        for one in record.pictures
    )  # fmt: skip
    return Table("Pictures", columns, rows)


def options_of(record: CouponRecord) -> tuple[NextOption, ...]:
    """What the next design is to be printed with."""
    found, made, told_next = record.found, record.made_with, record.next_print
    is_new = told_next.ink_offset_mm != made.ink_offset_mm
    ink = NextOption(
        "--ink-offset", format_mm(told_next.ink_offset_mm) if told_next.ink_offset_mm else "0",
        format_mm(made.ink_offset_mm) if made.ink_offset_mm else "0",
        f"{found.bleed_mm.sigma:.2g} mm" if is_new else "",
    )  # fmt: skip
    return (ink, *next_options(found.whole, made.whole))


def next_steps(record: CouponRecord) -> tuple[Command | Paragraph, ...]:
    """The options to print with, and what would tell more."""
    options = options_of(record)
    used = " ".join(one.typed for one in options if (one.value, one.made_with) != ("0", "0"))
    blocks: list[Command | Paragraph] = []
    if any(one.value != one.made_with for one in options):
        sure = ", ".join(one.sigma for one in options if one.sigma)
        blocks.append(Command(f"design ... {used}", f"prints right (± {sure})"))
    else:
        blocks.append(Paragraph("Nothing needs a correction" + (f": keep {used}." if used else ".")))
    if record.found.y_beyond_x_mm.is_significant:
        blocks.append(
            Paragraph(
                "One ink offset is for both axes: what they differ by stays, half of it on each; it moves no centre."
            )
        )
    axes = record.found.whole.axes
    if any(one.is_significant for one in axes.values()):
        scale = ", ".join(f"{name} {100 / (1 + one.value):.3f}%" for name, one in axes.items())
        blocks.append(Paragraph(f"In the slicer, beside that: scale {scale}."))
    if record.found.whole.known_size is None:
        blocks.append(
            Paragraph(
                'For the size measure from the left rim of one ring to that of another and give --length "ring 0 to '
                'ring 24:42.98mm+-0.03mm", or scan the coupon and give --dpi.'
            )
        )
    return tuple(blocks)
