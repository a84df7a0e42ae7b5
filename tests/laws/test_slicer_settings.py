"""What a page tells of a print is in the files that slicers open, for every printer and every build of plastic."""

import io
import json
import re
import zipfile
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from shapely import MultiPoint, box

from designer.builds.design import Design
from designer.builds.slicing import print_settings
from designer.formats.project import PRIME_MM3, PlateFiles, plate_files
from designer.kinds.presets import preset_names
from designer.make.bed import Plate
from tests.support.designs import SMALL, design_of
from tests.support.gcode import read_gcode, require_slicer, run_slicer

WAYS = [
    *((printer, "one-piece") for printer in preset_names("printers")),
    *((printer, build) for build in ("relief", "tiles") for printer in ("bambu-p1s", "prusa-mk4s")),
]
each_way = pytest.mark.parametrize(("printer", "build"), WAYS)


@cache
def made(printer: str, build: str) -> tuple[Design, Plate, PlateFiles]:
    """A small target, its first plate and the files of it."""
    kind, wishes = ("cube", {"edge": "40mm", "mount": "none"}) if build == "tiles" else ("board", SMALL["board"])
    target = design_of(kind, **{**wishes, "printer": printer, "build": build, "chord_error": "0.2mm"})
    return target, target.plates[0], plate_files(target.plates[0], target.job.printing)


def told(target: Design) -> Mapping[str, str]:
    """The page's table of settings."""
    table = print_settings(target, target.job.printing.printer.machine.shells, "")
    return {str(name.text): str(value.text) for name, value in table.rows}


def numbers(text: str) -> list[float]:
    """All that are in a sentence, in their order."""
    return [float(one) for one in re.findall(r"(?<![\w.])\d+(?:\.\d+)?", text)]


def config_of(package: bytes) -> dict[str, str]:
    """PrusaSlicer's settings, by the form in which it writes and reads them."""
    with zipfile.ZipFile(io.BytesIO(package)) as archive:
        lines = archive.read("Metadata/Slic3r_PE.config").decode().splitlines()
    assert all(line.startswith("; ") for line in lines if line)
    return dict(cast("tuple[str, str]", line[2:].split(" = ", 1)) for line in lines if " = " in line)


def project_of(package: bytes) -> dict[str, str | list[str]]:
    """Settings of Bambu Studio and OrcaSlicer; none of a package of geometry."""
    with zipfile.ZipFile(io.BytesIO(package)) as archive:
        path = "Metadata/project_settings.config"
        text = archive.read(path) if path in archive.namelist() else b"{}"
    return cast("dict[str, str | list[str]]", json.loads(text))


@each_way
def test_values_told_on_the_page_are_those_of_prusaslicers_settings(printer: str, build: str) -> None:
    """Nozzle, lines, layers, walls, infill, what is off, colours; the bed and the purge of the printer's profile."""
    target, _, files = made(printer, build)
    page, found, profile = told(target), config_of(files.prusa), target.job.printing.printer
    *_, nozzle, line = numbers(page["printer"])
    count = 1 if build == "relief" else 2  # of filaments that are loaded at a time
    assert found["nozzle_diameter"] == ",".join([f"{nozzle:g}"] * count)
    assert {float(found[key]) for key in found if key.endswith("extrusion_width")} == {line}
    assert {float(found[key]) for key in ("layer_height", "first_layer_height")} == {numbers(page["layer height"])[0]}
    shells = ["perimeters", "bottom_solid_layers", "top_solid_layers", "fill_density"]
    values = [float(found[key].rstrip("%")) for key in shells]
    assert values[: len(numbers(page["walls, infill"]))] == numbers(page["walls, infill"])
    assert found["filament_colour"].lower().split(";") == re.findall(r"#\w{6}", page["filaments"])[:count]
    assert page["supports"].startswith("off") == (found["support_material"] == "0")
    assert page["ironing"].startswith("off") == (found["ironing"] == "0")
    assert "compensation 0" in page["outline"]
    assert found["xy_size_compensation"] == found["elefant_foot_compensation"] == "0"
    assert found["bed_shape"].split(",")[2] == "x".join(f"{side:g}" for side in profile.bed_mm[:2])
    if count == 1:
        assert found["wipe_tower"] == "0"
        return
    purge = np.array(found["wiping_volumes_matrix"].split(","), dtype=float)
    wanted = [0.0, profile.machine.change.purge_to_ink_mm3, profile.machine.change.purge_to_body_mm3, 0.0]
    if build == "tiles" and sum(wanted) > 500:  # of a printer with a chute, more than the tower's place takes
        assert (purge <= wanted).all()
        assert purge[1] / purge[2] == pytest.approx(wanted[1] / wanted[2], rel=0.01)
    else:
        assert purge == pytest.approx(np.array(wanted), rel=1e-3)


@each_way
def test_values_told_on_the_page_are_those_of_the_project(printer: str, build: str) -> None:
    """The same of Bambu Studio and OrcaSlicer, where there are presets; each is named as different from them."""
    target, _, files = made(printer, build)
    page, found, presets = told(target), project_of(files.bambu), target.job.printing.printer.presets
    assert (presets is not None) == bool(found)
    if presets is None:
        return
    *_, nozzle, line = numbers(page["printer"])
    assert found["nozzle_diameter"] == [f"{nozzle:g}"]
    assert {float(cast("str", found[key])) for key in found if key.endswith("line_width")} == {line}
    layers = {float(cast("str", found[key])) for key in ("layer_height", "initial_layer_print_height")}
    assert layers == {numbers(page["layer height"])[0]}
    shells = ["wall_loops", "bottom_shell_layers", "top_shell_layers", "sparse_infill_density"]
    values = [float(cast("str", found[key]).rstrip("%")) for key in shells]
    assert values[: len(numbers(page["walls, infill"]))] == numbers(page["walls, infill"])
    colours = [one.lower() for one in found["filament_colour"]]
    assert colours == re.findall(r"#\w{6}", page["filaments"])[: len(colours)]
    assert len(colours) == (1 if build == "relief" else 2)
    assert (found["enable_support"], found["ironing_type"], found["brim_type"]) == ("0", "no ironing", "no_brim")
    offsets = ("xy_contour_compensation", "xy_hole_compensation", "elefant_foot_compensation")
    assert {found[key] for key in offsets} == {"0"}
    change = target.job.printing.printer.machine.change
    matrix = np.array(found["flush_volumes_matrix"], dtype=float).reshape(len(colours), -1)
    assert not matrix.diagonal().any()
    purge = matrix[~np.eye(len(colours), dtype=bool)] + PRIME_MM3
    assert purge == pytest.approx([change.purge_to_ink_mm3, change.purge_to_body_mm3][: len(purge)])
    of_process = {*found["different_settings_to_system"][0].split(";")}
    assert of_process >= {*shells, *offsets, "layer_height", "enable_support", "ironing_type", "brim_type"}
    assert of_process <= {*found}


@pytest.mark.parametrize(("printer", "build"), [way for way in WAYS if way[1] != "relief"])
def test_towers_stand_on_the_bed_clear_of_the_parts(printer: str, build: str) -> None:
    """PrusaSlicer's, as wide as told and as deep as what a layer purges, with its brim."""
    target, plate, files = made(printer, build)
    found, profile = config_of(files.prusa), target.job.printing.printer
    x, y, width, brim = (float(found[f"wipe_tower_{key}"]) for key in ("x", "y", "width", "brim_width"))
    purge = sum(float(one) for one in found["wiping_volumes_matrix"].split(","))
    depth = purge / (width * profile.layer_height_mm)
    tower = box(x - brim, y - brim, x + width + brim, y + depth + brim)
    assert box(0, 0, *profile.bed_mm[:2]).contains(tower)
    for excluded in profile.machine.excluded_mm:
        assert not box(*excluded).intersects(tower)
    for piece in plate.pieces:
        assert not MultiPoint(piece.as_it_lies.body.vertices_mm[:, :2]).convex_hull.intersects(tower)


@pytest.mark.slicer
@pytest.mark.parametrize("printer", ["prusa-mk4s", "prusa-xl"])
def test_prusaslicer_slices_the_file_with_no_other_settings(printer: str, tmp_path: Path) -> None:
    """Its settings are the file's: printer, layers, both extruders where the part has them, and what is purged."""
    target, plate, files = made(printer, "one-piece")
    package, gcode = tmp_path / "t.3mf", tmp_path / "t.gcode"
    package.write_bytes(files.prusa)
    run_slicer(require_slicer(), "--dont-arrange", "--export-gcode", "-o", str(gcode), str(package))
    text, wanted = gcode.read_text(), config_of(files.prusa)
    used = dict(re.findall(r"^; (\w+) = (.*)$", text, re.MULTILINE))
    assert {key: used[key] for key in wanted if key in used} == {key: wanted[key] for key in wanted if key in used}
    paths = read_gcode(text)
    assert paths.tool_changes == target.estimate.plates[0].changes
    at = paths.end_mm[:, :2]
    x, y, width = (float(wanted[f"wipe_tower_{key}"]) for key in ("x", "y", "width"))
    deep = sum(float(one) for one in wanted["wiping_volumes_matrix"].split(",")) / (
        width * float(wanted["layer_height"])
    )
    on_tower = ((at > [x - 4, y - 4]) & (at < [x + width + 4, y + deep + 4])).all(axis=1)
    lying = [piece.as_it_lies for piece in plate.pieces]
    for tool, parts in enumerate(([one.body for one in lying], [one.ink for one in lying])):
        corners = np.concatenate([part.vertices_mm[:, :2] for part in parts if part is not None])
        mine = at[(paths.tool == tool) & ~on_tower]
        assert len(mine)
        assert mine.min(axis=0) == pytest.approx(corners.min(axis=0), abs=0.5)
        assert mine.max(axis=0) == pytest.approx(corners.max(axis=0), abs=0.5)
