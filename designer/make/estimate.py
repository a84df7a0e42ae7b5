"""What a print takes before it is sliced: hours, filament of each slot, changes, purge, spools and money.

    >>> designer.ico(edge_mm=100).estimate.changes

From the model's own geometry: each layer is cut out of the meshes and covered as slicers do it. Walls are offsets of
its contours, the inside is filled sparsely where so many layers below and above reach over it, and solid elsewhere.
Time is the sum over lines, with the printer's speeds and accelerations (`designer.make.motion`), and over changes of
filament. Of high parts some layers are taken for those around them; volumes of body and ink are those of the meshes.

What is not in it: brim, supports, and what a printer does beyond its profile. `tests/benchmarks/bench_estimate.py`
holds it against PrusaSlicer.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from manifold3d import CrossSection, JoinType, OpType

from designer.base.arrays import Array, Flags, Rows
from designer.make.bed import Piece, Plate, mapped, purged
from designer.make.mesh import Part
from designer.make.motion import Pace, chords_mm, lines_time_s, loops_time_s
from designer.make.section import SIMPLE_MM, Sliced
from designer.spec.machine import FilamentChange, Machine
from designer.spec.spec import Price, PrinterProfile, PrintSpec

DENSITY_G_PER_CM3 = 1.24
"""PLA, as the tables of filament makers and slicers have it."""
DIAMETER_MM = 1.75
SPOOL_G = 1000.0
MOST_LAYERS = 48
"""More are not cut, but stand for each other."""
INK_FILL = 0.94
"""Ink laid down over ink in the model: 0.91 to 0.97 in G-code; slivers where ink ends in a slope are left out."""
BY_HAND = FilamentChange(180.0, 240.0, 240.0, has_tower=False)
"""Assumption: three minutes at the printer, who is told to be there, and 100 mm of filament until it is pure."""
TOP_REACH_MM = 3.0
"""How far a visible top goes on below what stands on it (`EXTERNAL_INFILL_MARGIN` of PrusaSlicer and its kin)."""
LEAST_SPARSE_MM2 = 70.0
"""Smaller areas of sparse infill are filled (PrusaSlicer's default; 15 in Bambu Studio)."""
RETRACTED_MM = 2.0
"""Shorter ways are gone without pulling the filament back (PrusaSlicer's and OrcaSlicer's default)."""
_ALIKE = 0.01
BODY, INK = 0, 1


@dataclass(frozen=True)
class PlateEstimate:
    """One print."""

    name: str
    layers: int
    inked_layers: int
    changes: int  # of the filament
    printing_s: float  # the part's own lines and ways
    changing_s: float  # with purge
    start_s: float
    body_mm3: float
    ink_mm3: float
    purge_mm3: float

    @property
    def body_g(self) -> float:
        """In the print."""
        return _grams(self.body_mm3)

    @property
    def time_s(self) -> float:
        """From the button to the last line."""
        return self.start_s + self.printing_s + self.changing_s


@dataclass(frozen=True)
class PrintEstimate:
    """All plates of a design."""

    plates: tuple[PlateEstimate, ...]
    machine: Machine
    filament: Price

    @property
    def time_s(self) -> float:
        """Of all plates, one after the other."""
        return sum(plate.time_s for plate in self.plates)

    @property
    def changing_s(self) -> float:
        """What of it goes into changes."""
        return sum(plate.changing_s for plate in self.plates)

    @property
    def changes(self) -> int:
        """Of the filament."""
        return sum(plate.changes for plate in self.plates)

    @property
    def inked_layers(self) -> int:
        """Layers that hold ink."""
        return sum(plate.inked_layers for plate in self.plates)

    @property
    def body_g(self) -> float:
        """In the print."""
        return _grams(sum(plate.body_mm3 for plate in self.plates))

    @property
    def ink_g(self) -> float:
        """In the print."""
        return _grams(sum(plate.ink_mm3 for plate in self.plates))

    @property
    def purge_g(self) -> float:
        """Of both, thrown away."""
        return _grams(sum(plate.purge_mm3 for plate in self.plates))

    @property
    def total_g(self) -> float:
        """All that comes off the spools."""
        return self.body_g + self.ink_g + self.purge_g

    @property
    def spools(self) -> float:
        """Of 1 kg."""
        return self.total_g / SPOOL_G

    @property
    def price(self) -> float:
        """In the currency of the filament's."""
        return self.total_g / 1000 * self.filament.amount


def _grams(volume_mm3: float) -> float:
    return volume_mm3 / 1000 * DENSITY_G_PER_CM3


def estimate(plates: Sequence[Plate], printing: PrintSpec) -> PrintEstimate:
    """What plates take on a printer: `estimate(design.plates, design.job.printing).changes`."""
    printer, alike = printing.printer, list[_CutPiece]()
    if printing.way.ink == "raised":
        printer = replace(printer, machine=replace(printer.machine, change=BY_HAND))
    return PrintEstimate(
        tuple(_plate_estimate(plate, printer, alike) for plate in plates), printer.machine, printing.filament_price
    )


def changing_layers(has_body: Flags, has_ink: Flags) -> tuple[int, ...]:
    """The layers in which the filament changes: each begins with the one that is loaded, if it has any of it.

    Args:
        has_body: by layer, from the bed up.  # (L,)
        has_ink: the same.  # (L,)
    """
    loaded = BODY if len(has_body) and bool(has_body[0]) else INK
    changes = []
    for number, layer in enumerate(zip(has_body.tolist(), has_ink.tolist(), strict=True)):
        if all(layer) or (any(layer) and not layer[loaded]):
            loaded = 1 - loaded
            changes.append(number)
    return tuple(changes)


def _plate_estimate(plate: Plate, printer: PrinterProfile, alike: list["_CutPiece"]) -> PlateEstimate:
    """The sum over its pieces, layer by layer; `alike` are pieces of earlier plates, to which its own are added."""
    machine, change = printer.machine, printer.machine.change
    cut = [_cut_piece(piece, printer, alike) for piece in plate.pieces]
    layers = max((one.layers for one in cut), default=0)
    there = np.zeros((2, layers), dtype=bool)
    for one in cut:
        there[:, : one.layers] |= one.is_there
    changing = changing_layers(*there)
    changes = len(changing)
    purge = purged(changing, printer)
    times = np.zeros(layers)
    for one in cut:
        times[: one.layers] += one.time_s
    # A layer that changes filament cools meanwhile.
    waiting = np.full(layers, machine.least_layer_s)
    waiting[list(changing)] -= purge.time_s / max(changes, 1)
    printing = np.maximum(times, waiting).sum()
    return PlateEstimate(
        plate.name, layers, int(there[INK].sum()), changes, float(printing), purge.time_s + changes * change.time_s,
        machine.start_s, sum(one.body_mm3 for one in cut), sum(one.ink_mm3 for one in cut), purge.volume_mm3,
    )  # fmt: skip


@dataclass(frozen=True)
class _CutPiece:
    """What one piece takes."""

    part: Part
    is_there: Flags  # (2, L) of body and ink
    time_s: Array  # (L,)
    body_mm3: float
    ink_mm3: float

    @property
    def layers(self) -> int:
        return len(self.time_s)


def _cut_piece(piece: Piece, printer: PrinterProfile, known: list[_CutPiece]) -> _CutPiece:
    """A piece that is as large as one before, such as a tile with other dots, takes as much."""
    part = piece.part.placed(lambda points: mapped(points, piece.bed_from_part[:3, :3]) + piece.bed_from_part[:3, 3])
    for one in known:
        if _is_alike(part, one.part):
            return one
    known.append(_Slicing(part, printer).cut())
    return known[-1]


def _is_alike(part: Part, other: Part) -> bool:
    if (part.ink is None) != (other.ink is None):
        return False
    pairs = [(part.body, other.body)] + ([(part.ink, other.ink)] if part.ink and other.ink else [])
    return all(
        math.isclose(a.volume_mm3, b.volume_mm3, rel_tol=_ALIKE)
        and abs(float(np.ptp(a.vertices_mm[:, 2]) - np.ptp(b.vertices_mm[:, 2]))) < 1e-3
        for a, b in pairs
    )


def _taken(count: int, closely: int) -> tuple[Rows, Array]:
    """The layers that are cut, and how many each stands for; the first and last ones all are.

    Those between are at golden steps within equal shares, so that no rows of rings keep time with them.
    """
    if count <= MOST_LAYERS:
        return np.arange(count), np.ones(count)
    inner = count - 2 * closely
    shares = MOST_LAYERS - 2 * closely
    bounds = closely + np.arange(shares + 1) * inner // shares
    golden = (np.arange(shares) * (math.sqrt(5) - 1) / 2) % 1
    middle = bounds[:-1] + np.floor(golden * np.diff(bounds)).astype(np.int64)
    ends = np.ones(closely)
    return (
        np.concatenate([np.arange(closely), middle, np.arange(count - closely, count)]),
        np.concatenate([ends, np.diff(bounds).astype(np.float64), ends]),
    )


class _Slicing:
    """One piece, cut and covered."""

    def __init__(self, part: Part, printer: PrinterProfile) -> None:
        self.machine, self.layer_mm, self.line_mm = printer.machine, printer.layer_height_mm, printer.line_width_mm
        # Lines have round sides and overlap by them: the spacing of the slicers' flow mathematics.
        self.spacing_mm = self.line_mm - self.layer_mm * (1 - math.pi / 4)
        self.part = part
        self.sliced = Sliced(part, self.layer_mm)
        self.walls_of = cache(self._walls_of)

    def cut(self) -> _CutPiece:
        """All layers."""
        shells = self.machine.shells
        layers, stands_for = _taken(self.sliced.count, max(shells.bottom_layers, shells.top_layers) + 2)
        kinds = [self._kind(layer) for layer in layers.tolist()]
        known = {kind: self._layer(layer) for kind, layer in dict(zip(kinds, layers.tolist(), strict=True)).items()}
        laid = [known[kind] for kind in kinds]
        areas = np.array([one.area_mm2 for one in laid]).reshape(-1, 2)
        filled = np.array([one.filled_mm2 for one in laid]).reshape(-1, 2)
        share = (stands_for @ filled) / np.maximum(stands_for @ areas, 1e-9)
        volumes = [mesh.volume_mm3 for mesh in (self.part.body, self.part.ink) if mesh is not None]
        body, ink = (*(v * s for v, s in zip(volumes, share, strict=False)), 0.0)[:2]
        times = np.repeat([one.time_s for one in laid], stands_for.astype(np.int64))
        return _CutPiece(self.part, self.sliced.is_there, times, float(body), INK_FILL * float(ink))

    def _kind(self, layer: int) -> tuple[int, ...]:
        """The same for layers that are covered alike: those around them, as far as shells look, are cut alike."""
        shells = self.machine.shells
        around = range(layer - shells.bottom_layers - 1, layer + max(shells.top_layers, 1) + 1)
        return tuple(self.sliced.lowest_like(near) for near in around)

    def _layer(self, layer: int) -> "_Laid":
        """One layer: body and ink."""
        is_first = layer == 0
        laid = [
            self._area(section, layer if row == BODY else None, is_first=is_first)
            for row, section in enumerate(self.sliced.sections(layer))
        ]
        laid += [(0.0, 0.0, 0.0)] * (2 - len(laid))
        area, filled, time = zip(*laid, strict=True)
        return _Laid(area, filled, sum(time))

    def _area(self, section: CrossSection, layer: int | None, *, is_first: bool) -> tuple[float, float, float]:
        """An area of one filament: its size, what of it is filled, and the time.

        Args:
            section: the area.
            layer: where sparse infill may be inside; None: nowhere.
            is_first: it lies on the bed.
        """
        area = section.area()
        if area <= 0:
            return 0.0, 0.0, 0.0
        walls, inside = self.walls_of(section)
        time = sum(
            loops_time_s(loops, self._pace("inner_wall" if number else "outer_wall", is_first))
            for number, loops in enumerate(walls)
        )
        starts = [loop[0] for loops in reversed(walls) for loop in loops]  # the outer wall last
        solid = inside if layer is None else self._solid(inside, layer)
        sparse = inside - solid if solid is not inside else CrossSection()
        top = CrossSection()
        if layer is not None and (self.sliced.outline(layer) - self.sliced.outline(layer + 1)).area() >= _ALIKE:
            top = solid - self.sliced.outline(layer + 1)
            if top.area() < solid.area() - _ALIKE:  # slicers let what shows reach below what stands on it
                top = solid ^ top.offset(TOP_REACH_MM, JoinType.Miter)
        bridge = self._bridge(solid, inside, layer) if layer else CrossSection()
        plain = solid - top - bridge if not (top.is_empty() and bridge.is_empty()) else solid
        for part, kind, spacing in (
            (plain, "solid_infill", self.spacing_mm),
            (bridge, "bridge", self.spacing_mm),
            (top, "top", self.spacing_mm),
            (sparse, "infill", self.spacing_mm / max(self.machine.shells.infill, 1e-3)),
        ):
            pace = self._pace(kind, is_first)
            time += self._fill(part, pace, spacing)
            starts += [contour[0] for contour in part.to_polygons()]
        time += self._ways(starts)
        return area, area - sparse.area() * (1 - self.machine.shells.infill), time

    def _walls_of(self, section: CrossSection) -> tuple[list[list[Array]], CrossSection]:
        """The loops of each wall, the outer one first, and what is inside of them all.

        A strip that is too narrow for a line on each side is drawn in one.
        """
        walls, left = list[list[Array]](), section
        for number in range(self.machine.shells.walls):
            left = left.offset(-self.spacing_mm if number else -self.line_mm / 2, JoinType.Miter).simplify(SIMPLE_MM)
            walls.append(left.to_polygons())
        return walls, left.offset(-self.line_mm / 2, JoinType.Miter) if walls else section

    def _solid(self, inside: CrossSection, layer: int) -> CrossSection:
        """What of the inside is filled solid: some layer near it, below or above, does not reach over it.

        Bands narrower than a line are left to the sparse infill, as slicers do.
        """
        shells = self.machine.shells
        if inside.is_empty() or shells.infill >= 1:
            return inside
        near = [self.sliced.outline(layer + away) for away in (shells.top_layers, -shells.bottom_layers)]
        if any(one.is_empty() for one in near):
            return inside
        outline = self.sliced.outline(layer)
        short = [one for one in near if (outline - one).area() > _ALIKE]
        if not short:
            return CrossSection()
        around = sum(float(np.hypot(*np.diff(loop, axis=0, append=loop[:1]).T).sum()) for loop in outline.to_polygons())
        # Walls of ink and body together are shell enough to slicers; one filament has to be as thick everywhere.
        depth_mm = max(outline.area() - inside.area(), 0.0) / max(around, 1e-9) if self.part.ink is None else 0.0
        covered, half = inside, self.spacing_mm / 2
        for one in short:
            covered = covered ^ one.offset(-depth_mm, JoinType.Miter)
        small = [part for part in covered.decompose() if part.area() < LEAST_SPARSE_MM2]
        covered = covered - CrossSection.batch_boolean(small, OpType.Add) if small else covered
        return (inside - covered).offset(-half, JoinType.Miter).offset(half, JoinType.Miter) ^ inside

    def _bridge(self, solid: CrossSection, inside: CrossSection, layer: int) -> CrossSection:
        """What of the solid infill is the first over sparse infill; narrow bands are not printed as bridges."""
        below, half = self._solid(inside, layer - 1), 2 * self.line_mm
        if below is inside:
            return CrossSection()
        bridge = (solid - below).offset(-half, JoinType.Miter).offset(half, JoinType.Miter)
        return bridge ^ solid

    def _fill(self, area: CrossSection, pace: Pace, spacing_mm: float) -> float:
        """Time of parallel lines with short ones between them, at 45 degrees."""
        contours = [np.asarray(loop) for loop in area.to_polygons()]
        chords = chords_mm(contours, spacing_mm, math.pi / 4)
        corner = self.machine.jerk_mm_s / math.sqrt(2)  # both axes turn at once, by half of the jump each
        turns = np.full(len(chords), min(spacing_mm, 10 * self.line_mm))
        return lines_time_s(chords, pace, corner) + lines_time_s(turns, pace, corner)

    def _ways(self, starts: list[Array]) -> float:
        """Time between lines: slicers go to islands in the order in which clipping finds them, as they stand here."""
        if len(starts) < 2:
            return 0.0
        ways = np.hypot(*np.diff(np.array(starts), axis=0).T)
        pace = Pace(self.machine.speeds.travel_mm_s, self.machine.accelerations.travel_mm_s2, self.machine.jerk_mm_s)
        return lines_time_s(ways, pace, pace.jerk_mm_s) + self.machine.retraction_s * int((ways > RETRACTED_MM).sum())

    def _pace(self, kind: str, is_first: bool) -> Pace:
        """Of a kind of line; never more than the nozzle melts."""
        name = "first_layer" if is_first else kind
        speed = getattr(self.machine.speeds, f"{name}_mm_s")
        rate = getattr(self.machine.accelerations, f"{'solid_infill' if name == 'bridge' else name}_mm_s2")
        most = self.machine.flow_mm3_s / (self.spacing_mm * self.layer_mm)
        return Pace(min(speed, most), rate, self.machine.jerk_mm_s)


@dataclass(frozen=True)
class _Laid:
    """One layer of a piece."""

    area_mm2: tuple[float, ...]  # of body and ink
    filled_mm2: tuple[float, ...]
    time_s: float


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
    return f"{few_digits(mass_g)} g"


def few_digits(value: float) -> str:
    """Two digits, three of those above 100."""
    return f"{float(f'{value:.{3 if value >= 100 else 2}g}'):g}"
