"""Pages as PDF: vector shapes at exact size."""

import io
import math

from reportlab.lib.colors import Color
from reportlab.pdfgen.canvas import Canvas
from reportlab.pdfgen.pathobject import PDFPathObject

from designer.make.pages import CUT_COLOUR, LINE_MM, MARK_COLOUR, Area, Polygon, SheetPage, Text

POINTS_PER_MM = 72 / 25.4
FONT = "Helvetica"
EVEN_ODD = 0  # FILL_EVEN_ODD of reportlab.pdfgen.canvas, which its type stubs lack


def pdf_bytes(pages: tuple[SheetPage, ...]) -> bytes:
    """The pages as a PDF file; the same pages give the same bytes.

    Circles become four Bezier curves each, which stray from the circle by 0.03 % of the radius; the centre is
    exact. Viewers are asked to print without scaling.
    """
    buffer = io.BytesIO()
    canvas = true_size(buffer, pages[0].title)
    for page in pages:
        canvas.setPageSize((page.width_mm * POINTS_PER_MM, page.height_mm * POINTS_PER_MM))
        _draw(canvas, page)
        canvas.showPage()
    canvas.save()
    return buffer.getvalue()


def true_size(buffer: io.BytesIO, title: str) -> Canvas:
    """A document that viewers print without scaling."""
    canvas = Canvas(buffer, invariant=True, pdfVersion=(1, 6))
    canvas.setTitle(encodable(title))
    canvas.setCreator("ringsolid")
    canvas.setViewerPreference("PrintScaling", "None")
    return canvas


def _draw(canvas: Canvas, page: SheetPage) -> None:
    """Draw a page in millimetres."""
    canvas.scale(POINTS_PER_MM, POINTS_PER_MM)
    for area in page.drawing.areas:
        fill_area(canvas, area, area.colour)
    canvas.setLineWidth(LINE_MM)
    canvas.setStrokeColor(CUT_COLOUR)
    for cut in page.drawing.cuts:
        canvas.drawPath(line_of(canvas.beginPath(), cut))
    canvas.setStrokeColor(MARK_COLOUR)
    for start, end in page.drawing.marks:
        canvas.line(*start, *end)
    canvas.setFillColor(MARK_COLOUR)
    for text in page.drawing.texts:
        _write(canvas, text)


def line_of(path: PDFPathObject, polygon: Polygon) -> PDFPathObject:
    """A path with one closed line more."""
    path.moveTo(*polygon[0])
    for point in polygon[1:]:
        path.lineTo(*point)
    path.close()
    return path


def fill_area(canvas: Canvas, area: Area, colour: str | Color) -> None:
    """Fill one area under the even-odd rule."""
    path = canvas.beginPath()
    for circle in area.circles:
        path.circle(*circle.centre_mm, circle.radius_mm)
    for polygon in area.polygons:
        line_of(path, polygon)
    canvas.setFillColor(colour)
    canvas.drawPath(path, stroke=0, fill=1, fillMode=EVEN_ODD)


def _write(canvas: Canvas, text: Text) -> None:
    canvas.saveState()
    canvas.translate(*text.position_mm)
    canvas.rotate(math.degrees(text.angle_rad))
    canvas.setFont(FONT, text.size_mm)
    draw = canvas.drawCentredString if text.centred else canvas.drawString
    draw(0, 0, encodable(text.text))
    canvas.restoreState()


def encodable(text: str) -> str:
    """The text with a question mark for each letter that the standard fonts lack."""
    return text.encode("cp1252", "replace").decode("cp1252")
