"""What a print takes, told once: hours, changes, purge, grams, spools and money, against the other builds.

And whether that is sensible: a design can be printable and yet nothing that anybody should print.
"""

import json
import math
import sys
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass

from designer.base.answer import Value, command_line
from designer.base.codec import decode, encode
from designer.base.errors import InputError
from designer.base.words import counted
from designer.builds.design import Design, apart, design_apart, maker_of
from designer.kinds.sizing import size_job
from designer.kinds.spec_file import parse_spec, replaced, spec_to_toml
from designer.make.estimate import (
    BY_HAND,
    DENSITY_G_PER_CM3,
    DIAMETER_MM,
    SPOOL_G,
    PrintEstimate,
    duration,
    estimate,
    few_digits,
    grams,
)
from designer.make.printability import check_printability
from designer.page.blocks import Cell, Command, Facts, Fold, Level, Paragraph, Table
from designer.page.folders import Shown, table_of
from designer.spec.build import BUILDS, builds_of
from designer.spec.spec import FILAMENT_PRICE, Job, PrintSpec

LONG_S = 24 * 3600.0
"""A print that goes on for longer must not fail in a night, and a day later nobody remembers why it did."""
MUCH_CHANGING_S = 2 * 3600.0
"""Changing filament for longer, and for more than a quarter of the whole, is time for nothing."""
MUCH_PURGE_G = 30.0
"""More than that, and more than the print weighs, is waste."""
MANY_RINGS = 500
"""Other builds of more take longer than a process takes to begin."""
COSTS_TITLE = "Time, filament and cost"


@dataclass(frozen=True)
class BuildCosts:
    """A build of a target, and what it takes."""

    build: str
    has_printed_ink: bool
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
        return min(fewer, key=lambda way: (len(way.faults), not way.has_printed_ink, way.estimate.time_s), default=None)


OtherBuilds = tuple[BuildCosts, ...]


def _other_builds(design: Design) -> OtherBuilds:
    """Those that there can be, but grooves to paint: they are as slow to estimate as all others together."""
    among, own = builds_of(design.job.target.form), design.job.printing.build
    names = (name for name in among if name != own and BUILDS[name].ink != "recessed")
    return tuple(way for name in names if (way := _otherwise(design, name)) is not None)


def costs_of(design: Design) -> Costs:
    """A design against its other builds; for a command those of a large target are told by a process beside it."""
    is_beside = command_line() and design.target.ring_count > MANY_RINGS
    told = apart("designer.app.costs:write_others", design.job) if is_beside else lambda: None
    printing = design.job.printing
    own, written = BuildCosts(printing.build, printing.way.has_printed_ink, design.estimate), told()
    return Costs(own, _other_builds(design) if written is None else decode(OtherBuilds, json.loads(written)))


def write_others() -> None:
    """What the process beside a command runs."""
    sys.stdout.write(json.dumps(encode(OtherBuilds, _other_builds(design_apart()))))


def _otherwise(design: Design, build: str) -> BuildCosts | None:
    """The same target in another build; None where it cannot be, or has nothing to print."""
    if not BUILDS[build].has_body:
        return None
    values = replaced(tomllib.loads(spec_to_toml(design.job)), {"build": build})
    try:
        job = size_job(parse_spec(values, "")).job
    except InputError:
        return None
    return build_costs(job)


def build_costs(job: Job) -> BuildCosts | None:
    """What a job takes; None where it cannot be made so, or breaks a rule."""
    design, printing = Design(job), job.printing
    try:
        if check_printability(design.target, printing).violations:
            return None
        plates = maker_of(printing).sample_plates(design)
        return BuildCosts(printing.build, printing.way.has_printed_ink, estimate(plates, printing))
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
    said = f"It takes {duration(costs.own.estimate.time_s)} and {money(costs.own.estimate)}, {', '.join(faults)}"
    if costs.better is None:
        return f"{said}. A smaller target takes less."
    return f"{said}. Better: --build {costs.better.build}, {cost_words(costs.better.estimate)}."


def better_build(costs: Costs, name: str) -> tuple[Command, ...]:
    """What to type for the build to take instead, in the folder of the design; nothing for a sensible one."""
    if costs.better is None:
        return ()
    build = costs.better.build
    line = f"design make {name}.toml --build {build} -o {build}"
    return (Command(line, "Better, typed in this folder"),)


def cost_words(estimate: PrintEstimate) -> str:
    """The same of a sensible one: `3 h 20 min, 4 changes of filament, 120 g, 3.00 EUR`."""
    changes = (f"{counted(estimate.changes, 'change')} of filament",) * bool(estimate.changes)
    return ", ".join((duration(estimate.time_s), *changes, grams(estimate.total_g), money(estimate)))


def money(estimate: PrintEstimate) -> str:
    """`3.00 EUR`."""
    return f"{estimate.price:.2f} {estimate.filament.currency}"


def cost_table(costs: Costs, printing: PrintSpec) -> Table:
    """This build against the others."""
    filament, shown = printing.filament_price, Shown[BuildCosts]
    return table_of(
        (costs.own, *costs.others),
        shown("build", lambda one: f"this: {one.build}" if one is costs.own else one.build),
        shown("time", lambda one: _cell(duration, one.estimate.time_s, "usable" if one.faults else None)),
        shown("changes", lambda one: one.estimate.changes),
        shown("purge", lambda one: _cell(grams, one.estimate.purge_g)),
        shown("filament", lambda one: _cell(grams, one.estimate.total_g)),
        shown(f"price, {filament.currency}", lambda one: Cell(f"{one.estimate.price:.2f}", one.estimate.price)),
    )  # fmt: skip


def _cell(words: Callable[[float], str], value: float, level: Level | None = None) -> Cell:
    return Cell(words(value), value, level=level)


def _rests_on(printing: PrintSpec) -> str:
    """The assumptions in a line."""
    machine, filament = printing.printer.machine, printing.filament_price
    price = f"{filament.words} a kilogram{', assumed' * (filament == FILAMENT_PRICE)} (--filament-price)"
    change = machine.change
    changing = f"a change of {change.time_s:g} s with {change.purge_to_ink_mm3:g} or {change.purge_to_body_mm3:g} mm³"
    if printing.way.ink == "raised":
        changing = f"a change by hand in {BY_HAND.time_s:g} s with {BY_HAND.purge_to_ink_mm3:g} mm³"
    elif change.is_tool_changer:
        changing = f"a nozzle for each filament, {change.time_s:g} s and {change.purge_to_ink_mm3:g} mm³ a change"
    return (
        f"{price}; {printing.printer.name}: {changing}, {machine.start_s / 60:.2g} min a plate to heat; without "
        f"brim{', stand' * printing.stand}{', jig' * printing.jig} and supports. PrusaSlicer "
        "differs by up to 15 % in time, 5 % in plastic; printers by more."
    )


def cost_fold(costs: Costs, printing: PrintSpec) -> Fold:
    """This build against the others, and its filament by slot."""
    one = costs.own.estimate
    start_s = sum(plate.start_s for plate in one.plates)
    parts = (("printing", one.time_s - one.changing_s - start_s), ("changing", one.changing_s), ("heating", start_s))
    times = ", ".join(f"{name} {duration(time_s)}" for name, time_s in parts if time_s)
    facts, section_mm2 = [("time", times)], math.pi / 4 * DIAMETER_MM**2  # of filament of PLA
    for slot, mass_g in (("purged", one.purge_g), ("ink", one.ink_g), ("body", one.body_g)):
        if mass_g:
            facts.insert(0, (slot, f"{grams(mass_g)}, {few_digits(mass_g / DENSITY_G_PER_CM3 / section_mm2)} m"))
    table = (cost_table(costs, printing),) if costs.others else ()
    return Fold(COSTS_TITLE, (*table, Facts(tuple(facts)), Paragraph(_rests_on(printing))))


def costs_summary(costs: Costs) -> Value:
    """The same for a program."""
    return [
        {
            "build": way.build, "is_this": way is costs.own, "time_s": round(way.estimate.time_s),
            "changing_s": round(way.estimate.changing_s), "changes": way.estimate.changes,
            "body_g": round(way.estimate.body_g, 2), "ink_g": round(way.estimate.ink_g, 2),
            "purge_g": round(way.estimate.purge_g, 2), "spools": round(way.estimate.spools, 3),
            "price": round(way.estimate.price, 2), "currency": way.estimate.filament.currency,
            "faults": list(way.faults),
            "plates": [asdict(plate) for plate in way.estimate.plates],
        }
        for way in (costs.own, *costs.others)
    ]  # fmt: skip
