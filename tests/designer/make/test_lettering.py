"""Stencil letters: readable, apart from the rings, and never a loop of ink around white."""

import math
import string
from itertools import combinations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from shapely import Point, Polygon, box
from shapely.affinity import scale, translate
from shapely.geometry.base import BaseGeometry
from shapely.ops import unary_union

from designer.base.errors import InputError
from designer.kinds.ico import IcoSpec, icosahedron
from designer.kinds.layout import lay_out
from designer.kinds.sizing import size_job
from designer.kinds.spec_file import RawValue, parse_spec
from designer.make.lettering import GAP, HEIGHT, WIDTH, glyph_outlines, letter_faces, text_contours, text_width
from designer.make.pattern import FacePattern, Pattern, make_pattern
from designer.spec.spec import Job

ALPHABET = string.digits + "ABCDEF"


def glyph(letter: str) -> BaseGeometry:
    return unary_union([Polygon(contour) for contour in glyph_outlines(letter)])


def job_of(**values: RawValue) -> Job:
    return size_job(parse_spec(values, "")).job


def pattern_of(job: Job) -> Pattern:
    printed = 1 + job.printing.shrink_compensation_percent / 100
    return make_pattern(lay_out(job.target), job.printing, scale=printed)


def letters_on(face: FacePattern) -> BaseGeometry:
    return unary_union([Polygon(contour) for contour in (*face.dark_text, *face.light_text)])


@pytest.mark.parametrize("letter", ALPHABET)
def test_letters_enclose_nothing(letter: str) -> None:
    """No letter closes a loop: the white around its ink is one piece, connected over more than corners."""
    around = box(-1, -1, WIDTH + 1, HEIGHT + 1).difference(glyph(letter))
    assert isinstance(around, Polygon)  # several pieces would be a MultiPolygon
    # ... and stays one when the ink bleeds a little, so no white passage is only a corner wide
    assert isinstance(around.buffer(-0.4, join_style="mitre"), Polygon)


@pytest.mark.parametrize("letter", ALPHABET)
def test_letters_are_sound_contours_on_the_grid(letter: str) -> None:
    """Contours are simple, counter-clockwise, a stroke apart from each other, on whole numbers, and fill the cell."""
    contours = glyph_outlines(letter)
    pieces = [Polygon(contour) for contour in contours]
    assert all(piece.is_valid and piece.exterior.is_ccw for piece in pieces)
    assert all(a.distance(b) >= 1 for k, a in enumerate(pieces) for b in pieces[:k])
    assert all((contour == np.round(contour)).all() for contour in contours)
    left, low, right, high = glyph(letter).bounds
    assert (low, high) == (0, HEIGHT)
    assert left >= 0
    assert right <= WIDTH
    # nothing thinner than a stroke: opening by just less than half a stroke loses no area
    opened = glyph(letter).buffer(-0.49, join_style="mitre").buffer(0.49, join_style="mitre")
    assert opened.area == pytest.approx(glyph(letter).area)


def test_letters_differ() -> None:
    """Any two letters differ in at least one cell of the grid."""
    for a, b in combinations(ALPHABET, 2):
        assert glyph(a).symmetric_difference(glyph(b)).area >= 1, (a, b)


@given(st.text(ALPHABET + " ", min_size=1, max_size=14), st.floats(0.1, 2), st.floats(-50, 50))
@settings(max_examples=30, deadline=None)
def test_text_is_a_centred_line(text: str, stroke_mm: float, baseline_mm: float) -> None:
    """Letter n starts 6 n strokes right of the line's left end; the line, 6 N - 1 strokes long, is centred on x = 0."""
    ink = unary_union([Polygon(contour) for contour in text_contours(text, stroke_mm, baseline_mm)])
    assume(not ink.is_empty)
    assert ink.bounds[1] == pytest.approx(baseline_mm)
    assert ink.bounds[3] == pytest.approx(baseline_mm + HEIGHT * stroke_mm)
    for place, letter in enumerate(text):
        left = (6 * place - (6 * len(text) - 1) / 2) * stroke_mm
        cell = box(left, baseline_mm, left + WIDTH * stroke_mm, baseline_mm + HEIGHT * stroke_mm)
        expected = glyph(letter).area * stroke_mm**2 if letter != " " else 0
        assert ink.intersection(cell).area == pytest.approx(expected, abs=1e-6)


@given(
    edge_mm=st.floats(14, 60),
    border_mm=st.floats(1.5, 6),
    nozzle=st.sampled_from(["0.2mm", "0.4mm"]),
    inlay_mm=st.sampled_from([0.4, 1.0, 3.0]),
    offset_mm=st.sampled_from([-0.1, 0.0, 0.1]),
    percent=st.sampled_from([-20, 0, 1, 20]),
)
@settings(max_examples=30, deadline=None)
def test_letters_in_a_border_stay_clear(
    edge_mm: float, border_mm: float, nozzle: str, inlay_mm: float, offset_mm: float, percent: float
) -> None:
    """On an icosahedron, letters keep a line's width to the window and to the border's sides down at the ink's floor.

    Whatever edge, border, inlay, offset and compensation are: letters that would not are left out.
    """
    try:
        job = job_of(
            kind="ico",
            edge=f"{edge_mm}mm",
            border=f"{border_mm}mm",
            nozzle=nozzle,
            inlay_depth=inlay_mm,
            ink_offset=offset_mm,
            shrink_compensation=percent,
            chord_error="50um",
        )
        pattern = pattern_of(job)
    except InputError:
        assume(False)
    printed = 1 + percent / 100
    line = job.printing.printer.line_width_mm
    for face in (pattern.faces[3], pattern.faces[19]):  # numbers of one and of two digits
        assert face.window is not None
        floor = Polygon(face.outline * (1 - inlay_mm / (icosahedron().inradius * edge_mm * printed)))
        letters = letters_on(face)
        assert floor.contains(letters) or letters.is_empty
        if not letters.is_empty:
            assert floor.exterior.distance(letters) >= line - 1e-6
            assert Polygon(face.window).distance(letters) >= line - 1e-6
            assert min(math.dist(a, b) for c in face.light_text for a, b in zip(c, np.roll(c, 1, 0), strict=True)) >= (
                line - 1e-6
            )


@given(st.floats(55, 120), st.floats(0.5, 8), st.sampled_from(["0mm", "1mm", "5mm"]), st.sampled_from([-10, 0, 5]))
@settings(max_examples=25, deadline=None)
def test_letters_on_a_board_stay_clear(size_mm: float, margin_mm: float, border: str, percent: float) -> None:
    """On a board, letters keep a line's width to rings, border and edge; without a border half a ring's radius."""
    job = job_of(
        kind="board",
        size=f"{size_mm}x{size_mm}mm",
        ring_diameter="7mm",
        pitch="10mm",
        margin=f"{margin_mm}mm",
        border=border,
        shrink_compensation=percent,
        chord_error="50um",
    )
    face = pattern_of(job).faces[0]
    letters = letters_on(face)
    line = job.printing.printer.line_width_mm
    if not letters.is_empty:
        assert Polygon(face.outline).contains(letters)
        assert Polygon(face.outline).exterior.distance(letters) >= line - 1e-6
        if face.window is not None:
            assert Polygon(face.window).distance(letters) >= line - 1e-6
        else:
            radius = 3.5 * (1 + percent / 100)
            nearest = min(Point(position).distance(letters) for position in face.position_mm)
            assert nearest >= 1.5 * radius - 1e-6


def written(job: Job, face: int) -> str:
    """What stands on a face, read letter by letter."""
    contours = letter_faces(lay_out(job.target), job.printing, 1.0).contours[face]
    ink = unary_union([Polygon(contour) for contour in contours])
    left, low, right, high = ink.bounds
    stroke = (high - low) / HEIGHT
    count = math.ceil((right - left) / stroke / (WIDTH + GAP))
    # "1" does not fill its cell: the line is centred, so its left end follows from its number of letters
    start = -text_width("0" * count) * stroke / 2
    text = ""
    for place in range(count):
        x = start + place * (WIDTH + GAP) * stroke
        cell = ink.intersection(box(x, low, x + WIDTH * stroke, high))
        known = {letter: translate(scale(glyph(letter), stroke, stroke, origin=(0, 0)), x, low) for letter in ALPHABET}
        nearest = min(ALPHABET, key=lambda letter, k=known, c=cell: k[letter].symmetric_difference(c).area)
        text += " " if cell.is_empty else nearest
    return text


def test_every_face_bears_its_number_and_the_id() -> None:
    """Face n shows n and the first eight digits of the geometry's id, or n alone where the line is too short."""
    job = job_of(kind="ico", edge="100mm", border="6mm")
    target_id = lay_out(job.target).geometry_id[:8].upper()
    assert [written(job, face) for face in range(20)] == [f"{face} {target_id}" for face in range(20)]
    short = job_of(kind="ico", edge="42mm", border="6mm")
    assert [written(short, face) for face in (0, 7, 19)] == ["0", "7", "19"]


def test_board_bears_the_id() -> None:
    """A board shows the first eight digits of its id."""
    job = job_of(kind="board", size="100x80mm", pitch="10mm")
    assert written(job, 0) == lay_out(job.target).geometry_id[:8].upper()


def test_labels_are_left_out_on_request_and_for_want_of_room() -> None:
    """Without labels nothing is written; where nothing fits, the remark names the room and what is needed."""
    off = job_of(kind="board", size="100x80mm", pitch="10mm", labels=False)
    tight = job_of(kind="ico", edge="20mm")
    assert isinstance(tight.target, IcoSpec)
    for job, remark in ((off, "off"), (tight, "left out, there is room for 0.00mm and they are 3.15mm high")):
        lettering = letter_faces(lay_out(job.target), job.printing, 1.0)
        assert not any(lettering.contours)
        assert remark in lettering.remark
