"""Pages as one SVG file: user units are millimetres, the pages stand one below the other."""

import math
from collections.abc import Iterator
from html import escape

from designer.make.pages import CUT_COLOUR, LINE_MM, MARK_COLOUR, Area, Circle, Point, Polygon, SheetPage

PAGE_GAP_MM = 10.0


def svg_bytes(pages: tuple[SheetPage, ...]) -> bytes:
    """The pages as an SVG file; the same pages give the same bytes.

    Page k is the group `page-k`, with a layer each for ink, cut lines, marks and text, and a page of Inkscape's.
    """
    tops = [sum(page.height_mm + PAGE_GAP_MM for page in pages[:k]) for k in range(len(pages))]
    width_mm, height_mm = decimal(max(page.width_mm for page in pages)), decimal(tops[-1] + pages[-1].height_mm)
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<svg xmlns="http://www.w3.org/2000/svg" xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"',
        '     xmlns:sodipodi="http://sodipodi.sourceforge.net/DTD/sodipodi-0.dtd" version="1.1"',
        f'     width="{width_mm}mm" height="{height_mm}mm" viewBox="0 0 {width_mm} {height_mm}">',
        f"<title>{escape(pages[0].title, quote=False)}</title>",
        '<sodipodi:namedview inkscape:document-units="mm">',
        *(
            f'<inkscape:page x="0" y="{decimal(top)}" width="{decimal(page.width_mm)}" '
            f'height="{decimal(page.height_mm)}"/>'
            for page, top in zip(pages, tops, strict=True)
        ),
        "</sodipodi:namedview>",
    ]
    for number, (page, top) in enumerate(zip(pages, tops, strict=True), start=1):
        lines += _page_lines(page, number, top)
    lines.append("</svg>\n")
    return "\n".join(lines).encode()


def _page_lines(page: SheetPage, number: int, top: float) -> Iterator[str]:
    """The group of one page."""
    drawing = page.drawing
    stroke = f'fill="none" stroke-width="{LINE_MM}"'
    yield f'<g id="page-{number}" transform="translate(0 {decimal(top)})">'
    yield _layer(number, "ink", 'fill-rule="evenodd"')
    for area in drawing.areas:
        yield f'<path fill="{area.colour}" d="{area_path(area, page.height_mm)}"/>'
    yield "</g>"
    yield _layer(number, "cut", f'{stroke} stroke="{CUT_COLOUR}"')
    for cut in drawing.cuts:
        yield f'<path d="{polygon_path(cut, page.height_mm)}"/>'
    yield "</g>"
    yield _layer(number, "marks", f'{stroke} stroke="{MARK_COLOUR}"')
    for start, end in drawing.marks:
        yield f'<path d="M{_point(start, page.height_mm)}L{_point(end, page.height_mm)}"/>'
    yield "</g>"
    yield _layer(number, "text", f'fill="{MARK_COLOUR}" font-family="Helvetica, Arial, sans-serif"')
    for text in drawing.texts:
        anchor = ' text-anchor="middle"' if text.centred else ""
        turn = f" rotate({decimal(-math.degrees(text.angle_rad))})" if text.angle_rad else ""
        place = f"translate({_point(text.position_mm, page.height_mm)}){turn}"
        words = escape(text.text, quote=False)
        yield f'<text transform="{place}" font-size="{decimal(text.size_mm)}"{anchor}>{words}</text>'
    yield "</g>"
    yield "</g>"


def _layer(page_number: int, name: str, style: str) -> str:
    return f'<g id="page-{page_number}-{name}" inkscape:groupmode="layer" inkscape:label="{name}" {style}>'


def area_path(area: Area, height: float) -> str:
    """Circles and polygons as one path, of a page so high."""
    circles = (_circle_path(circle, height) for circle in area.circles)
    return "".join([*circles, *(polygon_path(polygon, height) for polygon in area.polygons)])


def _circle_path(circle: Circle, height: float) -> str:
    """Two half circles."""
    (x, y), radius = circle.centre_mm, decimal(circle.radius_mm)
    left, right = (_point((x + side, y), height) for side in (-circle.radius_mm, circle.radius_mm))
    arc = f"A{radius} {radius} 0 0 0 "
    return f"M{left}{arc}{right}{arc}{left}Z"


def polygon_path(polygon: Polygon, height: float) -> str:
    """A closed line as a path, of a page so high."""
    return "M" + "L".join(_point(point, height) for point in polygon) + "Z"


def _point(point: Point, height: float) -> str:
    """A point of the page, whose y points up, in SVG, whose y points down."""
    return f"{decimal(point[0])} {decimal(height - point[1])}"


def decimal(value: float) -> str:
    """Rounded to 10 nm, and no longer than needed."""
    text = f"{value:.5f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text
