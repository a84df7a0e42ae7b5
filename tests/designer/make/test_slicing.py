"""The acceptance test: PrusaSlicer slices the files, and its G-code is held against the target."""

import re
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
import shapely

from designer.base.arrays import Array, Flags
from designer.base.solid import Faceted
from designer.builds.design import EXPORTERS, Design
from designer.builds.relief import change_of
from designer.formats.project import files_in_turn, plate_files
from designer.make.bed import Piece, Plate, bed_from_target
from designer.make.mesh import Mesh, Part
from designer.make.pattern import FacePattern, Pattern
from designer.spec.kind import KINDS
from tests.support.designs import COARSE, SMALL, design_of, ink_of, packages_of, small, small_board
from tests.support.gcode import (
    FILAMENT_MM,
    Toolpaths,
    machine_settings,
    one_filament,
    read_gcode,
    require_slicer,
    run_slicer,
    slice_3mf,
    slicer_settings,
)

BODY_TOOL, INK_TOOL = 0, 1
INK_FILL = (0.85, 1.1)
"""Ink in the G-code over ink in the model."""
BODY_FILL = (0.95, 1.05)
"""The same of the body, which is sliced at 100 % infill: with less, the figure would say nothing of the shape."""
CONFIG = "Metadata/Slic3r_PE_model.config"

pytestmark = pytest.mark.slicer


def layout_findings(command: str, package: Path) -> list[str]:
    """What is wrong with the object as the slicer understands it; nothing for one object in two filaments."""
    round_trip = package.with_suffix(".round-trip.3mf")
    run_slicer(command, "--export-3mf", "-o", str(round_trip), str(package))
    with zipfile.ZipFile(round_trip) as archive:
        config = archive.read(CONFIG).decode()
    filaments = re.findall(r'type="volume" key="extruder" value="(\d+)"', config)
    findings = []
    if (objects := config.count("<object ")) != 1:
        findings.append(f"{objects} objects")
    if (volumes := config.count("<volume ")) != 2:
        findings.append(f"{volumes} volumes")
    if filaments != ["1", "2"]:
        findings.append(f"volumes with the filaments {filaments}")
    return findings


def print_findings(design: Design, toolpaths: Toolpaths, body_fill: tuple[float, float] = BODY_FILL) -> list[str]:
    """What is wrong with the print: ink outside the target's ink, a face without, volumes out of range."""
    findings = []
    for name, tool, mesh, (low, high) in (
        ("body", BODY_TOOL, design.part.body, body_fill),
        ("ink", INK_TOOL, ink_of(design), INK_FILL),
    ):
        fill = toolpaths.of_tool(tool).volume_mm3 / mesh.volume_mm3
        if not low <= fill <= high:
            findings.append(f"{name} volume is {fill:.3f} of the model's")
    point = _ink_points_in_target(design, toolpaths.of_tool(INK_TOOL))
    faces = ink_faces(design, point)
    if not faces.any(axis=0).all():
        findings.append(f"outside the ink: {np.count_nonzero(~faces.any(axis=0))} of {len(point)} points")
    if not faces.any(axis=1).all():
        findings.append(f"no ink on faces {np.flatnonzero(~faces.any(axis=1)).tolist()}")
    return findings


def _ink_points_in_target(design: Design, ink: Toolpaths) -> Array:
    """Both ends and the middle of every ink segment, at half the layer's height, where the slicer cuts.  # (N, 3)

    The G-code is centred at the bed's middle, where `bed_from_target` puts the part too.
    """
    printing = design.job.printing
    point = np.concatenate([ink.start_mm, (ink.start_mm + ink.end_mm) / 2, ink.end_mm])
    point = point - [0.0, 0.0, printing.printer.layer_height_mm / 2]
    motion = bed_from_target(design.target, printing)
    return (point - motion[:3, 3]) @ motion[:3, :3]


def ink_faces(design: Design, point_mm: Array, deep_mm: float = 0.0) -> Flags:
    """On which faces each point lies within the inlay's depth and inside the ink.  # (F, N)

    Paths run along the middle of their lines, so they lie inside the ink by half a line where it is wide enough,
    and may leave it by a seventh of a line where it is not.
    """
    printing = design.job.printing
    aside = printing.printer.line_width_mm / 7
    above = printing.printer.layer_height_mm / 2
    found = np.zeros((design.target.face_count, len(point_mm)), dtype=bool)
    pattern, body = design.printed_pattern, design.job.target.body
    for number, (frame, face) in enumerate(zip(pattern.target_from_face, pattern.faces, strict=True)):
        x, y, z = ((point_mm - frame[:3, 3]) @ frame[:3, :3]).T
        near = np.flatnonzero((z < above) & (z > -printing.inlay_mm - above - deep_mm))
        ink = ink_of_face(pattern, face).buffer(aside)
        if isinstance(body, Faceted) and body.is_inward:  # below an edge, borders meet beyond both outlines
            outline = shapely.Polygon(face.outline)
            ink |= outline.buffer(printing.inlay_mm + aside, join_style="mitre") - outline
        shapely.prepare(ink)
        found[number, near] = shapely.contains_xy(ink, x[near], y[near])
    return found


def ink_of_face(pattern: Pattern, face: FacePattern) -> shapely.Geometry:
    """The ink polygons of a face, in its frame."""
    ink = [] if face.window is None else [shapely.Polygon(face.outline, [face.window])]
    for row, position in zip(face.stamp, face.position_mm, strict=True):
        stamp = pattern.stamps[row]
        holes = [] if stamp.hole is None else [stamp.hole + position]
        ink.append(shapely.Polygon(stamp.rim + position, holes))
    ink += [shapely.Polygon(letter) for letter in face.dark_text]
    white = [shapely.Polygon(letter) for letter in face.light_text]
    return shapely.difference(shapely.union_all(ink), shapely.union_all(white))


def sliced(command: str, design: Design, package: Path) -> Toolpaths:
    """Slice a package of this target with its printer's settings."""
    printer = design.job.printing.printer
    center = (printer.bed_mm[0] / 2, printer.bed_mm[1] / 2)
    return slice_3mf(command, package, slicer_settings(printer), center)


FINE: Mapping[str, Mapping[str, object]] = {
    "octahedron": {"edge": "16mm"}, "corner": {"edge": "26mm"}, "tetrahedron": {"edge": "18mm"},
    "ico": {"edge": "14mm"}, "dodecahedron": {"edge": "10mm"}, "dome": {"edge": "14mm"}, "solid": SMALL["solid"],
}  # fmt: skip
"""They have room for an inlay as deep as usual at a fine nozzle; thinner than a line, steep faces take it badly."""


@pytest.mark.parametrize("name", [name for name in KINDS if name != "cube"])
def test_sliced_file_has_all_ink_in_the_targets_ink(name: str, tmp_path: Path) -> None:
    """The sliced file is one object in two filaments, and the ink goes where the target has ink, and all of it."""
    command, design = require_slicer(), small(name)
    if name in FINE:
        design = design_of(name, nozzle="0.2mm", layer_height="0.16mm", chord_error=COARSE, **FINE[name])
    package = tmp_path / "target.3mf"
    package.write_bytes(packages_of(design).prusa)
    assert layout_findings(command, package) == []
    assert print_findings(design, sliced(command, design, package)) == []


@pytest.mark.parametrize("marks", ["chessboard", "charuco"])
def test_squares_and_cells_that_touch_are_printed_whole(marks: str, tmp_path: Path) -> None:
    """A hair between black places that touch, for a sound mesh, leaves no gap: no less ink than of rings."""
    command, more = require_slicer(), {"dictionary": "4x4_50"} if marks == "charuco" else {}
    design = design_of("board", marks=marks, squares="4x3", square="12mm", labels=False, **more)
    package = tmp_path / "target.3mf"
    package.write_bytes(packages_of(design).prusa)
    assert layout_findings(command, package) == []
    assert print_findings(design, sliced(command, design, package)) == []


def test_a_print_at_the_profiles_settings_is_as_estimated(tmp_path: Path) -> None:
    """All ink in a cube's ink; changes to the count, and grams of each slot."""
    command, design = require_slicer(), small("cube")
    printer = design.job.printing.printer
    package = tmp_path / "target.3mf"
    package.write_bytes(packages_of(design).prusa)
    assert layout_findings(command, package) == []
    settings = {**machine_settings(printer), "wipe_tower": "0", "filament_load_time": "0,0"}
    toolpaths = slice_3mf(command, package, settings, (printer.bed_mm[0] / 2, printer.bed_mm[1] / 2))
    assert print_findings(design, toolpaths, body_fill=(0.0, 1.0)) == []
    text = package.with_suffix(".gcode").read_text()
    account = re.search(r"^; filament used \[g\] = (.+)$", text, re.MULTILINE)
    assert account is not None
    body_g, ink_g = (float(mass) for mass in account[1].split(","))
    assert design.estimate.changes == toolpaths.tool_changes
    assert design.estimate.inked_layers == len(set(toolpaths.of_tool(INK_TOOL).end_mm[:, 2].round(3).tolist()))
    assert design.estimate.body_g == pytest.approx(body_g, rel=0.05)
    assert design.estimate.ink_g == pytest.approx(ink_g, rel=0.1)


@pytest.mark.parametrize(("kind", "layers"), [("board", 4), ("cube", 6)])
def test_a_painted_surface_is_printed_in_both_filaments_where_the_target_has_them(
    kind: str, layers: int, tmp_path: Path
) -> None:
    """One mesh: its ink in all solid layers of a flat face, as deep as the design's ink in an upright one.

    A few points in a thousand lie beside, where a layer of an upright face begins or ends a ring.
    """
    command, wishes = require_slicer(), {**SMALL[kind], "chord_error": COARSE, "inlay_depth": "0.8mm"}
    design, package = design_of(kind, **wishes), tmp_path / "target.3mf"
    ((_, content, _),) = EXPORTERS["painted"](design)
    package.write_bytes(content)
    toolpaths = sliced(command, design, package)
    findings = print_findings(design, toolpaths)
    assert [one for one in findings if not one.startswith("outside the ink")] == []
    point = _ink_points_in_target(design, toolpaths.of_tool(INK_TOOL))
    deep_mm = layers * design.job.printing.printer.layer_height_mm - design.job.printing.inlay_mm
    assert ink_faces(design, point, deep_mm).any(axis=0).mean() > 0.995


def test_a_profile_of_one_filament_prints_all_of_it_in_that_one(tmp_path: Path) -> None:
    """What the instructions warn of: PrusaSlicer drops the pattern of a printer with one filament, and exits with 0."""
    command, design = require_slicer(), small_board()
    package, ini, gcode = (tmp_path / name for name in ("target.3mf", "one.ini", "one.gcode"))
    package.write_bytes(packages_of(design).prusa)
    ini.write_text("nozzle_diameter = 0.4\nfilament_diameter = 1.75\nskirts = 0\n")
    run_slicer(command, "--load", str(ini), "--export-gcode", "-o", str(gcode), str(package))
    assert not re.search(r"^T1", gcode.read_text(), re.MULTILINE)


def test_misplaced_ink_fails_the_print_check(tmp_path: Path) -> None:
    """Ink half a millimetre beside its place is found in the G-code, although the layout and volumes are right."""
    command, design = require_slicer(), small_board()
    moved = Mesh(ink_of(design).vertices_mm + np.array([0.5, 0.0, 0.0]), ink_of(design).triangles)
    motion = bed_from_target(design.target, design.job.printing)
    package = tmp_path / "moved.3mf"
    package.write_bytes(
        plate_files(Plate("", (Piece("moved", Part(design.part.body, moved), motion),)), design.job.printing).prusa
    )
    assert layout_findings(command, package) == []
    findings = print_findings(design, sliced(command, design, package))
    assert [finding.split(":")[0] for finding in findings] == ["outside the ink"]


@pytest.mark.parametrize("printer", ["prusa-mk4", "bambu-p1s", "bambu-a1-mini"])
def test_relief_changes_filament_once_below_its_rings(printer: str, tmp_path: Path) -> None:
    """One object, one change in front of the rings' first layer; all ink above it, on ink; time and grams as told."""
    command, design = require_slicer(), design_of(
        "board", **SMALL["board"], build="relief", printer=printer, chord_error=COARSE
    )  # fmt: skip
    profile, takes = design.job.printing.printer, design.estimate
    package, center = tmp_path / "relief.3mf", (profile.bed_mm[0] / 2, profile.bed_mm[1] / 2)
    package.write_bytes(packages_of(design).prusa)
    for settings in (one_filament(slicer_settings(profile)), one_filament(machine_settings(profile))):
        toolpaths = slice_3mf(command, package, settings, center)
        text = package.with_suffix(".gcode").read_text()
        before, *after = re.split(r"^M600$", text, flags=re.MULTILINE)
        change_mm, layer = change_of(design)
        assert len(after) == 1
        assert float(re.findall(r"^;Z:(.+)$", before, re.MULTILINE)[-1]) == pytest.approx(change_mm)
        assert before.count(";LAYER_CHANGE") == layer
        is_ink = toolpaths.end_mm[:, 2] > change_mm - 1e-6
        if settings["fill_density"] == "100%":
            assert volume_mm3(toolpaths, ~is_ink) == pytest.approx(design.part.body.volume_mm3, rel=0.05)
            assert volume_mm3(toolpaths, is_ink) == pytest.approx(ink_of(design).volume_mm3, rel=0.15)
        lies = bed_from_target(design.target, design.job.printing)
        at = np.concatenate([toolpaths.start_mm, toolpaths.end_mm])[np.tile(is_ink, 2)] - lies[:3, 3]
        ink = ink_of_face(design.printed_pattern, design.printed_pattern.faces[0]).buffer(profile.line_width_mm / 7)
        assert shapely.contains_xy(ink, *(at @ lies[:3, :3])[:, :2].T).all()
    seconds, mass_g = told_by_slicer(text)
    assert takes.plates[0].printing_s == pytest.approx(seconds, rel=0.15)
    assert takes.body_g + takes.ink_g == pytest.approx(mass_g, rel=0.05)


@pytest.mark.parametrize("printer", ["prusa-mk4", "generic"])
def test_rings_in_a_file_of_their_own_begin_on_the_plate(printer: str, tmp_path: Path) -> None:
    """Sliced with the files' own settings: a plate of whole height; then rings a layer above it, all of them over it.

    After homing, nothing of the second goes below the plate's top. Both lie where the file of both has them.
    """
    design = design_of("board", **SMALL["board"], build="relief", printer=printer, chord_error=COARSE)
    job, lies = design.job, bed_from_target(design.target, design.job.printing)
    layer_mm, (change_mm, _) = job.printing.printer.layer_height_mm, change_of(design)
    files = files_in_turn(design.plates[0], job.printing, design.thumbnails[0])
    paths, texts = [], []
    for name, content in zip(("body", "pattern"), files, strict=True):
        (package := tmp_path / f"{name}.3mf").write_bytes(content)
        gcode = package.with_suffix(".gcode")
        run_slicer(require_slicer(), "--dont-arrange", "--export-gcode", "-o", str(gcode), str(package))
        texts.append(gcode.read_text())
        paths.append(read_gcode(re.split(r"^G28.*$", texts[-1], maxsplit=1, flags=re.MULTILINE)[1]))
    plate, rings = paths
    assert plate.end_mm[:, 2].max() == pytest.approx(change_mm - layer_mm)
    assert rings.end_mm[0, 2] == rings.end_mm[:, 2].min() == pytest.approx(change_mm)
    assert rings.end_mm[:, 2].max() == pytest.approx(change_mm - layer_mm + job.printing.inlay_mm)
    homed = re.split(r"^G28.*$", texts[1], flags=re.MULTILINE)[1]
    heights = [float(z) for z in re.findall(r"^G[01] .*?Z([-\d.]+)", homed, re.MULTILINE)]
    assert min(heights) >= change_mm - 1e-6
    assert re.findall(r"^G[01] ([XYZ])", homed, re.MULTILINE)[0] == "Z"  # up, before it goes sideways
    ink = ink_of_face(design.printed_pattern, design.printed_pattern.faces[0])
    at = (np.concatenate([rings.start_mm, rings.end_mm]) - lies[:3, 3]) @ lies[:3, :3]
    line_mm = job.printing.printer.line_width_mm
    assert shapely.contains_xy(ink.buffer(line_mm / 8), *at[:, :2].T).all()
    laid = shapely.union_all(shapely.points(at[:, :2])).buffer(2 * line_mm)
    assert all(laid.intersects(part) for part in ink.geoms)
    assert volume_mm3(rings, np.ones(len(rings.tool), dtype=bool)) == pytest.approx(ink_of(design).volume_mm3, rel=0.15)


def volume_mm3(toolpaths: Toolpaths, which: Flags) -> float:
    """What some of the moves lay down."""
    return float(toolpaths.filament_mm[which].sum()) * np.pi * FILAMENT_MM**2 / 4


def told_by_slicer(gcode: str) -> tuple[float, float]:
    """Seconds and grams."""
    said = re.search(r"estimated printing time \(normal mode\) = (.+)", gcode)
    mass = re.search(r"; filament used \[g\] = ([\d.]+)", gcode)
    assert said is not None
    assert mass is not None
    size = {"h": 3600, "m": 60, "s": 1}
    return sum(int(count) * size[unit] for count, unit in re.findall(r"(\d+)([hms])", said[1])), float(mass[1])


def test_grooves_are_open_above_and_closed_below(tmp_path: Path) -> None:
    """A recessed board prints as much as it has, nothing in its grooves, and all below them."""
    command, design = require_slicer(), design_of("board", **SMALL["board"], build="recessed", chord_error=COARSE)
    profile, lies = design.job.printing.printer, bed_from_target(design.target, design.job.printing)
    (package := tmp_path / "recessed.3mf").write_bytes(packages_of(design).prusa)
    center = (profile.bed_mm[0] / 2, profile.bed_mm[1] / 2)
    paths = slice_3mf(command, package, one_filament(slicer_settings(profile)), center)
    assert paths.tool_changes == 0
    assert volume_mm3(paths, np.ones(len(paths.tool), dtype=bool)) == pytest.approx(
        design.part.body.volume_mm3, rel=0.05
    )
    grooves = ink_of_face(design.printed_pattern, design.printed_pattern.faces[0]).buffer(-profile.line_width_mm / 2)
    start, end = ((at - lies[:3, 3]) @ lies[:3, :3] for at in (paths.start_mm, paths.end_mm))
    lines = shapely.linestrings(np.stack([start[:, :2], end[:, :2]], axis=1))
    layer_mm, depth_mm = profile.layer_height_mm, design.job.printing.inlay_mm
    shapely.prepare(grooves)
    assert not shapely.intersects(grooves, lines[end[:, 2] > -depth_mm + layer_mm / 2]).any()
    floor = shapely.buffer(lines[np.abs(end[:, 2] + depth_mm) < layer_mm / 2], 0.55 * profile.line_width_mm)
    assert shapely.union_all(floor).intersection(grooves).area == pytest.approx(grooves.area, rel=0.01)
