"""What is said of a target put together from pieces: which sits badly, by how much, and what to do."""

import math
from collections.abc import Sequence

from calib.draw.print_errors import told
from calib.measure_target.deviations import Estimate
from calib.measure_target.tile_fit import PARTS, Fault, Seat, Seats
from designer.base.words import capital, figure, with_digits
from designer.page.blocks import Cell, Column, Finding, Level, Table

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
