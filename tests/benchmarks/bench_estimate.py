"""Estimates against PrusaSlicer: `python -m tests.benchmarks.bench_estimate [PRINTER ...]`, some minutes a printer.

Prints for each design our figure, PrusaSlicer's and the ratio, of time, plastic in the part, purge and changes. Both
have the profile's numbers. What PrusaSlicer 2.5 cannot be told is the same for both: one acceleration for all walls,
one for all infill, and a tower of all that is purged, printed at 80 mm/s at most. Heating up is in neither. The ways to
the tower, a second a change, are in PrusaSlicer's figure beyond the profile's time of a change.
"""

import re
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from designer.builds.design import Design
from designer.formats.stl import stl_bytes
from designer.kinds.sizing import size_job
from designer.make.bed import mapped
from designer.make.estimate import DENSITY_G_PER_CM3, PrintEstimate, estimate
from tests.support.designs import asked_for, packages_of
from tests.support.gcode import FILAMENT_MM, find_slicer, machine_settings, run_slicer

PRINTERS = ("bambu-p1s", "prusa-mk4s", "prusa-xl")
TOWER_MM_S, TOWER_LINE_MM = 80.0, 1.25
"""Speed of the tower's lines, and their width by the nozzle's (`GCode/WipeTower.cpp`)."""
DESIGNS = {
    "ico 20": ("ico", {"edge": "20mm"}),
    "ico 20, 0.2 mm nozzle": ("ico", {"edge": "20mm", "nozzle": "0.2mm"}),
    "ico 40": ("ico", {"edge": "40mm"}),
    "ico 60": ("ico", {"edge": "60mm"}),
    "ico 100": ("ico", {"edge": "100mm"}),
    "cube 28": ("cube", {"edge": "28mm"}),
    "cube 60": ("cube", {"edge": "60mm"}),
    "board 60 x 60": ("board", {"size": "60x60mm"}),
    "board 100 x 80": ("board", {"size": "100x80mm"}),
    "board 200 x 200": ("board", {"size": "200x200mm"}),
    "body of ico 60": ("ico", {"edge": "60mm", "build": "stickers"}),
    "body of cube 80": ("cube", {"edge": "80mm", "build": "stickers"}),
}
"""The name, the kind and what is asked for."""
_WORD = re.compile(r"([XYE])(-?\d*\.?\d+)")


def main() -> int:
    """A table for each printer."""
    command = find_slicer()
    if command is None:
        print("prusa-slicer is not installed (Debian package prusa-slicer)", file=sys.stderr)
        return 2
    for printer in sys.argv[1:] or PRINTERS:
        print(f"{printer}: ours / PrusaSlicer's = ratio", flush=True)
        for title, (kind, values) in DESIGNS.items():
            try:
                design = Design(size_job(asked_for(kind, {**values, "printer": printer})).job)
                print(f"  {title:22} {_compared(command, design)}", flush=True)
            except Exception as error:  # the other designs go on
                print(f"  {title:22} {str(error).splitlines()[0]}", flush=True)
    return 0


def _compared(command: str, design: Design) -> str:
    """One row."""
    design = _as_sliced(design)
    plates, printing = design.plates, design.job.printing
    start = time.process_time()
    ours = estimate(plates, printing)
    seconds = time.process_time() - start
    theirs = _sliced(command, design)
    rows = {
        "min": (_time_s(ours) / 60, theirs["time_s"] / 60),
        "g body": (ours.body_g, theirs["body_g"]),
        "g ink": (ours.ink_g, theirs["ink_g"]),
        "g purge": (ours.purge_g, theirs["purge_g"]),
        "changes": (float(ours.changes), theirs["changes"]),
    }
    told = [f"{a:8.2f} /{b:8.2f} {name} = {a / b:.3f}" for name, (a, b) in rows.items() if b > 0.005]
    return "   ".join([*told, f"{seconds:.2f} s"])


def _as_sliced(design: Design) -> Design:
    """With what PrusaSlicer can be told of the printer."""
    printing = design.job.printing
    printer, machine = printing.printer, printing.printer.machine
    layer_mm = printer.layer_height_mm
    tower_mm3_s = TOWER_MM_S * layer_mm * (TOWER_LINE_MM * printer.nozzle_mm - layer_mm * (1 - np.pi / 4))
    rates = machine.accelerations
    machine = replace(
        machine,
        accelerations=replace(
            rates, inner_wall_mm_s2=rates.outer_wall_mm_s2, solid_infill_mm_s2=rates.infill_mm_s2,
            top_mm_s2=rates.infill_mm_s2,
        ),
        change=replace(machine.change, purge_flow_mm3_s=tower_mm3_s, most_on_tower_mm3=5000.0),
        retraction_s=2 * (0.8 / 40 + 40 / 5000),  # length over speed, speed over acceleration
        start_s=0.0,
    )  # fmt: skip
    return Design(replace(design.job, printing=replace(printing, printer=replace(printer, machine=machine))))


def _time_s(ours: PrintEstimate) -> float:
    return sum(plate.printing_s + plate.changing_s for plate in ours.plates)


def _sliced(command: str, design: Design) -> dict[str, float]:
    """PrusaSlicer's own account; what is purged is what the tower takes, filament that is pulled back not counted."""
    job, printer = design.job, design.job.printing.printer
    with tempfile.TemporaryDirectory() as folder:
        model, ini, gcode = (Path(folder) / name for name in ("model.3mf", "settings.ini", "model.gcode"))
        settings = dict(machine_settings(printer))
        if job.printing.way.is_two_filament:
            model.write_bytes(packages_of(design).prusa)
        else:
            model = model.with_suffix(".stl")
            settings["wipe_tower"] = "0"
            model.write_bytes(_body(design))
        ini.write_text("".join(f"{key} = {value}\n" for key, value in settings.items()))
        center = f"{printer.bed_mm[0] / 2 - 30:g},{printer.bed_mm[1] / 2:g}"
        run_slicer(command, "--load", str(ini), "--export-gcode", "--center", center, "-o", str(gcode), str(model))
        return _account(gcode.read_text())


def _body(design: Design) -> bytes:
    """The first piece as it lies."""
    piece = design.plates[0].pieces[0]
    motion = piece.bed_from_part
    return stl_bytes(piece.part.placed(lambda points: mapped(points, motion[:3, :3]) + motion[:3, 3]).body)


def _account(text: str) -> dict[str, float]:
    """Time and total from the comments; part, purge and changes from the moves."""
    told = re.search(r"estimated printing time \(normal mode\) = (.+)", text)
    used = re.search(r"filament used \[g\] = (.+)", text)
    assert told is not None
    assert used is not None
    seconds = {"d": 86400, "h": 3600, "m": 60, "s": 1}
    grams_per_mm = np.pi * FILAMENT_MM**2 / 4 / 1000 * DENSITY_G_PER_CM3
    part, tool, changes, kind = [0.0, 0.0], -1, 0, ""
    for line in text.splitlines():
        if line.startswith(";TYPE:"):
            kind = line[6:]
        elif re.match(r"T\d", line):
            changes += tool not in (-1, int(line[1]))
            tool = int(line[1])
        elif line.startswith("G1") and kind not in ("Wipe tower", "Custom"):
            words = dict(_WORD.findall(line.split(";")[0]))
            if float(words.get("E", 0)) > 0 and ("X" in words or "Y" in words):
                part[max(tool, 0)] += float(words["E"]) * grams_per_mm
    total = sum(map(float, used[1].split(",")))
    return {
        "time_s": sum(int(n) * seconds[unit] for n, unit in re.findall(r"(\d+)([dhms])", told[1])),
        "body_g": part[0], "ink_g": part[1], "changes": changes,
        "purge_g": total - sum(part) if "Wipe tower" in text else 0.0,
    }  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
