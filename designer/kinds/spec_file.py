"""The files people write: target specs and printer profiles in TOML, every field optional, quantities with units.

The command line's options are read by the same rules: a key of a file and an option are one (`designer.spec.options`).
"""

import json
import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Literal, TypeAlias, TypeVar, cast

from designer.base.codec import BadValueError, decode, decode_written, encode
from designer.base.errors import InputError
from designer.base.files import MAX_TOML_BYTES, JsonValue, read_small_text, read_spec_file
from designer.base.marks import Above, AtMost, Reads, Told
from designer.base.marks import Length as ItemCount
from designer.base.units import (
    UNITS_MM,
    format_mm,
    format_skew,
    page_size_mm,
    parse_length_mm,
    parse_lengths_mm,
    parse_percent,
    parse_skew_rad,
)
from designer.base.words import shown, suggestion
from designer.spec.build import ANY_MOUNT, MOUNTS, NO_MOUNT, Format, InkSide, build_name
from designer.spec.format import FORMATS
from designer.spec.kind import KINDS, kind_named, kinds
from designer.spec.machine import UNKNOWN_MACHINE, Machine
from designer.spec.options import Asked, AskedPrinting, Value, is_required, options_of
from designer.spec.spec import Job, Lattice, Price

LEAST_LENGTH_MM, MOST_PERCENT = 0.0005, 20

RawValue = object
"""A value as TOML or the command line gives it, before the models have checked it."""


def _positive(value: float) -> float:
    if value <= 0:
        raise ValueError("must be more than zero")
    if value < LEAST_LENGTH_MM:
        raise ValueError(f"must be at least {LEAST_LENGTH_MM:g}mm")
    return value


def _not_negative(value: float) -> float:
    if value < 0:
        raise ValueError("must not be negative")
    return value


def _size(text: str) -> tuple[float, float]:
    width, height = parse_lengths_mm(text, 2)
    return _positive(width), _positive(height)


def _bed(text: str) -> tuple[float, float, float]:
    width, depth, height = parse_lengths_mm(text, 3)
    return _positive(width), _positive(depth), _positive(height)


def _format_list(value: RawValue) -> list[str]:
    given = value.split(",") if isinstance(value, str) else value
    if not isinstance(given, list) or not all(isinstance(name, str) for name in given):
        raise ValueError(f"must be a list of {', '.join(FORMATS)}, or all")
    names = [name.strip().lower() for name in given]
    if "all" in names:
        return list(FORMATS)
    for name in names:
        if name not in FORMATS:
            hint = suggestion(name, list(FORMATS)) or f"; use {', '.join(FORMATS)} or all"
            raise ValueError(f"unknown format {name!r}{hint}")
    return [name for name in FORMATS if name in names]


def _page(value: str) -> str:
    try:
        page_size_mm(value)
    except InputError as error:
        raise ValueError(str(error).removeprefix(f"page {value!r}").lstrip(": ")) from None
    return value


def _unicode(value: str) -> str:
    try:
        value.encode()
    except UnicodeEncodeError:  # a path of bytes that are no text, which the resolved spec could not hold
        raise ValueError("must be text; rename the file") from None
    return value


def _name(value: str) -> str:
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}", value):
        raise ValueError(
            "must be 1 to 64 letters, digits, dots, dashes or underscores and begin with a letter or digit"
        )
    return value


def _colour(value: str) -> str:
    if not re.fullmatch(r"#[0-9a-fA-F]{6}", value):
        raise ValueError("must be a colour such as #ffffff")
    return value.lower()


def _whole(least: int, below: int, rule: str) -> Reads:
    """A whole number, also as text of as many digits."""

    def read(value: RawValue) -> int:
        is_text = isinstance(value, str) and value.isascii() and value.isdecimal() and len(value) < len(str(below))
        number = int(cast("str", value)) if is_text else value
        if isinstance(number, bool) or not isinstance(number, int) or not least <= number < below:
            raise ValueError(f"must be a whole number {rule}")
        return number

    return Reads(read)


def _ratio(value: RawValue) -> float:
    ratio = float(value) if isinstance(value, str) and re.fullmatch(r"\d{0,3}\.?\d{1,20}", value) else value
    if isinstance(ratio, bool) or not isinstance(ratio, (int, float)) or not 0.2 <= ratio <= 0.8:
        raise ValueError("must be a number from 0.2 to 0.8; 0.45 locates centres best")
    return float(ratio)


def _price(value: RawValue) -> Price:
    text = str(value) if isinstance(value, (int, float, str)) and not isinstance(value, bool) else ""
    found = re.fullmatch(r"(\d{0,6}\.?\d{1,20}) ?([A-Za-z]{3})?", text)
    if found is None or float(found[1]) > 10_000:
        raise ValueError("must be a number from 0 to 10000, in EUR or with its currency: 25, 25USD")
    return Price(round(float(found[1]), 4), (found[2] or "EUR").upper())


FilamentPrice: TypeAlias = Annotated[Price, Reads(_price)]


def _chord_error(value: float) -> float:
    if not 0.0005 <= value <= 0.5:
        raise ValueError("must be from 0.0005mm to 0.5mm")
    return value


def _one_of(names: Collection[str], value: str) -> str:
    name = " ".join(value.lower().split())
    if name not in names:
        raise ValueError(f"must be one of {', '.join(names)}")
    return name


def _machine(value: RawValue) -> Machine:
    machine = value if isinstance(value, Machine) else decode(Machine, cast("JsonValue", value))
    for left, front, right, rear in machine.excluded_mm:
        if left >= right or front >= rear:
            area = f"[{left:g}, {front:g}, {right:g}, {rear:g}]"
            raise ValueError(
                f"excluded_mm {area}: must be left, front, right and rear of a rectangle, such as [0, 0, 18, 28]"
            )
    return machine


def _text(check: Callable[[str], str]) -> Reads:
    """A text that a check gives back."""

    def read(value: RawValue) -> str:
        if not isinstance(value, str):
            raise ValueError("must be text")
        return check(value)

    return Reads(read)


def _all(parse: Callable[[str], tuple[float, ...]]) -> Reads:
    return Reads(lambda value: parse(cast("str", value)))


def _length(*checks: Callable[[float], float]) -> Reads:
    """A length that keeps some rules."""

    def read(value: RawValue) -> float:
        length = parse_length_mm(cast("str | float", value))
        for check in checks:
            length = check(length)
        return length

    return Reads(read)


def _percent(value: RawValue) -> float:
    percent = parse_percent(cast("str | float", value))
    if not -MOST_PERCENT <= percent <= MOST_PERCENT:
        raise ValueError(f"must be from -{MOST_PERCENT}% to {MOST_PERCENT}%")
    return percent


def _switch(value: RawValue) -> bool:
    if not isinstance(value, bool):
        raise ValueError("must be true or false")
    return value


def _counts(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"\s*(\d{1,4})\s*[x×]\s*(\d{1,4})\s*", text, re.IGNORECASE) if isinstance(text, str) else None
    if found is None:
        raise ValueError("must be columns x rows, such as 11x8")
    return int(found[1]), int(found[2])


def _dictionary(value: str) -> str:
    from designer.marks.dictionaries import dictionary_named  # here: reading a command line needs no arrays

    return dictionary_named(value)


Length = Annotated[float, _length()]
PositiveLength = Annotated[float, _length(_positive)]
Skew = Annotated[tuple[float, float, float], Reads(lambda value: parse_skew_rad(cast("str | float", value)))]
Percent = Annotated[float, Reads(_percent)]
Bed = Annotated[tuple[float, float, float], _all(_bed)]
OfMachine = Annotated[Machine, Reads(_machine)]
READ: Mapping[Value, object] = {
    "file": Annotated[str, _text(_unicode)],
    "name": Annotated[str, _text(_name)],
    "length": Length,
    "length above 0": PositiveLength,
    "length from 0": Annotated[float, _length(_not_negative)],
    "chord error": Annotated[float, _length(_positive, _chord_error)],
    "size": Annotated[tuple[float, float], _all(_size)],
    "bed": Bed,
    "count": Annotated[int, _whole(1, 100_000, "above zero")],
    "ratio": Annotated[float, Reads(_ratio)],
    "percent": Percent,
    "skew": Skew,
    "colour": Annotated[str, _text(_colour)],
    "build": Annotated[str, _text(build_name)],
    "lattice": Lattice,
    "formats": Annotated[list[Format], Reads(_format_list)],
    "page": Annotated[str, _text(_page)],
    "switch": Annotated[bool, Reads(_switch)],
    "machine": OfMachine,
    "price": FilamentPrice,
    "ink side": InkSide,
    "mount": Annotated[str, _text(partial(_one_of, (*MOUNTS, NO_MOUNT, ANY_MOUNT)))],
    "mesh": Annotated[str, _text(_unicode)],
    "unit": Annotated[str, _text(partial(_one_of, UNITS_MM))],
    "corners": Annotated[tuple[tuple[float, float, float], ...], ItemCount(4, 1000)],
    "marks": Literal["chessboard", "charuco", "aprilgrid", "circles"],
    "counts": Annotated[tuple[int, int], Reads(lambda value: _counts(cast("str", value)))],
    "dictionary": Annotated[str, _text(_dictionary)],
    "number": Annotated[int, _whole(0, 10_000, "from 0")],
    "polygons": Annotated[tuple[tuple[int, ...], ...], ItemCount(0, 1000)],
}
"""What an option's text must look like, by what it takes."""


@dataclass(frozen=True)
class NozzleFile:
    """The line a nozzle lays down."""

    diameter: Annotated[PositiveLength, Told("nozzle diameter, such as 0.4mm")]
    line_width: Annotated[PositiveLength, Told("line width, such as 0.45mm")]
    layer_height: Annotated[PositiveLength, Told("layer height, such as 0.2mm")]
    flow_mm3_s: Annotated[float, Above(0), AtMost(200)] | None = None  # the most that it melts


@dataclass(frozen=True)
class PrinterFile:
    """A printer: its bed, the nozzle it comes with, and its nozzles."""

    title: Annotated[str, Told("printer's name")]
    bed: Annotated[Bed, Told("printable volume, such as 256x256x256mm")]
    nozzle: Annotated[PositiveLength, Told("nozzle it comes with, such as 0.4mm")]
    nozzles: Annotated[tuple[NozzleFile, ...], Told("list of nozzles"), ItemCount(1, 100)]
    machine: OfMachine = UNKNOWN_MACHINE
    ink_offset: Length | None = None  # that undoes its bleed
    shrink_compensation: Percent | None = None  # how much larger to print
    skew_compensation: Skew | None = None  # angles that undo its skew
    filament_price: FilamentPrice | None = None  # of a kilogram

    def machine_with(self, nozzle_mm: float) -> Machine:
        """What it is with one of its nozzles."""
        flow = next((one.flow_mm3_s for one in self.nozzles if one.diameter == nozzle_mm), None)
        return self.machine if flow is None else replace(self.machine, flow_mm3_s=flow)


_Asked = TypeVar("_Asked", bound=AskedPrinting)


def _asked(asked: type[_Asked], values: Mapping[str, RawValue], origin: str) -> _Asked:
    """Options that were checked.

    Raises:
        InputError: the first thing that is wrong, in a line: an unknown key is likely the missing one, misspelt.
    """
    known = options_of(asked)
    try:
        for key in values:
            if key not in known:
                raise BadValueError(_unknown(asked, key))
        for name, option in known.items():
            if name not in values and is_required(asked, name):
                raise BadValueError(f"{name} is missing; give the {option.help}")
        given = {key: value for key, value in values.items() if value is not None}
        read = {name: decode_written(READ[known[name].value], value, name) for name, value in given.items()}
        return asked(**read)  # type: ignore[arg-type]  # fields by name are more than types can follow
    except BadValueError as error:
        raise InputError(" ".join(f"{_prefix(origin)}{error}".split())) from None


def _unknown(asked: type[AskedPrinting], key: str) -> str:
    others = [repr(kind.name) for kind in kinds() if key in options_of(kind.asked)]
    if others and issubclass(asked, Asked):
        return f"{key} is for kind {' or '.join(others)}; leave it out, or change the kind"
    return f"unknown key {key!r}{suggestion(key, list(options_of(asked)))}"


def parse_spec(values: Mapping[str, RawValue], origin: str) -> Asked:
    """Check a spec's values.

    Args:
        values: keys as the kind's options, with `kind`.
        origin: what to name in messages, a file or the command; may be empty.

    Raises:
        InputError: an unknown kind or key, or a value that breaks a rule.
    """
    kind = values.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        given = f"{shown(kind)} is unknown" if kind is not None else "is missing"
        raise InputError(f"{_prefix(origin)}kind {given}; write kind = {' or '.join(repr(k) for k in KINDS)}")
    return _asked(kind_named(kind).asked, {key: value for key, value in values.items() if key != "kind"}, origin)


def replaced(values: Mapping[str, RawValue], options: Mapping[str, RawValue]) -> dict[str, RawValue]:
    """A file's values with options in their place.

    What belongs to a replaced printer, nozzle or build goes with it: a resolved spec names the bed and the line of the
    first two, and what a build chose for itself.
    """
    gone: set[str] = set()
    if "printer" in options:
        gone |= {"bed", "line_width", "layer_height", "machine"}
    if "nozzle" in options:
        gone |= {"line_width", "layer_height", "machine"}
    if "build" in options and values.get("build") not in (None, options["build"]):
        gone |= {"inlay_depth", "sticker_thickness", "formats"}
    return {**{key: value for key, value in values.items() if key not in gone}, **options}


def parse_printing(values: Mapping[str, RawValue]) -> AskedPrinting:
    """Check the values of printing options alone.

    Raises:
        InputError: a value that breaks a rule.
    """
    return _asked(AskedPrinting, values, "")


def read_printer_file(path: Path) -> PrinterFile:
    """A printer profile.

    Raises:
        InputError: the file cannot be read or breaks a rule.
    """
    try:
        return decode(PrinterFile, cast("JsonValue", read_spec_file(path)))
    except BadValueError as error:
        raise InputError(f"{path}: {error}") from None


def with_corrections(
    path: Path, *, ink_offset_mm: float, shrink_percent: float, skew_rad: tuple[float, float, float]
) -> str:
    """The text of a printer's file with what is to be corrected on it, the other lines as they are.

    Raises:
        InputError: the file is no printer's.
    """
    read_printer_file(path)
    rows = (
        f'ink_offset = "{format_mm(ink_offset_mm)}"',
        f'shrink_compensation = "{shrink_percent:.4g}%"',
        f'skew_compensation = "{format_skew(skew_rad)}"',
    )
    names = tuple(row.split(" ")[0] for row in rows)
    kept = [line for line in read_small_text(path, MAX_TOML_BYTES, "a TOML file").splitlines()
            if line.split("=")[0].strip() not in names]  # fmt: skip
    # Keys of the printer itself stand before its tables.
    first = next((at for at, line in enumerate(kept) if line.strip() and not line.lstrip().startswith("#")), len(kept))
    return "\n".join((*kept[:first], *rows, *kept[first:])) + "\n"


def _prefix(origin: str) -> str:
    return f"{origin}: " if origin else ""


def spec_to_toml(job: Job) -> str:
    """The full resolved spec as a file that `design make` reads back to the same job."""
    target, printing, printer = job.target, job.printing, job.printing.printer
    values: dict[str, RawValue] = {
        "kind": target.kind,
        "name": job.name,
        **target.options(),
        "ring_diameter": format_mm(target.ring_diameter_mm),
        "pitch": format_mm(target.pitch_mm),
        "ring_ratio": target.ring_ratio,
        "border": format_mm(target.border_mm),
        "margin": format_mm(target.margin_mm),
        "build": printing.build,
        "printer": printer.name,
        "nozzle": format_mm(printer.nozzle_mm),
        "line_width": format_mm(printer.line_width_mm),
        "layer_height": format_mm(printer.layer_height_mm),
        "bed": format_mm(*printer.bed_mm),
        "machine": encode(Machine, printer.machine),
        "ink_side": printing.ink_side,
        "mount": printing.mount,
        "inlay_depth": format_mm(printing.inlay_mm),
        "ink_offset": format_mm(printing.ink_offset_mm),
        "shrink_compensation": f"{printing.shrink_compensation_percent!r}%",
        "skew_compensation": format_skew(printing.skew_compensation_rad),
        "sticker_thickness": format_mm(printing.sticker_thickness_mm),
        "lip": printing.lip,
        "jig": printing.jig,
        "body_colour": printing.body_colour,
        "ink_colour": printing.ink_colour,
        "labels": printing.labels,
        "stand": printing.stand,
        "filament_price": printing.filament_price.words,
        "chord_error": format_mm(printing.chord_error_mm),
        "formats": list(job.formats),
        "page": job.page,
    }
    idle = printing.way.idle
    return "".join(f"{key} = {_toml_value(value)}\n" for key, value in values.items() if key not in idle)


def _toml_value(value: RawValue) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list | tuple):
        return f"[{', '.join(_toml_value(item) for item in value)}]"
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {_toml_value(item)}' for key, item in value.items())} }}"
    if isinstance(value, str):
        # TOML's basic strings are JSON's, but for the delete character, which TOML wants escaped too.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(value)
