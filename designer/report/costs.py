"""What a print takes, told once: hours, changes, purge, grams, spools and money, against the other builds.

And whether that is sensible: a design can be printable and yet nothing that anybody should print.
"""

import math
import tomllib
from collections.abc import Iterator
from dataclasses import asdict, dataclass

from designer.base.answer import Value
from designer.base.errors import InputError
from designer.kinds.sizing import size_job
from designer.kinds.spec_file import parse_spec, spec_to_toml
from designer.make.estimate import DENSITY_G_PER_CM3, DIAMETER_MM, SPOOL_G, PrintEstimate
from designer.make.printability import check_printability
from designer.page.blocks import Cell, Column, Level, Section, Table, text_table
from designer.produce import Design
from designer.report.making import colour_words
from designer.spec.build import BUILDS, builds_of
from designer.spec.spec import FILAMENT_PRICE, PrintSpec

LONG_S = 24 * 3600.0
"""A print that goes on for longer must not fail in a night, and a day later nobody remembers why it did."""
MUCH_CHANGING_S = 2 * 3600.0
"""Changing filament for longer, and for more than a quarter of the whole, is time for nothing."""
MUCH_PURGE_G = 30.0
"""More than that, and more than the print weighs, is waste."""
COSTS_TITLE = "Time, filament and cost"
_CHOSEN_ANEW = ("name", "build", "inlay_depth", "sticker_thickness", "formats")
"""What a build chooses for itself."""


@dataclass(frozen=True)
class BuildCosts:
    """A build of a target, and what it takes."""

    build: str
    is_two_filament: bool
    estimate: PrintEstimate

    @property
    def faults(self) -> tuple[str, ...]:
        """Why nobody should print it so; nothing for a sensible print."""
        return tuple(_faults(self.estimate))


@dataclass(frozen=True)
class Costs:
    """A design and the other builds of the same target that print plastic; its own may print none."""

    own: BuildCosts
    others: tuple[BuildCosts, ...]

    @property
    def is_printed(self) -> bool:
        """Whether the design prints plastic, so that there is something to tell."""
        return bool(self.own.estimate.plates)

    @property
    def better(self) -> BuildCosts | None:
        """The build to take instead: one with fewer faults, printed ink before glued paper, then the faster one."""
        fewer = [way for way in self.others if len(way.faults) < len(self.own.faults)]
        return min(fewer, key=lambda way: (len(way.faults), not way.is_two_filament, way.estimate.time_s), default=None)


def costs_of(design: Design) -> Costs:
    """A design against its other builds."""
    printing = design.job.printing
    others = (_otherwise(design, name) for name in builds_of(design.job.target.form) if name != printing.build)
    own = BuildCosts(printing.build, printing.is_two_filament, design.estimate)
    return Costs(own, tuple(way for way in others if way is not None))


def _otherwise(design: Design, build: str) -> BuildCosts | None:
    """The same target in another build; None where it cannot be, or has nothing to print."""
    if not BUILDS[build].has_body:
        return None
    values = {key: value for key, value in tomllib.loads(spec_to_toml(design.job)).items() if key not in _CHOSEN_ANEW}
    try:
        other = Design(size_job(parse_spec({**values, "build": build}, "")).job)
        if check_printability(other.target, other.job.printing).violations:
            return None
        return BuildCosts(build, BUILDS[build].is_two_filament, other.estimate)
    except InputError:
        return None


def _faults(estimate: PrintEstimate) -> Iterator[str]:
    """What is beyond reason, in words."""
    longest = max((plate.time_s for plate in estimate.plates), default=0.0)
    if longest > LONG_S:
        yield f"{duration(longest)} in one go" if len(estimate.plates) > 1 else "in one go"
    if estimate.changing_s > max(MUCH_CHANGING_S, estimate.time_s / 4):
        yield f"{duration(estimate.changing_s)} of it for {estimate.changes} changes of filament"
    if estimate.purge_g > max(MUCH_PURGE_G, estimate.body_g + estimate.ink_g):
        yield f"{grams(estimate.purge_g)} purged for {grams(estimate.body_g + estimate.ink_g)} of target"
    heaviest = max((plate.body_g for plate in estimate.plates), default=0.0)
    if heaviest > SPOOL_G:
        yield f"a body of {grams(heaviest)}, more than a spool holds"


def verdict(costs: Costs) -> str:
    """Why a design should not be printed so, and what is better; "" for a sensible one."""
    faults = costs.own.faults
    if not faults:
        return ""
    said = f"It takes {duration(costs.own.estimate.time_s)}, {', '.join(faults)}"
    if costs.better is None:
        return f"{said}. A smaller target takes less."
    other = costs.better.estimate
    changes = f" and {_changes(other.changes)}" if costs.better.is_two_filament else ""
    return f"{said}. Better: --build {costs.better.build}, {duration(other.time_s)}{changes}."


def cost_sentence(estimate: PrintEstimate) -> str:
    """The same of a sensible one: `3 h 20 min, 4 changes of filament, 120 g`."""
    parts = [duration(estimate.time_s), grams(estimate.total_g)]
    if estimate.changes:
        parts.insert(1, f"{_changes(estimate.changes)} of filament")
    return f"About {', '.join(parts)}."


def _changes(count: int) -> str:
    return f"{count} change{'s' * (count != 1)}"


def duration(time_s: float) -> str:
    """`40 min`, `3 h 20 min`, `39 h`."""
    minutes = max(round(time_s / 60), 1)
    if minutes < 60:
        return f"{minutes} min"
    if minutes < 600:
        return f"{minutes // 60} h" + (f" {minutes % 60} min" if minutes % 60 else "")
    return f"{round(minutes / 60)} h"


def grams(mass_g: float) -> str:
    """`0.72 g`, `120 g`."""
    return f"{_few_digits(mass_g)} g"


def _few_digits(value: float) -> str:
    """Two digits, three of those above 100."""
    return f"{float(f'{value:.{3 if value >= 100 else 2}g}'):g}"


def cost_table(costs: Costs, printing: PrintSpec, layers: float) -> Table:
    """This build against the others; a plate has so many layers."""
    is_assumed = printing.filament_price == FILAMENT_PRICE
    assumed, currency = (", which is assumed", ", EUR") if is_assumed else ("", "")
    columns = (
        Column("build", is_number=False),
        Column("plates"),
        Column("time", note="of all plates, one after the other, with heating up"),
        Column("changes", note="of the filament"),
        Column("purge", note="filament that changes throw away"),
        Column("filament", note="all that comes off the spools"),
        Column("spools", note="of 1 kg"),
        Column(f"price{currency}", note=f"at {printing.filament_price:g} a kilogram{assumed}: --filament-price"),
    )
    rows = tuple(_cost_row(way, is_own=way is costs.own) for way in (costs.own, *costs.others))
    return Table("What it takes", columns, rows, note=_rests_on(printing, layers))


def _cost_row(way: BuildCosts, *, is_own: bool) -> tuple[Cell, ...]:
    one = way.estimate
    level: Level | None = "usable" if way.faults else None
    return (
        Cell(f"{way.build}, this design" if is_own else way.build),
        Cell(str(len(one.plates)), len(one.plates)),
        Cell(duration(one.time_s), one.time_s, level=level),
        Cell(str(one.changes), one.changes),
        Cell(grams(one.purge_g), one.purge_g),
        Cell(grams(one.total_g), one.total_g),
        Cell(f"{one.spools:.2f}", one.spools),
        Cell(f"{one.price:.2f}", one.price),
    )


def _rests_on(printing: PrintSpec, layers: float) -> str:
    """The assumptions in a line."""
    machine = printing.printer.machine
    change = machine.change
    changing = f"a change of {change.time_s:g} s with {change.purge_to_ink_mm3:g} or {change.purge_to_body_mm3:g} mm³"
    if change.is_tool_changer:
        changing = f"a nozzle for each filament, {change.time_s:g} s and {change.purge_to_ink_mm3:g} mm³ a change"
    left_out = f"Brim{', stand' * printing.stand} and supports"
    return (
        f"Estimated before slicing, from the model and the profile of {printing.printer.name}: "
        f"{machine.shells.words(layers)}, layers of {printing.printer.layer_height_mm:g} mm, {changing}. "
        "PrusaSlicer with the same settings differs by "
        f"up to 15 % in time and 5 % in plastic, real printers by more. {machine.start_s / 60:.2g} min a plate "
        f"for heating and levelling are as the profile assumes. {left_out} are not in it."
    )


def cost_section(costs: Costs, printing: PrintSpec, plate_layers: float = math.inf) -> Section:
    """This build against the others, its filament by slot, its time by plate."""
    one = costs.own.estimate
    layers = "1 layer holds" if one.inked_layers == 1 else f"{one.inked_layers} layers hold"
    why = f" {layers} ink, which makes {_changes(one.changes)}." if one.changes else ""
    blocks = (cost_table(costs, printing, plate_layers), _slot_table(one, printing), _plate_table(one))
    return Section(COSTS_TITLE, blocks, f"{cost_sentence(one)}{why}")


def _slot_table(one: PrintEstimate, printing: PrintSpec) -> Table:
    """What comes off each spool."""
    body, ink = colour_words(printing.body_colour), colour_words(printing.ink_colour)
    rows = [("1, body", body if one.ink_g else "any", one.body_g)]
    if one.ink_g:
        rows.append(("2, ink", ink, one.ink_g))
    if one.purge_g:
        rows.append(("both, purged", "", one.purge_g))
    columns = (Column("slot", is_number=False), Column("colour", is_number=False), Column("weight"), Column("length"))
    cells = tuple(
        (Cell(slot), Cell(colour), Cell(grams(mass), mass), Cell(f"{_few_digits(_length_m(mass))} m", _length_m(mass)))
        for slot, colour, mass in rows
    )
    return Table(
        "Filament of each slot", columns, cells, note="PLA, 1.24 g/cm³ by its makers; length of filament of 1.75 mm."
    )


def _plate_table(one: PrintEstimate) -> Table:
    """Each print for itself."""
    heads = ("plate", "time", "printing", "changing", "heating up", "layers", "of them with ink", "changes")
    rows = []
    for number, plate in enumerate(one.plates, start=1):
        times = (plate.time_s, plate.printing_s, plate.changing_s, plate.start_s)
        counts = (plate.layers, plate.inked_layers, plate.changes)
        name = plate.name.replace("-", " ") or str(number)
        rows.append((name, *(duration(time) if time else "" for time in times), *map(str, counts)))
    return text_table("Plates", heads, rows)


def _length_m(mass_g: float) -> float:
    """Of filament."""
    return mass_g / DENSITY_G_PER_CM3 / (math.pi / 4 * DIAMETER_MM**2)


def costs_summary(costs: Costs) -> Value:
    """The same for a program."""
    return [
        {
            "build": way.build, "is_this": way is costs.own, "time_s": round(way.estimate.time_s),
            "changing_s": round(way.estimate.changing_s), "changes": way.estimate.changes,
            "body_g": round(way.estimate.body_g, 2), "ink_g": round(way.estimate.ink_g, 2),
            "purge_g": round(way.estimate.purge_g, 2), "spools": round(way.estimate.spools, 3),
            "price": round(way.estimate.price, 2), "faults": list(way.faults),
            "plates": [asdict(plate) for plate in way.estimate.plates],
        }
        for way in (costs.own, *costs.others)
    ]  # fmt: skip
