"""Sticker sheets and board artwork: places, labels, and exact size in PDF and SVG."""

import math
import os
import re
import shutil
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image
from scipy import ndimage
from shapely import Point as ShapelyPoint
from shapely import Polygon as ShapelyPolygon
from shapely import STRtree, affinity, box
from shapely.geometry import LineString
from shapely.geometry.base import BaseGeometry

from designer.base.errors import InputError
from designer.base.units import MARGIN_MM, SCALE_BAR_MM, page_size_mm
from designer.formats.pdf import pdf_bytes
from designer.formats.svg import svg_bytes
from designer.kinds.board import BoardSpec
from designer.kinds.cube import CubeSpec
from designer.kinds.ico import IcoSpec, icosahedron
from designer.kinds.layout import lay_out
from designer.make.pages import SheetPage, Text
from designer.make.pattern import make_pattern
from designer.make.sheets import BLEED_MM, lay_out_sheets
from designer.spec.spec import PrinterProfile, PrintSpec, Spec
from designer.target import TargetGeometry
from tests.support.programs import run

PRINTER = PrinterProfile("any", (256.0, 256.0, 256.0), 0.4, 0.45, 0.2)
SVG = "{http://www.w3.org/2000/svg}"
INKSCAPE = "{http://www.inkscape.org/namespaces/inkscape}"
HOSTILE = "<b>&\"'\x00\x1b]0; é 靶 " + "W" * 300


def printing(*, offset: float = 0.0, thickness: float = 0.1, labels: bool = True) -> PrintSpec:
    return PrintSpec("stickers", PRINTER, 0.0, offset, 0.0, thickness, "#ffffff", "#112233", labels, False, 0.005)


def ico(edge: float) -> IcoSpec:
    return IcoSpec(edge, 8, 0.07 * edge, 0.45, 0.1 * edge, 0.02 * edge, 0.03 * edge)


def board(width: float, height: float, border: float = 0.0) -> BoardSpec:
    columns, rows = (int((size - 2 * border - 2) // 10) for size in (width, height))
    return BoardSpec((width, height), 3.0, columns, rows, "square", 7.0, 0.45, 10.0, border, 1.0, True)


MASTER = IcoSpec(133.0, 8, 10.5, 0.45, 13.2, 2.66, 3.0)
CUBE = CubeSpec(60.0, 6, 6.0, 0.45, 9.0, 1.6, 2.0)
ALU = BoardSpec((400.0, 400.0), 3.0, 39, 39, "square", 8.0, 0.45, 10.0, 0.0, 5.0, True)


def sheets(
    spec: Spec, page: str = "A4", name: str = "target", prints: PrintSpec | None = None
) -> tuple[TargetGeometry, tuple[SheetPage, ...]]:
    prints = prints or printing()
    target = lay_out(spec)
    return target, lay_out_sheets(target, make_pattern(target, prints), prints, page, name)


def text_box(text: Text) -> ShapelyPolygon:
    """The room a text takes, from its descenders to its capitals."""
    x, y = text.position_mm
    left = x - text.width_mm / 2 if text.centred else x
    flat = box(left, y - 0.22 * text.size_mm, left + text.width_mm, y + 0.73 * text.size_mm)
    return affinity.rotate(flat, text.angle_rad, origin=(x, y), use_radians=True)


def everything_drawn(page: SheetPage) -> list[BaseGeometry]:
    """Each thing on the page that must stay clear of all others: pieces with their ink, marks, texts."""
    drawing = page.drawing
    pieces = [ShapelyPolygon(cut) for cut in drawing.cuts]
    outside = [text_box(text) for text in drawing.texts]
    for area in drawing.areas:
        shapes = [ShapelyPolygon(polygon) for polygon in area.polygons]
        shapes += [ShapelyPoint(circle.centre_mm).buffer(circle.radius_mm) for circle in area.circles]
        home = [k for k, piece in enumerate(pieces) if piece.intersects(shapes[0])]
        assert len(home) <= 1
        for shape in shapes:
            if home:
                pieces[home[0]] = pieces[home[0]].union(shape)
            else:
                outside.append(shape)
    # The bar and its ticks touch; a mark is tested as thick as it is drawn.
    bar = [mark for mark in drawing.marks if mark[0][1] == MARGIN_MM]
    outside.append(LineString([(MARGIN_MM, MARGIN_MM), (MARGIN_MM + SCALE_BAR_MM, MARGIN_MM + 2.5)]).envelope)
    outside += [LineString(mark).buffer(0.05) for mark in drawing.marks if mark not in bar]
    return pieces + outside


def assert_clear_and_printable(page: SheetPage) -> None:
    things = everything_drawn(page)
    printable = box(MARGIN_MM, MARGIN_MM, page.width_mm - MARGIN_MM, page.height_mm - MARGIN_MM).buffer(0.051)
    assert all(printable.covers(thing) for thing in things)
    first, second = STRtree(things).query(things, predicate="intersects")
    met = [(int(a), int(b)) for a, b in zip(first, second, strict=True) if a < b]
    assert not met


@settings(max_examples=25, deadline=None)
@given(
    edge=st.floats(10.0, 160.0),
    page=st.sampled_from(["A4", "A3", "Letter", "fit", "200x900mm"]),
    thickness=st.floats(0.0, 0.3),
)
def test_stickers_are_clear_of_each_other_and_printable(edge: float, page: str, thickness: float) -> None:
    """On every page, no sticker, label, mark or line of the foot meets another, and all lie in the printable area."""
    spec = ico(edge)
    target = lay_out(spec)
    prints = printing(thickness=thickness, labels=False)
    try:
        pages = lay_out_sheets(target, make_pattern(target, prints), prints, page, "x" * 60)
    except InputError:
        assert page != "fit"
        assert edge > 140
        return
    assert sum(len(p.drawing.cuts) for p in pages) == 20
    for p in {len(p.drawing.cuts): p for p in pages}.values():
        assert_clear_and_printable(p)


@settings(max_examples=25, deadline=None)
@given(width=st.floats(45.0, 300.0), height=st.floats(45.0, 300.0), border=st.sampled_from([0.0, 4.0]))
def test_board_is_clear_of_the_foot_and_printable(width: float, height: float, border: float) -> None:
    """A page that fits holds the board, clear of the foot, and is no larger than board, marks, foot and margins."""
    _, (page,) = sheets(board(width, height, border), "fit", HOSTILE)
    assert_clear_and_printable(page)
    assert page.width_mm <= max(width + 30, 120)
    assert page.height_mm <= height + 60


@pytest.mark.parametrize("edge", [20.0, 100.0])
def test_labels_name_the_face_across_the_edge(edge: float) -> None:
    """The label along a sticker's edge names the face that shares this edge in space, found from the frames alone.

    Each of twenty stickers has its face's number, once on all pages together.
    """
    target, pages = sheets(ico(edge))
    frame = target.target_from_face
    corners = np.einsum("fij,fkj->fki", frame[:, :3, :2], target.outline_mm) + frame[:, None, :3, 3]
    numbers, checked = [], 0
    for page in pages:
        for cut in page.drawing.cuts:
            beside = [text for text in page.drawing.texts if is_beside(text, cut)]
            (face,) = (int(text.text.split()[1]) for text in beside if text.text.startswith("FACE"))
            numbers.append(face)
            for text in (text for text in beside if text.text.startswith("joins")):
                k = int(np.argmin([side(cut, k).distance(text_box(text)) for k in range(3)]))
                shared = corners[face][[k, (k + 1) % 3]]
                neighbour = int(text.text.split()[1])
                gap = np.linalg.norm(shared[:, None] - corners[neighbour][None], axis=2).min(axis=1)
                assert neighbour != face
                assert gap.max() < 1e-6
                checked += 1
    assert checked == 60
    assert sorted(numbers) == list(range(20))


def side(cut: tuple[tuple[float, float], ...], k: int) -> LineString:
    return LineString([cut[k], cut[(k + 1) % 3]])


def is_beside(text: Text, cut: tuple[tuple[float, float], ...]) -> bool:
    return min(side(cut, k).distance(text_box(text)) for k in range(3)) < 1.5


def test_each_sticker_carries_its_faces_code() -> None:
    """Seen from the code corner, the dots of the sticker labelled FACE k are those of face k, not mirrored."""
    target, pages = sheets(ico(60.0))
    for page in pages:
        for cut, shift, turn in placements(page):
            (face,) = (
                int(t.text.split()[1]) for t in page.drawing.texts if t.text.startswith("FACE") and is_beside(t, cut)
            )
            piece = ShapelyPolygon(cut)
            features = [a.circles for a in page.drawing.areas if a.circles]
            dots = {circle[0].centre_mm for circle in features if len(circle) == 1}
            drawn = np.array([dot for dot in dots if piece.contains(ShapelyPoint(dot))])
            mine = target.is_dot & (target.ring_face == face)
            expected = target.center_in_face_mm[mine, :2] @ turn.T + shift
            assert np.abs(sorted_rows(drawn) - sorted_rows(expected)).max() < 1e-6


def placements(page: SheetPage) -> list[tuple[tuple[tuple[float, float], ...], np.ndarray, np.ndarray]]:
    """Each cut with the motion from its face frame to the page: one side is lowest, the first corner at the left."""
    found = []
    for cut in page.drawing.cuts:
        centre = np.mean(cut, axis=0)
        x, y = np.array(cut[0]) - centre
        turn = math.atan2(y, x) - math.pi * (1 / 2 if len(cut) == 3 else 3 / 4)
        cos, sin = math.cos(turn), math.sin(turn)
        found.append((cut, centre, np.array([[cos, -sin], [sin, cos]])))
    return found


def sorted_rows(points: np.ndarray) -> np.ndarray:
    rounded = np.round(points, 3)
    return points[np.lexsort((rounded[:, 1], rounded[:, 0]))]


@pytest.mark.parametrize("thickness", [0.0, 0.1, 1.0])
def test_cut_is_the_facet_of_the_smaller_body(thickness: float) -> None:
    """The cut triangle's edge is that of the icosahedron whose faces lie one sticker's thickness deeper."""
    _, pages = sheets(MASTER, prints=printing(thickness=thickness))
    smaller = (icosahedron().inradius * 133.0 - thickness) / icosahedron().inradius
    vertices = smaller * icosahedron().vertices
    distances = np.linalg.norm(vertices[:, None] - vertices[None], axis=2)
    edge = distances[distances > 1].min()
    for page in pages:
        for cut in page.drawing.cuts:
            assert [side(cut, k).length for k in range(3)] == pytest.approx([edge] * 3, abs=1e-6)


def test_border_bleeds_beyond_the_cut() -> None:
    """The border's ink goes on beyond the nominal outline by the bleed, and its hole is the window."""
    target, (page, *_) = sheets(ico(100.0), prints=printing(labels=False))
    borders = [a for a in page.drawing.areas if len(a.polygons) == 2]
    assert len(borders) == len(page.drawing.cuts)
    nominal, window = (ShapelyPolygon(polygon[0]) for polygon in (target.outline_mm, target.window_mm))
    for border in borders:
        outer, hole = (ShapelyPolygon(polygon) for polygon in border.polygons)
        assert outer.area == pytest.approx(nominal.buffer(BLEED_MM, join_style="mitre").area)
        assert hole.area == pytest.approx(window.area)
        assert outer.contains(hole)


def test_ink_offset_grows_the_rings_only_in_the_artwork() -> None:
    """Rings are drawn with the ink offset on both radii, and the page says so."""
    _, (page,) = sheets(board(60, 60), prints=printing(offset=0.05))
    rings = [area.circles for area in page.drawing.areas if len(area.circles) == 2]
    assert {tuple(round(c.radius_mm, 6) for c in ring) for ring in rings} == {(3.55, 1.525)}
    assert any("ink offset +0.05 mm" in text.text for text in page.drawing.texts)
    assert not any("ink offset" in text.text for text in sheets(board(60, 60))[1][0].drawing.texts)


def test_landscape_only_where_it_holds_more() -> None:
    """A page is turned only if more stickers then fit on it."""
    _, upright = sheets(ico(20.0))
    _, turned = sheets(MASTER, "A3")
    assert (upright[0].width_mm, upright[0].height_mm) == (210.0, 297.0)
    assert (turned[0].width_mm, turned[0].height_mm) == (420.0, 297.0)
    assert [len(page.drawing.cuts) for page in turned] == [8, 8, 4]


@pytest.mark.parametrize(
    ("text", "size"),
    [
        ("A4", (210.0, 297.0)),
        ("a3", (297.0, 420.0)),
        ("letter", (215.9, 279.4)),
        ("400x600mm", (400.0, 600.0)),
        ("120.5x80", (120.5, 80.0)),
        ("40x60cm", (400.0, 600.0)),
        ("fit", None),
    ],
)
def test_page_sizes(text: str, size: tuple[float, float] | None) -> None:
    """A page is a known name or a width and height, as any other size is written."""
    assert page_size_mm(text) == size


@pytest.mark.parametrize(
    "text",
    [
        *("", "A5", "400", "400x", "x600mm", "400x600x800mm", "400x600mm\n<>"),
        *("nanx600mm", "400xinfmm", "1e999x400mm", "-400x600mm", "0x0mm", "100x100mm", "400x50mm", "5001x400mm"),
    ],
)
def test_bad_page_sizes(text: str) -> None:
    """Any other page size is refused in one line that says what to use."""
    with pytest.raises(InputError, match=r"^[^\n]*; use [^\n]*$"):
        page_size_mm(text)


def test_too_small_a_page_is_refused_with_one_that_does() -> None:
    """A piece that does not fit on the page is refused, and the page size named as the remedy works."""
    for spec in (ico(200.0), board(300.0, 220.0, 4.0)):
        with pytest.raises(InputError, match=r"printable area of 190\.0 x 2") as caught:
            sheets(spec)
        remedy = re.search(r"at least (\d+x\d+mm)", str(caught.value))
        assert remedy
        assert sheets(spec, remedy[1])[1]


def test_sticker_thicker_than_the_border_allows() -> None:
    """A sticker so thick that the cut leaves the border is refused."""
    with pytest.raises(InputError, match="use stickers thinner than"):
        sheets(ico(20.0), prints=printing(thickness=1.2, labels=False))


def test_fit_that_no_pdf_can_hold() -> None:
    """A board larger than PDF's largest page is refused."""
    with pytest.raises(InputError, match="at most 5000mm"):
        sheets(board(4990.0, 40.0), "fit")


# Read back from SVG


def svg_point(text: str) -> np.ndarray:
    return np.array([float(number) for number in text.split()])


@pytest.mark.parametrize("spec", [MASTER, CUBE, board(100.0, 80.0, 4.0)])
def test_svg_holds_true_circles_at_the_features(spec: Spec) -> None:
    """Each feature is one path of full circles (ring: two, dot: one) with its radii, and the pitch holds in mm."""
    target, pages = sheets(spec, "fit")
    root = ElementTree.fromstring(svg_bytes(pages))
    assert root.get("width") == f"{root.get('viewBox').split()[2]}mm"
    assert root.get("height") == f"{root.get('viewBox').split()[3]}mm"
    arcs = re.compile(r"M([^AMZL]+)A(\S+) (\S+) 0 0 0 ([^AMZL]+)A\2 \3 0 0 0 \1Z")
    centres, radii = [], []
    for path in root.iter(f"{SVG}path"):
        found = arcs.findall(path.get("d"))
        if found:
            middle = [(svg_point(left) + svg_point(right)) / 2 for left, _, _, right in found]
            assert np.ptp(middle, axis=0).max() < 1e-5
            assert all(
                np.ptp([svg_point(m[0])[0], svg_point(m[3])[0]]) == pytest.approx(2 * float(m[1])) for m in found
            )
            centres.append(middle[0] * [1, -1] + [0, pages[0].height_mm])
            radii.append(tuple(sorted(float(match[1]) for match in found)))
    assert len(centres) == target.ring_count
    expected = [(r,) if dot else (i, r) for i, r, dot in zip(*radii_of(target), strict=True)]
    assert sum(sorted(radii), ()) == pytest.approx(sum(sorted(expected), ()), abs=1e-5)
    assert nearest_distance_mm(expected_places(target, pages[0]), np.array(centres)).max() < 2e-5


def radii_of(target: TargetGeometry) -> tuple[list[float], list[float], list[bool]]:
    return target.radius_inner_mm.tolist(), target.radius_outer_mm.tolist(), target.is_dot.tolist()


def expected_places(target: TargetGeometry, page: SheetPage) -> np.ndarray:
    """Where the target's features belong on a page that begins with face 0, given its cut lines.  # (N, 2)"""
    if target.face_count == 1:
        return target.center_in_face_mm[:, :2] + np.mean(page.drawing.cuts[0], axis=0)
    places = []
    for face, (_, shift, turn) in enumerate(placements(page)):
        places.append(target.center_in_face_mm[target.ring_face == face, :2] @ turn.T + shift)
    return np.concatenate(places)


def test_svg_pages_stand_below_each_other() -> None:
    """Page k is the group page-k, inside the drawing, and a page of Inkscape's at the same place."""
    _, pages = sheets(ico(100.0))
    root = ElementTree.fromstring(svg_bytes(pages))
    groups = root.findall(f"{SVG}g")
    assert [group.get("id") for group in groups] == [f"page-{k + 1}" for k in range(5)]
    tops = [float(re.fullmatch(r"translate\(0 (\S+)\)", group.get("transform"))[1]) for group in groups]
    assert tops == [pytest.approx(k * 307.0) for k in range(5)]
    inkscape = [
        [float(page.get(key)) for key in ("x", "y", "width", "height")] for page in root.iter(f"{INKSCAPE}page")
    ]
    assert inkscape == [pytest.approx([0.0, top, 210.0, 297.0]) for top in tops]
    assert float(root.get("viewBox").split()[3]) == pytest.approx(4 * 307.0 + 297.0)


def test_hostile_names_are_escaped() -> None:
    """A name with markup, control characters or great length leaves both files readable and the page clear."""
    _, pages = sheets(board(60.0, 60.0), name=HOSTILE)
    root = ElementTree.fromstring(svg_bytes(pages))
    assert root.find(f"{SVG}title").text.startswith("<b>&\"'??]0; é 靶 W")
    assert len(root.find(f"{SVG}title").text) == 60
    assert pdf_bytes(pages).startswith(b"%PDF")
    assert_clear_and_printable(pages[0])


# Read back from PDF by poppler

DPI = 600
MM_PER_PX = 25.4 / DPI


def rasterise(pdf: bytes, folder: Path) -> np.ndarray:
    """The first page's darkness from 0 to 1, row 0 at its lower edge; see DPI."""
    if shutil.which("pdftoppm") is None:
        if os.environ.get("CI"):
            pytest.fail("pdftoppm is missing: install poppler-utils")
        pytest.skip("pdftoppm is missing: install poppler-utils")
    (folder / "in.pdf").write_bytes(pdf)
    run("pdftoppm", "-r", DPI, "-gray", "-f", "1", "-l", "1", "-singlefile", "in.pdf", "out", cwd=folder)
    return 1 - np.asarray(Image.open(folder / "out.pgm"), dtype=np.float32)[::-1] / 255


def measured_features(dark: np.ndarray, height_mm: float, radius_mm: float) -> np.ndarray:
    """Centroids of the round blots of this radius, in page mm.  # (N, 2)"""
    label, count = ndimage.label(dark > 0.02)
    boxes = ndimage.find_objects(label)
    size = 2 * radius_mm / MM_PER_PX
    wanted = [k for k in range(count) if all(abs(s.stop - s.start - size) < 3 for s in boxes[k])]
    corner = np.array([[s.start for s in boxes[k]] for k in wanted])
    centroid = corner + [ndimage.center_of_mass(np.where(label[boxes[k]] == k + 1, dark[boxes[k]], 0)) for k in wanted]
    # Pixel k covers k..k+1; a page that is no whole number of pixels ends within the top row of the picture.
    up = height_mm - (len(dark) - 0.5 - centroid[:, 0]) * MM_PER_PX
    return np.stack([(centroid[:, 1] + 0.5) * MM_PER_PX, up], axis=1)


def nearest_distance_mm(from_points: np.ndarray, to_points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(from_points[:, None] - to_points[None], axis=2).min(axis=1)


@pytest.mark.parametrize(("spec", "page"), [(ico(20.0), "fit"), (ico(100.0), "A4"), (board(60, 60, 2.0), "fit")])
def test_pdf_features_lie_where_the_target_says(spec: Spec, page: str, tmp_path: Path) -> None:
    """Rasterised by another program, every feature's centre is within 0.02 mm of its place; nothing is scaled."""
    target, pages = sheets(spec, page, prints=replace(printing(labels=False), ink_colour="#000000"))
    page_of_shapes = replace(pages[0], drawing=replace(pages[0].drawing, texts=()))  # letters are as large as rings
    dark = rasterise(pdf_bytes((page_of_shapes,)), tmp_path)
    measured = measured_features(dark, page_of_shapes.height_mm, spec.ring_diameter_mm / 2)
    places = expected_places(target, page_of_shapes)
    assert len(measured) == len(places)
    assert nearest_distance_mm(places, measured).max() < 0.02


def test_pdf_scale_bar_is_100_mm(tmp_path: Path) -> None:
    """On paper the bar's eleven ticks are 10 mm apart, 100 mm in all."""
    _, pages = sheets(board(60, 60))
    dark = rasterise(pdf_bytes(pages), tmp_path)
    rows = slice(round((MARGIN_MM + 0.5) / MM_PER_PX), round((MARGIN_MM + 1.2) / MM_PER_PX))
    # The page's foot is wider than the bar: the ticks are the only ink in columns up to its end.
    profile = dark[rows, : round((MARGIN_MM + SCALE_BAR_MM + 2) / MM_PER_PX)].mean(axis=0)
    label, count = ndimage.label(profile > 0.05)
    ticks = np.array(ndimage.center_of_mass(profile, label, range(1, count + 1)))[:, 0] * MM_PER_PX
    assert len(ticks) == 11
    assert np.abs(ticks - ticks[0] - 10 * np.arange(11)).max() < 0.02


def test_pdf_pages_have_their_exact_size_and_ask_for_no_scaling() -> None:
    """Each MediaBox is the page's size to a micrometre, and viewers are told not to scale."""
    for spec, page in ((ico(100.0), "A4"), (ALU, "fit")):
        _, pages = sheets(spec, page)
        data = pdf_bytes(pages)
        boxes = re.findall(rb"/MediaBox \[ 0 0 (\S+) (\S+) \]", data)
        assert len(boxes) == len(pages)
        for (width, height), sheet in zip(boxes, pages, strict=True):
            assert float(width) / 72 * 25.4 == pytest.approx(sheet.width_mm, abs=1e-3)
            assert float(height) / 72 * 25.4 == pytest.approx(sheet.height_mm, abs=1e-3)
        number = re.search(rb"/ViewerPreferences (\d+) 0 R", data)[1]
        assert re.search(rb"\n" + number + rb" 0 obj\n<<\s*/PrintScaling /None\s*>>", data)


def test_widths_are_upper_bounds() -> None:
    """A text's assumed width is at least that in Helvetica, so that what is kept clear stays clear."""
    from reportlab.pdfbase.pdfmetrics import stringWidth

    for code in range(32, 127):
        assert stringWidth(chr(code), "Helvetica", 3.0) <= Text(chr(code), (0.0, 0.0), 3.0).width_mm


def test_ink_is_compound() -> None:
    """No white is painted over ink: every area has the ink's or the marks' colour."""
    _, pages = sheets(ico(100.0))
    assert {area.colour for page in pages for area in page.drawing.areas} == {"#112233", "#000000"}
    assert math.isclose(sum(len(a.circles) == 2 for p in pages for a in p.drawing.areas), 20 * 33)
