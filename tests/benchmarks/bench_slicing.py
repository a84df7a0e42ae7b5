"""Slice the paper's one-piece icosahedron and board: `python -m tests.benchmarks.bench_slicing`.

Prints the ink in the G-code over the ink in the model (0.85 to 1.1 is wanted), tool changes and slicing time.
"""

import sys
import tempfile
import time
from pathlib import Path

from designer.kinds.sizing import size_job
from designer.produce import Design
from tests.support.designs import asked_for, ink_of, packages_of
from tests.support.gcode import find_slicer, slice_3mf, slicer_settings

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
    for title, asked in TARGETS.items():
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


if __name__ == "__main__":
    sys.exit(main())
