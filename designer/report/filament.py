"""How much filament a part takes: the solid shell and the sparse inside of the body, and the ink.

A slicer fills a body solid within so many walls of its sides and so many layers of its bottom and top, and sparsely
deeper inside. Under a flat face that is inclined by t against the bed, walls of width w reach w sin t deep, n layers
of height h reach n h cos t deep, and the larger of the two counts. Around ink that stands in a slope, the slicer lays
the walls behind the ink, so the shell is deeper there by the inlay. What is left inside is the same solid with every
face moved in.
"""

import math
from dataclasses import dataclass

import numpy as np
from manifold3d import Manifold
from numpy.typing import NDArray

from designer.make.bed import bed_from_target, printed_corners_mm
from designer.produce import Design
from designer.spec.spec import PrinterProfile

DENSITY_G_PER_CM3 = 1.24
"""PLA, as the tables of filament makers and slicers have it."""
DIAMETER_MM = 1.75
INK_FILL = 0.93
"""Ink laid down over ink in the model: 0.91 to 0.95 in G-code (`tests/designer/test_design_report.py`)."""
INFILL_FILL = 0.93
"""Infill laid down over the percentage asked for, in the inside of solids sliced with gyroid or grid."""
PURGE_G_PER_CHANGE = 0.16
"""On a single nozzle: 120 g in the 757 changes of an icosahedron of edge 100 mm. Slicers differ by several times."""
SPREAD = 0.1
"""By how much slicers, at these settings, differ from this model: up to 6 % in PrusaSlicer."""
_SAME_NORMAL = 1e-6
_LAST_BITS = 1e-9


@dataclass(frozen=True)
class Shells:
    """The slicer's settings that decide on filament."""

    walls: int = 3
    bottom_layers: int = 4
    top_layers: int = 5
    infill: float = 0.15

    @property
    def text(self) -> str:
        """In words."""
        return (
            f"{self.walls} walls, {self.bottom_layers} solid layers at the bottom and {self.top_layers} at the top, "
            f"{100 * self.infill:g} % infill"
        )


@dataclass(frozen=True)
class FilamentAmount:
    """Filament of one slot."""

    volume_mm3: float

    @property
    def mass_g(self) -> float:
        """Of PLA."""
        return self.volume_mm3 / 1000 * DENSITY_G_PER_CM3

    @property
    def length_m(self) -> float:
        """Of filament of 1.75 mm."""
        return self.volume_mm3 / (math.pi / 4 * DIAMETER_MM**2) / 1000

    @property
    def mass_text(self) -> str:
        """The range within which slicers agree."""
        return f"{_range_text(self.mass_g)} g"

    @property
    def length_text(self) -> str:
        """The same in metres."""
        return f"{_range_text(self.length_m)} m"


def two_digits(value: float) -> str:
    """`120`: an estimate has no more digits."""
    return f"{float(f'{value:.2g}'):g}"


def _range_text(value: float) -> str:
    """`30-37`: the value's range, rounded outwards to two digits, or three of those above 100."""
    low, high = value * (1 - SPREAD), value * (1 + SPREAD)
    digits = 1 - math.floor(math.log10(high)) if high < 100 else 2 - math.floor(math.log10(high))
    step = 10.0**-digits
    shown = max(digits, 0)
    # A bound that is a round number but for its last bit stays what it is.
    down, up = math.floor(low / step + _LAST_BITS), math.ceil(high / step - _LAST_BITS)
    return f"{step * down:.{shown}f}-{step * up:.{shown}f}"


@dataclass(frozen=True)
class Filament:
    """Expected filament of a print, without what the printer purges, and without the stand."""

    shells: Shells
    body: FilamentAmount
    ink: FilamentAmount | None  # None: one filament
    changes: int  # of the filament
    inked_layers: int

    @property
    def total_g(self) -> float:
        """Weight of the print."""
        return self.body.mass_g + (self.ink.mass_g if self.ink else 0.0)

    @property
    def purge_g(self) -> float:
        """On a single nozzle, with the usual purge of a change."""
        return PURGE_G_PER_CHANGE * self.changes


def expected_filament(design: Design, shells: Shells | None = None) -> Filament:
    """What the part of a design takes in a slicer with these settings."""
    shells = Shells() if shells is None else shells
    body_mm3, part = design.part.body.volume_mm3, design.part
    core_mm3 = _core_mm3(design, shells)
    body = FilamentAmount(max(body_mm3 - core_mm3, 0.0) + INFILL_FILL * shells.infill * min(core_mm3, body_mm3))
    if part.ink is None:
        return Filament(shells, body, None, 0, 0)
    layers = inked_layers(design)
    # Within a layer the printer begins with the filament that it ended the last one with: one change a layer.
    last = 0 if layers >= _all_layers(design) else 1
    return Filament(shells, body, FilamentAmount(INK_FILL * part.ink.volume_mm3), layers + last, layers)


def inked_layers(design: Design) -> int:
    """How many layers hold ink."""
    ink = design.part.ink
    if ink is None:
        return 0
    height = ink.vertices_mm @ bed_from_target(design.target, design.job.printing)[2, :3]
    return round(float(np.ptp(height)) / design.job.printing.printer.layer_height_mm)


def _all_layers(design: Design) -> int:
    height = design.part.body.vertices_mm @ bed_from_target(design.target, design.job.printing)[2, :3]
    return round(float(np.ptp(height)) / design.job.printing.printer.layer_height_mm)


def _core_mm3(design: Design, shells: Shells) -> float:
    """The volume that is filled sparsely: the solid with its faces moved in."""
    printing = design.job.printing
    corners = printed_corners_mm(design.target, printing)
    up = bed_from_target(design.target, printing)[2, :3]
    core = Manifold.hull_points(corners)
    for normal in _normals(design):
        has_ink = printing.is_two_filament and _is_face(design, normal)
        inset = _inset_mm(float(normal @ up), printing.printer, shells, printing.inlay_mm if has_ink else 0.0)
        core = core.trim_by_plane(tuple((-normal).tolist()), inset - float((corners @ normal).max()))
    return max(float(core.volume()), 0.0)


def _normals(design: Design) -> NDArray[np.float64]:
    """Outward normals of all faces, of a board also of its sides and its back.  # (N, 3)"""
    if design.job.target.solid is None:
        return np.concatenate([np.eye(3), -np.eye(3)])
    return design.target.target_from_face[:, :3, 2]


def _is_face(design: Design, normal: NDArray[np.float64]) -> bool:
    """Whether a normal is that of a face with a pattern."""
    return bool((design.target.target_from_face[:, :3, 2] @ normal > 1 - _SAME_NORMAL).any())


def _inset_mm(upwards: float, printer: PrinterProfile, shells: Shells, inlay_mm: float) -> float:
    """How deep a face's shell is, normal to it.

    Args:
        upwards: cosine of the angle between the face's normal and the bed's.
        printer: gives line width and layer height.
        shells: the slicer's settings.
        inlay_mm: depth of the ink; 0 for none.
    """
    layer, line = printer.layer_height_mm, printer.line_width_mm
    # Lines have round sides and overlap by them: the spacing of the slicers' flow mathematics.
    spacing = line - layer * (1 - math.pi / 4)
    walls = line + (shells.walls - 1) * spacing
    sine = math.sqrt(max(1 - upwards**2, 0.0))
    layers = shells.top_layers if upwards > 0 else shells.bottom_layers
    return max(walls * sine + inlay_mm, layers * layer * abs(upwards))
