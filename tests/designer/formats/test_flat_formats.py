"""Files for lasers, cutters and board houses, as the programs of others read and draw them."""

import io
import zipfile
from pathlib import Path

import ezdxf
import numpy as np
import pytest
import svgelements
from ezdxf.document import Drawing as DxfDocument
from numpy.typing import NDArray
from PIL import Image
from pygerber.gerberx3.api.v2 import GerberFile, ParsedFile
from pygerber.gerberx3.parser2.apertures2.circle2 import Circle2
from pygerber.gerberx3.parser2.commands2.flash2 import Flash2

import calib
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.builds.design import EXPORTERS, Design, make_files
from designer.kinds.sizing import size_job
from designer.make.pages import CUT, ENGRAVE, LABEL, MARK_COLOUR
from designer.spec.build import Format
from designer.spec.format import FORMATS
from tests.support.designs import SMALL, asked_for, design_of, small

pytestmark = pytest.mark.filterwarnings("ignore:.*deprecated")  # in the readers of others

MICROMETRE_MM = 1e-3
PX_PER_MM = 20


def flat(kind: str, *formats: Format, **more: object) -> Design:
    """A small target on paper or sheet, with a border."""
    build = "sheet" if kind == "board" else "stickers"
    values = {**SMALL[kind], "build": build, "formats": ",".join(formats), "chord_error": "50um", "page": "fit", **more}
    return design_of(kind, **values)


def content_of(design: Design, suffix: str) -> bytes:
    """A file of a design."""
    name = f"{design.job.name}.{suffix}"
    return next(file.content for file in make_files(design, lambda _: None) if file.name == name)


def dxf_of(design: Design) -> DxfDocument:
    return ezdxf.read(io.StringIO(content_of(design, "dxf").decode("ascii")))


def circles(document: DxfDocument) -> Array:
    """Centres and radii of what is engraved, in mm.  # (N, 3)"""
    found = document.modelspace().query(f'CIRCLE[layer=="{ENGRAVE}"]')
    return np.array([(one.dxf.center.x, one.dxf.center.y, one.dxf.radius) for one in found])


def gerbers_of(design: Design, suffix: str, place: Path) -> dict[str, ParsedFile]:
    """The layers of an order, as PyGerber reads them, by the ends of their names."""
    with zipfile.ZipFile(io.BytesIO(content_of(design, suffix))) as archive:
        archive.extractall(place)
    return {path.suffix: GerberFile.from_file(path).parse() for path in place.iterdir() if path.suffix != ".drl"}


def outlines(document: DxfDocument, layer: str) -> list[Array]:
    """Closed polylines of a layer, (N, 2) each."""
    found = document.modelspace().query(f'POLYLINE[layer=="{layer}"]')
    assert all(one.is_closed for one in found)
    return [np.array([(vertex.dxf.location.x, vertex.dxf.location.y) for vertex in one.vertices]) for one in found]


def expected(design: Design, face: int) -> Array:
    """Centre and radius of each circle of a face's ink, in its frame.  # (N, 3)"""
    target = design.target
    mine = target.ring_face == face
    centre = target.center_in_face_mm[mine, :2]
    radii = np.stack([target.radius_outer_mm[mine], target.radius_inner_mm[mine]], axis=1)
    rows = np.concatenate([np.column_stack([centre, radii[:, k]]) for k in range(2)])
    return rows[rows[:, 2] > 0]


def farthest(seen: Array, told: Array) -> float:
    """The largest distance of a row from the nearest of the others, one for one."""
    assert len(seen) == len(told)
    distance = np.linalg.norm(seen[:, None] - told[None], axis=2)
    assert len(set(distance.argmin(axis=0).tolist())) == len(told)
    return float(distance.min(axis=0).max())


@pytest.mark.parametrize("kind", ["board", "ico", "cube"])
def test_dxf_is_sound_and_true(kind: str) -> None:
    """A reader of others finds no fault in a DXF, and within each cut line the circles of one face, within 1 um."""
    design = flat(kind, "dxf", border="1.5mm") if kind == "board" else flat(kind, "dxf")
    document = dxf_of(design)
    audit = document.audit()
    assert not audit.errors
    assert not audit.fixes
    assert document.dxfversion == "AC1009"
    assert {entity.dxf.layer for entity in document.modelspace()} <= {CUT, ENGRAVE, LABEL}
    drawn, cuts = circles(document), outlines(document, CUT)
    assert len(cuts) == design.target.face_count
    for face, cut in enumerate(cuts):
        middle = cut.mean(axis=0)
        within = np.linalg.norm(drawn[:, :2] - middle, axis=1) < np.linalg.norm(cut - middle, axis=1).max()
        nominal = design.target.outline_mm[face]
        turned = np.sign((cut[0] - middle) @ (nominal[0] - nominal.mean(axis=0)))
        seen = drawn[within] - np.append(middle, 0)
        seen[:, :2] = turned * seen[:, :2] + nominal.mean(axis=0)
        of_face = [row for row in seen if np.linalg.norm(expected(design, face) - row, axis=1).min() < 1]
        assert farthest(np.array(of_face), expected(design, face)) < MICROMETRE_MM
    assert len(drawn) == sum(len(expected(design, face)) for face in range(design.target.face_count))


@pytest.mark.parametrize("kind", ["board", "cube"])
def test_laser_svg_is_the_same_drawing_as_dxf(kind: str) -> None:
    """Its size is in mm; every circle of the DXF is one of its arcs, every line one of its paths, by colour."""
    design = flat(kind, "dxf", "laser")
    document = dxf_of(design)
    drawing = svgelements.SVG.parse(io.BytesIO(content_of(design, "laser.svg")), ppi=25.4)
    paths = list(drawing.elements(lambda element: isinstance(element, svgelements.Path)))
    engraved = [path for path in paths if path.fill == "#000000"]
    assert len(engraved) == 1
    height = float(drawing.height)
    seen = []
    for part in engraved[0].as_subpaths():
        piece = svgelements.Path(part)
        if any(isinstance(step, svgelements.Arc) for step in piece):
            left, top, right, bottom = piece.bbox()
            seen.append(((left + right) / 2, height - (top + bottom) / 2, (right - left) / 2))
    assert farthest(np.array(seen), circles(document)) < MICROMETRE_MM
    for layer, colour in ((CUT, "#ff0000"), (LABEL, "#0000ff")):
        lines = [path for path in paths if path.stroke == colour]
        corners = [np.array([(point.x, height - point.y) for point in path.as_points()]) for path in lines]
        told = outlines(document, layer)
        assert len(lines) == len(told)
        for seen_line, told_line in zip(corners, told, strict=True):
            assert np.abs(seen_line.min(axis=0) - told_line.min(axis=0)).max() < MICROMETRE_MM
            assert np.abs(seen_line.max(axis=0) - told_line.max(axis=0)).max() < MICROMETRE_MM


def flashes(layer: ParsedFile) -> list[Flash2]:
    return [command for command in layer._command_buffer if isinstance(command, Flash2)]


def ring_of(flash: Flash2) -> list[float]:
    """Place and both diameters of a flash, in mm."""
    assert isinstance(flash.aperture, Circle2)
    numbers = (flash.flash_point.x, flash.flash_point.y, flash.aperture.diameter, flash.aperture.hole_diameter)
    return [0.0 if number is None else float(number.as_millimeters()) for number in numbers]


@pytest.mark.parametrize(("suffix", "ink"), [("gerber", ".gto"), ("gerber-mask", ".gts")])
def test_gerber_is_read_as_the_board(suffix: Format, ink: str, tmp_path: Path) -> None:
    """A reader of others finds each ring as a flash: centre and both diameters as designed, the board's size true."""
    design = flat("board", suffix, border="1.5mm")
    layers = gerbers_of(design, f"{suffix}.zip", tmp_path)
    target = design.target
    low = target.outline_mm[0].min(axis=0)
    seen = np.array([ring_of(flash) for flash in flashes(layers[ink])])
    told = np.column_stack([target.center_mm[:, :2] - low, 2 * target.radius_outer_mm, 2 * target.radius_inner_mm])
    assert farthest(seen, told) < MICROMETRE_MM
    edge = layers[".gm1"].get_info()
    size = np.ptp(target.outline_mm[0], axis=0)
    assert np.allclose([float(edge.width_mm), float(edge.height_mm)], size + 0.1)  # and the pen
    assert len(flashes(layers[".gts" if ink == ".gto" else ".gbs"])) == 0


def test_both_sides_of_a_board_lie_where_they_are(tmp_path: Path) -> None:
    """Seen from the top, rings of the front are in the top layer and those of the back, mirrored, in the bottom one."""
    design = flat("board", "gerber", two_sided=True)
    layers = gerbers_of(design, "gerber.zip", tmp_path)
    target = design.target
    low = target.outline_mm[0].min(axis=0)
    for face, ink in enumerate((".gto", ".gbo")):
        seen = np.array([ring_of(flash)[:2] for flash in flashes(layers[ink])])
        assert farthest(seen, target.center_mm[target.ring_face == face, :2] - low) < MICROMETRE_MM


@pytest.mark.parametrize(("kind", "more"), [("ico", {}), ("coupon", {}), ("board", {"two_sided": True})])
def test_every_kind_can_be_cut(kind: str, more: dict[str, object]) -> None:
    """Whatever stands beside the pieces of a kind, its files are made; each ring is engraved once."""
    design = design_of(kind, **{**SMALL[kind], "formats": "dxf,laser", "page": "fit", **more})
    drawn = circles(dxf_of(design))
    assert len(drawn) == 2 * design.target.ring_count - int(design.target.is_dot.sum())
    assert b"</svg>" in content_of(design, "laser.svg")


def detected(grey: NDArray[np.uint8], design: Design, within_px: float) -> float:
    """The share of rings that are found in drawn artwork, all of them where they were drawn."""
    found = calib.detect(grey, design.target)
    scale = np.polyfit(design.target.center_mm[found.ring, 0], found.center_px[:, 0], 1)
    assert np.abs(np.polyval(scale, design.target.center_mm[found.ring, 0]) - found.center_px[:, 0]).max() < within_px
    return len(found.ring) / design.target.ring_count


@pytest.mark.parametrize(("suffix", "ink"), [("gerber", ".gto"), ("gerber-mask", ".gts")])
def test_drawn_gerber_is_detected_with_all_rings(suffix: Format, ink: str, tmp_path: Path) -> None:
    """Artwork as PyGerber draws it shows the detector every ring; drawn areas are ink, or openings in it."""
    design = flat("board", suffix)
    layers = gerbers_of(design, f"{suffix}.zip", tmp_path)
    picture = tmp_path / "drawn.png"
    layers[ink].render_raster(str(picture), dpmm=PX_PER_MM)
    drawn = np.asarray(Image.open(picture).convert("L"))
    grey = np.where(drawn == drawn[0, 0], 255, 0).astype(np.uint8)  # of the first pixel's colour is what is white
    assert detected(np.pad(grey, 60, constant_values=255), design, within_px=0.6) == 1  # it draws on whole pixels


def test_drawn_dxf_is_detected_with_all_rings() -> None:
    """What a laser fills, all circles under the even-odd rule, shows the detector every ring."""
    design = flat("board", "dxf")
    drawn = circles(dxf_of(design))
    size = (np.ptp(design.target.outline_mm[0], axis=0) * PX_PER_MM).astype(int)
    fine = 4
    x, y = ((np.arange(fine * count) + 0.5) / (fine * PX_PER_MM) for count in size.tolist())
    dark = np.zeros((len(y), len(x)), dtype=bool)
    for cx, cy, radius in drawn.tolist():
        rows, columns = (np.flatnonzero(np.abs(axis - at) <= radius) for axis, at in ((y, cy), (x, cx)))
        inside = (x[columns] - cx) ** 2 + (y[rows, None] - cy) ** 2 <= radius**2
        dark[np.ix_(rows, columns)] ^= inside
    share = dark[::-1].reshape(size[1], fine, size[0], fine).mean(axis=(1, 3))
    grey = np.pad((255 * (1 - share)).astype(np.uint8), 60, constant_values=255)
    assert detected(grey, design, within_px=0.05) == 1


def test_marks_of_sheets_are_not_cut() -> None:
    """Scale bar, trim marks and the foot's text are for paper: nothing of them is in a cutter's file."""
    design = flat("ico", "dxf")
    (page,) = design.pages
    assert page.drawing.marks
    kinds = {entity.dxftype() for entity in dxf_of(design).modelspace()}
    assert kinds == {"CIRCLE", "POLYLINE"}
    assert MARK_COLOUR == "#000000"  # the triangles at the code corners are engraved with the ink


def test_every_format_is_made() -> None:
    """What options offer has an exporter, and the other way round."""
    assert set(EXPORTERS) == set(FORMATS)


@pytest.mark.parametrize("name", [name for name, entry in FORMATS.items() if entry.guide])
def test_formats_of_other_makers_are_told_on_the_page(name: Format) -> None:
    """A file that goes to a laser or a board house comes with what to do there, which names the file."""
    from designer.app.design_page import other_makers

    kinds = [kind for kind in ("board", "ico") if small(kind).target.form in FORMATS[name].forms]
    for design in (flat(kind, name, page="A4" if kind == "ico" else "fit") for kind in kinds):
        files = make_files(design, lambda _: None)
        section = other_makers(design, files)
        assert section is not None
        told = repr(section)
        mine = [file.name for file in files if file.name.endswith(FORMATS[name].suffix)]
        assert mine
        assert mine[0] in told
        assert mine[-1] in told
        assert FORMATS[name].title[1:] in told
    assert other_makers(flat("board", "pdf"), ()) is None


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"kind": "ico", "formats": "gerber"}, "Gerber is of a plate, and this is a solid; use dxf or laser"),
        ({"kind": "board", "formats": "dxf", "skew_compensation": "xy 0.2deg"}, "DXF is for flat stock, skew"),
        ({"kind": "board", "formats": "laser", "shrink_compensation": "1%"}, "Laser SVG is for flat stock, shrink"),
    ],
)
def test_refusals(values: dict[str, str], message: str) -> None:
    """A format that cannot show the target as it is made is refused, with what to do."""
    kind = values["kind"]
    with pytest.raises(InputError, match=message):
        size_job(asked_for(kind, {**SMALL[kind], **values}))


def test_a_board_larger_than_boards_are_made_is_remarked_upon() -> None:
    """It may be made somewhere: a remark, turned either way, and none where it fits."""

    def remarks(size: str) -> str:
        return " ".join(size_job(asked_for("board", {"size": size, "build": "sheet", "formats": "gerber"})).remarks)

    assert "larger than the usual 400 x 500mm" in remarks("300x510mm")
    assert "larger" not in remarks("490x390mm")
    assert "finest" not in remarks("490x390mm")


def test_strokes_finer_than_a_maker_holds_are_remarked_upon() -> None:
    """Silkscreen holds 0.15 mm, solder mask somewhat less."""
    values = {"columns": 8, "rows": 8, "pitch": "1mm", "build": "sheet", "ring_diameter": "0.5mm"}
    for name, is_said in (("gerber", True), ("gerber-mask", False), ("dxf", False)):
        said = " ".join(size_job(asked_for("board", {**values, "formats": name})).remarks)
        assert ("0.138mm, is below 0.15mm" in said) == is_said
