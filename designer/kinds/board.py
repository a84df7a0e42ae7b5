"""A plate with rings on one face, or on both."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, ClassVar

from designer.base.errors import InputError
from designer.base.marks import LEFT_OUT
from designer.base.units import format_mm, round_down, round_up
from designer.base.words import with_article
from designer.spec.build import Form
from designer.spec.kind import Kind
from designer.spec.options import (
    DIAMETER_OVER_PITCH,
    Asked,
    Option,
    check_count,
    check_rings,
    chosen_ring,
    chosen_words,
    diameter_and_pitch,
)
from designer.spec.spec import RING_RATIO, Lattice, Line, Spec, SpecValue

if TYPE_CHECKING:
    from designer.base.arrays import Array
    from designer.base.codes import Index
    from designer.marks.face_marks import FaceMarks
    from designer.target import TargetGeometry

RINGS_ACROSS = 22
"""A board's shorter side over its pitch, as on the paper's 3DBoard."""
THICKNESS_MM = 5.0
"""Of a plate, as on the paper's 3DBoard."""
BOARD_DOTS: "frozenset[Index]" = frozenset({(0, 0), (1, 0), (0, 2)})
"""The origin mark of a board. Its three distances differ on both lattices, so no rotation and no mirror image
maps it onto itself. The dot at (0, 0) is the index origin."""
USUAL_SIZE_MM = (280.0, 200.0)
"""Of a board of which nothing is said: A4 with room for the edge of a page; less where a printer makes less."""
BACK_DOTS: "frozenset[Index]" = frozenset({(0, 0), (3, 0), (1, 3)})
"""The mark of the back of a board with two faces: on both lattices no two of its dots are as far apart as two of the
front's, so that a turned, shifted or mirrored part of one mark is no part of the other; two dots tell the face."""
MARKS_OF: Mapping[str, tuple[str, ...]] = {
    "chessboard": ("squares", "square"),
    "charuco": ("squares", "square", "marker", "dictionary", "first_id"),
    "aprilgrid": ("tags", "tag", "gap", "dictionary", "first_id"),
    "circles": ("circles", "pitch", "diameter", "asymmetric"),
}
"""Their options: what is counted and its side or step first."""
MARKS_OPTIONS = tuple(dict.fromkeys(name for names in MARKS_OF.values() for name in names if name != "pitch"))
Counts = tuple[int, int]
MARKS_ACROSS: Mapping[str, tuple[Counts, Counts]] = {
    "chessboard": ((10, 7), (7, 10)), "charuco": ((11, 8), (8, 11)), "aprilgrid": ((6, 4), (4, 6)),
    "circles": ((6, 9), (4, 11)),
}  # fmt: skip
"""Of wide and of high boards of which nothing is said: chessboards whose sum is odd, and asymmetric circles in an odd
number of rows, do not look the same turned by half a turn."""
MARKER_SHARE, TAG_SPACING = 0.75, 0.3
"""A marker's side over a square's, and the gap over a tag's side, as Kalibr's."""
LEAST_ACROSS, LEAST_ACROSS_TWO_SIDED = 3, 4
"""Rings along a side that hold the marks."""


@dataclass(frozen=True)
class BoardSpec(Spec):
    """A rectangular plate with rings on one face, or on both; `columns` counts the longest row."""

    kind: ClassVar[str] = "board"
    form: ClassVar[Form] = "plate"
    page: ClassVar[str] = "fit"
    extent: ClassVar[tuple[str, ...]] = ("size", "lattice", "thickness")

    size_mm: tuple[float, float]  # width, height
    thickness_mm: float
    columns: int
    rows: int
    lattice: Lattice
    ring_diameter_mm: float
    ring_ratio: float
    pitch_mm: float
    border_mm: float
    margin_mm: float
    dots: bool  # three dots that mark origin and orientation
    two_sided: Annotated[bool | None, LEFT_OUT] = None  # None: one face; files of such boards never named it

    def lay_out(self) -> "TargetGeometry":
        """The board: x right, y up, z out of the face, origin at the face's centre.

        The lattice is centred on the face. Index (0, 0) is the corner dot of the origin mark, which lies near the
        middle; without dots the indices are counted from the same place. A back has the same rings in a frame turned by
        half a turn about y, and its own mark.
        """
        import numpy as np  # here: reading a command line needs none

        from designer.kinds.layout import same_on_all_faces

        steps = self.pitch_mm * lattice_steps(self.lattice)
        raw = board_index(self.columns, self.rows, self.lattice)
        position = np.array(raw) @ steps
        origin = _origin_index(raw, position, BOARD_DOTS)
        dots, (frames, outline) = [BOARD_DOTS if self.dots else frozenset()], self.sides
        if self.two_sided:
            i, j = _origin_index(raw, position, BACK_DOTS)
            dots.append(frozenset((i - origin[0] + k, j - origin[1] + m) for k, m in BACK_DOTS))
        return same_on_all_faces(
            self,
            index=[(i - origin[0], j - origin[1]) for i, j in raw],
            in_face_mm=position - 0.5 * (position.min(axis=0) + position.max(axis=0)),
            dots=dots,
            target_from_face=frames,
            outline_mm=outline,
            window_mm=outline - np.sign(outline) * self.border_mm,
            face_code=[-1] * len(frames),
            lattice_mm=steps,
        )

    @property
    def sides(self) -> "tuple[Array, Array]":
        """Frames of the front and, if there is one, the back, and the outline of each.  # (F, 4, 4), (4, 2)"""
        import numpy as np

        frames, (width, height) = np.stack([np.eye(4), np.diag([-1.0, 1.0, -1.0, 1.0])]), self.size_mm
        frames[1, 2, 3] = -self.thickness_mm
        outline = 0.5 * np.array([[-width, -height], [width, -height], [width, height], [-width, height]])
        return frames[: 2 if self.two_sided else 1], outline

    @property
    def depth_mm(self) -> float:
        """The plate's thickness."""
        return self.thickness_mm

    @property
    def words(self) -> str:
        """As in `board of 220 x 220 mm`."""
        return f"board of {self.size_mm[0]:g} x {self.size_mm[1]:g} mm{', two-sided' if self.two_sided else ''}"

    @property
    def size_words(self) -> str:
        """With its thickness."""
        return format_mm(*self.size_mm, self.thickness_mm)

    def facts(self) -> tuple[tuple[str, str], ...]:
        """Shape and lattice."""
        width, height = self.size_mm
        return (
            (
                "shape",
                f"board, {width:g} x {height:g} x {self.thickness_mm:g} mm{', two-sided' * bool(self.two_sided)}",
            ),
            ("lattice", f"{self.lattice}, {self.columns} columns, {self.rows} rows"),
        )

    def options(self) -> Mapping[str, SpecValue]:
        """Of the plate and its rows."""
        return {
            "size": format_mm(*self.size_mm),
            "thickness": format_mm(self.thickness_mm),
            "columns": self.columns,
            "rows": self.rows,
            "lattice": self.lattice,
            "dots": self.dots,
            "two_sided": bool(self.two_sided),
        }


@dataclass(frozen=True)
class MarkedBoardSpec(BoardSpec):
    """A plate with marks that other detectors find; columns and rows count squares or tags, the pitch is theirs."""

    marks: str = ""  # as in MARKS_OF
    marker_mm: Annotated[float | None, LEFT_OUT] = None  # of a ChArUco board
    gap_mm: Annotated[float | None, LEFT_OUT] = None  # between tags
    dictionary: Annotated[str | None, LEFT_OUT] = None
    first_id: Annotated[int | None, LEFT_OUT] = None
    asymmetric: Annotated[bool | None, LEFT_OUT] = None  # of circles

    @property
    def side_mm(self) -> float:
        """Of a square or tag; of circles the step."""
        return self.pitch_mm if self.marks == "circles" else self.ring_diameter_mm

    @property
    def face_marks(self) -> "FaceMarks":
        """Of the front."""
        from designer.marks.aprilgrid import AprilGrid
        from designer.marks.charuco import Charuco
        from designer.marks.chessboard import Chessboard
        from designer.marks.circles import Circles

        counts, first = (self.columns, self.rows), self.first_id or 0
        if self.marks == "charuco":
            return Charuco(counts, self.pitch_mm, self.marker_mm or 0.0, self.dictionary or "", first)
        if self.marks == "aprilgrid":
            spacing = round((self.gap_mm or 0.0) / self.ring_diameter_mm, 12)
            return AprilGrid(counts, self.ring_diameter_mm, spacing, self.dictionary or "", first)
        if self.marks == "circles":
            return Circles(counts, self.pitch_mm, self.ring_diameter_mm, asymmetric=bool(self.asymmetric))
        return Chessboard(counts, self.pitch_mm)

    def lay_out(self) -> "TargetGeometry":
        """The marks in the middle of the face; a back has the same with the ids that follow."""
        import numpy as np

        from designer.target import target_of_marks

        front, (frames, outline) = self.face_marks, self.sides
        faces = [front, *([front.following] if self.two_sided and front.following is not None else [])]
        around = np.tile(outline, (len(faces), 1, 1))
        return replace(target_of_marks(faces, frames[: len(faces)]), spec=self, outline_mm=around, window_mm=around)

    @property
    def words(self) -> str:
        """As in `board of 280 x 200 mm with a chessboard of 10 x 7 squares of 23 mm (9 x 6 inner corners)`."""
        return f"{super().words} with {with_article(self.face_marks.words)}"

    def facts(self) -> tuple[tuple[str, str], ...]:
        """Shape and marks."""
        return (super().facts()[0], ("marks", self.face_marks.words))

    def options(self) -> Mapping[str, SpecValue]:
        """Of the plate and its marks."""
        counted, step = MARKS_OF[self.marks][:2]
        own: dict[str, SpecValue] = {counted: f"{self.columns}x{self.rows}", step: format_mm(self.side_mm)}
        if self.asymmetric is not None:
            own |= {"diameter": format_mm(self.ring_diameter_mm), "asymmetric": self.asymmetric}
        if self.marker_mm is not None:
            own["marker"] = format_mm(self.marker_mm)
        if self.gap_mm is not None:
            own["gap"] = format_mm(self.gap_mm)
        if self.dictionary is not None:
            own |= {"dictionary": self.dictionary, "first_id": self.first_id or 0}
        kept = {name: value for name, value in super().options().items() if name in ("size", "thickness", "two_sided")}
        return {**kept, "marks": self.marks, **own}


@dataclass(frozen=True, kw_only=True)
class AskedBoard(Asked):
    """A board as asked for."""

    of_some: ClassVar[tuple[str, ...]] = ("columns", "rows", "lattice", "dots", "marks", *MARKS_OPTIONS)

    size: Annotated[tuple[float, float] | None, Option("size", "width and height, such as 220x220mm")] = None
    thickness: Annotated[float | None, Option("length above 0", "thickness of the plate (5mm)")] = None
    columns: Annotated[int | None, Option("count", "rings in the longest row")] = None
    rows: Annotated[int | None, Option("count", "rows of rings")] = None
    lattice: Annotated[Lattice | None, Option("lattice", "square or triangular")] = None
    dots: Annotated[bool | None, Option("switch", "three dots that mark origin and orientation")] = None
    two_sided: Annotated[bool | None, Option("switch", "rings on both faces, with marks that tell them apart")] = None
    marks: Annotated[
        str | None,
        Option("marks", "marks of other detectors instead of rings: chessboard, charuco, aprilgrid or circles"),
    ] = None
    squares: Annotated[tuple[int, int] | None, Option("counts", "squares of a chessboard or ChArUco: 11x8")] = None
    square: Annotated[float | None, Option("length above 0", "side of a square")] = None
    marker: Annotated[float | None, Option("length above 0", "side of a marker (.75 of a square)")] = None
    dictionary: Annotated[str | None, Option("dictionary", "of markers or tags, by OpenCV's name")] = None
    first_id: Annotated[int | None, Option("number", "id of the first marker or tag (0)")] = None
    tags: Annotated[tuple[int, int] | None, Option("counts", "tags of an AprilGrid: 6x4")] = None
    tag: Annotated[float | None, Option("length above 0", "side of a tag")] = None
    gap: Annotated[float | None, Option("length above 0", "between two tags (.3 of a tag)")] = None
    circles: Annotated[tuple[int, int] | None, Option("counts", "circles in a row, and rows: 4x11")] = None
    diameter: Annotated[float | None, Option("length above 0", "of circles (.7 of the way to the next)")] = None
    asymmetric: Annotated[bool | None, Option("switch", "each second row of circles is shifted by half a step")] = None

    def sized(self, line: Line) -> tuple[BoardSpec, str]:
        """See `Asked.sized`."""
        if self.marks is not None:
            return _marked(self, self.marks, line)
        if odd := next((name for name in MARKS_OPTIONS if getattr(self, name) is not None), None):
            raise InputError(f"{odd}: belongs to boards with --marks {' or '.join(MARKS_OF)}; leave it out")
        lattice: Lattice = self.lattice or "square"
        asked_size = self.size if self.size is not None or self._has_rings else _usual_size_mm(line)
        if asked_size is not None and self.ring_diameter is None and self.pitch is None:
            diameter, pitch = _auto_board_rings(self, min(asked_size), line)
        else:
            diameter, pitch = diameter_and_pitch(self)
        check_rings(diameter, self.ring_ratio or RING_RATIO, pitch, line)
        border = self.border or 0.0
        margin = self.margin if self.margin is not None else pitch / 2
        around = diameter + 2 * (border + margin)
        row_step = pitch * (1.0 if lattice == "square" else math.sqrt(3) / 2)
        if asked_size is None:
            columns, rows = self.columns or 0, self.rows or 0  # both are given
            size = (round_up((columns - 1) * pitch + around), round_up((rows - 1) * row_step + around))
        else:
            size = asked_size
            columns = self.columns or 1 + math.floor((size[0] - around) / pitch + 1e-9)
            rows = self.rows or 1 + math.floor((size[1] - around) / row_step + 1e-9)
        spec = BoardSpec(
            size_mm=size,
            thickness_mm=self.thickness or THICKNESS_MM,
            columns=columns,
            rows=rows,
            lattice=lattice,
            ring_diameter_mm=diameter,
            ring_ratio=self.ring_ratio or RING_RATIO,
            pitch_mm=pitch,
            border_mm=border,
            margin_mm=margin,
            dots=self.dots is not False,
            two_sided=self.two_sided or None,
        )
        _check_board(spec, line, ((columns - 1) * pitch + around, (rows - 1) * row_step + around))
        return spec, chosen_words(_chosen(self, spec))

    def size_name(self, spec: Spec) -> str:
        """Its size, or its rings and their distance, whichever was given."""
        if isinstance(spec, MarkedBoardSpec):
            counts, side = f"{spec.columns}x{spec.rows}", format_mm(spec.side_mm)
            return f"{spec.marks}-{counts}-{side}{'-two-sided' * bool(self.two_sided)}"
        named = f"{self.columns}x{self.rows}-{format_mm(spec.pitch_mm)}"
        if not self._has_rings or self.size is not None:
            named = str(spec.options()["size"])
        return f"{named}-two-sided" if self.two_sided else named

    @property
    def _has_rings(self) -> bool:
        """Whether the rings, not the size, say how large it is.

        Raises:
            InputError: rings without their distance, or the other way round.
        """
        if self.columns is None and self.rows is None:
            return False
        is_whole = None not in (self.columns, self.rows) and (self.pitch is not None or self.ring_diameter is not None)
        if self.size is None and not is_whole:
            raise InputError(
                "a board needs its size, or its rings and their distance; give --size 200x200mm, or --columns 10 "
                "--rows 7 --pitch 20mm"
            )
        return is_whole


def _marked(asked: AskedBoard, marks: str, line: Line) -> tuple[MarkedBoardSpec, str]:
    """A board with other detectors' marks, their sizes chosen for a process; see `Asked.sized`."""
    of_tags, of_circles, mine = marks == "aprilgrid", marks == "circles", MARKS_OF[marks]
    odd = [name for name in (*MARKS_OPTIONS, "columns", "rows", "lattice", "dots") if getattr(asked, name) is not None]
    if odd := [name for name in odd if name not in mine]:
        raise InputError(f"{odd[0]}: {marks} has none; leave it out, and use {', '.join(mine)}")
    counts, side = (getattr(asked, name) for name in mine[:2])
    if asked.gap is not None and side is None:
        raise InputError("gap: belongs to the tags' side; give --tag, too")
    spacing = asked.gap / side if asked.gap is not None and side is not None else TAG_SPACING * of_tags
    is_aslant = of_circles and (counts is None if asked.asymmetric is None else asked.asymmetric)
    wide = DIAMETER_OVER_PITCH * (math.sqrt(0.5) if is_aslant else 1.0)
    # In sides of a square or tag, or steps of circles: what one more takes, what all take besides, the white around.
    step, more = (1 + spacing, 1 + spacing), (spacing, spacing)  # with the small squares around tags
    if of_circles:
        step, more = (1.0, 0.5 if is_aslant else 1.0), (-0.5 if is_aslant else -1.0,) * 2
        more = more if asked.diameter is not None else (more[0] + wide, more[1] + wide)
    around = (spacing if of_tags else 0.25 if is_aslant else 0.5) if asked.margin is None else 0.0
    given_mm, size = (asked.margin or 0.0) + (asked.diameter or 0.0) / 2, asked.size
    if size is None and (counts is None or side is None):
        size = _usual_size_mm(line)
    if counts is None and side is not None and size is not None:
        room = [(one - 2 * given_mm) / side - 2 * around for one in size]
        columns, rows = (math.floor((room[k] - more[k]) / step[k] + 1e-9) for k in (0, 1))
        counts = columns, rows - (is_aslant and rows % 2 == 0)
    if counts is None:
        counts = MARKS_ACROSS[marks][size is not None and size[0] < size[1]]
    total = [counts[k] * step[k] + more[k] + 2 * around for k in (0, 1)]
    if side is None:
        side = min((one - 2 * given_mm) / sides for one, sides in zip(size or (0.0, 0.0), total, strict=True))
        side = math.floor(10 * side) / 10 if side > 1 else max(round_down(side), 0.01)
    needed = (total[0] * side + 2 * given_mm, total[1] * side + 2 * given_mm)
    spec = MarkedBoardSpec(
        size_mm=asked.size or (round_up(needed[0]), round_up(needed[1])), thickness_mm=asked.thickness or THICKNESS_MM,
        columns=counts[0], rows=counts[1], lattice="square",
        ring_diameter_mm=(asked.diameter or round_down(wide * side)) if of_circles else side, ring_ratio=RING_RATIO,
        pitch_mm=round((1 + spacing) * side, 9), border_mm=0.0,
        margin_mm=round(asked.margin if asked.margin is not None else around * side, 9), dots=False,
        two_sided=asked.two_sided or None, marks=marks, gap_mm=round(spacing * side, 9) if of_tags else None,
        marker_mm=(asked.marker or round_down(MARKER_SHARE * side)) if marks == "charuco" else None,
        dictionary=(asked.dictionary or _dictionary(marks, counts, asked)) if "dictionary" in mine else None,
        first_id=asked.first_id or 0 if "dictionary" in mine else None, asymmetric=is_aslant if of_circles else None,
    )  # fmt: skip
    for name in ("ring_diameter", "pitch", "ring_ratio", "border"):  # which resolved specs of all kinds name
        wanted, own = getattr(asked, name), getattr(spec, name if name == "ring_ratio" else f"{name}_mm")
        if wanted is not None and not math.isclose(wanted, own, abs_tol=1e-6):
            raise InputError(f"{name} {wanted:g}: of rings; {marks} has none: leave it out, and use {', '.join(mine)}")
    _check_marked(spec, line, needed)
    return spec, chosen_words(_chosen_marks(asked, spec))


def _chosen_marks(asked: AskedBoard, spec: MarkedBoardSpec) -> Iterator[str]:
    """What was not given, and why it is as it is."""
    counted, step = MARKS_OF[spec.marks][:2]
    if getattr(asked, counted) is None:
        yield f"{spec.columns} x {spec.rows} {counted}{', every second row shifted' * bool(spec.asymmetric)}"
    if getattr(asked, step) is None:
        yield f"{step} {spec.side_mm:g}mm (as large as fits)"
    if spec.asymmetric is not None and asked.diameter is None:
        yield f"diameter {spec.ring_diameter_mm:g}mm ({DIAMETER_OVER_PITCH:g} of the way to the next)"
    if spec.marker_mm is not None and asked.marker is None:
        yield f"marker {spec.marker_mm:g}mm ({MARKER_SHARE:g} of a square)"
    if spec.gap_mm is not None and asked.gap is None:
        yield f"gap {spec.gap_mm:g}mm ({TAG_SPACING:g} of a tag, as Kalibr's)"
    if spec.dictionary is not None and asked.dictionary is None:
        yield f"dictionary {spec.dictionary}"
    if (front := spec.face_marks).is_ambiguous:
        yield f"turned it looks the same; {front.remedy} does not"
    if asked.size is None:
        yield f"board {format_mm(*spec.size_mm)}"
    if asked.thickness is None:
        yield f"thickness {spec.thickness_mm:g}mm"


def _dictionary(marks: str, counts: tuple[int, int], asked: AskedBoard) -> str:
    """AprilTag's usual one for tags, else the smallest of 5 x 5 cells that holds the ids."""
    from designer.marks.dictionaries import MARKERS

    if marks == "aprilgrid":
        return "DICT_APRILTAG_36h11"
    needed = (asked.first_id or 0) + counts[0] * counts[1] // 2 * (2 if asked.two_sided else 1)
    return next((name for name in MARKERS if name.startswith("DICT_5X5") and MARKERS[name] >= needed), "DICT_5X5_1000")


def _check_marked(spec: MarkedBoardSpec, line: Line, needed_mm: tuple[float, float]) -> None:
    """The rules of marks, whoever chose the sizes."""
    what = f"marks {spec.marks}"
    try:
        front = spec.face_marks
        back = front.following if spec.two_sided else front
    except ValueError as error:
        raise InputError(f"{what}: {error}") from None
    if back is None:
        raise InputError(f"two_sided: nothing tells two sides of {spec.marks} apart; use charuco or aprilgrid")
    if any(need > have + 1e-6 for need, have in zip(needed_mm, spec.size_mm, strict=True)):
        raise InputError(
            f"{what}: {spec.columns} x {spec.rows} with their margin need {needed_mm[0]:.4g} x {needed_mm[1]:.4g}mm, "
            f"more than the board's {format_mm(*spec.size_mm)}; use fewer, smaller ones, or leave the size out"
        )
    if front.least_mm < line.nozzle_mm - 1e-9:
        least = spec.side_mm * line.comfortable_mm / front.least_mm
        coarser = " or a dictionary of fewer cells" if spec.dictionary is not None else ""
        raise InputError(
            f"{what}: the narrowest black or white, {front.least_mm:.3g}mm, is thinner than {line.process}; use a "
            f"{MARKS_OF[spec.marks][1]} of at least {least:.3g}mm{coarser}"
        )
    check_count(len(front.index) * (2 if spec.two_sided else 1), line)


def _usual_size_mm(line: Line) -> tuple[float, float]:
    """The size of a board of which nothing is said."""
    width, height = (10 * max(math.floor(min(pair) / 10), 1) for pair in zip(USUAL_SIZE_MM, line.plate_mm, strict=True))
    return width, height


def _chosen(asked: AskedBoard, spec: BoardSpec) -> Iterator[str]:
    """What was not given, and why it is as it is."""
    if asked.size is None:
        of_rings = asked.columns is not None
        is_usual = spec.size_mm == USUAL_SIZE_MM
        room = "about A4" if is_usual else "what the bed takes beside brim and prime tower"
        room += "; --size says otherwise"
        yield f"board {format_mm(*spec.size_mm)} ({'rings and margin' if of_rings else room})"
    pitch = spec.pitch_mm
    if asked.pitch is None and asked.ring_diameter is None:
        finest = pitch > round_down(min(spec.size_mm) / RINGS_ACROSS)
        why = "the least of two lines a stroke" if finest else f"1/{RINGS_ACROSS} of the shorter side, as in the paper"
        yield f"pitch {pitch:g}mm ({why})"
    yield from chosen_ring(asked, spec)
    if asked.columns is None or asked.rows is None:
        yield f"{spec.columns} x {spec.rows} rings (as many as fit)"
    if asked.margin is None:
        yield f"margin {spec.margin_mm:g}mm (half the pitch)"
    if asked.thickness is None:
        yield f"thickness {spec.thickness_mm:g}mm (as in the paper)"


def _auto_board_rings(asked: AskedBoard, shorter_mm: float, line: Line) -> tuple[float, float]:
    """Diameter and pitch in the paper's proportions, not finer than two lines a stroke."""
    ratio = asked.ring_ratio or RING_RATIO
    finest = line.comfortable_mm * max(2 / (1 - ratio), 1 / ratio) / DIAMETER_OVER_PITCH
    pitch = max(round_down(shorter_mm / RINGS_ACROSS), math.ceil(10 * finest) / 10)
    return round_down(DIAMETER_OVER_PITCH * pitch), pitch


def _check_board(spec: BoardSpec, line: Line, needed_mm: tuple[float, float]) -> None:
    """The rules of a board but those of its rings, whoever chose the sizes."""
    least = LEAST_ACROSS_TWO_SIDED if spec.two_sided else LEAST_ACROSS
    if spec.columns < least or spec.rows < least:
        raise InputError(
            f"a board of {format_mm(*spec.size_mm)} holds {max(spec.columns, 0)} x {max(spec.rows, 0)} rings at pitch "
            f"{spec.pitch_mm:g}mm; it must hold {least} x {least}: use a larger board or a smaller pitch"
        )
    if spec.two_sided and not spec.dots:
        raise InputError("two_sided without dots: nothing tells front from back; leave --no-dots out")
    if any(need > have + 1e-9 for need, have in zip(needed_mm, spec.size_mm, strict=True)):
        raise InputError(
            f"{spec.columns} x {spec.rows} rings with their margin need {needed_mm[0]:.4g} x {needed_mm[1]:.4g}mm, "
            f"more than the board's {format_mm(*spec.size_mm)}; use fewer rings, a smaller pitch or a smaller margin"
        )
    if 0 < spec.border_mm < line.nozzle_mm:
        raise InputError(
            f"border {spec.border_mm:g}mm is thinner than {line.process}; "
            f"use 0 for none or at least {line.width_mm:g}mm"
        )
    if spec.margin_mm + spec.border_mm <= 0:
        raise InputError("margin 0mm lets rings touch the board's edge; use a margin of at least one line")
    check_count(spec.columns * spec.rows * (2 if spec.two_sided else 1), line)


def lattice_steps(lattice: Lattice) -> "Array":
    """Steps of i and j on a board with pitch 1, as rows.  # (2, 2)"""
    import numpy as np

    return np.array([[1.0, 0.0], [0.0, 1.0] if lattice == "square" else [0.5, math.sqrt(3) / 2]])


def board_index(columns: int, rows: int, lattice: Lattice) -> "list[Index]":
    """Lattice indices of a board's features, row by row from below.

    Every second row of a triangular lattice is shifted by half a pitch and holds one ring less.
    """
    if lattice == "square":
        return [(i, j) for j in range(rows) for i in range(columns)]
    return [(i - j // 2, j) for j in range(rows) for i in range(columns - j % 2)]


def _origin_index(index: "list[Index]", position: "Array", dots: "frozenset[Index]") -> "Index":
    """The index that brings a mark nearest to the middle of the lattice."""
    import numpy as np

    from designer.kinds.layout import DECIMALS

    place = dict(zip(index, position, strict=True))
    middle = 0.5 * (position.min(axis=0) + position.max(axis=0))

    def distance(origin: "Index") -> float:
        marks = [place.get((origin[0] + i, origin[1] + j)) for i, j in dots]
        on_board = [mark for mark in marks if mark is not None]
        if len(on_board) < len(marks):
            return math.inf
        return round(float(np.linalg.norm(np.mean(on_board, axis=0) - middle)), DECIMALS)

    return min(index, key=distance)


KIND = Kind("a board with rings on one face or on both", AskedBoard, BoardSpec, MarkedBoardSpec)
