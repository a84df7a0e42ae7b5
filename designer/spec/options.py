"""What a person may ask for: the options of the command line, which are the keys of a spec in TOML.

Values are those after reading: numbers in millimetres. A field that is None is chosen by `sizing`. What a text must
look like to become such a value is in `spec_file`, by the `Value` that an option names.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import MISSING, dataclass, fields
from typing import Annotated, ClassVar, Literal, get_args, get_type_hints

from designer.base.errors import InputError
from designer.base.units import round_down, round_up
from designer.spec.build import BUILDS, MOUNTS, NO_MOUNT, Format, InkSide
from designer.spec.machine import Machine
from designer.spec.spec import Line, Price, Spec

Value = Literal[
    "file", "name", "length", "length above 0", "length from 0", "chord error", "size", "bed", "count", "ratio",
    "percent", "skew", "colour", "build", "lattice", "formats", "page", "switch", "machine", "price", "ink side",
    "mount", "mesh", "unit", "corners", "polygons", "marks", "counts", "dictionary", "number",
]  # fmt: skip
DIAMETER_OVER_PITCH = 0.7
"""Of the paper's rings, 7 mm at 10 mm."""


@dataclass(frozen=True)
class Option:
    """What an option takes, and what it means."""

    value: Value
    help: str


@dataclass(frozen=True, kw_only=True)
class AskedPrinting:
    """How a target is to be made."""

    printer: Annotated[str | None, Option("file", "printer template, or a TOML file of your own")] = None
    nozzle: Annotated[float | None, Option("length above 0", "nozzle diameter")] = None
    line_width: Annotated[float | None, Option("length above 0", "width of a printed line")] = None
    layer_height: Annotated[float | None, Option("length above 0", "height of a printed layer")] = None
    bed: Annotated[tuple[float, float, float] | None, Option("bed", "printable volume, such as 256x256x256mm")] = None
    machine: Annotated[
        Machine | None, Option("machine", "speeds, filament change and fits of the printer, as its file has them")
    ] = None
    build: Annotated[str | None, Option("build", f"how it is made: {', '.join(BUILDS)}")] = None
    ink_side: Annotated[InkSide | None, Option("ink side", "which way the ink of tiles looks: down or up")] = None
    mount: Annotated[
        str | None, Option("mount", f"what the core of tiles is held by: {', '.join(MOUNTS)} or {NO_MOUNT} (auto)")
    ] = None
    inlay_depth: Annotated[float | None, Option("length above 0", "depth of the ink, or how high it is raised")] = None
    ink_offset: Annotated[float | None, Option("length", "grow (or, below zero, shrink) the ink to undo bleed")] = None
    shrink_compensation: Annotated[float | None, Option("percent", "print this much larger, in percent")] = None
    skew_compensation: Annotated[
        tuple[float, float, float] | None, Option("skew", "undo skewed axes, such as 'xy 0.02deg, yz -0.1deg'")
    ] = None
    sticker_thickness: Annotated[
        float | None, Option("length above 0", "thickness of the stickers, taken off the body")
    ] = None
    lip: Annotated[bool | None, Option("switch", "a frame around each sticker, which places it (where it fits)")] = None
    jig: Annotated[bool | None, Option("switch", "also write a jig for edges of tiles, and a press")] = None
    body_colour: Annotated[str | None, Option("colour", "colour of the body (#ffffff)")] = None
    ink_colour: Annotated[str | None, Option("colour", "colour of the ink (#000000)")] = None
    labels: Annotated[bool | None, Option("switch", "print face numbers and target id where they fit")] = None
    stand: Annotated[bool | None, Option("switch", "also write a printable stand")] = None
    filament_price: Annotated[Price | None, Option("price", "what a kilogram of filament costs (25EUR)")] = None
    chord_error: Annotated[float | None, Option("chord error", "farthest a polygon strays from its circle (5um)")] = (
        None
    )


@dataclass(frozen=True, kw_only=True)
class Asked(AskedPrinting, ABC):
    """What every kind of target can be asked for; each kind adds its own."""

    read_into: ClassVar[tuple[str, ...]] = ()
    """Options that name a file and how to read it: a resolved spec has what it holds."""

    of_some: ClassVar[tuple[str, ...]] = ()
    """Options that not all targets of the kind have; a resolved spec has those of its own."""

    name: Annotated[str | None, Option("name", "base name of the files and of the folder")] = None
    ring_diameter: Annotated[float | None, Option("length above 0", "outer diameter of the rings")] = None
    pitch: Annotated[
        float | None, Option("length above 0", "distance between neighbouring rings, or circles in a row")
    ] = None
    ring_ratio: Annotated[float | None, Option("ratio", "inner over outer diameter of a ring (0.45)")] = None
    border: Annotated[float | None, Option("length from 0", "width of the black border")] = None
    margin: Annotated[float | None, Option("length from 0", "least white around the rings, to border or edge")] = None
    formats: Annotated[
        list[Format] | None, Option("formats", f"further formats: {', '.join(get_args(Format))}, or all")
    ] = None
    page: Annotated[str | None, Option("page", "sheet size: A4, A3, Letter, fit, or such as 400x600mm")] = None

    @abstractmethod
    def sized(self, line: Line) -> tuple[Spec, str]:
        """The spec with the sizes that were left open chosen for a process, and how they were, in words.

        Raises:
            InputError: sizes that no such target can have, or that the process cannot make.
        """

    @abstractmethod
    def size_name(self, spec: Spec) -> str:
        """What stands for the size in the default name of the files."""


def options_of(asked: type[AskedPrinting]) -> Mapping[str, Option]:
    """The options by name, those that all kinds share first."""
    hints = get_type_hints(asked, include_extras=True)
    return {field.name: get_args(hints[field.name])[1] for field in fields(asked)}


def is_required(asked: type[AskedPrinting], name: str) -> bool:
    """Whether a person must give the option."""
    return any(field.name == name and field.default is MISSING for field in fields(asked))


def diameter_and_pitch(asked: Asked) -> tuple[float, float]:
    """Ring diameter and pitch of which at least one is given; the other follows in the paper's proportion."""
    diameter, pitch = asked.ring_diameter, asked.pitch
    if pitch is None:
        if diameter is None:
            raise InputError("neither ring diameter nor pitch is given; give --ring-diameter or --pitch")
        return diameter, round_up(diameter / DIAMETER_OVER_PITCH)
    if diameter is None:
        diameter = round_down(DIAMETER_OVER_PITCH * pitch)
        if diameter == 0:
            raise InputError(f"pitch {pitch:g}mm leaves no stroke that can be made; use a larger pitch")
    return diameter, pitch


def chosen_ring(asked: Asked, spec: Spec) -> Iterator[str]:
    """Diameter or pitch, if it followed from the other."""
    share = f"{DIAMETER_OVER_PITCH:g} of the pitch, as in the paper"
    if asked.ring_diameter is None:
        yield f"rings of {spec.ring_diameter_mm:g}mm ({share})"
    elif asked.pitch is None:
        yield f"pitch {spec.pitch_mm:g}mm (the rings are {share})"


def chosen_words(chosen: Iterable[str]) -> str:
    """A line that says what was not given."""
    parts = tuple(chosen)
    return f"sizes: {', '.join(parts)}; the others as given" if parts else "sizes: as given"


def widths_mm(spec: Spec) -> tuple[float, float, float]:
    """Stroke, white centre and gap between neighbours."""
    diameter = spec.ring_diameter_mm
    return diameter / 2 * (1 - spec.ring_ratio), diameter * spec.ring_ratio, spec.pitch_mm - diameter


def check_rings(diameter: float, ratio: float, pitch: float, line: Line) -> None:
    """Rings must leave white between them, and no stroke, white centre or gap be thinner than the tool that makes it.

    Raises:
        InputError: they do not.
    """
    apart = f"use at least {diameter + line.comfortable_mm:.4g}mm for {line.process}"
    if pitch <= diameter:
        raise InputError(f"pitch {pitch:g}mm makes rings of {diameter:g}mm touch; {apart}")
    widths = (
        ("stroke", diameter / 2 * (1 - ratio), 2 * line.width_mm / (1 - ratio)),
        ("white centre", diameter * ratio, line.width_mm / ratio),
    )
    for what, width, least_diameter in widths:
        if width < line.nozzle_mm - 1e-9:
            raise InputError(
                f"ring diameter {diameter:g}mm gives a {what} of {width:.3g}mm, thinner than {line.process}; "
                f"use rings of at least {least_diameter:.3g}mm"
            )
    if pitch - diameter < line.nozzle_mm - 1e-9:
        gap = f"{pitch - diameter:.3g}mm between rings of {diameter:g}mm"
        raise InputError(f"pitch {pitch:g}mm leaves {gap}, thinner than {line.process}; {apart}")


def check_border(border_mm: float | None, line: Line) -> None:
    """A border that is given must be seen and made.

    Raises:
        InputError: it is too narrow.
    """
    if border_mm is not None and border_mm < line.nozzle_mm:
        raise InputError(
            f"border {border_mm:g}mm is too narrow for the detector to tell faces apart by it, and for "
            f"{line.process}; use at least {line.width_mm:g}mm"
        )


def check_count(rings: int, line: Line) -> None:
    """Keep hostile sizes from filling the memory.

    Raises:
        InputError: too many rings.
    """
    if rings > line.most_rings:
        raise InputError(f"{rings} rings are more than {line.most_rings}; use a larger pitch or a smaller target")
