"""Run PrusaSlicer without a screen, and read the G-code it writes."""

import os
import re
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from designer.base.arrays import Array, Rows
from designer.formats.settings import prusa_print_settings
from designer.spec.spec import PrinterProfile
from tests.support.programs import run

FILAMENT_MM = 1.75
_WORD = re.compile(r"([XYZE])(-?\d*\.?\d+)")


@dataclass(frozen=True)
class Toolpaths:
    """All moves that lay down material, in the order of printing."""

    tool: Rows  # (N,)
    start_mm: Array  # (N, 3) nozzle tip: z is the layer's top
    end_mm: Array  # (N, 3)
    filament_mm: Array  # (N,) length of filament
    tool_changes: int

    def of_tool(self, tool: int) -> "Toolpaths":
        """The moves of one tool."""
        mine = self.tool == tool
        return Toolpaths(
            self.tool[mine], self.start_mm[mine], self.end_mm[mine], self.filament_mm[mine], self.tool_changes
        )

    @property
    def volume_mm3(self) -> float:
        """The material laid down."""
        return float(self.filament_mm.sum()) * np.pi * FILAMENT_MM**2 / 4


def read_gcode(text: str) -> Toolpaths:
    """The extruding moves: those that go sideways while filament goes forward (not retracts, primes or wipes)."""
    tool, changes, absolute_e = 0, 0, True
    at = {"X": 0.0, "Y": 0.0, "Z": 0.0, "E": 0.0}
    rows = []
    for line in text.splitlines():
        command = line.split(";", 1)[0]
        code = command.split(" ", 1)[0]
        if code in ("G1", "G0"):
            words = {axis: float(value) for axis, value in _WORD.findall(command)}
            before = dict(at)
            at.update(words)
            fed = words.get("E", 0.0)
            if "E" in words and absolute_e:
                fed -= before["E"]
            if fed > 0 and ("X" in words or "Y" in words):
                rows.append((tool, before["X"], before["Y"], before["Z"], at["X"], at["Y"], at["Z"], fed))
        elif code == "G92":
            at.update({axis: float(value) for axis, value in _WORD.findall(command)})
        elif code in ("M82", "M83"):
            absolute_e = code == "M82"
        elif code in ("G2", "G3", "G91"):
            raise ValueError(f"this reader knows no {code}: {line}")
        elif re.fullmatch(r"T\d+", code):
            changes += int(code[1:]) != tool
            tool = int(code[1:])
    table = np.array(rows, dtype=float).reshape(-1, 8)
    return Toolpaths(table[:, 0].astype(np.int64), table[:, 1:4], table[:, 4:7], table[:, 7], changes)


def find_slicer() -> str | None:
    """The slicer's command, or None where it is not installed."""
    return shutil.which("prusa-slicer")


def require_slicer() -> str:
    """The slicer's command; without it the test is skipped, in CI it fails."""
    command = find_slicer()
    if command is None:
        reason = "prusa-slicer is not installed (Debian package prusa-slicer)"
        if os.environ.get("CI"):
            pytest.fail(reason)
        pytest.skip(reason)
    return command


def slicer_settings(printer: PrinterProfile) -> Mapping[str, str]:
    """Two filaments in one nozzle, solid, nothing but the part on the bed."""
    bed_x, bed_y, bed_z = printer.bed_mm
    width, layer = f"{printer.line_width_mm:g}", f"{printer.layer_height_mm:g}"
    extrusions = ("", "first_layer_", "perimeter_", "external_perimeter_", "infill_", "solid_infill_", "top_infill_")
    return {
        "printer_technology": "FFF",
        "nozzle_diameter": f"{printer.nozzle_mm:g},{printer.nozzle_mm:g}",
        "filament_diameter": f"{FILAMENT_MM},{FILAMENT_MM}",
        "temperature": "215,215",
        "first_layer_temperature": "215,215",
        "single_extruder_multi_material": "1",
        "layer_height": layer,
        "first_layer_height": layer,
        "wipe_tower": "0",
        "skirts": "0",
        "gcode_comments": "1",
        "bed_shape": f"0x0,{bed_x:g}x0,{bed_x:g}x{bed_y:g},0x{bed_y:g}",
        "max_print_height": f"{bed_z:g}",
        # Solid throughout, so that the extruded volumes can be held against the model's.
        "fill_density": "100%",
        "fill_pattern": "rectilinear",
        "seam_position": "rear",  # else it is sought for seconds where loops are least seen to begin
        "resolution": "0.03",
        **{f"{kind}extrusion_width": width for kind in extrusions},
    }


def run_slicer(command: str, *arguments: str) -> str:
    """What the slicer prints. An exit status of 0 says little: see what it wrote."""
    done = run(command, *arguments, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


def slice_3mf(command: str, package: Path, settings: Mapping[str, str], center_mm: tuple[float, float]) -> Toolpaths:
    """Slice a package, its bounding box centred at `center_mm`; files go beside the package."""
    ini, gcode = package.with_suffix(".ini"), package.with_suffix(".gcode")
    ini.write_text("".join(f"{key} = {value}\n" for key, value in settings.items()))
    center = f"{center_mm[0]:g},{center_mm[1]:g}"
    run_slicer(command, "--load", str(ini), "--export-gcode", "--center", center, "-o", str(gcode), str(package))
    return read_gcode(gcode.read_text())


def one_filament(settings: Mapping[str, str]) -> Mapping[str, str]:
    """The same for a nozzle that has but one, which is changed by hand."""
    paired = re.compile(r"([-\d.]+),\1")
    first = {name: pair[1] if (pair := paired.fullmatch(value)) else value for name, value in settings.items()}
    first.pop("wiping_volumes_matrix", None)
    return {**first, "single_extruder_multi_material": "0", "wipe_tower": "0"}


def machine_settings(printer: PrinterProfile) -> Mapping[str, str]:
    """A printer's profile as PrusaSlicer 2.5 takes it, with a wipe tower for two filaments.

    What that version has no setting for: one acceleration for walls and one for infill (here those of outer walls and
    of infill), and the tower's speed. Ramming and cooling moves are left out, since the profile's time of a change
    holds them.
    """
    machine, rates, change = printer.machine, printer.machine.accelerations, printer.machine.change
    bed_x, bed_y, _ = printer.bed_mm
    limits = {"x": (1000, 1), "y": (1000, 1), "z": (30, 1), "e": (120, 0)}
    return {
        **slicer_settings(printer),
        "single_extruder_multi_material": str(int(not change.is_tool_changer)),
        **prusa_print_settings(printer),
        "machine_limits_usage": "time_estimate_only",
        "gcode_flavor": "marlin2",
        "machine_max_acceleration_extruding": "50000",
        "machine_max_acceleration_retracting": "5000",
        "machine_max_acceleration_travel": f"{rates.travel_mm_s2:g}",
        **{f"machine_max_acceleration_{axis}": "50000" for axis in "xy"},
        "machine_max_acceleration_z": "500",
        "machine_max_acceleration_e": "5000",
        **{f"machine_max_feedrate_{axis}": str(speed) for axis, (speed, _) in limits.items()},
        **{f"machine_max_jerk_{axis}": f"{machine.jerk_mm_s:g}" for axis in "xy"},
        "filament_max_volumetric_speed": f"{machine.flow_mm3_s:g},{machine.flow_mm3_s:g}",
        "retract_length": "0.8,0.8",
        "retract_speed": "40,40",
        "retract_length_toolchange": "0,0",
        "slowdown_below_layer_time": f"{machine.least_layer_s:g},{machine.least_layer_s:g}",
        "min_print_speed": "10,10",
        "filament_density": "1.24,1.24",
        "wipe_tower": "1",
        "wipe_tower_x": f"{bed_x - 70:g}",
        "wipe_tower_y": f"{bed_y / 2:g}",
        "wiping_volumes_matrix": f"0,{change.purge_to_ink_mm3:g},{change.purge_to_body_mm3:g},0",
        "filament_load_time": f"{change.time_s:g},{change.time_s:g}",
        "filament_unload_time": "0,0",
        "filament_cooling_moves": "0,0",
        "cooling_tube_retraction": "5",
        "cooling_tube_length": "0",
        "parking_pos_retraction": "5",
        "extra_loading_move": "0",
        **{
            f"filament_{name}": "100,100"
            for name in ("loading_speed", "loading_speed_start", "unloading_speed", "unloading_speed_start")
        },
        "filament_ramming_parameters": "120 100 6.6| 0.05 6.6 0.45 6.6",
        "single_extruder_multi_material_priming": "0",
        "use_relative_e_distances": "1",
        "layer_gcode": "G92 E0",
    }
