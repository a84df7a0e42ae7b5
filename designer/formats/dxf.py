"""DXF of release 12, which every cutter, laser and CAD program reads: true circles and closed polylines.

The file format is that of Autodesk's DXF reference for AC1009: pairs of lines, a group code and a value.
"""

from collections.abc import Iterator

from designer.base.words import capital
from designer.make.pages import CUT, ENGRAVE, LABEL, Cutting, Polygon
from designer.target import TargetGeometry

COLOURS = {CUT: 1, ENGRAVE: 7, LABEL: 5}
"""Of the layers, in AutoCAD's table: red, black or white, blue."""
DECIMALS = 6  # a nanometre

Pair = tuple[int, str | int | float]


def dxf_bytes(cutting: Cutting, title: str) -> bytes:
    """A sheet as DXF R12 in millimetres; the same sheet gives the same bytes.

    Args:
        cutting: what is engraved and cut.
        title: a comment at the head.
    """
    pairs = [
        (999, "".join(letter if letter.isascii() and letter.isprintable() else "?" for letter in title)),
        (999, "units: millimetres"),
        *_header(cutting),
        *_layers(),
        (0, "SECTION"), (2, "ENTITIES"), *_entities(cutting), (0, "ENDSEC"), (0, "EOF"),
    ]  # fmt: skip
    return "".join(f"{code}\n{_text(value)}\n" for code, value in pairs).encode("ascii")


def steps(files: str, target: TargetGeometry, suffix: str) -> tuple[str, ...]:
    """What to do with the file.

    Args:
        files: their names, a sheet each.
        target: what is cut and engraved.
        suffix: of the format.
    """
    return (
        f"Open {files} in LightBurn, or in your cutter's or CAD program. DXF of release 12 says no unit: "
        "choose millimetres, scale 1.",
        *layer_steps(target, "Layer CUT, red", "layer ENGRAVE, black", "layer LABEL, blue"),
        *STOCK,
    )


def layer_steps(target: TargetGeometry, cut: str, engrave: str, label: str) -> Iterator[str]:
    """What belongs to which operation; the last three are what a file calls them."""
    yield f"{capital(engrave)}: fill, all shapes at once, so that what lies between two circles is a ring."
    yield f"{capital(cut)}: line, and last: cut pieces move."
    if target.is_plate and not target.is_planar:
        yield (
            "Both sides are drawn side by side. Engrave and cut side 0, turn it about its height in the opening it "
            "leaves, and engrave side 1 there; or glue two thin plates back to back."
        )
    if not target.is_planar:
        numbers = "numbers beside the pieces: the face's own, and along its edges those of the faces that it joins"
        yield f"{capital(label)}: {numbers}; mark them on the scrap."


STOCK = (
    "Stock that is light and turns dark where it is engraved, and matt: white laminate over a black core, or coated "
    "aluminium. The detector looks for dark rings on light ground.",
    "The beam is wider than a line: rings come out too wide by half of it on each side. Measure a ring, and design "
    "again with --ink-offset, below zero; centres stay where they are.",
    "Measure the distance of far rings along both axes of the machine, which are driven apart.",
)
"""The same for every laser."""


def _text(value: str | float) -> str:
    return f"{value:.{DECIMALS}f}" if isinstance(value, float) else str(value)


def _header(cutting: Cutting) -> Iterator[Pair]:
    yield from ((0, "SECTION"), (2, "HEADER"), (9, "$ACADVER"), (1, "AC1009"))
    yield from ((9, "$EXTMIN"), (10, 0.0), (20, 0.0), (30, 0.0))
    yield from ((9, "$EXTMAX"), (10, cutting.width_mm), (20, cutting.height_mm), (30, 0.0), (0, "ENDSEC"))


def _layers() -> Iterator[Pair]:
    yield from ((0, "SECTION"), (2, "TABLES"), (0, "TABLE"), (2, "LTYPE"), (70, 1))
    yield from ((0, "LTYPE"), (2, "CONTINUOUS"), (70, 0), (3, "Solid line"), (72, 65), (73, 0), (40, 0.0))
    yield from ((0, "ENDTAB"), (0, "TABLE"), (2, "LAYER"), (70, len(COLOURS)))
    for name, colour in COLOURS.items():
        yield from ((0, "LAYER"), (2, name), (70, 0), (62, colour), (6, "CONTINUOUS"))
    yield from ((0, "ENDTAB"), (0, "ENDSEC"))


def _entities(cutting: Cutting) -> Iterator[Pair]:
    for area in cutting.engrave:
        for circle in area.circles:
            x, y, radius = (float(value) for value in (*circle.centre_mm, circle.radius_mm))
            yield from ((0, "CIRCLE"), (8, ENGRAVE), (10, x), (20, y), (30, 0.0), (40, radius))
        for outline in area.polygons:
            yield from _polyline(ENGRAVE, outline)
    for layer, outlines in cutting.lines:
        for outline in outlines:
            yield from _polyline(layer, outline)


def _polyline(layer: str, outline: Polygon) -> Iterator[Pair]:
    """Closed; its own coordinates are zero, those of the vertices count."""
    yield from ((0, "POLYLINE"), (8, layer), (66, 1), (70, 1), (10, 0.0), (20, 0.0), (30, 0.0))
    for x, y in outline:
        yield from ((0, "VERTEX"), (8, layer), (10, float(x)), (20, float(y)), (30, 0.0))
    yield from ((0, "SEQEND"), (8, layer))
