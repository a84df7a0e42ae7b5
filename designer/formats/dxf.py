"""DXF of release 12, which every cutter, laser and CAD program reads: true circles and closed polylines.

The file format is that of Autodesk's DXF reference for AC1009: pairs of lines, a group code and a value.
"""

from collections.abc import Iterator

from designer.make.cutting import CUT, ENGRAVE, LABEL, Cutting
from designer.make.pages import Circle, Polygon

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


def _text(value: str | float) -> str:
    return f"{value:.{DECIMALS}f}" if isinstance(value, float) else str(value)


def _header(cutting: Cutting) -> Iterator[Pair]:
    yield from ((0, "SECTION"), (2, "HEADER"), (9, "$ACADVER"), (1, "AC1009"))
    yield from ((9, "$EXTMIN"), (10, 0.0), (20, 0.0), (30, 0.0))
    yield from ((9, "$EXTMAX"), (10, cutting.width_mm), (20, cutting.height_mm), (30, 0.0), (0, "ENDSEC"))


def _layers() -> Iterator[Pair]:
    yield from ((0, "SECTION"), (2, "TABLES"), (0, "TABLE"), (2, "LTYPE"), (70, 1))
    yield from ((0, "LTYPE"), (2, "CONTINUOUS"), (70, 0), (3, "Solid line"), (72, 65), (73, 0), (40, 0.0), (0, "ENDTAB"))
    yield from ((0, "TABLE"), (2, "LAYER"), (70, len(COLOURS)))
    for name, colour in COLOURS.items():
        yield from ((0, "LAYER"), (2, name), (70, 0), (62, colour), (6, "CONTINUOUS"))
    yield from ((0, "ENDTAB"), (0, "ENDSEC"))


def _entities(cutting: Cutting) -> Iterator[Pair]:
    for area in cutting.engrave:
        for circle in area.circles:
            yield from _circle(circle)
        for outline in area.polygons:
            yield from _polyline(ENGRAVE, outline)
    for layer, outlines in cutting.lines:
        for outline in outlines:
            yield from _polyline(layer, outline)


def _circle(circle: Circle) -> Iterator[Pair]:
    x, y = circle.centre_mm
    yield from ((0, "CIRCLE"), (8, ENGRAVE), (10, float(x)), (20, float(y)), (30, 0.0), (40, float(circle.radius_mm)))


def _polyline(layer: str, outline: Polygon) -> Iterator[Pair]:
    """Closed; its own coordinates are zero, those of the vertices count."""
    yield from ((0, "POLYLINE"), (8, layer), (66, 1), (70, 1), (10, 0.0), (20, 0.0), (30, 0.0))
    for x, y in outline:
        yield from ((0, "VERTEX"), (8, layer), (10, float(x)), (20, float(y)), (30, 0.0))
    yield from ((0, "SEQEND"), (8, layer))
