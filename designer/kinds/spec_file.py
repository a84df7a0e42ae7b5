"""The files people write: target specs and printer profiles in TOML, every field optional, quantities with units.

The command line's options are read by the same rules: a key of a file and an option are one (`designer.spec.options`).
"""

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Annotated, Optional, TypeVar, cast

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, create_model

from designer.base.codec import decode, encode
from designer.base.errors import InputError
from designer.base.small_file import MAX_TOML_BYTES, JsonValue, read_small_text, read_spec_file
from designer.base.units import (
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
from designer.spec.machine import Machine
from designer.spec.options import Asked, AskedPrinting, Value, is_required, options_of
from designer.spec.spec import Job, Lattice

LEAST_LENGTH_MM = 0.0005

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


def _count(value: RawValue) -> int:
    count = int(value) if isinstance(value, str) and re.fullmatch(r"\d{1,5}", value) else value
    if isinstance(count, bool) or not isinstance(count, int) or not 0 < count < 100_000:
        raise ValueError("must be a whole number above zero")
    return count


def _ratio(value: RawValue) -> float:
    ratio = float(value) if isinstance(value, str) and re.fullmatch(r"\d{0,3}\.?\d{1,20}", value) else value
    if isinstance(ratio, bool) or not isinstance(ratio, (int, float)) or not 0.2 <= ratio <= 0.8:
        raise ValueError("must be a number from 0.2 to 0.8; 0.45 locates centres best")
    return float(ratio)


def _price(value: RawValue) -> float:
    price = float(value) if isinstance(value, str) and re.fullmatch(r"\d{0,6}\.?\d{1,6}", value) else value
    if isinstance(price, bool) or not isinstance(price, (int, float)) or not 0 <= price <= 10_000:
        raise ValueError("must be a number from 0 to 10000, without a currency")
    return float(price)


def _chord_error(value: float) -> float:
    if not 0.0005 <= value <= 0.5:
        raise ValueError("must be from 0.0005mm to 0.5mm")
    return value


def _mount(value: str) -> str:
    name = " ".join(value.lower().split())
    if name not in (*MOUNTS, NO_MOUNT, ANY_MOUNT):
        raise ValueError(f"must be one of {', '.join((*MOUNTS, NO_MOUNT, ANY_MOUNT))}")
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


Length = Annotated[float, BeforeValidator(parse_length_mm)]
PositiveLength = Annotated[Length, AfterValidator(_positive)]
NonNegativeLength = Annotated[Length, AfterValidator(_not_negative)]
Skew = Annotated[tuple[float, float, float], BeforeValidator(parse_skew_rad)]
Percent = Annotated[float, BeforeValidator(parse_percent), Field(ge=-20, le=20)]
Count = Annotated[int, BeforeValidator(_count)]
Size = Annotated[tuple[float, float], BeforeValidator(_size)]
Bed = Annotated[tuple[float, float, float], BeforeValidator(_bed)]
Name = Annotated[str, AfterValidator(_name)]
Colour = Annotated[str, AfterValidator(_colour)]
OfMachine = Annotated[Machine, BeforeValidator(_machine)]
Ratio = Annotated[float, BeforeValidator(_ratio)]
Formats = Annotated[list[Format], BeforeValidator(_format_list)]
TYPE_OF_VALUE: Mapping[Value, object] = {
    "file": Annotated[str, AfterValidator(_unicode)],
    "name": Name,
    "length": Length,
    "length above 0": PositiveLength,
    "length from 0": NonNegativeLength,
    "chord error": Annotated[PositiveLength, AfterValidator(_chord_error)],
    "size": Size,
    "bed": Bed,
    "count": Count,
    "ratio": Ratio,
    "percent": Percent,
    "skew": Skew,
    "colour": Colour,
    "build": Annotated[str, AfterValidator(build_name)],
    "lattice": Lattice,
    "formats": Formats,
    "page": Annotated[str, AfterValidator(_page)],
    "switch": bool,
    "machine": OfMachine,
    "price": Annotated[float, BeforeValidator(_price)],
    "ink side": InkSide,
    "mount": Annotated[str, AfterValidator(_mount)],
}
"""What an option's text must look like, by what it takes."""


class _SpecFile(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class _KindFile(_SpecFile):
    """What a kind of target can be asked for; its fields follow from `Asked`."""


class NozzleFile(_SpecFile):
    """The line a nozzle lays down."""

    diameter: PositiveLength = Field(description="nozzle diameter, such as 0.4mm")
    line_width: PositiveLength = Field(description="line width, such as 0.45mm")
    layer_height: PositiveLength = Field(description="layer height, such as 0.2mm")
    flow_mm3_s: Annotated[float | None, Field(gt=0, le=200, strict=True)] = Field(
        None, description="the most that it melts, such as 12"
    )


class PrinterFile(_SpecFile):
    """A printer: its bed, the nozzle it comes with, and its nozzles."""

    title: str = Field(description="printer's name")
    bed: Bed = Field(description="printable volume, such as 256x256x256mm")
    nozzle: PositiveLength = Field(description="nozzle it comes with, such as 0.4mm")
    nozzles: Annotated[list[NozzleFile], Field(min_length=1, description="list of nozzles")]
    machine: OfMachine = Field(Machine(), description="speeds, filament change and fits")
    ink_offset: Length | None = Field(None, description="ink offset that undoes its bleed")
    shrink_compensation: Percent | None = Field(None, description="how much larger to print")
    skew_compensation: Skew | None = Field(None, description="angles that undo its skew")

    def machine_with(self, nozzle_mm: float) -> Machine:
        """What it is with one of its nozzles."""
        flow = next((one.flow_mm3_s for one in self.nozzles if one.diameter == nozzle_mm), None)
        return self.machine if flow is None else replace(self.machine, flow_mm3_s=flow)


_Model = TypeVar("_Model", bound=_SpecFile)
_Asked = TypeVar("_Asked", bound=AskedPrinting)


@cache
def _model_of(asked: type[AskedPrinting]) -> type[_SpecFile]:
    """The model that checks a kind's options."""
    base = _KindFile if issubclass(asked, Asked) else _SpecFile
    fields: dict[str, tuple[object, object]] = {}
    for name, option in options_of(asked).items():
        needed = is_required(asked, name)
        value = TYPE_OF_VALUE[option.value]
        fields[name] = (
            value if needed else Optional[value],  # noqa: UP045 - `|` is not for a value at run time
            Field(... if needed else None, description=option.help),
        )
    # Fields by name are more than pydantic's types can follow.
    return create_model(asked.__name__, __base__=base, **fields)  # type: ignore[call-overload, no-any-return]


def _asked(asked: type[_Asked], values: Mapping[str, RawValue], origin: str) -> _Asked:
    """Options that were checked."""
    model = _validate(_model_of(asked), values, origin)  # type: ignore[arg-type]  # a class is hashable
    return asked(**{name: getattr(model, name) for name in options_of(asked)})


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

    What belongs to a replaced printer or nozzle goes with it: a resolved spec names the bed and the line of both.
    """
    gone: set[str] = set()
    if "printer" in options:
        gone |= {"bed", "line_width", "layer_height", "machine"}
    if "nozzle" in options:
        gone |= {"line_width", "layer_height", "machine"}
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
    return _validate(PrinterFile, read_spec_file(path), str(path))


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


def _validate(model: type[_Model], values: Mapping[str, RawValue], origin: str) -> _Model:
    """Build the model, and turn the first thing wrong with the values into one line."""
    try:
        return model.model_validate(dict(values))
    except ValidationError as error:
        # An unknown key comes first: it is likely the missing one, misspelt.
        first = min(error.errors(), key=lambda wrong: wrong["type"] != "extra_forbidden")
        more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
        what = _explain(model, first["loc"], first["type"], str(first["msg"]), first["input"])
        raise InputError(" ".join(f"{_prefix(origin)}{what}{more}".split())) from None


def _explain(model: type[_SpecFile], location: tuple[int | str, ...], kind: str, message: str, value: object) -> str:
    """One line on one wrong value."""
    key = ".".join(str(part) for part in location)
    if kind == "extra_forbidden":
        others = [repr(kind.name) for kind in kinds() if key in options_of(kind.asked)]
        if others and issubclass(model, _KindFile):
            return f"{key} is for kind {' or '.join(others)}; leave it out, or change the kind"
        return f"unknown key {key!r}{suggestion(key, list(model.model_fields))}"
    if kind == "missing":
        field = (NozzleFile if model is PrinterFile and len(location) > 1 else model).model_fields[str(location[-1])]
        return f"{key} is missing; give the {field.description}"
    rule = message.removeprefix("Value error, ")
    return f"{key} {shown(value)}: {rule[:1].lower()}{rule[1:]}"


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
        "body_colour": printing.body_colour,
        "ink_colour": printing.ink_colour,
        "labels": printing.labels,
        "stand": printing.stand,
        "filament_price": printing.filament_price,
        "chord_error": format_mm(printing.chord_error_mm),
        "formats": list(job.formats),
        "page": job.page,
    }
    idle = printing.way.idle
    return "".join(f"{key} = {_toml_value(value)}\n" for key, value in values.items() if key not in idle)


def _toml_value(value: RawValue) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return f"[{', '.join(_toml_value(item) for item in value)}]"
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {_toml_value(item)}' for key, item in value.items())} }}"
    if isinstance(value, str):
        # TOML's basic strings are JSON's, but for the delete character, which TOML wants escaped too.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(value)
