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
from designer.spec.machine import BRIM_MM, UNKNOWN_MACHINE, Area, Machine, Presets

if TYPE_CHECKING:
    from designer.base.arrays import Array
    from designer.base.solid import Faceted, Solid
    from designer.target import TargetGeometry

Lattice = Literal["square", "triangular"]
SpecValue = str | float | int | bool | list[float] | tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Price:
    """What something costs: `Price(25, "EUR")`."""

    amount: float
    currency: str = "EUR"

    @property
    def words(self) -> str:
        """`25 EUR`."""
        return f"{self.amount:.10g} {self.currency}"


FILAMENT_PRICE = Price(25.0)
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
        """The regular solid that the faces bound; None: there is none."""
        return None

    @property
    def body(self) -> "Solid | Faceted | None":
        """The solid that the faces bound, of any kind; None: a plate with one face, `depth_mm` thick."""
        return self.solid

    @property
    def marks_mm(self) -> "Array":
        """Ink on each face beside rings, dots and border: convex quadrangles, counter-clockwise.  # (K, 4, 2)"""
        import numpy as np  # here: reading a command line needs none

        return np.empty((0, 4, 2))

    @property
    def depth_mm(self) -> float:
        """How deep the body is behind a face's ink: of plates and walls the thickness; of a solid no limit."""
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


_ROUNDING_MM = 1e-6
"""Lengths of a part come out of turns of the design."""


def beside(room: Area, taken: Area) -> list[Area]:
    """The largest rectangles of a room that are clear of another rectangle."""
    left, front, right, rear = room
    if taken[0] >= right or taken[2] <= left or taken[1] >= rear or taken[3] <= front:
        return [room]
    parts = [
        (left, front, taken[0], rear), (taken[2], front, right, rear),
        (left, front, right, taken[1]), (left, taken[3], right, rear),
    ]  # fmt: skip
    return [part for part in parts if part[0] < part[2] and part[1] < part[3]]


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

    @property
    def excluded_words(self) -> str:
        """`18 x 28 mm in front left`; "" of a bed that is free everywhere."""
        return " and ".join(self._area_words(*area) for area in self.machine.excluded_mm)

    def _area_words(self, left: float, front: float, right: float, rear: float) -> str:
        size = f"{right - left:g} x {rear - front:g} mm"
        width, depth, _ = self.bed_mm
        along = "in front" if front <= 0 else "at the rear" if rear >= depth else ""
        across = "left" if left <= 0 else "right" if right >= width else ""
        return f"{size} {along} {across}" if along and across else f"{size} from {left:g}, {front:g} mm on"

    def rooms_mm(self, free_mm: float = 0.0, strip_mm: tuple[float, float] = (0.0, 0.0)) -> tuple[Area, ...]:
        """The largest rectangles of the bed that may be printed on, which overlap; one of no size if nothing is left.

        Args:
            free_mm: between them and the bed's rim or an excluded area.
            strip_mm: left free along the left rim and along the front.
        """
        width, depth, _ = self.bed_mm
        rooms: list[Area] = [(strip_mm[0] + free_mm, strip_mm[1] + free_mm, width - free_mm, depth - free_mm)]
        for left, front, right, rear in self.machine.excluded_mm:
            taken = (left - free_mm, front - free_mm, right + free_mm, rear + free_mm)
            rooms = [part for room in rooms for part in beside(room, taken)]
        return tuple(rooms) or ((0.0, 0.0, 0.0, 0.0),)

    def place_mm(
        self, size_mm: tuple[float, float], free_mm: float = 0.0, strip_mm: tuple[float, float] = (0.0, 0.0)
    ) -> tuple[float, float] | None:
        """The front left corner of a rectangle as near to the bed's middle as there is room for it; None: nowhere.

        This is the one rule for what fits: checks, pictures and files stand on it.
        """
        middle = [(side - length) / 2 for side, length in zip(self.bed_mm, size_mm, strict=False)]
        places = []
        for room in self.rooms_mm(free_mm, strip_mm):
            most = [room[k + 2] - size_mm[k] for k in (0, 1)]
            if all(most[k] >= room[k] - _ROUNDING_MM for k in (0, 1)):
                places.append((min(max(middle[0], room[0]), most[0]), min(max(middle[1], room[1]), most[1])))
        return min(places, key=lambda place: math.dist(place, middle), default=None)

    def laid_mm(self, size_mm: tuple[float, float], strip_mm: tuple[float, float] = (0.0, 0.0)) -> tuple[float, float]:
        """Where a rectangle is laid: clear of a strip and with room for a brim, else with the brim, else without.

        One that is too large lies in the middle.
        """
        place = self.place_mm(size_mm, BRIM_MM, strip_mm) or self.place_mm(size_mm, BRIM_MM) or self.place_mm(size_mm)
        return place or ((self.bed_mm[0] - size_mm[0]) / 2, (self.bed_mm[1] - size_mm[1]) / 2)


@dataclass(frozen=True)
class PrintSpec:
    """How the target is made. Nothing in here changes the target's nominal geometry."""

    build: str  # a name in `designer.spec.build.BUILDS`
    printer: PrinterProfile
    inlay_mm: float  # depth of the ink in a two-filament print, or how high it is raised
    ink_offset_mm: float  # > 0 grows the ink, < 0 shrinks it
    shrink_compensation_percent: float  # printed lengths are (1 + percent / 100) of the design's
    sticker_thickness_mm: float
    body_colour: str  # "#rrggbb"
    ink_colour: str
    labels: bool  # face numbers and target id where they fit
    stand: bool
    chord_error_mm: float  # farthest a polygon may stray from its circle
    filament_price: Price = FILAMENT_PRICE  # of a kilogram
    skew_compensation_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """xy, xz, yz of the bed: the files are sheared against this skew of the printer, see `designer.make.bed`."""
    ink_side: InkSide = "down"
    jig: bool = False  # that helps to glue tiles
    lip: bool = False  # stickers are laid into frames that stand out of the body
    mount: str = ANY_MOUNT  # what holds the core of tiles: a name in `designer.spec.build.MOUNTS`, or one of its others

    @property
    def way(self) -> Build:
        """What the build is like."""
        return BUILDS[self.build]

    def below_raised_mm(self, depth_mm: float) -> float:
        """Of a plate so deep in all, what lies below raised ink: whole layers, for the filament changes between two."""
        layer, scale = self.printer.layer_height_mm, 1 + self.shrink_compensation_percent / 100
        return max(round((depth_mm * scale - self.inlay_mm) / layer), 1) * layer

    @property
    def filament_colours(self) -> tuple[str, ...]:
        """Of what the printer has loaded at a time: body, then ink."""
        return (self.body_colour, self.ink_colour) if self.way.loads_two else (self.body_colour,)


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
