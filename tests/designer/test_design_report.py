"""The design folder's page: what it says follows from the design, and nothing on it is said twice differently."""

import inspect
import itertools
import math
import re
import shlex
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser
from shapely import MultiPoint

from calib.app.inputs import load_camera
from calib.app.render import render
from calib.measure_target.lengths import asked_length, length_in
from calib.renderer.faces import ring_truth
from calib.renderer.poses import PoseGrid, grid_poses
from calib.renderer.scene import scene_from_target
from designer.app.costs import BuildCosts, Costs, cost_fold
from designer.app.design_page import DOT, code_blocks, design_page, headline, page_file
from designer.app.measuring import (
    READING,
    SIMULATED_CAMERA,
    caliper_lengths,
    corner_rings,
    example_length,
    simulated_line,
    skew_effect_mm,
    skew_per_mm_deg,
)
from designer.app.stands import stand_section, trial_sections
from designer.base.codes import CODES, TRIANGLE_POSITIONS
from designer.base.errors import InputError
from designer.base.units import skew_matrix
from designer.builds.design import Design, make_files
from designer.builds.slicing import BODY_SLOT, INK_SLOT, SLICERS, usual_slicer
from designer.formats.folder import OutputFile, write_folder
from designer.kinds.ico import icosahedron
from designer.kinds.layout import IMAGE_HALF_DIAGONAL, IMAGE_HALF_HEIGHT, opposite_faces
from designer.kinds.sizing import size_job
from designer.make.bed import bed_from_target
from designer.make.estimate import DENSITY_G_PER_CM3, PlateEstimate, PrintEstimate, duration
from designer.make.printability import PrintCheck, PrintFinding, check_printability
from designer.make.stand import make_stand, stand_from_target
from designer.page.blocks import (
    Block,
    Command,
    Facts,
    Figure,
    FileList,
    Fold,
    Leaf,
    Page,
    Paragraph,
    Steps,
    Table,
    View3d,
)
from designer.page.page_file import PAGE_FILE
from designer.page.scene import Rings, Surface
from designer.spec.options import Asked
from designer.spec.spec import PAPER_LINE_MM, Price
from designer.target import bounding_radius_mm
from designer.target_scene import polygon_area_mm2
from tests.support.browser import open_page, overflow_px, unresolved
from tests.support.designs import COARSE, asked_for, design_of

_LETTERED = {"size": "60x60mm", "columns": 5, "rows": 5, "ring_diameter": "7mm", "pitch": "10mm"}
SPECS: dict[str, Asked] = {
    "ico": asked_for("ico", {"edge": "20mm", "chord_error": COARSE}),
    "board": asked_for("board", {**_LETTERED, "chord_error": COARSE}),
    "stickers": asked_for("ico", {"edge": "30mm", "build": "stickers", "chord_error": COARSE}),
    "sheet": asked_for("board", {"size": "200x150mm", "build": "sheet", "dots": False}),
    "sheared": asked_for("ico", {
        "edge": "40mm", "chord_error": COARSE, "printer": "prusa-mk4", "body_colour": "#f5f5f0", "stand": True,
        "ink_offset": "-20um", "shrink_compensation": "0.4%", "skew_compensation": "xy 0.1deg, xz -0.05deg",
    }),
}  # fmt: skip
BUILDS = tuple(SPECS)


@cache
def made(build: str) -> tuple[Design, PrintCheck, tuple[OutputFile, ...]]:
    """A design, its check and its files, as the command makes them."""
    design = Design(size_job(SPECS[build]).job)
    check = check_printability(design.target, design.job.printing)
    return design, check, make_files(design, lambda stage: None)


@cache
def page_of(build: str) -> Page:
    return design_page(*made(build))


def leaves(page: Page) -> Iterator[Leaf]:
    """All blocks of a page, those in folds too."""

    def inside(block: Block) -> Iterator[Leaf]:
        yield from block.blocks if isinstance(block, Fold) else (block,)

    for block in (*page.lead, *(block for section in page.sections for block in section.blocks)):
        yield from inside(block)


def words(page: Page) -> str:
    """All steps, paragraphs, table cells and commands of a page."""
    parts: list[str] = []
    for leaf in leaves(page):
        if isinstance(leaf, Steps):
            parts += leaf.items
        elif isinstance(leaf, Table):
            parts += [cell.text for row in leaf.rows for cell in row]
        elif isinstance(leaf, Paragraph):
            parts.append(leaf.text)
        elif isinstance(leaf, Command):
            parts += [leaf.line, leaf.purpose]
    return "\n".join(parts)


@pytest.mark.parametrize("build", BUILDS)
def test_every_file_is_listed_with_its_size(build: str) -> None:
    """The list holds every other file of the folder, with its size, and nothing else; the page is below 2.5 MB."""
    files = made(build)[2]
    assert len(page_file(page_of(build)).content) < 2_500_000
    (listed,) = [leaf for leaf in leaves(page_of(build)) if isinstance(leaf, FileList)]
    assert [(row.path, row.size_bytes) for row in listed.rows] == [(f.name, len(f.content)) for f in files]


@pytest.mark.parametrize("build", BUILDS)
def test_files_named_in_words_exist(build: str) -> None:
    """Every NAME.something in steps and commands is a file of the folder: no build is told to open another's files."""
    design, _, files = made(build)
    named = re.findall(rf"\b{re.escape(design.job.name)}(?:\.\w+)+", words(page_of(build)))
    assert named
    assert set(named) <= {file.name for file in files}


@pytest.mark.parametrize(("build", "most"), [("ico", 1301), ("board", 1010)])
def test_a_page_has_half_the_words_that_it_once_had(build: str, most: int) -> None:
    """All that stands between tags, folded or not; on 2026-11-25 it was twice that."""
    text = page_file(page_of(build)).content.decode()
    text = re.sub(r"(?s)<(script|style|head).*?</\1>|<[^>]+>", " ", text)
    assert len(text.split()) <= most


def test_caliper_lengths_are_distances_in_the_geometry() -> None:
    """Each length that `calib measure` knows is, to the micrometre, the one it finds in the target file."""
    for build in BUILDS:
        design = made(build)[0]
        measured = [one for one in caliper_lengths(design) if one.option]
        assert measured
        for one in measured:
            assert one.length_mm == pytest.approx(length_in(design.target, one.option), abs=1e-6)


def test_icosahedron_has_ten_pairs_of_faces_two_inradii_apart() -> None:
    """All ten pairs are listed, no face twice, and each lies 2 r = 1.5115 a apart; one of them stands upright."""
    design = made("ico")[0]
    pairs = opposite_faces(design.target)
    assert sorted(face for pair in pairs for face in pair) == list(range(20))
    lengths = caliper_lengths(design)
    assert [one.length_mm for one in lengths] == pytest.approx([2 * icosahedron().inradius * 20] * 10)
    assert [one.what for one in lengths if one.is_upright] == ["face 2 to face 19"]


def test_corner_rings_are_the_outermost() -> None:
    """The convex hull of the four corner rings holds every ring's centre, and their lengths are the lattice's."""
    target = made("sheet")[0].target
    corners = target.center_in_face_mm[list(corner_rings(target)), :2]
    step = np.roll(corners, -1, axis=0) - corners
    to_ring = target.center_in_face_mm[:, None, :2] - corners
    assert (step[:, 0] * to_ring[..., 1] - step[:, 1] * to_ring[..., 0] > -1e-9).all()


def test_skew_figures_agree_with_a_sheared_target() -> None:
    """A skew of 0.3 deg changes diagonals and pairs of faces by what the page says, to a few per cent of it."""
    angle = math.radians(0.3)
    board = made("sheet")[0].target
    matrix = skew_matrix((angle, 0.0, 0.0))[:2, :2]
    a, b, c, d = board.center_in_face_mm[list(corner_rings(board)), :2] @ matrix.T
    difference = abs(np.linalg.norm(c - a) - np.linalg.norm(d - b))
    assert difference * skew_per_mm_deg(board) == pytest.approx(0.3, rel=0.02)

    design = made("ico")[0]
    skews = ((angle, 0.0, 0.0), (0.0, angle, 0.0), (0.0, 0.0, angle))
    worst = max(abs(change) for skew in skews for change in pair_changes_mm(design, skew))
    assert skew_effect_mm(design, angle) == pytest.approx(worst, rel=0.02)


def pair_changes_mm(design: Design, skew: tuple[float, float, float]) -> list[float]:
    """By how much a printer of this skew changes the distance of each pair of faces, from the sheared corners."""
    to_bed = bed_from_target(design.target, design.job.printing)[:3, :3]
    frame, outline = design.target.target_from_face, design.target.outline_mm
    corners = np.einsum("fij,fkj->fki", frame[:, :3, :2], outline) + frame[:, None, :3, 3]
    made_corners = corners @ to_bed.T @ skew_matrix(skew).T
    changes = []
    for first, second in opposite_faces(design.target):
        normal = np.cross(*(made_corners[first, 1:] - made_corners[first, :1]))
        normal /= np.linalg.norm(normal)
        distance = abs(normal @ (made_corners[first, 0] - made_corners[second, 0]))
        changes.append(float(distance - 2 * icosahedron().inradius * 20))
    return changes


@pytest.mark.parametrize("build", BUILDS)
def test_example_length_is_read_by_calib_measure(build: str) -> None:
    """The length in the commands is refused as it stands, in a line that asks for a reading, and taken with one.

    No command on the page holds a length that nobody measured.
    """
    lines = [leaf.line for leaf in leaves(page_of(build)) if isinstance(leaf, Command) and "calib measure" in leaf.line]
    assert len(lines) == 2
    assert all(re.search(r'length "[a-z0-9 -]+:READINGmm', line) for line in lines)
    design = made(build)[0]
    text = example_length(design)
    with pytest.raises(InputError, match="put your reading in place of 'READINGmm'") as refusal:
        asked_length("--length", text, design.target)
    assert "\n" not in str(refusal.value)
    name = text.split(":")[0]
    reading = 1.001 * length_in(design.target, name)
    asked = asked_length("--length", text.replace(READING, f"{reading:.2f}"), design.target)
    assert (asked.name, asked.sigma_mm) == (name, 0.02)
    assert asked.value_mm == pytest.approx(reading, abs=0.005001)


def test_a_large_icosahedron_has_lengths_within_reach() -> None:
    """Where no two opposite faces are within a caliper's reach, the sides of the face on top are given.

    They are the longest rows of that face, within reach over their outer edges, and the commands name one of them.
    """
    design = design_of("ico", edge="100mm")
    target = design.target
    lengths = caliper_lengths(design)
    assert [one.is_long for one in lengths] == [True] * 10 + [False] * 3
    up = bed_from_target(target, design.job.printing)[2, :3]
    pairs = [tuple(map(int, re.findall(r"ring (\d+)", one.option))) for one in lengths[10:]]
    assert len({frozenset(pair) for pair in pairs}) == 3
    for first, second in pairs:
        face = target.ring_face[first]
        assert target.ring_face[second] == face
        assert target.target_from_face[face, :3, 2] @ up == pytest.approx(1)
        on_face = target.center_mm[target.ring_face == face]
        longest = np.linalg.norm(on_face[:, None] - on_face, axis=2).max()
        assert np.linalg.norm(target.center_mm[first] - target.center_mm[second]) == pytest.approx(longest)
    assert example_length(design).startswith("ring ")


def test_photos_come_before_what_needs_them() -> None:
    """The page takes the photos and finds the rings before it measures the print with them."""
    for build in BUILDS:
        lines = [leaf.line for leaf in leaves(page_of(build)) if isinstance(leaf, Command)]
        (run,) = [n for n, line in enumerate(lines) if re.search(r"^calib run \S+ photos -o camera$", line)][:1]
        (use,) = [n for n, line in enumerate(lines) if "camera/detections.csv" in line]
        assert run < use


@pytest.mark.parametrize(
    "asked",
    [
        asked_for("ico", {"edge": "20mm"}),
        asked_for("ico", {"edge": "100mm"}),
        asked_for("ico", {"edge": "133mm", "build": "stickers"}),
        asked_for("board", {"size": "200x200mm"}),
        asked_for("board", {"size": "400x300mm", "build": "sheet"}),
    ],
)
def test_simulated_photos_cover_the_image(asked: Asked) -> None:
    """The rings of the simulated photos that the page offers surround three quarters of the image.

    A board shows many of its rings in each, so that it can be named.
    """
    design = Design(size_job(asked).job)
    words = shlex.split(simulated_line(design))
    option = dict(itertools.pairwise(words))
    near, far = (float(part.removesuffix("mm")) for part in option["--distance"].split(".."))
    cap = math.radians(float(option.get("--cap-angle", "180deg").removesuffix("deg")))
    aside = float(option["--aim-offset"].removesuffix("mm"))
    grid = PoseGrid(int(option["--views"]), cap, (near, far), "--random-roll" in words, aside)
    assert near > bounding_radius_mm(design.target) + aside  # else calib render refuses
    camera, scene = load_camera(SIMULATED_CAMERA), scene_from_target(design.target)
    truths = [ring_truth(scene, camera, pose) for pose in grid_poses(grid, np.random.default_rng(0))]
    seen = [truth.center_px[truth.whole & (truth.incidence_rad < math.radians(65))] for truth in truths]
    assert MultiPoint(np.concatenate(seen)).convex_hull.area >= 0.75 * math.prod(camera.image_size)
    if design.target.face_count == 1:
        assert np.median([len(rings) for rings in seen]) > 0.9 * design.target.ring_count
        assert min(len(rings) for rings in seen) > 0.3 * design.target.ring_count


def test_the_simulated_camera_is_the_one_that_is_rendered() -> None:
    """Angles of view and name are those of the default of `calib render`."""
    assert inspect.signature(render).parameters["camera"].default == SIMULATED_CAMERA
    camera = load_camera(SIMULATED_CAMERA)
    width, height = camera.image_size
    focal_px = camera.params[0]
    assert pytest.approx(height / 2 / focal_px, rel=1e-3) == IMAGE_HALF_HEIGHT
    assert pytest.approx(math.hypot(width, height) / 2 / focal_px, rel=1e-3) == IMAGE_HALF_DIAGONAL


@pytest.mark.parametrize(
    ("shape", "reach_mm"),
    [
        ({"columns": 3, "rows": 3, "pitch": "10mm"}, 150.0),
        ({"columns": 3, "rows": 3, "pitch": "200mm", "ring_diameter": "10mm"}, math.inf),
        ({"columns": 41, "rows": 31, "pitch": "10mm", "ring_diameter": "8mm"}, 150.0),
    ],
)
def test_a_caliper_reaches_the_example(shape: dict[str, str | int], reach_mm: float) -> None:
    """The length of the commands is within a caliper's reach, over the rings' outer edges, if the board has such."""
    design = design_of("board", build="sheet", dots=False, **shape)
    target, name = design.target, example_length(design).split(":")[0]
    assert length_in(target, name) + 2 * target.radius_outer_mm[0] <= reach_mm


def test_commands_have_only_options_that_exist() -> None:
    """Every option of every command on the pages is one of that command's."""
    import typer

    from calib.cli import app as calib
    from designer.cli import app as design

    groups = {"calib": typer.main.get_command(calib()), "design": typer.main.get_command(design())}
    for build in BUILDS:
        for leaf in leaves(page_of(build)):
            if not isinstance(leaf, Command):
                continue
            program, name, *rest = leaf.line.split()
            command = groups[program].commands[name]  # type: ignore[attr-defined]  # a group has them
            known = {option for parameter in command.params for option in parameter.opts}
            assert {word for word in rest if re.match(r"--?[a-z]", word)} <= known, leaf.line


def test_slots_are_those_of_the_3mf_files() -> None:
    """Body and ink are in the slots that the instructions name, in both packages."""
    files = {file.name: file.content for file in made("board")[2]}
    for name, config in (("prusa", "Slic3r_PE_model"), ("bambu", "model_settings")):
        (package,) = [content for file, content in files.items() if file.endswith(f".{name}.3mf")]
        with zipfile.ZipFile(BytesIO(package)) as archive:
            text = archive.read(f"Metadata/{config}.config").decode()
        pairs = re.findall(r'key="name" value="(body|ink)"/>.*?key="extruder" value="(\d)"', text, re.DOTALL)
        assert pairs == [("body", str(BODY_SLOT)), ("ink", str(INK_SLOT))]


def test_the_printers_own_slicer_comes_first_and_open() -> None:
    """Prusa's printers get PrusaSlicer's steps first, others Bambu Studio's; the others are closed."""
    for build, first in (("board", "Bambu Studio, OrcaSlicer"), ("sheared", "PrusaSlicer")):
        design = made(build)[0]
        assert usual_slicer(design.job.printing.printer) == first
        (making,) = [section for section in page_of(build).sections if section.title == "Making it"]
        folds = [block for block in making.blocks if isinstance(block, Fold)]
        assert [fold.is_open for fold in folds] == [True, False]
        assert folds[0].title == f"In {first}"
        others = [block.text for block in folds[1].blocks if isinstance(block, Paragraph)]
        assert {text.partition(":")[0] for text in others} == {one.title for one in SLICERS} - {first}


def test_compensation_is_said_where_it_is_in_the_files() -> None:
    """A sheared, enlarged print says both, and not to turn or scale it; another says neither."""
    sheared, plain = words(page_of("sheared")), words(page_of("ico"))
    assert "+0.4 %" in sheared
    assert '--shrink-compensation 0.4% --skew-compensation "xy 0.1deg, xz -0.05deg"' in sheared
    assert "sheared" not in plain
    assert "+0.4" not in plain


def test_headline_says_the_worst_of_the_check() -> None:
    """No warnings: printable; warnings: with care, and which rules warn; a violation, if ever: not printable."""
    assert headline(made("board")[0].job.printing, made("board")[1]).word == "printable"
    design, check, _ = made("ico")
    careful = headline(design.job.printing, check)
    assert (careful.level, careful.word) == ("usable", "printable with care")
    assert "ring stroke" in careful.sentence
    broken = replace(check, findings=(*check.findings, PrintFinding("bed", "violation", "too large")))
    told = headline(design.job.printing, broken)
    assert (told.level, told.sentence) == ("bad", "too large")


@pytest.mark.parametrize("build", BUILDS)
def test_every_rule_that_applies_is_shown_once(build: str) -> None:
    """Findings and holding rules are each on the page; widths that hold are above the limit shown, others below."""
    design, check, _ = made(build)
    shown = check.told().rows
    assert len(shown) == len({finding.rule for finding in check.findings} | set(check.holding))
    printing = design.job.printing
    good_mm = 2 * (printing.printer.line_width_mm if printing.way.is_two_filament else PAPER_LINE_MM)
    for rule in {"stroke", "centre", "gap", "margin", "border"} & check.looks.keys():
        width_mm = float(check.looks[rule].measured.removesuffix(" mm"))
        if rule in check.holding:
            assert width_mm >= good_mm - 1e-6
        elif any(rule in finding.rules for finding in check.findings):
            assert width_mm < good_mm


def test_code_table_shows_the_dots_of_the_target() -> None:
    """Read off the table, the dots of each face are those of the geometry."""
    target = made("ico")[0].target
    (table,) = [leaf for leaf in code_blocks(made("ico")[0]) if isinstance(leaf, Table)]
    assert len(table.rows) == 20
    for face, row in enumerate(table.rows):
        mine = target.ring_face == face
        dots = {(int(i), int(j)) for i, j in target.ring_index[mine & target.is_dot]}
        assert dots == CODES[int(target.face_code[face])]
        drawn = row[1].text.replace("/", "")
        assert {TRIANGLE_POSITIONS[k] for k, mark in enumerate(drawn) if mark == DOT} == dots


@pytest.mark.parametrize("build", BUILDS)
def test_scene_shows_what_is_printed(build: str) -> None:
    """Every ring is in the scene, and the area of letters is that of the printed ones at the design's size."""
    design = made(build)[0]
    view = page_of(build).lead[0]
    assert isinstance(view, View3d)
    shapes = [shape for layer in view.scene.layers for shape in layer.shapes]
    assert sum(len(shape.center_mm) for shape in shapes if isinstance(shape, Rings)) == design.target.ring_count
    two_filament = design.job.printing.way.is_two_filament
    pattern = design.printed_pattern if two_filament else design.artwork
    letters = [contour for face in pattern.faces for contour in (*face.dark_text, *face.light_text)]
    printed_mm2 = sum(abs(polygon_area_mm2(contour)) for contour in letters)
    scale = design.scale if two_filament else 1.0
    layers = [layer for layer in view.scene.layers if layer.name == "printed letters"]
    shown_mm2 = sum(surface_area_mm2(s) for layer in layers for s in layer.shapes if isinstance(s, Surface))
    assert shown_mm2 == pytest.approx(printed_mm2 / scale**2, rel=1e-6)
    if build == "board":
        assert shown_mm2 > 0


def surface_area_mm2(surface: Surface) -> float:
    a, b, c = (surface.vertices_mm[surface.triangles[:, k]] for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def test_page_without_a_preview_has_no_poster() -> None:
    """Without the PNG file the page is made all the same."""
    design, check, files = made("ico")
    page = design_page(design, check, [file for file in files if not file.name.endswith(".png")])
    (view,) = [leaf for leaf in leaves(page) if isinstance(leaf, View3d)]
    assert view.poster is None


def test_pages_open_in_a_browser(tmp_path: Path, browser: Browser) -> None:
    """From disk, without trouble, every link and picture resolves and nothing is wider than a phone."""
    for build in ("stickers", "board"):
        folder = tmp_path / build
        write_folder(folder, (*made(build)[2], page_file(page_of(build))))
        with open_page(browser, folder / PAGE_FILE, width=390) as page:
            assert unresolved(page, folder / PAGE_FILE) == []
            assert overflow_px(page) == 0


@pytest.mark.parametrize("asked", [SPECS["sheared"], asked_for("board", {"size": "120x90mm", "stand": True})])
def test_a_stand_is_shown_under_the_target_with_size_and_weight(asked: Asked) -> None:
    """The page tells the stand's box, a weight below solid plastic's, and draws it where it carries the target."""
    design = Design(size_job(asked).job)
    stand = make_stand(design.target, design.job.printing)
    view, facts = stand_section(design).blocks
    assert isinstance(view, View3d)
    assert isinstance(facts, Facts)
    told = dict(facts.rows)
    assert told["size"] == " x ".join(f"{length:.0f}" for length in np.ptp(stand.vertices_mm, axis=0)) + " mm"
    solid_g = stand.volume_mm3 / 1000 * DENSITY_G_PER_CM3
    assert 0.3 * solid_g < float(told["weight"].removesuffix(" g")) <= 1.02 * solid_g
    (drawn,) = [shape for layer in view.scene.layers if layer.name == "stand" for shape in layer.shapes]
    assert isinstance(drawn, Surface)
    motion = stand_from_target(design.target)
    in_stand_mm = drawn.vertices_mm @ motion[:3, :3].T + motion[:3, 3]
    assert in_stand_mm[:, 2].min() == pytest.approx(0.0, abs=1e-6)
    assert in_stand_mm * design.scale == pytest.approx(stand.vertices_mm, abs=1e-6)
    assert np.array(view.scene.up) == pytest.approx(motion[2, :3], abs=1e-9)


def test_a_page_tells_of_a_stand_where_there_is_one() -> None:
    """The section is on the page of a design with a stand, and on no other."""
    for build in ("sheared", "ico"):
        titles = [section.title for section in page_of(build).sections]
        assert ("The stand" in titles) == made(build)[0].job.printing.stand


def test_what_a_plate_takes_is_told_below_its_picture_alone() -> None:
    """Each plate's hours and changes once: two would differ by rounding."""
    design = design_of("cube", edge="40mm", build="tiles", chord_error=COARSE)
    page = design_page(design, check_printability(design.target, design.job.printing), ())
    captions = [leaf.caption for leaf in leaves(page) if isinstance(leaf, Figure) and leaf.title.startswith("Plate")]
    for plate, caption in zip(design.estimate.plates, captions, strict=True):
        assert caption.startswith(f"{duration(plate.time_s)}, ")
        assert (f"{plate.changes} changes" in caption) == bool(plate.inked_layers)


def test_lengths_of_filament_are_plain_numbers() -> None:
    """220 m, not 2.2e+02 m."""
    printing = made("ico")[0].job.printing
    plate = PlateEstimate("", 1, 1, 1, 1.0, 1.0, 1.0, 530e3, 20e3, 1e3)
    own = BuildCosts("one-piece", True, PrintEstimate((plate,), printing.printer.machine, Price(25.0)))
    (slots,) = (block for block in cost_fold(Costs(own, ()), printing).blocks if isinstance(block, Facts))
    assert [value.rpartition(", ")[2] for _, value in slots.rows[:3]] == ["220 m", "8.3 m", "0.42 m"]


def test_a_coupon_is_no_fault_and_leads_to_calib_coupon() -> None:
    """Its fine marks are not warned of, those below a line are; what follows is `calib coupon` with its options."""
    design = design_of("coupon", ink_offset="-30um")
    check = check_printability(design.target, design.job.printing)
    assert not [finding for finding in check.findings if finding.level != "note"]
    lines = [leaf.line for part in trial_sections(design) for leaf in part.blocks if isinstance(leaf, Command)]
    assert lines[0].startswith("calib coupon coupon.jpg --length")
    assert all(" --ink-offset -0.03mm --printer bambu-p1s --save " in line for line in lines[:2])
    fine = size_job(asked_for("coupon", {"nozzle": "0.2mm"})).job.printing
    assert (design.job.printing.inlay_mm, fine.inlay_mm, fine.printer.layer_height_mm) == (0.2, 0.2, 0.1)  # opaque
    wide = replace(design.job.printing, printer=replace(design.job.printing.printer, line_width_mm=0.7))
    assert "one line" in check_printability(design.target, wide).findings[0].text
