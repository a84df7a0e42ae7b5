"""The acceptance test: PrusaSlicer slices the files, and its G-code is held against the target."""

import re
import zipfile
from collections.abc import Callable
from functools import partial
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import shapely

from designer.base.arrays import Array, Flags
from designer.formats.threemf import plate_files
from designer.make.bed import Piece, bed_from_target
from designer.make.mesh import Mesh, Part
from designer.make.pattern import FacePattern, Pattern
from designer.produce import Design
from designer.spec.kind import KINDS
from tests.support.designs import ink_of, packages_of, small, small_board, small_ico
from tests.support.gcode import Toolpaths, read_gcode, require_slicer, run_slicer, slice_3mf, slicer_settings

BODY_TOOL, INK_TOOL = 0, 1
INK_FILL = (0.85, 1.1)
"""Ink in the G-code over ink in the model."""
BODY_FILL = (0.95, 1.05)
"""The same of the body, which is sliced at 100 % infill: with less, the figure would say nothing of the shape."""
CONFIG = "Metadata/Slic3r_PE_model.config"

pytestmark = pytest.mark.slicer


def layout_findings(command: str, package: Path) -> list[str]:
    """What is wrong with the object as the slicer understands it; nothing for one object in two filaments."""
    objects = len(re.findall(r"^\[.*\]$", _info(command, package), re.MULTILINE))
    round_trip = package.with_suffix(".round-trip.3mf")
    run_slicer(command, "--export-3mf", "-o", str(round_trip), str(package))
    with zipfile.ZipFile(round_trip) as archive:
        config = archive.read(CONFIG).decode()
    volumes = config.count("<volume ")
    filaments = re.findall(r'type="volume" key="extruder" value="(\d+)"', config)
    findings = []
    if objects != 1 or config.count("<object ") != 1:
        findings.append(f"{objects} objects")
    if volumes != 2:
        findings.append(f"{volumes} volumes")
    if filaments != ["1", "2"]:
        findings.append(f"volumes with the filaments {filaments}")
    return findings


def _info(command: str, package: Path) -> str:
    """One section in square brackets per object, without the log's lines."""
    lines = run_slicer(command, "--info", str(package)).splitlines()
    return "\n".join(line for line in lines if "[trace]" not in line)


def print_findings(design: Design, toolpaths: Toolpaths) -> list[str]:
    """What is wrong with the print: ink outside the target's ink, a face without, volumes out of range."""
    findings = []
    for name, tool, mesh, (low, high) in (
        ("body", BODY_TOOL, design.part.body, BODY_FILL),
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


def ink_faces(design: Design, point_mm: Array) -> Flags:
    """On which faces each point lies within the inlay's depth and inside the ink.  # (F, N)

    Paths run along the middle of their lines, so they lie inside the ink by half a line where it is wide enough,
    and may leave it by an eighth of a line where it is not.
    """
    printing = design.job.printing
    aside = printing.printer.line_width_mm / 8
    above = printing.printer.layer_height_mm / 2
    found = np.zeros((design.target.face_count, len(point_mm)), dtype=bool)
    pattern = design.printed_pattern
    for number, (frame, face) in enumerate(zip(pattern.target_from_face, pattern.faces, strict=True)):
        x, y, z = ((point_mm - frame[:3, 3]) @ frame[:3, :3]).T
        near = np.flatnonzero((z < above) & (z > -printing.inlay_mm - above))
        ink = ink_of_face(pattern, face).buffer(aside)
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


@pytest.mark.parametrize(
    "make",
    [partial(small_ico, 0.2), *(partial(small, name) for name in KINDS if name != "ico")],
    ids=["ico-nozzle-0.2", *(name for name in KINDS if name != "ico")],
)
def test_sliced_file_has_all_ink_in_the_targets_ink(make: Callable[[], Design], tmp_path: Path) -> None:
    """The sliced file is one object in two filaments, and the ink goes where the target has ink, and all of it."""
    command, design = require_slicer(), make()
    package = tmp_path / "target.3mf"
    package.write_bytes(packages_of(design).prusa)
    assert layout_findings(command, package) == []
    assert print_findings(design, sliced(command, design, package)) == []


def without_ranges(design: Design) -> bytes:
    """The package without PrusaSlicer's triangle ranges."""
    return _with_config(design, lambda config: "<config/>")


def with_swapped_filaments(design: Design) -> bytes:
    """Body in the second filament, ink in the first."""
    numbers = {"1": "2", "2": "1"}
    swap = re.compile(r'(key="extruder" value=")(\d)')
    return _with_config(design, lambda config: swap.sub(lambda found: found[1] + numbers[found[2]], config))


def _with_config(design: Design, change: Callable[[str], str]) -> bytes:
    """The package with its slicer settings changed."""
    package = BytesIO()
    with zipfile.ZipFile(BytesIO(packages_of(design).prusa)) as old, zipfile.ZipFile(package, "w") as new:
        for path in old.namelist():
            content = old.read(path)
            new.writestr(path, change(content.decode()) if path == CONFIG else content)
    return package.getvalue()


@pytest.mark.parametrize(
    "wrong",
    [lambda design: packages_of(design).bambu, without_ranges, with_swapped_filaments],
    ids=["components", "one-volume", "swapped"],
)
def test_wrong_layout_fails_both_checks(wrong: Callable[[Design], bytes], tmp_path: Path) -> None:
    """A layout PrusaSlicer misreads is found in its view of the object and in the G-code, though it exits with 0."""
    command, design = require_slicer(), small_board()
    package = tmp_path / "wrong.3mf"
    package.write_bytes(wrong(design))
    assert layout_findings(command, package)
    assert print_findings(design, sliced(command, design, package))


def test_misplaced_ink_fails_the_print_check(tmp_path: Path) -> None:
    """Ink half a millimetre beside its place is found in the G-code, although the layout and volumes are right."""
    command, design = require_slicer(), small_board()
    moved = Mesh(ink_of(design).vertices_mm + np.array([0.5, 0.0, 0.0]), ink_of(design).triangles)
    motion = bed_from_target(design.target, design.job.printing)
    package = tmp_path / "moved.3mf"
    package.write_bytes(
        plate_files((Piece("moved", Part(design.part.body, moved), motion),), design.job.printing).prusa
    )
    assert layout_findings(command, package) == []
    findings = print_findings(design, sliced(command, design, package))
    assert [finding.split(":")[0] for finding in findings] == ["outside the ink"]


def test_reader_counts_only_moves_that_lay_down_material() -> None:
    """Retracts, primes, wipes and travels are no toolpaths; E may be absolute or relative; T changes the tool."""
    toolpaths = read_gcode(
        "M82\nG1 Z0.2 F100\nG1 X1 Y1 E-2 ; wipe\nG92 E0\nG1 E2 ; prime\nG1 X2 E3\nG1 X5\n"
        "T1\nM83\nG1 X6 Y2 E.5 ; comment E9\nG1 E-1\n"
    )
    assert toolpaths.tool.tolist() == [0, 1]
    assert toolpaths.start_mm.tolist() == [[1, 1, 0.2], [5, 1, 0.2]]
    assert toolpaths.end_mm.tolist() == [[2, 1, 0.2], [6, 2, 0.2]]
    assert toolpaths.filament_mm.tolist() == [1, 0.5]
    assert toolpaths.tool_changes == 1
