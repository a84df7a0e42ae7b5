"""Slice the paper's one-piece icosahedron and board, and the icosahedron in tiles.

    python -m tests.benchmarks.bench_slicing            # all
    python -m tests.benchmarks.bench_slicing tiles      # all plates of the icosahedron in tiles alone

Prints the ink in the G-code over the ink in the model (0.85 to 1.1 is wanted), tool changes, purge and slicing time.
"""

import math
import re
import sys
import tempfile
import time
from pathlib import Path

from designer.builds.design import Design
from designer.formats.project import plate_files
from designer.kinds.sizing import size_job
from designer.make.estimate import DENSITY_G_PER_CM3
from tests.support.designs import asked_for, ink_of, packages_of
from tests.support.gcode import (
    FILAMENT_MM,
    find_slicer,
    machine_settings,
    read_gcode,
    run_slicer,
    slice_3mf,
    slicer_settings,
)

RINGS = {"ring_diameter": "7mm", "pitch": "10mm"}
TARGETS = {
    "icosahedron, edge 100 mm": asked_for("ico", {"edge": "100mm", "rings_per_side": 8, "border": "2mm", **RINGS}),
    "board, 220 x 220 x 5 mm": asked_for("board", {"size": "220x220mm", "columns": 21, "rows": 21, **RINGS}),
}


def main() -> int:
    """Print one line per target."""
    command = find_slicer()
    if command is None:
        print("prusa-slicer is not installed (Debian package prusa-slicer)", file=sys.stderr)
        return 2
    tiles(command)
    for title, asked in TARGETS.items() if "tiles" not in sys.argv else ():
        design = Design(size_job(asked).job)
        printer = design.job.printing.printer
        # The inside of the body is of no interest here, and solid it would double the time.
        settings = {**slicer_settings(printer), "fill_density": "15%"}
        with tempfile.TemporaryDirectory() as folder:
            package = Path(folder) / "target.3mf"
            package.write_bytes(packages_of(design).prusa)
            start = time.perf_counter()
            toolpaths = slice_3mf(command, package, settings, (printer.bed_mm[0] / 2, printer.bed_mm[1] / 2))
            seconds = time.perf_counter() - start
        volume = ink_of(design).volume_mm3
        print(
            f"{title}: inlay {design.job.printing.inlay_mm:g} mm, "
            f"ink {toolpaths.of_tool(1).volume_mm3 / volume:.3f} of the model's {volume / 1000:.2f} cm3, "
            f"{toolpaths.tool_changes} tool changes, sliced in {seconds:.0f} s",
            flush=True,
        )
    return 0


def tiles(command: str) -> None:
    """Plate by plate with the printer's settings, a tower in the corner: at most 15 changes and 10 g are wanted."""
    design = Design(size_job(asked_for("ico", {"edge": "100mm", "build": "tiles"})).job)
    printer = design.job.printing.printer
    corner = {f"wipe_tower_{axis}": f"{size - 60:g}" for axis, size in zip("xy", printer.bed_mm[:2], strict=True)}
    settings = {**machine_settings(printer), **corner, "support_material": "0"}
    changes, purge_g = 0, 0.0
    for plate, guess in zip(design.plates, design.estimate.plates, strict=True):
        with tempfile.TemporaryDirectory() as folder:
            package, ini, gcode = (Path(folder) / f"plate.{suffix}" for suffix in ("3mf", "ini", "gcode"))
            package.write_bytes(plate_files(plate, design.job.printing).prusa)
            ini.write_text("".join(f"{key} = {value}\n" for key, value in settings.items()))
            start = time.perf_counter()
            arguments = ("--load", str(ini), "--dont-arrange", "--export-gcode", "-o", str(gcode), str(package))
            run_slicer(command, *arguments)
            text, seconds = gcode.read_text(), time.perf_counter() - start
        purged, weight, ink = tower_g(text), weight_g(text), read_gcode(text).of_tool(1).volume_mm3
        model = sum(piece.part.ink.volume_mm3 for piece in plate.pieces if piece.part.ink is not None)
        tools = len(re.findall(r"^T[01]", text, re.MULTILINE)) - 1 if plate.is_two_filament else 0
        changes, purge_g = changes + tools, purge_g + purged
        told = f", ink and its purge {ink / model:.3f} of the model's" if model else ""
        print(
            f"{plate.name}, {plate.words}: {tools} changes (predicted {guess.changes}), {weight:.1f} g, of which "
            f"{purged:.1f} g purge{told}, sliced in {seconds:.0f} s",
            flush=True,
        )
    print(f"all plates: {changes} changes, {purge_g:.1f} g purge", flush=True)


def tower_g(gcode: str) -> float:
    """What the wipe tower takes."""
    length, kind = 0.0, ""
    for line in gcode.splitlines():
        if line.startswith(";TYPE:"):
            kind = line.removeprefix(";TYPE:").strip()
        elif kind == "Wipe tower" and (fed := re.match(r"G1 .*E(-?\d*\.?\d+)", line)):
            length += float(fed[1])
    return length * math.pi / 4 * FILAMENT_MM**2 / 1000 * DENSITY_G_PER_CM3


def weight_g(gcode: str) -> float:
    """All filament, as the slicer says."""
    used = re.search(r"; filament used \[g\] = (.*)", gcode)
    return sum(float(part) for part in used[1].split(",")) if used else math.nan


if __name__ == "__main__":
    sys.exit(main())
