"""What a person asks for, fully resolved: plain frozen values, lengths in millimetres.

`TargetSpec` is the target's shape and decides `TargetGeometry`; `PrintSpec` is how it is made and never
changes the geometry; `Job` is both together with what to write. Defaults and automatic sizes are chosen in
`sizing`; text with units is read in `spec_file`.
"""

import math
from dataclasses import dataclass, fields
from typing import Literal

Lattice = Literal["square", "triangular"]
Build = Literal["solid", "stickers", "printed", "sheet"]
Format = Literal["3mf", "stl", "png", "pdf", "svg", "step", "glb"]
SpecValue = str | float | int | bool | list[float]

BUILDS: dict[str, tuple[Build, ...]] = {"ico": ("solid", "stickers"), "board": ("printed", "sheet")}
"""By kind, the usual one first."""
TWO_FILAMENT_BUILDS: tuple[Build, ...] = ("solid", "printed")
"""Builds whose ink is printed into the body."""
PAPER_LINE_MM = 0.1
"""Thinnest line of an office printer, where the pattern is printed on paper or sheet."""
RING_RATIO = 0.45
"""Inner over outer ring radius. The Cramer-Rao optimum for the centre is 0.433, and flat around it."""


@dataclass(frozen=True)
class IcoSpec:
    """An icosahedron with `rings_per_side` rings along each side of a face's triangular lattice."""

    edge_mm: float
    rings_per_side: int
    ring_diameter_mm: float
    ring_ratio: float
    pitch_mm: float
    border_mm: float
    margin_mm: float  # least white between the outermost rings and the border

    @property
    def kind(self) -> Literal["ico"]:
        """The kind's name in files and commands."""
        return "ico"


@dataclass(frozen=True)
class BoardSpec:
    """A rectangular plate with rings on one face; `columns` counts the longest row."""

    size_mm: tuple[float, float]  # width, height
    thickness_mm: float
    columns: int
    rows: int
    lattice: Lattice
    ring_diameter_mm: float
    ring_ratio: float
    pitch_mm: float
    border_mm: float  # 0: no border
    margin_mm: float  # least white between the outermost rings and the border or the board's edge
    dots: bool  # three dots that mark origin and orientation

    @property
    def kind(self) -> Literal["board"]:
        """The kind's name in files and commands."""
        return "board"


TargetSpec = IcoSpec | BoardSpec
SPEC_OF_KIND: dict[str, type[IcoSpec] | type[BoardSpec]] = {"ico": IcoSpec, "board": BoardSpec}


def spec_to_mapping(spec: TargetSpec) -> dict[str, SpecValue]:
    """The spec as JSON values, with its `kind`. Whole numbers in fields of type float become floats."""
    values: dict[str, SpecValue] = {"kind": spec.kind}
    for field in fields(spec):
        value = getattr(spec, field.name)
        if isinstance(value, tuple):
            values[field.name] = [float(v) for v in value]
        else:
            values[field.name] = float(value) if field.type is float else value
    return values


def spec_from_mapping(values: dict[str, SpecValue]) -> TargetSpec:
    """The inverse of `spec_to_mapping`.

    Raises:
        ValueError: unknown kind, or a field that is missing, unknown or of the wrong type.
    """
    kind = values.get("kind")
    if not isinstance(kind, str) or kind not in SPEC_OF_KIND:
        raise ValueError(f"spec kind {kind!r} is unknown; it must be one of {', '.join(SPEC_OF_KIND)}")
    spec_type = SPEC_OF_KIND[kind]
    expected = {field.name: field.type for field in fields(spec_type)}
    given = {key: value for key, value in values.items() if key != "kind"}
    if given.keys() != expected.keys():
        odd = ", ".join(sorted(map(repr, given.keys() ^ expected.keys())))
        raise ValueError(f"spec of kind {kind!r} has missing or unknown fields: {odd}")
    checked = {key: _as_type(key, given[key], expected[key]) for key in expected}
    return spec_type(**checked)  # type: ignore[arg-type]  # _as_type has checked each value against its field


def _as_type(key: str, value: SpecValue, expected: object) -> object:
    """`value` as the field type `expected`, for the few types that specs use."""
    number = float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else math.nan
    if expected is float and math.isfinite(number):
        return number
    if expected is int and number.is_integer():
        return int(number)
    if expected is bool and isinstance(value, bool):
        return value
    if expected == Lattice and value in ("square", "triangular"):
        return value
    if expected == tuple[float, float] and isinstance(value, list) and len(value) == 2:
        return tuple(_as_type(key, part, float) for part in value)
    raise ValueError(f"spec field {key!r} has the value {value!r}, which it cannot have")


@dataclass(frozen=True)
class PrinterProfile:
    """What the design rules need to know of a printer."""

    name: str
    bed_mm: tuple[float, float, float]
    nozzle_mm: float
    line_width_mm: float
    layer_height_mm: float


@dataclass(frozen=True)
class PrintSpec:
    """How the target is made. Nothing in here changes the target's nominal geometry."""

    build: Build
    printer: PrinterProfile
    inlay_mm: float  # depth of the ink in a two-filament print
    ink_offset_mm: float  # > 0 grows the ink, < 0 shrinks it
    shrink_compensation_percent: float  # printed lengths are (1 + percent / 100) of the design's
    sticker_thickness_mm: float
    body_colour: str  # "#rrggbb"
    ink_colour: str
    labels: bool  # face numbers and target id where they fit
    stand: bool
    chord_error_mm: float  # farthest a polygon may stray from its circle
    skew_compensation_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """xy, xz, yz of the bed: the files are sheared against this skew of the printer, see `designer.make.bed`."""

    @property
    def is_two_filament(self) -> bool:
        """Whether the ink is printed into the body."""
        return self.build in TWO_FILAMENT_BUILDS

    @property
    def pattern_line_mm(self) -> float:
        """The finest line of the process that makes the pattern."""
        return self.printer.line_width_mm if self.is_two_filament else PAPER_LINE_MM

    @property
    def pattern_least_mm(self) -> float:
        """The least width of ink or white that this process can make."""
        return self.printer.nozzle_mm if self.is_two_filament else PAPER_LINE_MM


@dataclass(frozen=True)
class Job:
    """One run of `design`: a target, how to make it, and which files to write."""

    name: str
    target: TargetSpec
    printing: PrintSpec
    formats: tuple[Format, ...]
    page: str  # "A4", "A3", "Letter", "fit" or "WIDTHxHEIGHTmm"
