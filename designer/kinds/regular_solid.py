"""Targets that are regular solids with the same lattice and a code on every face: sizes, faces, words.

Sizes start from the paper's proportions: on an icosahedron of edge 100 mm 8 rings a side, diameter 7 mm, pitch 10 mm,
border 2 mm.
"""

import math
from abc import abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, ClassVar

from designer.base.errors import InputError
from designer.base.units import format_mm, round_down, round_up
from designer.spec.build import Form
from designer.spec.options import (
    DIAMETER_OVER_PITCH,
    Asked,
    Option,
    check_border,
    check_count,
    check_rings,
    chosen_ring,
    chosen_words,
    diameter_and_pitch,
    widths_mm,
)
from designer.spec.spec import RING_RATIO, Line, Spec, SpecValue

if TYPE_CHECKING:
    from designer.base.solid import Polyhedron, Solid
    from designer.target import TargetGeometry

BORDER_OVER_EDGE = 0.02
_PAPER_INRADIUS = 1 / (2 * math.sqrt(3))
"""Of the paper's triangle, over its side."""
MARGIN_OVER_PITCH = (_PAPER_INRADIUS - BORDER_OVER_EDGE) / 0.1 - 7 * _PAPER_INRADIUS - DIAMETER_OVER_PITCH / 2
"""White between the outermost rings and the border that the paper's proportions leave."""
LEAST_INRADIUS_MM = 2.0
"""Less would leave no body behind the ink."""
MOST_RINGS_PER_SIDE = 8
"""What is chosen at most, as on the paper's icosahedron."""


@dataclass(frozen=True)
class SolidSpec(Spec):
    """A regular solid with `rings_per_side` rings along each side of a face's lattice."""

    form: ClassVar[Form] = "solid"
    page: ClassVar[str] = "A4"
    extent: ClassVar[tuple[str, ...]] = ("edge",)
    fewest_rings: ClassVar[int]
    """Along a side; with fewer, the corners with the codes overlap so far that a code turns into another."""

    edge_mm: float
    rings_per_side: int
    ring_diameter_mm: float
    ring_ratio: float
    pitch_mm: float
    border_mm: float
    margin_mm: float

    @staticmethod
    @abstractmethod
    def shape() -> "Polyhedron":
        """The solid for edge length 1."""

    def lay_out(self) -> "TargetGeometry":
        """The same lattice on each face, and the face's code in dots about the first corner of its outline."""
        import numpy as np

        from designer.base.codes import CODES
        from designer.base.solid import face_frames, regular_polygon
        from designer.kinds.layout import same_on_all_faces

        shape, per_side = self.shape(), self.rings_per_side
        sides, inradius = shape.sides, shape.face_inradius * self.edge_mm
        corner = regular_polygon(sides, 1.0)
        along = [corner[1] - corner[0], corner[-1] - corner[0]]
        steps = self.pitch_mm * np.array(along) / np.linalg.norm(along, axis=1, keepdims=True)
        first = regular_polygon(sides, (per_side - 1) * self.pitch_mm * shape.face_inradius)[0]
        index = shape.index(per_side)
        return same_on_all_faces(
            self,
            index=index,
            in_face_mm=first + np.array(index) @ steps,
            dots=[CODES[code] for code in shape.face_code],
            target_from_face=face_frames(self.edge_mm * shape.vertices[shape.faces_from_code]),
            outline_mm=regular_polygon(sides, inradius),
            window_mm=regular_polygon(sides, inradius - self.border_mm),
            face_code=list(shape.face_code),
            lattice_mm=steps,
        )

    @property
    def solid(self) -> "Solid":
        """The solid that the faces bound."""
        from designer.base.solid import Solid

        return Solid(self.shape(), self.edge_mm)

    @property
    def words(self) -> str:
        """As in `icosahedron of edge 100 mm`."""
        return f"{self.shape().name} of edge {self.edge_mm:g} mm"

    @property
    def size_words(self) -> str:
        """The edge."""
        return f"edge {format_mm(self.edge_mm)}"

    def facts(self) -> tuple[tuple[str, str], ...]:
        """Shape, height on a face, how far codes are apart, and lattice."""
        import numpy as np

        from designer.base.codes import differing_words, least_differing

        shape = self.shape()
        index = np.array(shape.index(self.rings_per_side))
        across = "face to face" if math.isclose(shape.height, 2 * shape.inradius) else "face to corner"
        apart = least_differing([index] * len(shape.faces), shape.lattice, shape.face_code)
        return (
            ("shape", f"{shape.name}, edge {self.edge_mm:g} mm, {shape.height * self.edge_mm:.2f} mm {across}"),
            ("codes differ in", differing_words(*apart)),
            ("lattice", f"{self.shape().lattice}, {self.rings_per_side} rings a side"),
        )

    def options(self) -> Mapping[str, SpecValue]:
        """Edge and rings."""
        return {"edge": format_mm(self.edge_mm), "rings_per_side": self.rings_per_side}


@dataclass(frozen=True, kw_only=True)
class AskedSolid(Asked):
    """A regular solid as asked for."""

    spec_type: ClassVar[type[SolidSpec]]

    @classmethod
    def of(cls, spec: type[SolidSpec]) -> "type[AskedSolid]":
        """What is asked for of a kind."""
        return type(f"Asked{spec.__name__}", (cls,), {"spec_type": spec})

    edge: Annotated[float, Option("length above 0", "edge length, such as 100mm")]
    rings_per_side: Annotated[int | None, Option("count", "rings along a side of a face")] = None

    def sized(self, line: Line) -> tuple[SolidSpec, str]:
        """See `Asked.sized`."""
        fewest = self.spec_type.fewest_rings
        if self.rings_per_side is not None and self.rings_per_side < fewest:
            raise InputError(
                f"rings_per_side {self.rings_per_side} is too few to tell {len(self.shape.faces)} faces apart; "
                f"use at least {fewest}"
            )
        check_border(self.border, line)
        if self.rings_per_side is None and self.ring_diameter is None and self.pitch is None:
            spec, remark = _auto(self, line)
        else:
            spec = _partly_given(self, line)
            remark = chosen_words(_chosen(self, spec))
        _check(spec, line)
        return spec, remark

    def size_name(self, spec: Spec) -> str:
        """The edge."""
        return format_mm(self.edge)

    def spec_of(self, rings: int, diameter: float, pitch: float, border: float, margin: float) -> SolidSpec:
        """The spec with all sizes chosen."""
        return self.spec_type(self.edge, rings, diameter, self.ratio, pitch, border, margin)

    @property
    def ratio(self) -> float:
        """Inner over outer radius of the rings."""
        return self.ring_ratio or RING_RATIO

    @property
    def shape(self) -> "Polyhedron":
        """The solid for edge length 1."""
        return self.spec_type.shape()

    @property
    def face_inradius_mm(self) -> float:
        """From a face's centroid to its sides."""
        return self.shape.face_inradius * self.edge


def _auto(asked: AskedSolid, line: Line) -> tuple[SolidSpec, str]:
    """The most rings, up to the paper's 8 a side, whose strokes, gaps and border are two lines wide.

    For a number of rings the paper's proportions come first, then the widest strokes between gaps of two lines.
    """
    comfort = line.comfortable_mm
    # Below the face, the border ends where the neighbour's begins: it must be wide enough for the usual inlay.
    border = _border_mm(asked, max(comfort, round_up(asked.shape.border_per_inlay * line.inlay_mm)))
    for rings in range(MOST_RINGS_PER_SIDE, asked.spec_type.fewest_rings - 1, -1):
        for spec in (_filled(asked, rings, border), _packed(asked, rings, border, comfort)):
            if spec is not None and min(_chosen_widths(asked, spec)) >= comfort - 1e-9:
                why = f"strokes, gaps and border of at least two lines ({comfort:g}mm) of {line.process}"
                most = "as in the paper" if rings == MOST_RINGS_PER_SIDE else "the most"
                return spec, f"auto: {rings} rings a side, {most} with {why}"
    return _tight(asked, line)


def _border_mm(asked: AskedSolid, least: float) -> float:
    """The border as asked for, else its share of the edge, but no less than `least`."""
    return asked.border if asked.border is not None else round(max(BORDER_OVER_EDGE * asked.edge, least), 4)


def _chosen_widths(asked: AskedSolid, spec: SolidSpec) -> list[float]:
    """Strokes, gaps, and border and margin where they were left open."""
    widths = list(widths_mm(spec))
    widths += [spec.border_mm] if asked.border is None else []
    return widths + ([spec.margin_mm] if asked.margin is None else [])


def _filled(asked: AskedSolid, rings: int, border: float) -> SolidSpec | None:
    """The pitch that fills the face's window with `rings` a side, or None where there is no window."""
    window_inradius = asked.face_inradius_mm - border
    per_pitch = (rings - 1) * asked.shape.face_inradius + DIAMETER_OVER_PITCH / 2
    if asked.margin is None:
        pitch = round_down(window_inradius / (per_pitch + MARGIN_OVER_PITCH))
        margin = round_down(MARGIN_OVER_PITCH * pitch)
    else:
        pitch, margin = round_down((window_inradius - asked.margin) / per_pitch), asked.margin
    diameter = round_down(DIAMETER_OVER_PITCH * pitch)
    return asked.spec_of(rings, diameter, pitch, border, margin) if diameter > 0 else None


def _packed(asked: AskedSolid, rings: int, border: float, gap: float) -> SolidSpec | None:
    """The widest strokes that leave gaps and margin of `gap`, or None where nothing is left for rings."""
    margin = asked.margin if asked.margin is not None else gap
    # inradius of the window = (rings - 1) pitch k + diameter / 2 + margin, with diameter = pitch - gap
    window_inradius = asked.face_inradius_mm - border
    pitch = round_down((window_inradius - margin + gap / 2) / ((rings - 1) * asked.shape.face_inradius + 0.5))
    diameter = round_down(pitch - gap)
    return asked.spec_of(rings, diameter, pitch, border, margin) if diameter > 0 else None


def _tight(asked: AskedSolid, line: Line) -> tuple[SolidSpec, str]:
    """The fewest rings a side, with the widest stroke that leaves gaps and border one line."""
    width, rings = line.width_mm, asked.spec_type.fewest_rings
    spec = _packed(asked, rings, _border_mm(asked, width), width)
    if spec is None or min(widths_mm(spec)[:2]) < width:
        raise InputError(
            f"edge {asked.edge:g}mm{_given(asked)} is too small for {rings} rings a side with {line.process}; "
            f"use at least {_smallest_edge_mm(asked, width):g}mm{line.finer}"
        )
    return spec, (
        f"auto: {rings} rings a side, the fewest that carry a face code; gaps and border are one line ({width:g}mm) of "
        f"{line.process} only: for two lines everywhere use a larger edge or a finer nozzle"
    )


def _smallest_edge_mm(asked: AskedSolid, width: float) -> float:
    """The smallest edge, in tenths of a millimetre, on which `_tight` finds room."""
    rings = asked.spec_type.fewest_rings
    least_diameter = width * max(2 / (1 - asked.ratio), 1 / asked.ratio)
    margin = asked.margin if asked.margin is not None else width
    window_inradius = (rings - 1) * asked.shape.face_inradius * (least_diameter + width) + least_diameter / 2 + margin
    edge = _edge_around(asked, window_inradius, width)
    # Pitch and diameter are rounded down to a hundredth: take the next tenth that still leaves the stroke its width.
    tenths = math.floor(10 * edge)
    while True:
        larger = replace(asked, edge=tenths / 10)
        spec = _packed(larger, rings, _border_mm(larger, width), width)
        if spec is not None and min(widths_mm(spec)[:2]) >= width:
            return tenths / 10
        tenths += 1


def _partly_given(asked: AskedSolid, line: Line) -> SolidSpec:
    """Complete sizes of which some are given."""
    border = _border_mm(asked, line.width_mm)
    if asked.ring_diameter is None and asked.pitch is None and asked.rings_per_side is not None:
        spec = _filled(asked, asked.rings_per_side, border)
        if spec is None:
            raise InputError(
                f"edge {asked.edge:g}mm has no room inside a border of {border:g}mm; use a narrower border"
            )
        return spec
    diameter, pitch = diameter_and_pitch(asked)
    check_rings(diameter, asked.ratio, pitch, line)
    margin = asked.margin if asked.margin is not None else round(pitch - diameter, 4)
    room = asked.face_inradius_mm - border - diameter / 2 - margin
    rings = asked.rings_per_side or 1 + math.floor(room / (asked.shape.face_inradius * pitch) + 1e-9)
    if room < 0 or rings < asked.spec_type.fewest_rings:
        raise InputError(
            f"edge {asked.edge:g}mm{_given(asked)} cannot carry {asked.spec_type.fewest_rings} rings a side of "
            f"{diameter:g}mm at pitch {pitch:g}mm; use {_what_fits(asked, line, diameter, pitch)}"
        )
    return asked.spec_of(rings, diameter, pitch, border, margin)


def _chosen(asked: AskedSolid, spec: SolidSpec) -> Iterator[str]:
    """What was not given beside the sizes of rings that were, and why it is as it is."""
    fills_face = asked.ring_diameter is None and asked.pitch is None
    if fills_face:
        yield f"pitch {spec.pitch_mm:g}mm (fills the face)"
    yield from chosen_ring(asked, spec)
    if asked.rings_per_side is None:
        yield f"{spec.rings_per_side} rings a side (as many as fit)"
    if asked.border is None:
        yield f"border {spec.border_mm:g}mm ({BORDER_OVER_EDGE:g} of the edge, but no less than a line)"
    if asked.margin is None:
        why = "the paper's share of the pitch" if fills_face else "at least the gap between rings"
        yield f"margin {spec.margin_mm:g}mm ({why})"


def _what_fits(asked: AskedSolid, line: Line, diameter: float, pitch: float) -> str:
    """The largest rings that fit on the edge, if any can be made, and the smallest edge for the rings."""
    across = (asked.spec_type.fewest_rings - 1) * asked.shape.face_inradius
    window_inradius = across * pitch + diameter / 2 + (pitch - diameter if asked.margin is None else asked.margin)
    edge = f"an edge of at least {math.ceil(10 * _edge_around(asked, window_inradius, line.width_mm) + 0.01) / 10:g}mm"
    room = asked.face_inradius_mm - _border_mm(asked, line.width_mm) - (asked.margin or 0.0)
    largest = round_down(room * diameter / (window_inradius - (asked.margin or 0.0)))
    its_pitch = round_down(largest * pitch / diameter)
    narrowest = min(largest / 2 * (1 - asked.ratio), largest * asked.ratio, its_pitch - largest)
    return edge if narrowest < line.nozzle_mm else f"rings of at most {largest:g}mm at pitch {its_pitch:g}mm, or {edge}"


def _edge_around(asked: AskedSolid, window_inradius: float, least_border: float) -> float:
    """The edge whose border leaves a window of this inradius."""
    least = LEAST_INRADIUS_MM / asked.shape.inradius
    if asked.border is not None:
        return max(least, (window_inradius + asked.border) / asked.shape.face_inradius)
    # The border is one line, or its share of the edge.
    shared = window_inradius / (asked.shape.face_inradius - BORDER_OVER_EDGE)
    return max(least, (window_inradius + least_border) / asked.shape.face_inradius, shared)


def _given(asked: AskedSolid) -> str:
    """The border and margin that were asked for, since they take room too."""
    parts = [f"{name} {value:g}mm" for name, value in (("border", asked.border), ("margin", asked.margin)) if value]
    return f" with {' and '.join(parts)}" if parts else ""


def _check(spec: SolidSpec, line: Line) -> None:
    """The rules of a solid, whoever chose the sizes."""
    shape = spec.shape()
    check_rings(spec.ring_diameter_mm, spec.ring_ratio, spec.pitch_mm, line)
    room = shape.face_inradius * spec.edge_mm - spec.border_mm - spec.ring_diameter_mm / 2
    margin = room - (spec.rings_per_side - 1) * shape.face_inradius * spec.pitch_mm
    if margin < max(spec.margin_mm, 1e-6) - 1e-9:
        fitting = 1 + math.floor(max(room - spec.margin_mm, 0) / (shape.face_inradius * spec.pitch_mm) + 1e-9)
        raise InputError(
            f"{spec.rings_per_side} rings a side leave a margin of {margin:.3g}mm to the border, "
            f"less than {spec.margin_mm:g}mm; "
            f"use at most {fitting} rings a side, a smaller pitch, or a smaller margin"
        )
    check_count(len(shape.faces) * len(shape.index(spec.rings_per_side)), line)
    if spec.solid.inradius_mm < LEAST_INRADIUS_MM:
        least = math.ceil(10 * LEAST_INRADIUS_MM / shape.inradius) / 10
        raise InputError(f"edge {spec.edge_mm:g}mm leaves no body behind the ink; use at least {least:g}mm")
