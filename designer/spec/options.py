"""What a person may ask for: the options of the command line, which are the keys of a spec in TOML.

Values are those after reading: numbers in millimetres. A field that is None is chosen by `sizing`. What a text must
look like to become such a value is in `spec_file`, by the `Value` that an option names.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from typing import Annotated, Literal, get_args, get_type_hints

from designer.spec.spec import Build, Format, Line, Spec

Value = Literal[
    "file", "name", "length", "length above 0", "length from 0", "chord error", "size", "bed", "count", "ratio",
    "percent", "skew", "colour", "build", "lattice", "formats", "page", "switch",
]  # fmt: skip


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
    build: Annotated[Build | None, Option("build", "solids: solid or stickers; boards: printed or sheet")] = None
    inlay_depth: Annotated[float | None, Option("length above 0", "depth of the ink in a two-filament print")] = None
    ink_offset: Annotated[float | None, Option("length", "grow (or, below zero, shrink) the ink to undo bleed")] = None
    shrink_compensation: Annotated[float | None, Option("percent", "print this much larger, in percent")] = None
    skew_compensation: Annotated[
        tuple[float, float, float] | None, Option("skew", "undo skewed axes, such as 'xy 0.02deg, yz -0.1deg'")
    ] = None
    sticker_thickness: Annotated[
        float | None, Option("length above 0", "thickness of the stickers, taken off the body")
    ] = None
    body_colour: Annotated[str | None, Option("colour", "colour of the body (#ffffff)")] = None
    ink_colour: Annotated[str | None, Option("colour", "colour of the ink (#000000)")] = None
    labels: Annotated[bool | None, Option("switch", "print face numbers and target id where they fit")] = None
    stand: Annotated[bool | None, Option("switch", "also write a printable stand")] = None
    chord_error: Annotated[float | None, Option("chord error", "farthest a polygon strays from its circle (5um)")] = (
        None
    )


@dataclass(frozen=True, kw_only=True)
class Asked(AskedPrinting, ABC):
    """What every kind of target can be asked for; each kind adds its own."""

    name: Annotated[str | None, Option("name", "base name of the files and of the folder")] = None
    ring_diameter: Annotated[float | None, Option("length above 0", "outer diameter of the rings")] = None
    pitch: Annotated[float | None, Option("length above 0", "distance between neighbouring rings")] = None
    ring_ratio: Annotated[float | None, Option("ratio", "inner over outer diameter of a ring (0.45)")] = None
    border: Annotated[float | None, Option("length from 0", "width of the black border")] = None
    margin: Annotated[float | None, Option("length from 0", "least white around the rings, to border or edge")] = None
    formats: Annotated[list[Format] | None, Option("formats", "further formats: step, pdf, svg, glb, or all")] = None
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
