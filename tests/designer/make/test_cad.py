"""STEP files: exact solids, read back with Open CASCADE's own reader."""

from dataclasses import dataclass, replace
from pathlib import Path

import build123d
import numpy as np
import pytest

from designer.kinds.board import BoardSpec
from designer.kinds.cube import CubeSpec
from designer.kinds.ico import IcoSpec
from designer.kinds.layout import lay_out
from designer.make import cad
from designer.make.mesh import Part, inlaid, plate_hull, solid_hull
from designer.make.pattern import Pattern, make_pattern
from designer.spec.spec import PrinterProfile, PrintSpec, Spec
from designer.target import TargetGeometry

PRINTER = PrinterProfile("p", (256, 256, 256), 0.4, 0.45, 0.2)
ICO = PrintSpec("one-piece", PRINTER, 1.0, 0.0, 0.0, 0.25, "#f0e0c0", "#203040", False, False, 0.005)
BOARD = replace(ICO, inlay_mm=0.6, labels=True)
SCALE = 1.01


@dataclass(frozen=True)
class Case:
    """A target with its meshes and what was read back of its file, all at one scale."""

    spec: Spec
    printing: PrintSpec
    target: TargetGeometry
    pattern: Pattern
    part: Part
    step: Path
    whole: build123d.Compound

    @property
    def body(self) -> build123d.Shape:
        """The body."""
        return self.whole.children[0]

    @property
    def ink(self) -> tuple[build123d.Shape, ...]:
        """The marks."""
        return self.whole.children[1].children


CASES: dict[str, tuple[Spec, PrintSpec]] = {
    "ico, narrow border": (IcoSpec(30.0, 5, 3.0, 0.45, 4.0, 0.4, 0.5), ICO),
    "cube": (CubeSpec(24.0, 5, 2.6, 0.45, 3.6, 1.2, 0.5), ICO),
    "board, light letters": (BoardSpec((60.0, 60.0), 4.0, 4, 4, "square", 7.0, 0.45, 10.0, 5.0, 5.0, True), BOARD),
    "board, dark letters": (BoardSpec((60.0, 50.0), 4.0, 4, 3, "square", 7.0, 0.45, 10.0, 0.0, 5.0, True), BOARD),
}


@pytest.fixture(params=CASES, scope="module")
def case(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Case:
    spec, printing = CASES[request.param]
    target = lay_out(spec)
    pattern = make_pattern(target, printing, scale=SCALE)
    if spec.solid is not None:
        hull = solid_hull(pattern, spec.solid, printing.inlay_mm, scale=SCALE)
    else:
        hull = plate_hull(pattern, SCALE * spec.depth_mm, printing.inlay_mm)
    part = inlaid(pattern, hull, printing.inlay_mm)
    path = tmp_path_factory.mktemp("step") / "x.step"
    path.write_bytes(cad.step_bytes(spec, pattern, printing, name="x", scale=SCALE))
    return Case(spec, printing, target, pattern, part, path, build123d.import_step(path))


def solid_volume(case: Case) -> float:
    """Of the whole target as printed."""
    if isinstance(case.spec, IcoSpec):
        return 5 / 12 * (3 + 5**0.5) * (SCALE * case.spec.edge_mm) ** 3
    if isinstance(case.spec, CubeSpec):
        return (SCALE * case.spec.edge_mm) ** 3
    assert isinstance(case.spec, BoardSpec)
    return float(np.prod(case.spec.size_mm)) * case.spec.thickness_mm * SCALE**3


def test_step_keeps_products_names_and_colours(case: Case) -> None:
    """A reader finds the products body and ink, each mark a valid solid with its name, and the filaments' colours."""
    assert case.whole.label == "x"
    assert [child.label for child in case.whole.children] == ["body", "ink"]
    assert case.body.is_valid
    assert all(solid.is_valid for solid in case.ink)
    labels = [solid.label for solid in case.ink]
    has_border = case.pattern.faces[0].window is not None
    letters = sum(len(face.dark_text) for face in case.pattern.faces)
    assert labels.count("border") == has_border
    assert labels.count("dot") == case.target.is_dot.sum()
    assert labels.count("ring") == (~case.target.is_dot).sum()
    assert labels.count("text") == letters
    assert len(labels) == case.target.ring_count + has_border + letters
    assert hex_colour(case.body) == case.printing.body_colour
    assert {hex_colour(child) for child in case.ink} == {case.printing.ink_colour}


def test_body_and_ink_fill_the_solid(case: Case) -> None:
    """Together they have the solid's volume: no gap, no overlap; true circles and equal-area polygons agree."""
    ink = sum(solid.volume for solid in case.ink)
    assert case.body.volume + ink == pytest.approx(solid_volume(case), rel=1e-6)
    assert case.part.ink is not None
    assert case.body.volume == pytest.approx(case.part.body.volume_mm3, rel=1e-6)
    assert ink == pytest.approx(case.part.ink.volume_mm3, rel=1e-6)


def hex_colour(shape: build123d.Shape) -> str:
    return "#" + bytes(round(255 * value) for value in tuple(shape.color)[:3]).hex()


def test_step_places_every_ring(case: Case) -> None:
    """The rings' and dots' top circles, read back, lie on the target's centres with its radii; none is a polygon."""
    marks = [child for child in case.ink if child.label in ("ring", "dot")]
    for row, mark in enumerate(marks):
        centre = SCALE * case.target.center_mm[row]
        normal = case.target.target_from_face[case.target.ring_face[row], :3, 2]
        circles = mark.edges().filter_by(build123d.GeomType.CIRCLE)
        at = np.array([tuple(circle.arc_center) for circle in circles])
        on_top = np.abs((at - centre) @ normal) < 1e-6
        np.testing.assert_allclose(at[on_top], np.tile(centre, (on_top.sum(), 1)), atol=1e-5)
        radii = sorted({round(circle.radius, 6) for circle in circles}, reverse=True)
        is_dot = case.target.is_dot[row]
        expected = [case.target.radius_outer_mm[row], *([] if is_dot else [case.target.radius_inner_mm[row]])]
        np.testing.assert_allclose(radii, SCALE * np.array(expected), atol=1e-6)


def test_copies_share_their_shape(case: Case) -> None:
    """The file holds one solid for the body and one for each distinct ink shape, however many copies there are."""
    shapes = {"body"} | {solid.label for solid in case.ink if solid.label != "text"}
    letters = [solid for solid in case.ink if solid.label == "text"]
    assert case.step.read_text().count("MANIFOLD_SOLID_BREP(") == len(shapes) + len(letters)


def test_ink_offset_and_inlay_reach_the_solids() -> None:
    """A grown ink is wider, and the ink is as deep as the inlay: a dot's volume is pi (r + offset)^2 depth."""
    spec, printing = CASES["board, dark letters"]
    printing = replace(printing, ink_offset_mm=0.1, inlay_mm=0.8)
    solids = cad.inlaid_solids(spec, make_pattern(lay_out(spec), printing), printing.inlay_mm)
    dot = next(solid for solid in solids.ink if solid.label == "dot")
    assert dot.volume == pytest.approx(np.pi * 3.6**2 * 0.8, rel=1e-9)
