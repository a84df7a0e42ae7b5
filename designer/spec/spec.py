"""What a person asks for, fully resolved: plain frozen values, lengths in millimetres.

`Spec` is the target's shape and decides `TargetGeometry`; each kind has its own (`designer.kinds`). `PrintSpec` is how
it is made and never changes the geometry; `Job` is both together with what to write. Defaults and automatic sizes are
chosen in `sizing`; text with units is read in `spec_file`.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal

from designer.spec.build import ANY_MOUNT, BUILDS, Build, Form, Format, InkSide
from designer.spec.machine import UNKNOWN_MACHINE, Machine, Presets

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from designer.base.solid import Solid
    from designer.target import TargetGeometry

Lattice = Literal["square", "triangular"]
SpecValue = str | float | int | bool | list[float]

FILAMENT_PRICE = 25.0
"""Of a kilogram of PLA: profiles of slicers say 15.99 to 24.99 (Bambu) and 27.82 to 36.29 (Prusa)."""
PAPER_LINE_MM = 0.1
"""Thinnest line of an office printer, where the pattern is printed on paper or sheet."""
RING_RATIO = 0.45
"""Inner over outer ring radius. The Cramer-Rao optimum for the centre is 0.433, and flat around it."""


class Spec(ABC):
    """The shape of a target of some kind, a frozen dataclass, and all that the kind can tell of it."""

    kind: ClassVar[str]
    """The kind's name in files and commands."""
    form: ClassVar[Form]
    """Which ways there are to make one (`designer.spec.build.builds_of`)."""
    page: ClassVar[str]
    """The usual page of its sheets."""
    extent: ClassVar[tuple[str, ...]]
    """The options that say how large it is; all others can be chosen from them."""

    least_gap_mm: ClassVar[float] = math.inf
    """The least white between marks that are no rings."""
    flat_ink_layers: ClassVar[int] = 3
    """How deep the ink of flat faces usually is."""

    is_graded: ClassVar[bool] = False
    """Whether it tells the printer, not a camera: its marks go down to a single line on purpose."""

    ring_diameter_mm: float
    ring_ratio: float
    pitch_mm: float
    border_mm: float  # 0: no border
    margin_mm: float  # least white between the outermost rings and the border or the edge

    @abstractmethod
    def lay_out(self) -> "TargetGeometry":
        """The nominal geometry."""

    @property
    def solid(self) -> "Solid | None":
        """The solid that the faces bound; None: a plate with one face, `depth_mm` thick."""
        return None

    @property
    def marks_mm(self) -> "NDArray[np.float64]":
        """Ink on each face beside rings, dots and border: convex quadrangles, counter-clockwise.  # (K, 4, 2)"""
        import numpy as np  # here: reading a command line needs none

        return np.empty((0, 4, 2))

    @property
    def depth_mm(self) -> float:
        """How deep the body is behind a face's ink: a plate's thickness; of a solid no limit of its own."""
        return math.inf

    @property
    @abstractmethod
    def words(self) -> str:
        """What it is, such as `icosahedron of edge 100 mm`."""

    @property
    @abstractmethod
    def size_words(self) -> str:
        """Its size alone, such as `edge 100mm`."""

    @abstractmethod
    def facts(self) -> tuple[tuple[str, str], ...]:
        """Names and values of what a drawing would say of its shape; the first is the shape, the last the lattice."""

    @abstractmethod
    def options(self) -> Mapping[str, SpecValue]:
        """What a person would type for the fields that other kinds do not have."""


@dataclass(frozen=True)
class PrinterProfile:
    """What the design rules need to know of a printer."""

    name: str
    bed_mm: tuple[float, float, float]
    nozzle_mm: float
    line_width_mm: float
    layer_height_mm: float
    machine: Machine = UNKNOWN_MACHINE
    """What time, filament and fits follow from."""

    @property
    def clearance_mm(self) -> float:
        """Between parts that are put into each other."""
        return self.machine.clearance_mm

    @property
    def presets(self) -> Presets | None:
        """What slicers call it, where they know it with this nozzle and this bed."""
        presets = self.machine.presets
        if presets is None or presets.nozzle_mm != self.nozzle_mm:
            return None
        fits = all(side <= most for side, most in zip(self.bed_mm, presets.plate_mm, strict=False))
        return presets if fits else None


@dataclass(frozen=True)
class PrintSpec:
    """How the target is made. Nothing in here changes the target's nominal geometry."""

    build: str  # a name in `designer.spec.build.BUILDS`
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
    filament_price: float = FILAMENT_PRICE  # of a kilogram, in any currency
    skew_compensation_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """xy, xz, yz of the bed: the files are sheared against this skew of the printer, see `designer.make.bed`."""
    ink_side: InkSide = "down"
    mount: str = ANY_MOUNT  # what holds the core of tiles: a name in `designer.spec.build.MOUNTS`, or one of its others

    @property
    def way(self) -> Build:
        """What the build is like."""
        return BUILDS[self.build]

    @property
    def is_two_filament(self) -> bool:
        """Whether the ink is printed into the body."""
        return self.way.is_two_filament

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
    target: Spec
    printing: PrintSpec
    formats: tuple[Format, ...]
    page: str  # "A4", "A3", "Letter", "fit" or "WIDTHxHEIGHTmm"


@dataclass(frozen=True)
class Line:
    """The finest line of the process that makes the pattern."""

    width_mm: float
    nozzle_mm: float  # a stroke below it cannot be made
    process: str
    most_rings: int  # more would take minutes and gigabytes
    inlay_mm: float  # how deep ink is usually set into steep faces; 0: it is laid on
    plate_mm: tuple[float, float] = (math.inf, math.inf)  # the largest plate that it makes, longer side first

    @property
    def finer(self) -> str:
        """A remedy to append, where there is one."""
        return ", or a finer nozzle" if self.nozzle_mm < self.width_mm else ""

    @property
    def comfortable_mm(self) -> float:
        """Two lines: strokes and gaps that print well."""
        return 2 * self.width_mm
