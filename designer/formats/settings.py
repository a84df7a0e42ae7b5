"""What the page tells of a print, in the fields of slicers: `process_settings(printer)`, `prusa_settings(...)`.

Names and forms of values are those that the programs write themselves. Bambu Studio and OrcaSlicer lay what is told
here over their presets (`designer.formats.project`). PrusaSlicer knows no such thing: its readers (`Plater.cpp`,
`Preset.cpp`) lay a file's settings over the program's defaults, printer and filaments too, and list them under the
file's name. So the file has all that the page, the estimate and the printer's profile know; how a printer starts and
changes filament, nobody but its own profile does. `printer_settings_id`, which PrusaSlicer shows in its list of
printers, asks for that; whoever follows keeps the settings of print, purge and tower.
"""

from collections.abc import Mapping
from math import ceil

from designer.base.words import NAME
from designer.make.bed import TOWER_BRIM_MM, TOWER_MM, Plate
from designer.spec.machine import BRIM_MM, TOWER_DEPTH_MM
from designer.spec.spec import PrinterProfile, PrintSpec

_WIDTHS = ("initial_layer", "outer_wall", "inner_wall", "top_surface", "sparse_infill", "internal_solid_infill")
_PRUSA_WIDTHS = ("first_layer", "perimeter", "external_perimeter", "infill", "solid_infill", "top_infill")
_PLA = {
    "filament_diameter": "1.75", "filament_density": "1.24", "temperature": "215", "first_layer_temperature": "215",
    "bed_temperature": "60", "first_layer_bed_temperature": "60", "fan_always_on": "1", "min_fan_speed": "100",
    "disable_fan_first_layers": "1",
}  # fmt: skip
"""As makers of PLA say; a filament that is chosen in the slicer has its own."""


def process_settings(printer: PrinterProfile, *, has_tower: bool) -> Mapping[str, str]:
    """Of Bambu Studio's and OrcaSlicer's process: what the page's table tells."""
    shells, width = printer.machine.shells, f"{printer.line_width_mm:g}"
    layer = f"{printer.layer_height_mm:g}"
    return {
        "layer_height": layer,
        "initial_layer_print_height": layer,
        "line_width": width,
        **{f"{kind}_line_width": width for kind in _WIDTHS},
        "wall_loops": str(shells.walls),
        "bottom_shell_layers": str(shells.bottom_layers),
        "top_shell_layers": str(shells.top_layers),
        "sparse_infill_density": f"{100 * shells.infill:g}%",
        "enable_support": "0",
        "brim_type": "no_brim",
        "ironing_type": "no ironing",
        "xy_contour_compensation": "0",
        "xy_hole_compensation": "0",
        "elefant_foot_compensation": "0",
        "enable_prime_tower": str(int(has_tower)),
        "flush_into_infill": "0",
        "flush_into_objects": "0",
    }


def prusa_settings(plate: Plate, printing: PrintSpec) -> Mapping[str, str]:
    """All that PrusaSlicer needs to slice a plate, and all that the page tells of it."""
    printer, machine = printing.printer, printing.printer.machine
    bed_x, bed_y, bed_z = printer.bed_mm
    colours = [colour.upper() for colour in printing.filament_colours]
    of_each = {
        **_PLA,
        "nozzle_diameter": f"{printer.nozzle_mm:g}",
        "filament_max_volumetric_speed": f"{machine.flow_mm3_s:g}",
        "slowdown_below_layer_time": str(ceil(machine.least_layer_s)),
    }
    return {
        "printer_technology": "FFF",
        "printer_settings_id": f"choose your own {printer.name}",
        "print_settings_id": NAME,
        "filament_settings_id": ";".join(['"choose your own"'] * len(colours)),
        "gcode_flavor": "marlin2",
        "start_gcode": f"; your own profile of {printer.name} starts it as it wants to be started\\nG28 ; home\\n",
        "bed_shape": f"0x0,{bed_x:g}x0,{bed_x:g}x{bed_y:g},0x{bed_y:g}",
        "max_print_height": f"{bed_z:g}",
        "single_extruder_multi_material": str(int(len(colours) > 1 and not machine.change.is_tool_changer)),
        "use_relative_e_distances": "1",
        "single_extruder_multi_material_priming": "0",
        "layer_gcode": "G92 E0",
        "filament_colour": ";".join(colours),
        "extruder_colour": ";".join(colours),
        "filament_type": ";".join(["PLA"] * len(colours)),
        **{key: ",".join([value] * len(colours)) for key, value in of_each.items()},
        **prusa_print_settings(printer),
        **(_purge(plate, printer) if len(colours) > 1 else {"wipe_tower": "0"}),
    }


def prusa_print_settings(printer: PrinterProfile) -> Mapping[str, str]:
    """Those of a print in it: layers, lines, shells, what is off, and the profile's speeds and accelerations."""
    machine = printer.machine
    speeds, rates, shells = machine.speeds, machine.accelerations, machine.shells
    width, layer = f"{printer.line_width_mm:g}", f"{printer.layer_height_mm:g}"
    return {
        "layer_height": layer,
        "first_layer_height": layer,
        "extrusion_width": width,
        **{f"{kind}_extrusion_width": width for kind in _PRUSA_WIDTHS},
        "perimeters": str(shells.walls),
        "bottom_solid_layers": str(shells.bottom_layers),
        "top_solid_layers": str(shells.top_layers),
        "fill_density": f"{100 * shells.infill:g}%",
        "fill_pattern": "grid",
        "ensure_vertical_shell_thickness": "1",
        "thick_bridges": "0",
        "support_material": "0",
        "brim_type": "no_brim",
        "brim_width": "0",
        "skirts": "0",
        "ironing": "0",
        "xy_size_compensation": "0",
        "elefant_foot_compensation": "0",
        "external_perimeter_speed": f"{speeds.outer_wall_mm_s:g}",
        "small_perimeter_speed": f"{speeds.outer_wall_mm_s:g}",
        "perimeter_speed": f"{speeds.inner_wall_mm_s:g}",
        "infill_speed": f"{speeds.infill_mm_s:g}",
        "solid_infill_speed": f"{speeds.solid_infill_mm_s:g}",
        "gap_fill_speed": f"{speeds.solid_infill_mm_s:g}",
        "top_solid_infill_speed": f"{speeds.top_mm_s:g}",
        "bridge_speed": f"{speeds.bridge_mm_s:g}",
        "first_layer_speed": f"{speeds.first_layer_mm_s:g}",
        "travel_speed": f"{speeds.travel_mm_s:g}",
        "perimeter_acceleration": f"{rates.outer_wall_mm_s2:g}",
        "infill_acceleration": f"{rates.infill_mm_s2:g}",
        "bridge_acceleration": f"{rates.infill_mm_s2:g}",
        "first_layer_acceleration": f"{rates.first_layer_mm_s2:g}",
        "default_acceleration": f"{rates.infill_mm_s2:g}",
    }


def _purge(plate: Plate, printer: PrinterProfile) -> Mapping[str, str]:
    """Volumes, and a tower at its place, 60 mm wide or as wide as it must be to hold what a layer purges.

    What a printer of Bambu Lab drops down its chute, this program lays onto the tower: there is as much as fits.
    """
    area, change = plate.tower_area, printer.machine.change
    purges = (change.purge_to_ink_mm3, change.purge_to_body_mm3)
    if area is None or not change.has_tower:
        return {"wipe_tower": "0", "wiping_volumes_matrix": f"0,{purges[0]:g},{purges[1]:g},0"}
    most_mm = [max(area[k + 2] - area[k] - 2 * BRIM_MM, TOWER_DEPTH_MM - BRIM_MM) for k in (0, 1)]
    section_mm2 = sum(purges) / printer.layer_height_mm
    width = min(max(TOWER_MM, section_mm2 / most_mm[1]), most_mm[0])
    depth = min(section_mm2 / width, most_mm[1])
    to_ink, to_body = (purge * min(1.0, width * depth / section_mm2) for purge in purges)
    corner = plate.tower_mm(width, depth)
    assert corner is not None  # noqa: S101 - it has a place
    return {
        "wiping_volumes_matrix": f"0,{to_ink:.4g},{to_body:.4g},0",
        "wipe_tower": "1",
        "wipe_tower_width": f"{round(width, 1):g}",
        "wipe_tower_brim_width": f"{TOWER_BRIM_MM:g}",
        "wipe_tower_x": f"{round(corner[0], 1):g}",
        "wipe_tower_y": f"{round(corner[1], 1):g}",
    }
