"""Expected filament, against limits that need no slicer and against PrusaSlicer."""

import math
import re
from pathlib import Path

import pytest

from designer.kinds.sizing import size_job
from designer.produce import Design
from designer.report.making import DENSITY_G_PER_CM3, SPREAD, FilamentAmount, expected_filament, inked_layers
from designer.spec.machine import Shells
from tests.support.designs import asked_for, ink_of, packages_of, small
from tests.support.gcode import require_slicer, run_slicer, slice_3mf, slicer_settings

SOLID = 10_000


def ico(edge: str, chord_error: str = "5um", rings: int | None = None) -> Design:
    asked = {"edge": edge, "chord_error": chord_error, "rings_per_side": rings}
    return Design(size_job(asked_for("ico", asked)).job)


def board(size: str, chord_error: str = "5um") -> Design:
    return Design(size_job(asked_for("board", {"size": size, "chord_error": chord_error})).job)


def test_walls_that_fill_the_part_take_its_whole_volume() -> None:
    """With more walls and layers than fit, the body's filament is its volume, whatever the infill."""
    for design in (ico("20mm"), board("100x80mm")):
        full = Shells(walls=SOLID, bottom_layers=SOLID, top_layers=SOLID, infill=0.0)
        assert expected_filament(design, full).body.volume_mm3 == pytest.approx(design.part.body.volume_mm3)


def test_more_of_anything_takes_more_filament() -> None:
    """Each wall, layer and per cent of infill adds, and ink does not depend on them."""
    design, usual = board("100x80mm"), Shells()
    amount = expected_filament(design, usual)
    for more in (Shells(walls=4), Shells(bottom_layers=5), Shells(top_layers=6), Shells(infill=0.2)):
        changed = expected_filament(design, more)
        assert changed.body.volume_mm3 > amount.body.volume_mm3
        assert changed.ink == amount.ink


def test_a_boards_shell_is_computed_by_hand() -> None:
    """Without infill a board is its plate less the box inside walls, bottom and top, and less the ink."""
    design = board("100x80mm")
    line, layer = 0.45, 0.2
    wall = line + 2 * (line - layer * (1 - math.pi / 4))
    inside = (100 - 2 * wall) * (80 - 2 * wall) * (5 - 4 * layer - 5 * layer)
    expected = 100 * 80 * 5 - inside - ink_of(design).volume_mm3
    assert expected_filament(design, Shells(infill=0.0)).body.volume_mm3 == pytest.approx(expected, rel=1e-3)


def test_stickers_and_printed_letters_need_no_ink() -> None:
    """A body in one filament has no ink, no changes and no purge."""
    design = Design(size_job(asked_for("ico", {"edge": "60mm", "build": "stickers"})).job)
    filament = expected_filament(design)
    assert (filament.ink, filament.changes, filament.purge_g) == (None, 0, 0.0)


@pytest.mark.parametrize(
    ("mass_g", "text"),
    [(0.7, "0.63-0.77 g"), (7.0, "6.3-7.7 g"), (30.0, "27-33 g"), (130.0, "117-143 g"), (1100.0, "990-1210 g")],
)
def test_ranges_are_rounded_outwards(mass_g: float, text: str) -> None:
    """The range holds the estimate and its spread, with two digits or three."""
    assert FilamentAmount(mass_g / DENSITY_G_PER_CM3 * 1000).mass_text == text


@pytest.mark.slicer
@pytest.mark.parametrize(
    ("design", "fill"),
    [(ico("40mm", "100um", 5), "grid"), (small("cube"), "grid"), (board("70x50mm", "100um"), "gyroid")],
    ids=["ico-40", "cube", "board"],
)
def test_prusaslicer_agrees_on_filament(design: Design, fill: str, tmp_path: Path) -> None:
    """Grams of each slot in PrusaSlicer's own account, and its changes of the filament, at the settings on the page."""
    command, shells = require_slicer(), Shells()
    printer = design.job.printing.printer
    settings = {
        **slicer_settings(printer),
        "perimeters": str(shells.walls),
        "bottom_solid_layers": str(shells.bottom_layers),
        "top_solid_layers": str(shells.top_layers),
        "fill_density": f"{100 * shells.infill:g}%",
        "fill_pattern": fill,
        "filament_density": f"{DENSITY_G_PER_CM3},{DENSITY_G_PER_CM3}",
    }
    package = tmp_path / "target.3mf"
    package.write_bytes(packages_of(design).prusa)
    toolpaths = slice_3mf(command, package, settings, (printer.bed_mm[0] / 2, printer.bed_mm[1] / 2))
    account = re.search(r"^; filament used \[g\] = (.+)$", package.with_suffix(".gcode").read_text(), re.MULTILINE)
    assert account is not None
    body_g, ink_g = (float(grams) for grams in account[1].split(","))
    filament = expected_filament(design)
    assert filament.ink is not None
    assert body_g == pytest.approx(filament.body.mass_g, rel=SPREAD)
    assert ink_g == pytest.approx(filament.ink.mass_g, rel=SPREAD)
    assert filament.changes == toolpaths.tool_changes
    assert inked_layers(design) == len(set(toolpaths.of_tool(1).end_mm[:, 2].round(3).tolist()))


@pytest.mark.slicer
def test_a_profile_of_one_filament_prints_all_of_it_in_that_one(tmp_path: Path) -> None:
    """What the instructions warn of: PrusaSlicer drops the pattern of a printer with one filament, and exits with 0."""
    command, design = require_slicer(), board("60x60mm")
    package, ini, gcode = (tmp_path / name for name in ("target.3mf", "one.ini", "one.gcode"))
    package.write_bytes(packages_of(design).prusa)
    ini.write_text("nozzle_diameter = 0.4\nfilament_diameter = 1.75\nskirts = 0\n")
    run_slicer(command, "--load", str(ini), "--export-gcode", "-o", str(gcode), str(package))
    assert not re.search(r"^T1", gcode.read_text(), re.MULTILINE)
