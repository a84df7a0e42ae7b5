"""The ink as polygons: circles, offsets, scale, and the nesting that the detector relies on."""

import math
import re

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from PIL import Image, ImageDraw
from scipy import ndimage
from shapely import Polygon

from designer.base.errors import InputError
from designer.builds.design import Design
from designer.make.pattern import FacePattern, Pattern, circle_polygon, make_pattern
from designer.spec.spec import PrintSpec
from designer.target import TargetGeometry
from designer.target_scene import polygon_area_mm2
from tests.support.designs import design_of

ICO = design_of(kind="ico", edge="100mm", ring_diameter="7mm", pitch="10mm", border="2mm", labels=False)
BOARD = design_of(kind="board", size="60x50mm", ring_diameter="7mm", pitch="10mm", labels=False)
BORDERED = design_of(kind="board", size="60x60mm", ring_diameter="7mm", pitch="10mm", border="3mm", labels=False)
DESIGNS = {"ico": ICO, "board": BOARD, "bordered board": BORDERED}


def pattern_of(design: Design, offset_mm: float = 0.0, scale: float = 1.0) -> Pattern:
    printing = PrintSpec(**{**vars(design.job.printing), "ink_offset_mm": offset_mm})
    return make_pattern(design.target, printing, scale=scale)


def contours_of(pattern: Pattern, face: FacePattern) -> list[np.ndarray]:
    """All contours of a face, the ink on their left."""
    contours = [*face.dark_text, *face.light_text] + ([face.outline, face.window] if face.window is not None else [])
    for row, position in zip(face.stamp, face.position_mm, strict=True):
        contours += [contour + position for contour in pattern.stamps[row].contours]
    return contours


def ink_area(pattern: Pattern, face: FacePattern) -> float:
    return sum(map(polygon_area_mm2, contours_of(pattern, face)))


# --- circles ------------------------------------------------------------------------------------------------------


@given(st.floats(0.05, 500), st.floats(0.0005, 0.5))
@settings(max_examples=200, deadline=None)
def test_circles_have_the_circles_area_and_stay_close(radius_mm: float, chord_error_mm: float) -> None:
    """A counter-clockwise regular polygon of area pi r^2, no point of which is farther from the circle than asked."""
    polygon = circle_polygon(radius_mm, chord_error_mm)
    assert polygon_area_mm2(polygon) == pytest.approx(math.pi * radius_mm**2, rel=1e-11)
    corner = np.linalg.norm(polygon, axis=1)
    middle = np.linalg.norm((polygon + np.roll(polygon, -1, axis=0)) / 2, axis=1)
    assert np.ptp(corner) < 1e-12 * radius_mm
    assert np.ptp(np.linalg.norm(polygon - np.roll(polygon, -1, axis=0), axis=1)) < 1e-9 * radius_mm
    assert max(corner.max() - radius_mm, radius_mm - middle.min()) <= chord_error_mm


@given(st.floats(0.05, 500), st.floats(0.0005, 0.5))
@settings(max_examples=100, deadline=None)
def test_circles_have_no_more_corners_than_needed(radius_mm: float, chord_error_mm: float) -> None:
    """With four corners fewer (or below twelve) the equal-area polygon would stray too far."""
    count = len(circle_polygon(radius_mm, chord_error_mm)) - 4
    assume(count >= 12)
    step = 2 * math.pi / count
    corner = radius_mm * math.sqrt(step / math.sin(step))
    assert corner - radius_mm > chord_error_mm


# --- ink ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("design", DESIGNS.values(), ids=DESIGNS)
def test_ink_lies_on_the_left_of_every_contour(design: Design) -> None:
    """Rims run counter-clockwise, holes and windows clockwise, and the ink's area is that of the target's circles."""
    pattern, target = pattern_of(design), design.target
    for number, face in enumerate(pattern.faces):
        mine = target.ring_face == number
        rings = math.pi * (target.radius_outer_mm[mine] ** 2 - target.radius_inner_mm[mine] ** 2).sum()
        border = polygon_area_mm2(target.outline_mm[number]) - polygon_area_mm2(target.window_mm[number])
        assert ink_area(pattern, face) == pytest.approx(rings + border)
        assert polygon_area_mm2(face.outline) > 0
        assert (face.window is None) == (border == 0)
        assert face.window is None or polygon_area_mm2(face.window) < 0


@pytest.mark.parametrize("design", DESIGNS.values(), ids=DESIGNS)
@pytest.mark.parametrize("offset_mm", [-0.7, -0.05, 0.1, 1.0])
def test_offset_moves_every_edge_of_the_ink(design: Design, offset_mm: float) -> None:
    """Growing the ink by o adds o to rims, takes it from holes and moves the border's inner edge in by o."""
    plain, grown = pattern_of(design), pattern_of(design, offset_mm)
    assert len(plain.stamps) == len(grown.stamps)
    for before, after in zip(plain.stamps, grown.stamps, strict=True):
        rim, hole = before.outer_radius_mm + offset_mm, before.inner_radius_mm - offset_mm
        assert polygon_area_mm2(after.rim) == pytest.approx(math.pi * rim**2)
        assert (after.hole is None) == (before.hole is None)
        if after.hole is not None:
            assert polygon_area_mm2(after.hole) == pytest.approx(-math.pi * hole**2)
    for before, after in zip(plain.faces, grown.faces, strict=True):
        assert (after.outline == before.outline).all()
        if before.window is not None:
            moved = Polygon(before.window).buffer(-offset_mm, join_style="mitre")
            assert moved.symmetric_difference(Polygon(after.window)).area < 1e-6


@pytest.mark.parametrize("design", DESIGNS.values(), ids=DESIGNS)
def test_scale_enlarges_everything(design: Design) -> None:
    """At scale s every length on the faces, and the faces' distance from the origin, is s times as long."""
    plain, scaled = pattern_of(design), pattern_of(design, scale=1.01)
    for before, after in zip(plain.stamps, scaled.stamps, strict=True):
        assert after.outer_radius_mm == pytest.approx(1.01 * before.outer_radius_mm)
        assert after.inner_radius_mm == pytest.approx(1.01 * before.inner_radius_mm)
    for before, after in zip(plain.faces, scaled.faces, strict=True):
        assert after.position_mm == pytest.approx(1.01 * before.position_mm)
        assert after.outline == pytest.approx(1.01 * before.outline)
        assert (after.window is None) == (before.window is None)
        assert after.window is None or after.window == pytest.approx(1.01 * before.window)
    assert scaled.target_from_face[:, :3, :3] == pytest.approx(plain.target_from_face[:, :3, :3])
    assert scaled.target_from_face[:, :3, 3] == pytest.approx(1.01 * plain.target_from_face[:, :3, 3])


@pytest.mark.parametrize("design", DESIGNS.values(), ids=DESIGNS)
@pytest.mark.parametrize("scale", [1.0, 0.9])
def test_offsets_that_spoil_the_ink_are_refused(design: Design, scale: float) -> None:
    """Up to the limits that the message names, contours stay apart; beyond them the offset is refused.

    At the limits a stroke or a hole closes, rings touch each other or the border, or the border is used up.
    """
    for extreme in (-20.0, 20.0):
        with pytest.raises(InputError, match="ink offset") as raised:
            pattern_of(design, extreme, scale)
        assert len(str(raised.value).splitlines()) == 1
    limits = re.search(r"above (-[\d.]+)mm and below ([\d.]+)mm", str(raised.value))
    assert limits is not None
    for limit in map(float, limits.groups()):
        with pytest.raises(InputError):
            pattern_of(design, 1.001 * limit, scale)
        pattern = pattern_of(design, 0.99 * limit, scale)
        face = pattern.faces[0]
        discs = [Polygon(pattern.stamps[row].rim + at) for row, at in zip(face.stamp, face.position_mm, strict=True)]
        assert all(a.disjoint(b) for k, a in enumerate(discs) for b in discs[:k])
        field = Polygon(face.outline if face.window is None else face.window)
        assert Polygon(face.outline).covers(field)
        assert all(field.contains_properly(disc) for disc in discs)
        assert all(stamp.hole is None or Polygon(stamp.rim).contains(Polygon(stamp.hole)) for stamp in pattern.stamps)


def test_coarse_circles_that_would_touch_are_refused() -> None:
    """Equal-area polygons stray outside their circles: where rims would touch, a finer chord error is asked for."""
    close = {"kind": "board", "size": "60x60mm", "ring_diameter": "9.5mm", "pitch": "10mm", "margin": "1mm"}
    with pytest.raises(InputError, match="chord error"):
        pattern_of(design_of(**close, chord_error="0.4mm"))
    assert pattern_of(design_of(**close, chord_error="0.1mm")).stamps


# --- the nesting that the detector looks for --------------------------------------------------------------------------

PX_PER_MM = 16


def rasterised(pattern: Pattern, face: FacePattern) -> np.ndarray:
    """0 outside the face, 1 white, 2 ink; drawn by Pillow, blind to how the contours nest."""
    low, high = face.outline.min(axis=0) - 1, face.outline.max(axis=0) + 1
    width, height = np.ceil((high - low) * PX_PER_MM).astype(int).tolist()
    image = Image.new("L", (width, height), 0)
    draw = ImageDraw.Draw(image)

    def fill(contour: np.ndarray, value: int) -> None:
        draw.polygon([tuple(point) for point in (contour - low) * PX_PER_MM], fill=value)

    fill(face.outline, 1 if face.window is None else 2)
    if face.window is not None:
        fill(face.window, 1)
    for row, position in zip(face.stamp, face.position_mm, strict=True):
        fill(pattern.stamps[row].rim + position, 2)
        if pattern.stamps[row].hole is not None:
            fill(pattern.stamps[row].hole + position, 1)
    for contour in face.dark_text:
        fill(contour, 2)
    for contour in face.light_text:
        fill(contour, 1)
    return np.array(image)


def nesting(raster: np.ndarray) -> tuple[dict[int, bool], dict[int, int]]:
    """Connected regions as a border follower sees them: which are ink, and which region surrounds each."""
    everywhere = np.ones((3, 3))
    white, white_count = ndimage.label(raster == 1)
    ink, ink_count = ndimage.label(raster == 2, structure=everywhere)
    label = np.where(raster == 2, ink + white_count, white)
    parent = {}
    for number, place in enumerate(ndimage.find_objects(label), start=1):
        row = place[0].start
        column = int(np.flatnonzero(label[row] == number)[0])
        parent[number] = int(label[row, column - 1])
    return {number: number > white_count for number in range(1, white_count + ink_count + 1)}, parent


FACES = {
    "paper": (design_of(kind="ico", edge="100mm", ring_diameter="7mm", pitch="10mm"), 0),
    "20 mm, nozzle 0.4": (design_of(kind="ico", edge="20mm"), 11),
    "20 mm, nozzle 0.2": (design_of(kind="ico", edge="20mm", nozzle="0.2mm"), 19),
    "letters in the border": (design_of(kind="ico", edge="60mm", border="6mm"), 19),
    "board": (design_of(kind="board", size="100x80mm", pitch="10mm"), 0),
    "board with border": (design_of(kind="board", size="100x80mm", pitch="10mm", border="6mm"), 0),
    "triangular board": (design_of(kind="board", size="70x60mm", pitch="10mm", lattice="triangular", border="2mm"), 0),
}


@pytest.mark.parametrize(("design", "number"), FACES.values(), ids=FACES)
def test_marks_nest_as_the_detector_expects(design: Design, number: int) -> None:
    """Border around one white window around rings and dots; a ring holds one white centre, a dot nothing.

    Letters are childless: seen in the border as white specks, on a plain board as ink specks.
    """
    target: TargetGeometry = design.target
    mine = target.ring_face == number
    rings, dots = int((mine & ~target.is_dot).sum()), int((mine & target.is_dot).sum())
    face = design.printed_pattern.faces[number]
    is_ink, parent = nesting(rasterised(design.printed_pattern, face))
    children = {region: [inner for inner, outer in parent.items() if outer == region] for region in [0, *is_ink]}
    (outermost,) = children[0]
    assert is_ink[outermost] == (face.window is not None)
    fields = [region for region, inner in children.items() if inner and region and not is_ink[region]]
    assert len(fields) == 1  # one white region holds everything
    assert outermost == (fields[0] if face.window is None else parent[fields[0]])
    marks = children[fields[0]]
    assert all(is_ink[mark] for mark in marks)
    assert sum(len(children[mark]) == 1 for mark in marks) == rings
    assert sum(not children[mark] for mark in marks) == dots + len(face.dark_text)
    assert all(not children[centre] for mark in marks for centre in children[mark])
    if face.window is not None:
        assert len(children[outermost]) == 1 + len(face.light_text)
