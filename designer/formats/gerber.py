"""A board as a printed circuit: Gerber X2 layers, outline and drill file in one ZIP, as board houses take them.

The format follows Ucamco's Gerber Layer Format Specification: a ring is one flash of an aperture that is a circle with
a round hole, so its centre and both its circles are exact to the nanometre of the coordinates. The drill file is in
the format of Excellon. All layers are drawn as seen from the top, in millimetres, the board's lower left corner at 0.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from designer.formats.threemf import zipped
from designer.make.pattern import Contour, FacePattern, Pattern, Stamp, moved_in
from designer.spec.build import CircuitInk
from designer.target import TargetGeometry

COPPER_CLEARANCE_MM = 0.5
"""Of the copper from the board's edge, where it is routed: makers ask for 0.2 to 0.3 mm; an assumption with room."""
OUTLINE_MM = 0.1
_PER_MM = 10**6
_DRILL = "M48\n; no holes\nFMAT,2\nMETRIC,TZ\n%\nM30\n"
"""Nothing is drilled, but board houses ask for the file."""
_FIRST_APERTURE = 10

Polarity = str
DARK, CLEAR = "D", "C"


@dataclass(frozen=True)
class BoardSide:
    """What is printed on one side of the board, in the board's frame as seen from the top."""

    name: str  # "Top" or "Bot"
    outline: Contour
    face: FacePattern | None  # None: nothing
    board_from_face: Contour  # (3, 3) homogeneous, in the plane

    def placed(self, points: Contour) -> Contour:
        """Points of the face on the board.  # (N, 2)"""
        moved: Contour = points @ self.board_from_face[:2, :2].T + self.board_from_face[:2, 2]
        return moved


def gerber_zip(target: TargetGeometry, pattern: Pattern, ink: CircuitInk, name: str) -> bytes:
    """The order for a board house; the same board gives the same bytes.

    Args:
        target: a board, the nominal geometry.
        pattern: its ink, of scale 1.
        ink: what makes the black: the legend (silkscreen), or the solder mask that stays.
        name: of the files in the ZIP.
    """
    top, bottom = sides_of(target, pattern)
    layers = {"Edge_Cuts.gm1": _profile(top.outline, target), "NPTH.drl": _DRILL.encode("ascii")}
    for side, front, suffix, number in ((top, "F", "t", "L1"), (bottom, "B", "b", "L2")):
        layers[f"{front}_Cu.g{suffix}l"] = _copper(side, number, target, poured=ink == "legend")
        layers[f"{front}_Mask.g{suffix}s"] = _mask(side, pattern.stamps, target, has_ink=ink == "mask")
        if ink == "legend" and side.face is not None:
            layers[f"{front}_Silkscreen.g{suffix}o"] = _legend(side, pattern.stamps, target)
    return zipped({f"{name}-{layer}": content for layer, content in sorted(layers.items())})


def steps(files: str, target: TargetGeometry, suffix: str) -> tuple[str, ...]:
    """What to order, and what to look at when it comes.

    Args:
        files: their names.
        target: the board.
        suffix: of the format: `gerber` or `gerber-mask`.
    """
    diagonal_mm = float(np.linalg.norm(np.ptp(target.outline_mm[0], axis=0)))
    order, edges = _ink_words(has_mask=suffix == "gerber-mask")
    return (
        f"Upload {files} as it is: two layers, outline and an empty drill file. One piece, no panel, routed edges, "
        f"{_thickness_words(target)}.",
        order,
        "Tell the maker: print at 100 %, do not move or clip the pattern, no order number on a side with rings.",
        edges,
        f"Bow and twist may reach 0.75 % of the diagonal and still pass (JHDPCB): {0.0075 * diagonal_mm:.2g} mm "
        "here. Lay a ruler across it; glue a board that is bent on a flat plate.",
        "Measure the distance of far rings along both directions: laminate shrinks as it is made, along and across its "
        "fibres by different amounts. The outline is no measure, it is routed to 0.2 mm (Angus).",
    )


def _thickness_words(target: TargetGeometry) -> str:
    """Of a board with two sides it is part of the geometry."""
    if target.is_planar:
        return "1.6 mm or thicker"
    apart_mm = float(np.ptp(target.target_from_face[:, 2, 3]))
    return f"{apart_mm:g} mm thick: so far apart has the target file the two sides (--thickness; measure what comes)"


def _ink_words(*, has_mask: bool) -> tuple[str, str]:
    """What to order for the ink, and what its edges will be like."""
    if has_mask:
        return (
            "Solder mask black, and matt: gloss mirrors lamps. No silkscreen, no copper. The mask stays where ink is; "
            "what is white in the design is bare laminate, pale yellow.",
            "The mask's edges are exposed by light and sharper than silkscreen, but it has a thickness: looked at from "
            "the side, an edge casts a shadow. The laminate lets light through; put white paper behind it.",
        )
    return (
        "Solder mask white, matt if there is a choice; silkscreen black. The silkscreen is the ink; the copper under "
        "the mask, alike on both sides, keeps the board flat and its white opaque.",
        "Black is printed on white, so the mask does nothing to the edges: they are as sharp as the maker's legend "
        "printer, which holds lines of 0.15 mm (PCBWay, Angus).",
    )


def sides_of(target: TargetGeometry, pattern: Pattern) -> tuple[BoardSide, BoardSide]:
    """Top and bottom: faces whose normal points up, and down."""
    frame = target.target_from_face
    outline = pattern.faces[0].outline @ frame[0, :2, :2].T + frame[0, :2, 3]
    low = outline.min(axis=0)
    sides = {
        "Top": BoardSide("Top", outline - low, None, np.eye(3)),
        "Bot": BoardSide("Bot", outline - low, None, np.eye(3)),
    }
    for face, place in zip(pattern.faces, frame, strict=True):
        flat = np.eye(3)
        flat[:2, :2], flat[:2, 2] = place[:2, :2], place[:2, 3] - low
        name = "Top" if place[2, 2] > 0 else "Bot"
        sides[name] = BoardSide(name, outline - low, face, flat)
    return sides["Top"], sides["Bot"]


def _legend(side: BoardSide, stamps: Sequence[Stamp], target: TargetGeometry) -> bytes:
    """The ink, printed on the solder mask."""
    return _layer(f"Legend,{side.name}", "Positive", target, stamps, _ink(side, stamps, DARK))


def _mask(side: BoardSide, stamps: Sequence[Stamp], target: TargetGeometry, *, has_ink: bool) -> bytes:
    """The openings of the solder mask: none, or all that is white, so that the mask that stays is the ink."""
    drawn: list[str] = []
    if has_ink and side.face is not None:
        drawn = [_polarity(DARK), *_region(side.outline), *_ink(side, stamps, CLEAR)]
    return _layer(f"Soldermask,{side.name}", "Negative", target, stamps, drawn)


def _copper(side: BoardSide, number: str, target: TargetGeometry, *, poured: bool) -> bytes:
    """Copper all over, alike on both sides so that the board bows little and its white is opaque; or none."""
    drawn = [_polarity(DARK), *_region(moved_in(side.outline, COPPER_CLEARANCE_MM))] if poured else []
    return _layer(f"Copper,{number},{side.name}", "Positive", target, (), drawn)


def _profile(outline: Contour, target: TargetGeometry) -> bytes:
    """The edge that is routed."""
    points = [*outline, outline[0]]
    drawn = [f"D{_FIRST_APERTURE}*", f"{_at(points[0])}D02*", *(f"{_at(point)}D01*" for point in points[1:])]
    pen = Stamp(OUTLINE_MM / 2, 0.0, outline, None)
    return _layer("Profile,NP", "Positive", target, (pen,), drawn)


def _layer(
    function: str, polarity: str, target: TargetGeometry, stamps: Sequence[Stamp], drawn: Iterable[str]
) -> bytes:
    """A file: attributes, format, apertures and what is drawn."""
    about = (
        "GenerationSoftware,ringsolid,ringsolid", f"SameCoordinates,{target.geometry_id}", "Part,Single",
        f"FileFunction,{function}", f"FilePolarity,{polarity}",
    )  # fmt: skip
    head = (*(f"%TF.{text}*%" for text in about), "%FSLAX46Y46*%", "%MOMM*%", "G01*")
    apertures = (f"%ADD{_FIRST_APERTURE + row}C,{_aperture(stamp)}*%" for row, stamp in enumerate(stamps))
    return "\n".join([*head, *apertures, *drawn, "M02*\n"]).encode("ascii")


def _aperture(stamp: Stamp) -> str:
    hole = f"X{2 * stamp.inner_radius_mm:.6f}" if stamp.inner_radius_mm > 0 else ""
    return f"{2 * stamp.outer_radius_mm:.6f}{hole}"


def _ink(side: BoardSide, stamps: Sequence[Stamp], ink: Polarity) -> Iterator[str]:
    """Border, rings and letters of a side, in the polarity of ink."""
    face, white = side.face, CLEAR if ink == DARK else DARK
    if face is None:
        return
    if face.window is not None:
        yield from (_polarity(ink), *_region(side.outline), _polarity(white), *_region(side.placed(face.window)))
        for contour in face.light_text:
            yield from _region(side.placed(contour))
    yield _polarity(ink)
    for contour in face.dark_text:
        yield from _region(side.placed(contour))
    places = side.placed(face.position_mm)
    for row in range(len(stamps)):
        mine = places[face.stamp == row]
        if len(mine):
            yield f"D{_FIRST_APERTURE + row}*"
            yield from (f"{_at(place)}D03*" for place in mine)


def _region(contour: Contour) -> Iterator[str]:
    """A filled polygon."""
    yield from ("G36*", f"{_at(contour[0])}D02*")
    yield from (f"{_at(point)}D01*" for point in (*contour[1:], contour[0]))
    yield "G37*"


def _polarity(which: Polarity) -> str:
    return f"%LP{which}*%"


def _at(point: Contour) -> str:
    """A place, in nanometres."""
    x, y = np.rint(np.asarray(point) * _PER_MM).astype(np.int64).tolist()
    return f"X{x}Y{y}"
