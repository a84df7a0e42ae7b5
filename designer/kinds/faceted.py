"""Convex bodies of any flat faces: on each a lattice clipped to its outline, and a code that tells it from all others.

Pitch and rings are the same on all faces, so that a detector has one plan; where a lattice lies on its face, and where
on it the code, is what holds the most rings, the code far from the middle: a turn of the face then moves it.
"""

import itertools
import math
from abc import abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Annotated, ClassVar

from designer.base.errors import InputError
from designer.base.units import round_down, round_up
from designer.kinds.regular_solid import BORDER_OVER_EDGE, MARGIN_OVER_PITCH
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
)
from designer.spec.spec import RING_RATIO, Lattice, Line, Spec

if TYPE_CHECKING:
    from designer.base.arrays import Array, Rows
    from designer.base.codes import Index
    from designer.base.solid import Faceted
    from designer.target import TargetGeometry

LEAST_MARKS = 15
"""On a face: the code's ten places, and five rings beside them."""
MOST_RINGED = 100
"""Faces, for which there are codes on either lattice."""
USUAL_MARKS = 36
"""On the smallest face, where strokes and gaps of two lines allow: as on the paper's icosahedron."""
LEAST_DIFFERING = 2
"""Marks that must differ between any two faces, however they are turned."""
MOST_STEPS = 1000
"""Of a lattice from the middle of a face."""
_PHASES = 12
_FINER = 0.97
_TOLERANCE_MM = 1e-6


@dataclass(frozen=True)
class Fit:
    """What decides where a lattice lies on a face, and the rings on it."""

    ring_diameter_mm: float
    ring_ratio: float
    pitch_mm: float
    border_mm: float
    margin_mm: float
    lattice: Lattice

    @property
    def inset_mm(self) -> float:
        """From a face's sides to the nearest centres."""
        return self.border_mm + self.margin_mm + self.ring_diameter_mm / 2


@dataclass(frozen=True)
class FacetedSpec(Fit, Spec):
    """A convex body with rings on its flat faces."""

    form: ClassVar[Form] = "polyhedron"
    page: ClassVar[str] = "A4"

    @abstractmethod
    def shape(self) -> "Faceted":
        """The body, each face from any corner on."""

    def codes(self) -> Sequence[int] | None:
        """Rows of `CODES` to choose from; None: those for bodies of any faces."""
        return None

    @property
    def fit(self) -> Fit:
        """What decides where the lattices lie."""
        return Fit(*(getattr(self, field.name) for field in fields(Fit)))

    @cached_property
    def laid(self) -> "Laid":
        """Lattices and codes, face by face.

        Raises:
            InputError: a face has no room for them.
        """
        from designer.base.codes import face_codes

        shape = self.shape()
        faces = [lattice_on(self.fit, shape.vertices_mm[list(face)]) for face in shape.faces]
        if None in faces:
            raise InputError(f"face {faces.index(None)} has no room for {LEAST_MARKS} rings and dots; leave it bare")
        laid = tuple(face for face in faces if face is not None)
        return Laid(laid, *face_codes([face.index for face in laid], self.lattice, self.codes()))

    @property
    def body(self) -> "Faceted":
        """The body, each face from the corner at its code on."""
        shape = self.shape()
        rows = zip(shape.faces, self.laid.faces, strict=True)
        return replace(shape, faces=tuple(face[own.first :] + face[: own.first] for face, own in rows))

    def lay_out(self) -> "TargetGeometry":
        """The same lattice on all faces, clipped to each, and dots at its code."""
        import numpy as np

        from designer.base.codes import CODES
        from designer.kinds.layout import DECIMALS
        from designer.target import TargetGeometry

        laid, radius = self.laid, self.ring_diameter_mm / 2
        index = np.concatenate([face.index for face in laid.faces])
        count = [len(face.index) for face in laid.faces]
        frame = np.array([face.frame for face in laid.faces])
        center = [face.place_mm @ face.frame[:3, :2].T + face.frame[:3, 3] for face in laid.faces]
        placed: Array = np.concatenate(center)
        is_dot = np.array([tuple(at) in CODES[code] for face, code in zip(laid.faces, laid.code, strict=True)
                           for at in face.index.tolist()])  # fmt: skip
        corners = max(len(outline) for face in laid.faces for outline in (face.outline_mm, face.window_mm))
        return TargetGeometry(
            source="nominal",
            spec=self,
            ring_face=np.repeat(np.arange(len(count)), count),
            ring_index=index,
            center_mm=np.round(placed, DECIMALS),
            radius_outer_mm=np.full(len(index), radius),
            radius_inner_mm=np.where(is_dot, 0.0, radius * self.ring_ratio),
            is_dot=is_dot,
            target_from_face=np.round(frame, 12),
            outline_mm=np.round([split_sides(face.outline_mm, corners) for face in laid.faces], DECIMALS),
            window_mm=np.round([split_sides(face.window_mm, corners) for face in laid.faces], DECIMALS),
            face_code=np.array(laid.code),
            lattice_mm=np.tile(np.round(_steps_mm(self.fit), DECIMALS), (len(count), 1, 1)),
        )

    def facts(self) -> tuple[tuple[str, str], ...]:
        """Shape, how far codes are apart, and lattice."""
        from designer.base.codes import differing_words, least_differing

        counts = [len(face.index) for face in self.laid.faces]
        most = f"{min(counts)} to {max(counts)}" if min(counts) < max(counts) else f"{counts[0]}"
        apart = least_differing([face.index for face in self.laid.faces], self.lattice, self.laid.code)
        return (
            ("shape", self.words.replace(" of ", ", ", 1)),
            ("codes differ in", differing_words(*apart)),
            ("lattice", f"{self.lattice}, {most} rings a face"),
        )


@dataclass(frozen=True, eq=False)
class LaidFace:
    """A face with its lattice."""

    frame: "Array"  # (4, 4) target_from_face
    outline_mm: "Array"  # (K, 2) from the corner at the code on
    window_mm: "Array"  # (L, 2)
    first: int  # which corner of the body's face that is
    index: "Rows"  # (N, 2)
    place_mm: "Array"  # (N, 2)


@dataclass(frozen=True, eq=False)
class Laid:
    """All faces, and the row of `CODES` of each."""

    faces: tuple[LaidFace, ...]
    code: tuple[int, ...]
    differing: int  # marks, at least, between any two faces in any turn


def _steps_mm(fit: Fit) -> "Array":
    """Steps of i and j in every face's frame: down from the code's corner, to the left and to the right.  # (2, 2)"""
    import numpy as np

    if fit.lattice == "square":
        return fit.pitch_mm * np.array([[0.0, -1.0], [1.0, 0.0]])
    return fit.pitch_mm * np.array([[-0.5, -math.sqrt(3) / 2], [0.5, -math.sqrt(3) / 2]])


def lattice_on(fit: Fit, corner_mm: "Array") -> LaidFace | None:
    """The lattice that holds the most on a polygon in space; None: fewer than the least."""
    import numpy as np

    from designer.base.solid import plane_of

    normal = plane_of(corner_mm)[:3]
    best: tuple[int, float, int] | None = None
    for side in range(len(corner_mm)):
        x_axis = np.roll(corner_mm, -1, axis=0)[side] - corner_mm[side]
        x_axis = x_axis - (x_axis @ normal) * normal
        x_axis = x_axis / np.linalg.norm(x_axis)
        axes = np.stack([x_axis, np.cross(normal, x_axis), normal], axis=1)
        outline = (corner_mm - corner_mm.mean(axis=0)) @ axes[:, :2]
        found = _clipped(fit, tuple(map(tuple, np.round(outline, 4).tolist())))
        if found is not None and (best is None or (len(found[0]), found[2]) > best[:2]):
            best = len(found[0]), found[2], side
            index, place, _ = found
            frame, kept = axes, outline
    if best is None:
        return None
    target_from_face = np.eye(4)
    target_from_face[:3, :3] = frame
    target_from_face[:3, 3] = corner_mm.mean(axis=0)
    at_code = place[np.flatnonzero((index == 0).all(axis=1))[0]]
    first = int(np.round(np.linalg.norm(kept - at_code, axis=1), 6).argmin())
    window = inset_polygon(kept, fit.border_mm)
    start = int(np.round(np.linalg.norm(window - at_code, axis=1), 6).argmin())
    return LaidFace(
        target_from_face, np.roll(kept, -first, axis=0), np.roll(window, -start, axis=0), first, index, place
    )


def inset_polygon(outline_mm: "Array", distance_mm: float) -> "Array":
    """A convex polygon with its sides moved in, counter-clockwise; of short sides some may be gone.  # (L, 2)"""
    import numpy as np
    from shapely import Polygon
    from shapely.geometry.polygon import orient

    inner = Polygon(outline_mm).buffer(-distance_mm, join_style="mitre", mitre_limit=1e6)
    return np.array(orient(inner).exterior.coords)[:-1] if not inner.is_empty else np.empty((0, 2))


@lru_cache(maxsize=4096)
def _clipped(fit: Fit, outline_mm: tuple[tuple[float, float], ...]) -> "tuple[Rows, Array, float] | None":
    """Indices from the code on and places of a lattice with a row along the lowest side, and how far out the code is.

    A lattice may have a place at any corner of the room for centres, or in its middle, or begin anywhere on the lowest
    row; it is then moved to where it leaves the same white all around.
    """
    import numpy as np
    from shapely import Polygon, contains_xy

    room = inset_polygon(np.array(outline_mm), fit.inset_mm)
    if len(room) < 3:
        return None
    steps, (low, high) = _steps_mm(fit), (room.min(axis=0), room.max(axis=0))
    middle, reach = room.mean(axis=0), math.ceil(2 * float(np.ptp(room, axis=0).max()) / fit.pitch_mm) + 1
    if reach > MOST_STEPS:
        raise InputError(
            f"pitch {fit.pitch_mm:g}mm on a face {float(np.ptp(room, axis=0).max()):.0f}mm wide is too fine; use a "
            "larger pitch"
        )
    every = np.array(list(itertools.product(range(-reach, reach + 1), repeat=2)))
    places = every @ steps
    is_near = (np.abs(places) <= high - low + fit.pitch_mm).all(axis=1)
    every, places = every[is_near], places[is_near]
    along = [(middle[0] + shift * fit.pitch_mm, low[1]) for shift in np.arange(_PHASES) / _PHASES]
    grown = Polygon(room).buffer(_TOLERANCE_MM, join_style="mitre")
    inside = [contains_xy(grown, *(places + origin).T) for origin in (*room, middle, *along)]
    best: tuple[Rows, Array, float] | None = None
    for origin, mine in zip((*room, middle, *along), inside, strict=True):
        if mine.sum() < max(LEAST_MARKS, 0 if best is None else len(best[0])):
            continue
        index, place = every[mine], places[mine] + origin
        code = _code_place(index, place)
        if code is not None and (best is None or (len(index), code[1]) > (len(best[0]), best[2])):
            best = index - code[0], place, code[1]
    if best is None:
        return None
    index, place, out_mm = best
    side = np.roll(room, -1, axis=0) - room
    outward = np.stack([side[:, 1], -side[:, 0]], axis=1) / np.linalg.norm(side, axis=1, keepdims=True)
    white = ((room * outward).sum(axis=1) - (place @ outward.T)).min(axis=0)
    shift = np.linalg.lstsq(outward, white, rcond=None)[0]
    is_clear = (white - outward @ shift > -_TOLERANCE_MM).all()
    return index, place + (shift if is_clear else 0.0), out_mm


def _code_place(index: "Rows", place: "Array") -> "tuple[Index, float] | None":
    """Where the code's first position lies if it is as far from the middle as can be, and how far; None: nowhere."""
    import numpy as np

    from designer.base.codes import POSITIONS

    low = index.min(axis=0)
    row_at = np.full(np.ptp(index, axis=0) + 1 + np.max(POSITIONS, axis=0), -1)
    row_at[tuple((index - low).T)] = np.arange(len(index))
    rows = np.stack([row_at[tuple((index - low + step).T)] for step in np.array(POSITIONS)])  # (positions, N)
    is_whole = (rows >= 0).all(axis=0)
    if not is_whole.any():
        return None
    out_mm = np.linalg.norm(place[rows[:, is_whole]].mean(axis=0) - place.mean(axis=0), axis=1).round(6)
    first = int(out_mm.argmax())
    i, j = index[is_whole][first].tolist()
    return (i, j), float(out_mm[first])


def split_sides(outline_mm: "Array", corners: int) -> "Array":
    """A polygon with its longest sides halved until it has so many corners.  # (K, 2) -> (corners, 2)"""
    import numpy as np

    while len(outline_mm) < corners:
        after = np.roll(outline_mm, -1, axis=0)
        longest = int(np.round(np.linalg.norm(after - outline_mm, axis=1), 6).argmax())
        outline_mm = np.insert(outline_mm, longest + 1, (outline_mm + after)[longest] / 2, axis=0)
    return outline_mm


@dataclass(frozen=True, kw_only=True)
class AskedFaceted(Asked):
    """A convex body as asked for."""

    lattice: Annotated[Lattice | None, Option("lattice", "square or triangular")] = None

    @abstractmethod
    def body(self) -> "Faceted":
        """What may carry rings, and what may not.

        Raises:
            InputError: there is no such body.
        """

    @abstractmethod
    def spec_of(self, fit: Fit, body: "Faceted") -> FacetedSpec:
        """The spec with all sizes chosen."""

    @abstractmethod
    def larger(self, factor: float) -> str:
        """What to use instead of what is too small by a factor."""

    usual_lattice: ClassVar[Lattice] = "triangular"
    """Where none is asked for."""
    is_partly_bare: ClassVar[bool] = False
    """Whether faces that are too small may stay bare."""

    def sized(self, line: Line) -> tuple[FacetedSpec, str]:
        """See `Asked.sized`."""
        body, ratio = self.body(), self.ring_ratio or RING_RATIO
        check_border(self.border, line)
        least_mm, narrow_mm = line.comfortable_mm, max(line.width_mm, line.nozzle_mm)
        if self.ring_diameter is None and self.pitch is None:
            widest = float(body.vertices_mm.max() - body.vertices_mm.min())
            finest = max(_least_pitch_mm(line.comfortable_mm, ratio), 3 * widest / MOST_STEPS)
            wanted = self._with_room(body, self._fit(body, finest, line, line.comfortable_mm))
            if not wanted:
                least_mm, finest = narrow_mm, _least_pitch_mm(narrow_mm, ratio)
                wanted = self._with_room(body, self._fit(body, finest, line, narrow_mm))
            self._check_wanted(body, wanted, self._fit(body, finest, line, narrow_mm), line)
            fit = self._largest(body, wanted, finest, line, least_mm)
            remark = f"auto: pitch {fit.pitch_mm:g}mm, the largest with {USUAL_MARKS} rings on the smallest face"
            if fit.pitch_mm <= finest + 0.01:
                width = "two lines" if least_mm == line.comfortable_mm else "one line"
                remark = f"auto: pitch {fit.pitch_mm:g}mm, the least with strokes and gaps of {width} of {line.process}"
        else:
            diameter, pitch = diameter_and_pitch(self)
            check_rings(diameter, ratio, pitch, line)
            usual = self._fit(body, pitch, line, line.width_mm)
            margin = self.margin if self.margin is not None else round(pitch - diameter, 4)
            fit = replace(usual, ring_diameter_mm=diameter, margin_mm=margin)
            wanted = self._with_room(body, fit)
            self._check_wanted(body, wanted, fit, line)
            remark = ""
        bare = [face for row, face in enumerate(body.faces) if row not in wanted]
        ringed = replace(body, faces=tuple(body.faces[row] for row in wanted), bare=(*bare, *body.bare))
        spec = self.spec_of(fit, ringed)
        remark = remark or chosen_words(self._chosen(spec))
        check_count(sum(len(face.index) for face in spec.laid.faces), line)
        if spec.laid.differing < LEAST_DIFFERING:
            raise InputError(
                f"rings at pitch {fit.pitch_mm:g}mm: a face with so few of them looks like another one turned; use a "
                "smaller pitch"
            )
        _check_thickness(spec.shape(), line)
        small = f"; {len(bare)} of {len(body.faces)} faces too small for rings stay bare" if bare else ""
        return spec, f"{remark}{small}"

    def _chosen(self, spec: FacetedSpec) -> Iterator[str]:
        yield from chosen_ring(self, spec)
        if self.border is None:
            yield f"border {spec.border_mm:g}mm (what the ink's depth asks for)"
        if self.margin is None:
            yield f"margin {spec.margin_mm:g}mm (the gap between rings)"

    def _fit(self, body: "Faceted", pitch: float, line: Line, gap: float) -> Fit:
        """Rings in the paper's proportions, with gaps, margin and border of at least so much."""
        from designer.base.solid import INLAY_SHARE

        pitch = round_up(pitch)
        diameter = round_down(min(DIAMETER_OVER_PITCH * pitch, pitch - gap))
        border, margin = self.border, self.margin
        if border is None:  # below the face it ends where the neighbour's begins
            share = round(BORDER_OVER_EDGE * body.mean_edge_mm, 2)
            border = max(gap, round_up(body.inset_per_depth / INLAY_SHARE * line.inlay_mm), share)
        if margin is None:
            margin = max(gap, round_down(MARGIN_OVER_PITCH * pitch))
        ratio = self.ring_ratio or RING_RATIO
        return Fit(diameter, ratio, pitch, border, margin, self.lattice or self.usual_lattice)

    def _with_room(self, body: "Faceted", fit: Fit) -> tuple[int, ...]:
        """The faces that hold the least number of marks."""
        return tuple(row for row, count in enumerate(_counts(body, range(len(body.faces)), fit)) if count)

    def _largest(self, body: "Faceted", wanted: Sequence[int], finest: float, line: Line, gap: float) -> Fit:
        """The largest pitch at which all faces hold the usual number of marks, but no less than the finest."""
        from designer.base.solid import area_of

        area_mm2 = min(area_of(body.vertices_mm[list(body.faces[row])]) for row in wanted)
        pitch = math.sqrt(area_mm2 / (USUAL_MARKS * math.sqrt(3) / 2))
        while pitch > finest:
            fit = self._fit(body, pitch, line, gap)
            if min(_counts(body, wanted, fit)) >= USUAL_MARKS:
                return fit
            pitch *= _FINER
        return self._fit(body, finest, line, gap)

    def _check_wanted(self, body: "Faceted", wanted: Sequence[int], fit: Fit, line: Line) -> None:
        """Enough faces must hold rings, and there must be a code for each."""
        if not wanted or (len(wanted) < len(body.faces) and not self.is_partly_bare):
            factor = 1.0
            least = 1 if self.is_partly_bare else len(body.faces)
            while factor < _MOST_SCALE and len(self._with_room(scaled(body, factor), fit)) < least:
                factor *= 1.02
            raise InputError(
                f"faces too small for a code and {LEAST_MARKS - 10} rings of {fit.ring_diameter_mm:g}mm at pitch "
                f"{fit.pitch_mm:g}mm with {line.process}; use {self.larger(factor)}{line.finer}"
            )
        if len(wanted) > MOST_RINGED:
            raise InputError(
                f"{len(wanted)} faces hold rings, codes tell {MOST_RINGED} apart; use a larger --pitch, "
                "so that small faces stay bare, or a simpler body"
            )


_MOST_SCALE = 1000.0


def scaled(body: "Faceted", factor: float) -> "Faceted":
    """The same of another size."""
    return replace(body, vertices_mm=factor * body.vertices_mm)


def _check_thickness(body: "Faceted", line: Line) -> None:
    """The ink of two opposite faces must leave a body between them."""
    import numpy as np

    from designer.base.solid import plane_of

    planes = [plane_of(body.vertices_mm[list(face)]) for face in body.faces]
    thick_mm = min(float(np.ptp(body.vertices_mm @ plane[:3])) for plane in planes)
    if thick_mm < 3 * line.inlay_mm:
        raise InputError(
            f"body is {thick_mm:.3g}mm thick behind a face, and ink is {line.inlay_mm:g}mm deep from each side; "
            f"use one at least {3 * line.inlay_mm:g}mm thick, `design board` for a plate, or --build stickers"
        )


def _least_pitch_mm(width_mm: float, ratio: float) -> float:
    """Of rings whose stroke and centre are so wide, with gaps as wide."""
    diameter = round_up(width_mm * max(2 / (1 - ratio), 1 / ratio))
    return max(diameter / DIAMETER_OVER_PITCH, diameter + width_mm)


def _counts(body: "Faceted", rows: Iterable[int], fit: Fit) -> list[int]:
    """Marks on faces; 0 where there is no room for the least number."""
    import numpy as np

    counted: dict[object, int] = {}  # of faces whose sides and diagonals are alike one is enough
    counts = []
    for row in rows:
        corner = body.vertices_mm[list(body.faces[row])]
        key = tuple(np.sort(np.linalg.norm(corner[:, None] - corner, axis=2), axis=None).round(3).tolist())
        if key not in counted:
            face = lattice_on(fit, corner)
            counted[key] = 0 if face is None else len(face.index)
        counts.append(counted[key])
    return counts
