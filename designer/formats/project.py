"""What opens ready in slicers: `plate_files` for a plate, and `project_bytes` for all plates in one file.

PrusaSlicer's file has its settings (`designer.formats.settings`), that of Bambu Studio and OrcaSlicer is a project
where they know the printer by the same name; else it is geometry with its filaments, which those programs and Cura open
with the settings that are chosen in them. What their readers ask for was found in their published sources, and
`tests/designer/formats/test_project.py` holds files to it; neither program was run:

- `src/libslic3r/Format/bbs_3mf.cpp`: the metadata `Application` decides whose a file is. One that does not begin with
  the reader's name is bare geometry to it, whose plates are not made. So this one says `BambuStudio-`, for the sake of
  its readers, as all programs do that write such projects, OrcaSlicer among them; who wrote it is in its description.
  The version after the name must be of the reader's generation and not newer than the reader. Plates and what lies on
  them are in `Metadata/model_settings.config`, the plates numbered from 1 on.
- `src/slic3r/GUI/PartPlate.cpp`, `PartPlate.hpp`: what counts in the end is over which plate an object lies. Plates
  stand in rows from the left, a fifth of a plate apart, each row in front of the one before; there are as many columns
  as the root of the number of plates, rounded up, and 36 plates at most.
- `src/slic3r/GUI/Plater.cpp`: without settings (`Metadata/project_settings.config`) later versions make no plates.
- `src/libslic3r/PresetBundle.cpp`, `Preset.cpp`: settings are laid over the program's defaults, so that some of them
  alone would give a printer of defaults. Where presets of the system are named, all values are those of the presets,
  but for settings that `different_settings_to_system` names (`process_settings`). Hence there are projects only for
  printers whose presets both programs have by the same names. Colours, purge, place of the prime tower and type of the
  build plate are the project's own.
"""

import json
import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from types import MappingProxyType

from designer.base.words import NAME
from designer.formats.png import Thumbnails
from designer.formats.settings import process_settings, prusa_settings
from designer.formats.threemf import (
    PAINTED_METADATA,
    Members,
    ObjectText,
    bambu_changes,
    bambu_package,
    objects_of,
    prusa_change,
    prusa_config,
    prusa_package,
    quoted,
)
from designer.make.bed import Piece, Plate
from designer.make.mesh import ColouredMesh
from designer.spec.machine import Presets
from designer.spec.spec import PrintSpec

MOST_PLATES = 36
GAP = 0.2
"""Between plates, over their size."""
VERSION = "02.00.00.00"
"""The first of the generation in use, which all of it reads without a notice."""
PRIME_MM3 = 30.0
"""Of a change's purge, what is printed on the tower: a printer's file books both in one, these slicers do not."""
_NOT_SLICED = (
    '<?xml version="1.0" encoding="UTF-8"?>\n<config>\n <header>\n'
    '  <header_item key="X-BBL-Client-Type" value="slicer"/>\n'
    f'  <header_item key="X-BBL-Client-Version" value="{VERSION}"/>\n </header>\n</config>\n'
).encode()
"""What is known of slices, which these programs do without, but tools of others do not."""
_TOWER_MM = 35.0
"""How wide these slicers make a prime tower; how deep, they find out."""


@dataclass(frozen=True)
class PlateFiles:
    """The same plate twice, as zip packages."""

    prusa: bytes  # PrusaSlicer
    bambu: bytes  # Bambu Studio, OrcaSlicer; Cura


def plate_files(plate: Plate, printing: PrintSpec, thumbnails: Thumbnails | None = None) -> PlateFiles:
    """Write a plate for each slicer. The same input gives the same bytes.

    Raises:
        InputError: a name that XML cannot hold.
    """
    objects, presets = objects_of(plate.pieces), printing.printer.presets
    pictures = {} if thumbnails is None else {"Metadata/thumbnail.png": thumbnails.middle}
    config = prusa_config(prusa_settings(plate, printing))
    # zlib lets other threads run, so one package is compressed while the other is put together.
    with ThreadPoolExecutor(2) as pool:
        change = prusa_change(plate.change_z_mm(printing.printer.layer_height_mm), printing.ink_colour)
        prusa = pool.submit(prusa_package, objects, printing, {**config, **change, **pictures})
        if presets is None:
            bambu = pool.submit(bambu_package, objects, printing, members=pictures)
        else:
            each = () if thumbnails is None else (thumbnails,)
            bambu = pool.submit(_project, plate.pieces[0].name, (plate,), objects, printing, presets, each)
        return PlateFiles(prusa.result(), bambu.result())


def files_in_turn(plate: Plate, printing: PrintSpec, thumbnails: Thumbnails) -> tuple[bytes, bytes]:
    """PrusaSlicer's packages of a plate's body and of its raised ink, which is printed onto it at a `z_offset`.

    That is a setting of printers: whoever chooses another printer in the slicer takes it away.
    """
    body, ink, height_mm = plate.in_turn
    black, pictures = replace(printing, body_colour=printing.ink_colour), {"Metadata/thumbnail.png": thumbnails.middle}
    onto = {
        "z_offset": f"{height_mm:g}",
        "printer_settings_id": f"keep: begins at {height_mm:g} mm",
        "start_gcode": f"G91\\nG1 Z10 F600 ; off the plate, which is on the bed\\nG90\\nG28 ; home, beside the plate\\n"
        f"G1 Z{height_mm + 10:g} F600\\n",
    }  # fmt: skip
    return (
        prusa_package(objects_of(body.pieces), printing, {**prusa_config(prusa_settings(body, printing)), **pictures}),
        prusa_package(
            objects_of(ink.pieces), black, {**prusa_config({**prusa_settings(ink, black), **onto}), **pictures}
        ),
    )


def painted_bytes(mesh: ColouredMesh, plate: Plate, printing: PrintSpec, thumbnails: Thumbnails | None = None) -> bytes:
    """A plate's only piece as one mesh, its ink painted with the second filament: one package for all slicers.

    They print colours of upright faces as deep as they are told, those of flat ones in all solid layers.
    """
    (piece,), presets = plate.pieces, printing.printer.presets
    objects = [ObjectText.painted(piece.name, mesh, piece.bed_from_part)]
    deep = {"mmu_segmented_region_max_width": f"{printing.inlay_mm:g}"}
    config = prusa_config({**prusa_settings(plate, printing), **deep})
    if presets is None:
        pictures = {} if thumbnails is None else {"Metadata/thumbnail.png": thumbnails.middle}
        return bambu_package(objects, printing, PAINTED_METADATA, members={**config, **pictures})
    each = () if thumbnails is None else (thumbnails,)
    return _project(piece.name, (plate,), objects, printing, presets, each, PAINTED_METADATA, config, deep)


def project_bytes(
    title: str, plates: Sequence[Plate], printing: PrintSpec, presets: Presets, thumbnails: Sequence[Thumbnails] = ()
) -> bytes:
    """`project_bytes("ico", design.plates, printing, printing.printer.presets)`: the project as a zip package.

    Args:
        title: of the project.
        plates: as they are printed, 36 at most.
        printing: gives colours and purge.
        presets: of the printer.
        thumbnails: of each plate, or none.

    Raises:
        InputError: a name that XML cannot hold.
    """
    objects = objects_of([piece for at in range(len(plates)) for piece in _placed(plates, at, presets)])
    return _project(title, plates, objects, printing, presets, thumbnails)


def _project(
    title: str,
    plates: Sequence[Plate],
    objects: Sequence[ObjectText],
    printing: PrintSpec,
    presets: Presets,
    thumbnails: Sequence[Thumbnails],
    more_metadata: str = "",
    more_members: Members = MappingProxyType({}),
    more_settings: Mapping[str, str] = MappingProxyType({}),
) -> bytes:
    """Of objects that lie where their plates stand."""
    metadata = (
        more_metadata + f' <metadata name="Application">BambuStudio-{VERSION}</metadata>\n'
        ' <metadata name="BambuStudio:3mfVersion">1</metadata>\n'
        f' <metadata name="Title">{quoted(title)[1:-1]}</metadata>\n'
        f' <metadata name="Description">Written by {NAME}, not by Bambu Studio: its readers ask for that name.'
        "</metadata>\n"
    )
    settings = json.dumps(_settings(plates, printing, presets, more_settings), indent=1).encode()
    changes = [plate.change_z_mm(printing.printer.layer_height_mm) for plate in plates]
    members = {
        "Metadata/project_settings.config": settings,
        "Metadata/slice_info.config": _NOT_SLICED,
        **bambu_changes(changes),
        **more_members,
    }
    for number, pictures in enumerate(thumbnails, start=1):
        members[f"Metadata/plate_{number}.png"] = pictures.large
        members[f"Metadata/plate_{number}_small.png"] = pictures.small
    plates_text = _plates_text(title, plates, objects, has_pictures=bool(thumbnails))
    return bambu_package(objects, printing, metadata, plates_text, members)


def plate_corner_mm(at: int, count: int, presets: Presets) -> tuple[float, float]:
    """The front left corner of a plate, counted from 0, among so many."""
    row, column = divmod(at, math.isqrt(count - 1) + 1)
    width, depth = presets.plate_mm
    return column * width * (1 + GAP), -row * depth * (1 + GAP)


def _placed(plates: Sequence[Plate], at: int, presets: Presets) -> list[Piece]:
    """The pieces of a plate where it stands in the grid."""
    pieces = []
    for piece in plates[at].pieces:
        grid_from_part = piece.bed_from_part.copy()
        grid_from_part[:2, 3] += plate_corner_mm(at, len(plates), presets)
        pieces.append(replace(piece, bed_from_part=grid_from_part))
    return pieces


def _plates_text(title: str, plates: Sequence[Plate], objects: Sequence[ObjectText], *, has_pictures: bool) -> str:
    """Which objects lie on which plate. Plates are locked: arranging would take pieces into the tower's place."""
    text, rest = "", iter(objects)
    for number, plate in enumerate(plates, start=1):
        text += (
            f' <plate>\n  <metadata key="plater_id" value="{number}"/>\n'
            f'  <metadata key="plater_name" value={quoted(plate.title or title)}/>\n'
            '  <metadata key="locked" value="true"/>\n'
        )
        if has_pictures:
            text += f'  <metadata key="thumbnail_file" value="Metadata/plate_{number}.png"/>\n'
        for _ in plate.pieces:
            one = next(rest)
            text += (
                f'  <model_instance>\n   <metadata key="object_id" value="{one.object_id}"/>\n'
                '   <metadata key="instance_id" value="0"/>\n'
                f'   <metadata key="identify_id" value="{one.object_id}"/>\n  </model_instance>\n'
            )
        text += " </plate>\n"
    return text


def _settings(
    plates: Sequence[Plate], printing: PrintSpec, presets: Presets, more: Mapping[str, str]
) -> dict[str, str | list[str]]:
    """The project's own settings, and the presets by name. All values are text."""
    colours = [colour.upper() for colour in printing.filament_colours]
    towers = [plate.tower_mm(_TOWER_MM, _TOWER_MM) for plate in plates]
    has_tower = any(towers) and printing.printer.machine.change.has_tower
    process = {**process_settings(printing.printer, has_tower=has_tower), **more}
    usual = next((place for place in towers if place is not None), (0.0, 0.0))  # of plates that have no tower
    x, y = ([f"{(place or usual)[k]:g}" for place in towers] for k in (0, 1))
    change = printing.printer.machine.change
    purges = (change.purge_to_ink_mm3, change.purge_to_body_mm3)  # as the page has them
    to_ink, to_body = (f"{max(0.0, purge - PRIME_MM3):g}" for purge in purges)
    return {
        "name": "project_settings",
        "from": "project",
        "version": VERSION,
        "printer_model": presets.model,
        "nozzle_diameter": [f"{presets.nozzle_mm:g}"],
        "printer_settings_id": presets.printer,
        "print_settings_id": presets.process,
        "filament_settings_id": [presets.filament for _ in colours],
        "different_settings_to_system": [";".join(sorted(process)), *("" for _ in (*colours, "printer"))],
        **process,
        "filament_colour": colours,
        "curr_bed_type": presets.plate_type,
        "flush_volumes_matrix": ["0", to_ink, to_body, "0"] if len(colours) > 1 else ["0"],  # from each (rows) to each
        "flush_multiplier": "1",
        "wipe_tower_x": x,
        "wipe_tower_y": y,
    }
