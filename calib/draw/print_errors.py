"""Numbers of a print, what takes them back in the next, and how the pieces of a target sit."""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

from calib.measure_target.deviations import (
    Compensation,
    Estimate,
    WholePrint,
    compensation_percent,
    next_shrink_percent,
    next_skew_rad,
)
from calib.measure_target.tile_fit import PARTS, Fault, Seat, Seats
from designer.base.units import MOST_SKEW_DEG, SKEW_NAMES, Skew
from designer.base.words import capital, figure, with_digits
from designer.page.blocks import Cell, Column, Command, Finding, Level, Paragraph, Table
from designer.page.folders import Shown, table_of
from designer.spec.build import BUILDS, builds_of
from designer.target import TargetGeometry

FINEST = 1.5e-4
"""Standard deviation to whose digits numbers are told at the most."""
FINEST_DEG = 1.5e-2
"""The same of skews, so that they read as the option that takes them back, to 0.001 deg: 2 um on 100 mm."""


def told(one: Estimate, unit: str = "", scale: float = 1.0, *, signed: bool = True, finest: float = FINEST) -> str:
    """`+0.312 ± 0.004 %`."""
    value, sigma = scale * one.value, scale * one.sigma
    if not math.isfinite(value):
        return "-"
    text = with_digits(value, max(sigma, finest))
    sign = "+" if signed and not text.startswith("-") else ""
    return f"{sign}{text} ± {figure(sigma, 2)}{unit}"


def millimetres(one: Estimate, *, signed: bool = True) -> str:
    """`+0.101 ± 0.005 mm`."""
    return told(one, " mm", signed=signed)


def percent(one: Estimate, *, signed: bool = True) -> str:
    """`+0.312 ± 0.004 %`."""
    return told(one, " %", 100, signed=signed)


def degrees(one: Estimate) -> str:
    """`+0.031 ± 0.002 deg`."""
    return told(one, " deg", math.degrees(1), finest=FINEST_DEG)


ErrorRow = tuple[str, Estimate, Callable[[Estimate], str]]
"""What it is, how large, and how that is told."""


def errors_table(title: str, rows: Iterable[ErrorRow], note: str) -> Table:
    """How far a print is off, and what of it is more than noise."""
    return table_of(
        rows,
        Shown[ErrorRow]("", lambda row: row[0]),
        Shown[ErrorRow]("value ± sigma", lambda row: Cell(row[2](row[1]), row[1].value)),
        Shown[ErrorRow]("sigmas from zero", lambda row: row[1].significance),
        Shown[ErrorRow]("", lambda row: Cell("off", level="usable") if row[1].is_significant else "may be noise"),
        title=title,
        note=note,
    )


def whole_rows(whole: WholePrint) -> list[ErrorRow]:
    """Size and shape of a whole print, as far as they are known."""
    rows: list[ErrorRow] = [] if whole.known_size is None else [("size, + is too large", whole.known_size, percent)]
    rows += [(f"axis {name} beyond the mean", one, percent) for name, one in whole.axes.items()]
    return [*rows, *((f"skew {name}", one, degrees) for name, one in whole.skews_rad.items())]


@dataclass(frozen=True)
class NextOption:
    """An option of `design`, as it is typed for the next print of the same design."""

    name: str
    value: str  # "0": left away
    made_with: str  # what this print was made with
    sigma: str = ""  # of the value; "" if it is kept

    @property
    def typed(self) -> str:
        """Name and value."""
        return f'{self.name} "{self.value}"' if " " in self.value else f"{self.name} {self.value}"


def next_options(whole: WholePrint, made_with: Compensation) -> tuple[NextOption, ...]:
    """What the next print is to be made with, so that it comes out as designed."""
    made_percent, made_skew = made_with.shrink_percent, skew_words(made_with.skew_rad)
    percent, skew_rad = next_shrink_percent(whole, made_percent), next_skew_rad(whole, made_with.skew_rad)
    is_new = percent != made_percent
    sigma = f"{100 * whole.size.sigma:.2g} %" if is_new and whole.size is not None else ""
    shrink = NextOption(
        "--shrink-compensation", (f"{percent:.3f}%" if is_new else f"{percent:g}%") if percent else "0",
        f"{made_percent:g}%" if made_percent else "0", sigma,
    )  # fmt: skip
    skew = skew_words(skew_rad) if is_within_reach(skew_rad) else made_skew
    sigma_deg = max((math.degrees(one.sigma) for one in whole.skews_rad.values() if one.is_significant), default=0.0)
    return (
        shrink,
        NextOption("--skew-compensation", skew, made_skew, f"{sigma_deg:.2g} deg" if skew != made_skew else ""),
    )


def is_within_reach(skew_rad: Skew) -> bool:
    """Whether `design` takes so much back."""
    return max(map(abs, skew_rad)) <= math.radians(MOST_SKEW_DEG)


def skew_words(skew_rad: Skew) -> str:
    """Angles as `design --skew-compensation` reads them, to 0.001 deg: 2 um on 100 mm."""
    angles = [(name, f"{math.degrees(angle):.3f}") for name, angle in zip(SKEW_NAMES, skew_rad, strict=True)]
    return ", ".join(f"{name} {angle}deg" for name, angle in angles if float(angle)) or "0"


def is_plastic(target: TargetGeometry) -> bool:
    """Whether it is of ours and printed in plastic, so that `design` corrects size and angles; else on paper, or so."""
    build = target.build or (None if target.spec is None else builds_of(target.form)[0])
    return build is not None and BUILDS[build].has_body


def next_print(whole: WholePrint, made_with: Compensation, *, plastic: bool) -> tuple[Command | Paragraph, ...]:
    """What to dial in, so that the next print of the same design comes out right."""
    if not whole.can_be_corrected:
        return (Paragraph("Size or shape is off by more than a printer can be: nothing to dial in against it."),)
    return tuple(_in_plastic(whole, made_with) if plastic else _on_paper(whole))


def _on_paper(whole: WholePrint) -> Iterator[Command | Paragraph]:
    """Of a print on paper the size is all that a printer's dialog takes back."""
    size = whole.known_size
    if size is None:
        yield Paragraph("Measure one length with a caliper or a ruler and give it with --length, to know the size.")
    elif not size.is_significant:
        yield Paragraph("The size needs no correction.")
    else:
        yield Paragraph(f"Print it at {100 + compensation_percent(size.value):.3f} % of its size.")
    if not whole.is_in_shape:
        yield Paragraph(
            "Axes or angles are off by more than noise: another printer or paper; until then use the measured target."
        )


def _in_plastic(whole: WholePrint, made_with: Compensation) -> Iterator[Command | Paragraph]:
    size, options = whole.known_size, next_options(whole, made_with)
    shrink, skew = options
    if size is None:
        yield Paragraph("Measure one length with a caliper and give it with --length, to know the shrinkage.")
    elif shrink.value == shrink.made_with:
        keep = f": keep {shrink.typed}" if shrink.value != "0" else ""
        yield Paragraph(f"The size needs no correction{keep}.")
    if any(one.value != one.made_with for one in options):
        used = " ".join(one.typed for one in options if (one.value, one.made_with) != ("0", "0"))
        made = " and ".join(one.made_with for one in options if one.made_with != "0")
        sure = ", ".join(one.sigma for one in options if one.sigma)
        before = f"; this one was made with {made}" if made else ""
        yield Command(f"design ... {used}", f"the next print of the same design, in plastic (± {sure}){before}")
    if whole.axes and whole.is_in_shape:
        beyond = f" beyond {skew.typed}" if skew.value != "0" else ""
        yield Paragraph(f"Axes and angles need no correction{beyond}.")
    axes = [
        f"{name} {100 + compensation_percent(one.value):.3f}%" for name, one in whole.axes.items() if one.is_significant
    ]
    if axes:
        yield Paragraph(f"In the slicer, beside that: scale {', '.join(axes)}.")
    skews = [f"{name} by {degrees(one)}" for name, one in whole.skews_rad.items() if one.is_significant]
    if skews:
        yield Paragraph(
            "Or, with --skew-compensation left as it was, in the printer's skew correction (Marlin M852, Klipper "
            f"SET_SKEW): its second axis leans towards the first, {', '.join(skews)}."
        )
    if not is_within_reach(next_skew_rad(whole, made_with.skew_rad)):
        yield Paragraph(
            f"design takes back no more than {MOST_SKEW_DEG:g} deg of skew: square the printer's axes first."
        )


MOST_NAMED = 3
"""Pieces that get a line each; the others share one."""
LEVEL_OF_SEAT: dict[str, Level] = {"sits badly": "usable", "as usual": "good"}
NOUNS: dict[Fault, str] = {"lifted": "height", "shifted": "shift", "turned": "turn", "tilted": "tilt"}
HAND = 0.01
"""Least standard deviation that a sentence tells, in mm and deg."""
IN_PLANE: tuple[Fault, ...] = ("turned", "shifted")


def seats_sentence(seats: Seats) -> str:
    """How many pieces sit badly, and the worst one."""
    if not seats.judged:
        return f"no {seats.piece} is judged"
    count, judged, bad = len(seats.seats), seats.judged, seats.bad
    besides = f" ({count - judged} not judged)" if judged < count else ""
    if bad:
        sit = "sits" if len(bad) == 1 else "sit"
        return f"{len(bad)} of {count} {seats.piece}s {sit} badly{besides}; the worst is {_piece(seats, bad[0])}"
    worst = max((one for one in seats.seats if one.verdict == "as usual"), key=lambda one: one.worst)
    return f"all {seats.piece}s sit as is usual for '{seats.made}'{besides}; off most is {_piece(seats, worst)}"


def _piece(seats: Seats, one: Seat) -> str:
    return f"{seats.piece} {one.face}, {off_words(seats, one)}"


def off_words(seats: Seats, one: Seat) -> str:
    """`0.31 ± 0.01 mm high, turned 0.20 ± 0.01 deg`: what is beyond the limits, or comes nearest to them."""
    nearest = max(PARTS, key=lambda fault: one.share(fault, seats.limits))
    return ", ".join(_fault_words(one, fault) for fault in one.faults or (nearest,))


def _fault_words(one: Seat, fault: Fault) -> str:
    if fault == "lifted":
        return _height(one.height_mm)
    if fault == "shifted":
        return f"{_size(one.shift_mm, 'mm')} aside"
    return f"{fault} {_size(one.of(fault), 'deg', math.degrees(1))}"


def _height(one: Estimate) -> str:
    """`0.31 ± 0.01 mm high`."""
    return f"{_size(one, 'mm')} {'high' if one.value > 0 else 'low'}"


def _size(one: Estimate, unit: str, scale: float = 1.0) -> str:
    """Without its sign, and no finer than a hand can put a piece down; the tables have all digits."""
    value, sigma = abs(scale * one.value), max(scale * one.sigma, HAND)
    return f"{with_digits(value, 10 * sigma)} ± {figure(sigma, 1)} {unit}"


def seat_findings(seats: Seats) -> tuple[Finding, ...]:
    """The pieces that sit badly, the worst first, and what all have in common."""
    bad, piece = seats.bad, seats.piece
    rows = [Finding("usable", capital(f"{piece} {one.face}"), _remedy(seats, one)) for one in bad[:MOST_NAMED]]
    if more := bad[MOST_NAMED:]:
        numbers = ", ".join(str(one.face) for one in more)
        rows.append(Finding("usable", f"{len(more)} more {piece}s", f"{numbers}; the table has their numbers."))
    if 2 * len(bad) > seats.judged:
        most = (
            f"As most {piece}s are beyond the limits of '{seats.made}', so is this way of putting them on: leave those "
            "that hold, as they are in the measured target."
        )
        rows.append(Finding("note", "Most", most))
    if bad:
        again = f"After a {piece} was moved, take new photos and measure again; until then the measured target holds."
        rows.append(Finding("note", "Moving one", again))
    if (common := seats.common_height_mm) is not None:
        words = (
            f"stand {_height(common)} alike: body and {piece}s differ in size, or so much lies under each. It is no "
            f"{piece}'s fault, is in the measured target, and is taken off the heights that are told."
        )
        rows.append(Finding("note", f"All {piece}s", words))
    return tuple(rows)


def _remedy(seats: Seats, one: Seat) -> str:
    limits = " and ".join(_limit_words(seats, fault) for fault in one.faults)
    said = [f"{off_words(seats, one)}; usual for '{seats.made}' is up to {limits}"]
    if any(fault not in IN_PLANE for fault in one.faults):
        said.append(capital(seats.lifted_remedy))
    if any(fault in IN_PLANE for fault in one.faults):
        said.append(capital(seats.aside_remedy))
    return f"{'. '.join(said)}."


def _limit_words(seats: Seats, fault: Fault) -> str:
    limit = seats.limits.of(fault)
    return f"{figure(limit, 2)} mm" if fault in ("lifted", "shifted") else f"{figure(math.degrees(limit), 2)} deg"


def seats_table(seats: Seats, views: Sequence[int]) -> Table:
    """How each piece sits, the worst first."""
    columns = (
        Column(seats.piece), Column("verdict", is_number=False), Column("photos"),
        Column("of the limit", note="the largest of height, shift, turn and tilt over its limit"),
        Column("height [mm]"), Column("shift x [mm]"), Column("shift y [mm]"), Column("turned [deg]"),
        Column("tilted [deg]"),
    )  # fmt: skip
    order = sorted(seats.seats, key=lambda one: -one.worst)
    limits = ", ".join(f"{word} {_limit_words(seats, fault)}" for fault, word in NOUNS.items())
    common = seats.common_height_mm
    off = "" if common is None else f" All stand {_height(common)} alike, which is taken off."
    note = (
        "In the face's own axes about its middle, z outwards, against those that sit well, whose mean counts as right; "
        "what size and stretch of the body do is taken off. ± is the measurement's. "
        f"Limits of '{seats.made}': {limits}.{off}"
    )
    rows = tuple(_row(one, views[one.face]) for one in order)
    return Table(f"How the {seats.piece}s sit", columns, rows, note, visible_rows=20)


def _row(one: Seat, views: int) -> tuple[Cell, ...]:
    head = (
        Cell(str(one.face), one.face),
        Cell(one.verdict, level=LEVEL_OF_SEAT.get(one.verdict, "note")),
        Cell(str(views), views),
    )
    mm = (one.height_mm, one.shift_x_mm, one.shift_y_mm)
    deg = (one.turn_rad, one.tilt_rad)
    if one.verdict == "not known":
        return (*head, *(Cell("") for _ in range(1 + len(mm) + len(deg))))
    degree = math.degrees(1)
    numbers = [Cell(told(number), number.value) for number in mm]
    numbers += [Cell(told(number, "", degree, signed=number is one.turn_rad), degree * number.value) for number in deg]
    return (*head, Cell(f"{100 * one.worst:.0f} %", one.worst), *numbers)
