"""One project of all plates, read as the published readers of Bambu Studio and OrcaSlicer read it, and by others."""

import io
import json
import math
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import cast
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

from designer.app.design import DesignedTarget, design
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.builds.design import EXPORTERS
from designer.formats.project import MOST_PLATES, PRIME_MM3, plate_corner_mm
from designer.formats.settings import process_settings
from designer.kinds.presets import preset_names, preset_or_file
from designer.kinds.sizing import size_job
from designer.kinds.spec_file import read_printer_file
from designer.make.bed import Plate
from designer.spec.machine import Presets
from tests.support.designs import asked_for
from tests.support.gcode import require_slicer
from tests.support.programs import run

CORE = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
WISHES = {
    "cube": {"kind": "cube", "edge": "60mm", "pitch": "9mm", "printer": "bambu-a1-mini"},
    "board": {"kind": "board", "size": "560x220mm", "pitch": "40mm"},
}
COARSEST = "0.2mm"
TOWER_SIDE_MM, TOWER_BRIM_MM = 35.0, 3.0


@cache
def target_of(name: str) -> DesignedTarget:
    """A small target in tiles."""
    wishes = WISHES[name]
    return design(
        wishes["kind"], build="tiles", chord_error=COARSEST, **{k: v for k, v in wishes.items() if k != "kind"}
    )


@cache
def package_of(name: str) -> bytes:
    """Its project."""
    ((suffix, content, _),) = EXPORTERS["project"](target_of(name).design)
    assert suffix == "bambu-orca.3mf"
    return content


@pytest.fixture(params=WISHES)
def name(request: pytest.FixtureRequest) -> str:
    return cast("str", request.param)


@dataclass(frozen=True, eq=False)
class ReadObject:
    """As the readers have it: parts with their filaments, and where all corners are in the grid of plates."""

    name: str
    filament_of: dict[str, str]
    corners_mm: Array  # (N, 3)


@dataclass(frozen=True)
class ReadPlate:
    """A plate with what it names and what lies over it."""

    name: str
    named: list[str]
    over: list[str]
    corner_mm: tuple[float, float]


def columns_of(count: int) -> int:
    """`PartPlate.hpp`: the root, rounded half away from zero, and one more where that is less than the root."""
    root = math.sqrt(count)
    rounded = math.floor(root + 0.5)
    return rounded + 1 if root > rounded else rounded


def settings(element: ElementTree.Element) -> dict[str, str]:
    """The metadata right under an element."""
    return {entry.attrib["key"]: entry.attrib["value"] for entry in element.findall("metadata")}


def read_objects(archive: zipfile.ZipFile) -> dict[str, ReadObject]:
    """Built objects by their ids, with the settings that go with them by id."""
    model = ElementTree.fromstring(archive.read("3D/3dmodel.model"))
    of_id = {one.attrib["id"]: one for one in model.iter(f"{CORE}object")}
    config = ElementTree.fromstring(archive.read("Metadata/model_settings.config"))
    told = {one.attrib["id"]: one for one in config.findall("object")}
    read = {}
    for item in model.iter(f"{CORE}item"):
        number = item.attrib["objectid"]
        motion = np.array(item.attrib["transform"].split(), dtype=float).reshape(4, 3)  # of row vectors
        parts = [leaf.attrib["objectid"] for leaf in of_id[number].iter(f"{CORE}component")]
        by_part = {part.attrib["id"]: settings(part) for part in told[number].findall("part")}
        assert sorted(by_part) == sorted(parts), "a part is found by the id of its mesh"
        corners = np.array(
            [[float(at.attrib[k]) for k in "xyz"] for part in parts for at in of_id[part].iter(f"{CORE}vertex")]
        )
        filaments = {by_part[part]["name"]: by_part[part]["extruder"] for part in parts}
        read[number] = ReadObject(settings(told[number])["name"], filaments, corners @ motion[:3] + motion[3])
    return read


@cache
def read_plates(name: str) -> tuple[list[ReadPlate], list[ReadObject]]:
    """Plates by their numbers, with what reaches into their rectangles; and all objects."""
    plate_mm = presets_of(name).plate_mm
    with zipfile.ZipFile(io.BytesIO(package_of(name))) as archive:
        objects = read_objects(archive)
        config = ElementTree.fromstring(archive.read("Metadata/model_settings.config"))
    told = sorted(config.findall("plate"), key=lambda plate: int(settings(plate)["plater_id"]))
    assert [settings(plate)["plater_id"] for plate in told] == [str(1 + at) for at in range(len(told))]
    assert {settings(plate)["locked"] for plate in told} == {"true"}, "arranging leaves them as they are"
    identities = [settings(one)["identify_id"] for plate in told for one in plate.findall("model_instance")]
    assert len({*identities}) == len(identities) == len(objects)
    columns, plates = columns_of(len(told)), []
    for at, plate in enumerate(told):
        corner = np.array([at % columns * plate_mm[0] * 1.2, -(at // columns) * plate_mm[1] * 1.2])
        over = [
            one.name
            for one in objects.values()
            if (one.corners_mm[:, :2].max(axis=0) > corner).all()
            and (one.corners_mm[:, :2].min(axis=0) < corner + plate_mm).all()
        ]
        named = [objects[settings(one)["object_id"]].name for one in plate.findall("model_instance")]
        plates.append(ReadPlate(settings(plate)["plater_name"], named, over, (float(corner[0]), float(corner[1]))))
    return plates, [*objects.values()]


def presets_of(name: str) -> Presets:
    """Of the printer that a target is for."""
    presets = target_of(name).design.job.printing.printer.presets
    assert presets is not None
    return presets


def project_settings(name: str) -> dict[str, str | list[str]]:
    """The settings in a project."""
    with zipfile.ZipFile(io.BytesIO(package_of(name))) as archive:
        return cast("dict[str, str | list[str]]", json.loads(archive.read("Metadata/project_settings.config")))


def test_each_piece_lies_on_the_plate_that_names_it_as_on_its_own_bed(name: str) -> None:
    """Over the rectangle of one plate of the readers' grid, where the plate's own files have it, and over no other."""
    plates, objects = read_plates(name)
    made = target_of(name).design.plates
    assert [plate.named for plate in plates] == [[piece.name for piece in plate.pieces] for plate in made]
    assert [sorted(plate.over) for plate in plates] == [sorted(plate.named) for plate in plates]
    by_name = {one.name: one for one in objects}
    for plate, ours in zip(plates, made, strict=True):
        for piece in ours.pieces:
            lies = piece.as_it_lies
            wanted = np.concatenate([mesh.vertices_mm for mesh in (lies.body, lies.ink) if mesh is not None])
            on_bed = by_name[piece.name].corners_mm - [*plate.corner_mm, 0.0]
            assert ((on_bed > -1e-4) & (on_bed < presets_of(name).plate_mm[0])).all()
            assert on_bed == pytest.approx(wanted, abs=1e-4)


def test_body_is_filament_1_and_ink_2(name: str) -> None:
    """Of every object with ink; what has none has a body alone."""
    _, objects = read_plates(name)
    pieces = [piece for plate in target_of(name).design.plates for piece in plate.pieces]
    for one, piece in zip(objects, pieces, strict=True):
        assert one.filament_of == ({"body": "1"} if piece.part.ink is None else {"body": "1", "ink": "2"})


def test_plates_bear_names_that_a_file_may_have(name: str) -> None:
    """Number and contents, in letters that Bambu Studio takes for a plate's name."""
    plates, _ = read_plates(name)
    for number, (plate, ours) in enumerate(zip(plates, target_of(name).design.plates, strict=True), start=1):
        assert plate.name == f"plate {number}, {ours.words}"
        assert not {*plate.name} & {*'<>[]:/\\|?*"'}


def test_each_plate_has_its_picture(name: str) -> None:
    """512 pixels a side where its settings say, 128 under the name that goes with it; no two plates look alike."""
    with zipfile.ZipFile(io.BytesIO(package_of(name))) as archive:
        config = ElementTree.fromstring(archive.read("Metadata/model_settings.config"))
        places = [settings(plate)["thumbnail_file"] for plate in config.findall("plate")]
        large = [archive.read(place) for place in places]
        small = [archive.read(place.replace(".png", "_small.png")) for place in places]
    assert places == [f"Metadata/plate_{number}.png" for number in range(1, 1 + len(target_of(name).design.plates))]
    assert {Image.open(io.BytesIO(one)).size for one in large} == {(512, 512)}
    assert {Image.open(io.BytesIO(one)).size for one in small} == {(128, 128)}
    assert len({*large}) == len(large)


def test_the_grid_is_that_of_the_readers() -> None:
    """For any number of plates that there can be, and plates that are wider than deep."""
    width, depth = 340.0, 320.0
    presets = replace(presets_of("board"), plate_mm=(width, depth))
    for count in range(1, MOST_PLATES + 1):
        for at in range(count):
            row, column = divmod(at, columns_of(count))
            assert plate_corner_mm(at, count, presets) == (
                pytest.approx(1.2 * column * width),
                pytest.approx(-1.2 * row * depth),
            )


def test_it_is_taken_for_a_project(name: str) -> None:
    """By what both readers look at: the application's name and version, and presets that leave nothing open."""
    with zipfile.ZipFile(io.BytesIO(package_of(name))) as archive:
        model = ElementTree.fromstring(archive.read("3D/3dmodel.model"))
    told = {entry.attrib["name"]: entry.text or "" for entry in model.findall(f"{CORE}metadata")}
    prefix, _, version = told["Application"].partition("-")
    assert prefix == "BambuStudio"
    # Bambu Studio 2 takes its own generation; OrcaSlicer takes versions up to 2.3.2 for its own of old.
    assert (2, 0) <= tuple(map(int, version.split("."))) <= (2, 3, 2)
    assert "not by Bambu Studio" in told["Description"]
    found, presets = project_settings(name), presets_of(name)
    assert found["printer_model"] == presets.model
    assert found["printer_settings_id"] == presets.printer
    assert found["print_settings_id"] == presets.process
    assert found["filament_settings_id"] == [presets.filament] * 2
    assert found["filament_colour"] == ["#FFFFFF", "#000000"]
    process, *others = cast("list[str]", found["different_settings_to_system"])
    assert others == [""] * 3, "of two filaments and printer"
    assert {*process.split(";")} == {*process_settings(target_of(name).design.job.printing.printer, has_tower=True)}
    assert found["nozzle_diameter"] == ["0.4"]
    values = [one for value in found.values() for one in (value if isinstance(value, list) else [value])]
    assert all(isinstance(value, str) for value in values)


def test_purge_is_what_the_page_tells() -> None:
    """From each filament to each; what a tower takes is apart in these slicers."""
    change = target_of("cube").design.job.printing.printer.machine.change
    matrix = np.array(project_settings("cube")["flush_volumes_matrix"], dtype=float).reshape(2, 2)
    assert matrix[0, 1] + PRIME_MM3 == change.purge_to_ink_mm3
    assert matrix[1, 0] + PRIME_MM3 == change.purge_to_body_mm3
    assert not matrix.diagonal().any()


def test_prime_towers_stand_clear_of_pieces(name: str) -> None:
    """One place a plate; a tower of 35 mm with its brim, on the bed, over no piece that is printed with it."""
    made, found = target_of(name).design, project_settings(name)
    low = np.column_stack([np.array(found[f"wipe_tower_{k}"], dtype=float) for k in "xy"])
    assert len(low) == len(made.plates)
    for plate, corner in zip(made.plates, low, strict=True):
        if plate.is_two_filament:
            bed = made.job.printing.printer.bed_mm[:2]
            assert (corner >= TOWER_BRIM_MM).all()
            assert (corner + TOWER_SIDE_MM + TOWER_BRIM_MM <= bed).all()
            assert_clear(plate, corner)


def assert_clear(plate: Plate, corner: Array) -> None:
    """No corner of a piece in the tower's square, and no corner of the square under a piece (which are convex)."""
    low, high = corner - TOWER_BRIM_MM, corner + TOWER_SIDE_MM + TOWER_BRIM_MM
    square = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    for piece in plate.pieces:
        points = piece.as_it_lies.body.vertices_mm[:, :2]
        assert not ((points > low) & (points < high)).all(axis=1).any()
        turns = np.radians(np.arange(0, 180, 1.0))
        ways = np.column_stack([np.cos(turns), np.sin(turns)])
        of_piece, of_square = points @ ways.T, square @ ways.T
        apart = (of_piece.min(axis=0) > of_square.max(axis=0)) | (of_piece.max(axis=0) < of_square.min(axis=0))
        assert apart.any(), f"{piece.name} covers the tower's place"


def test_prusaslicer_shows_all_parts(tmp_path: Path) -> None:
    """As bare geometry: body and ink of each piece, closed."""
    path = tmp_path / "x.3mf"
    path.write_bytes(package_of("board"))
    said = run(require_slicer(), "--info", path).stdout
    parts = [part for plate in target_of("board").design.plates for piece in plate.pieces
             for part in (piece.part.body, piece.part.ink) if part is not None]  # fmt: skip
    facets = [int(line.split("=")[1]) for line in said.splitlines() if line.startswith("number_of_facets")]
    assert sorted(facets) == sorted(len(part.triangles) for part in parts)
    assert said.count("manifold = yes") == len(parts)


def formats_and_remarks(**wishes: str) -> tuple[Sequence[str], str]:
    """What is written of a cube in tiles, and what was remarked."""
    sized = size_job(asked_for("cube", {"edge": "50mm", "build": "tiles", **wishes}))
    return sized.job.formats, "\n".join(sized.remarks)


@pytest.mark.parametrize(
    ("wishes", "named"),
    [
        ({"printer": "prusa-xl"}, "prusa-xl with a 0.4mm nozzle"),
        ({"printer": "bambu-h2d"}, "bambu-h2d"),
        ({"nozzle": "0.2mm"}, "a 0.2mm nozzle"),
        ({"bed": "300x256x256mm"}, "a bed of 300x256mm"),
    ],
)
def test_without_known_presets_there_is_none(wishes: dict[str, str], named: str) -> None:
    """Settings without names would replace the person's printer: left out with the reason, refused if asked for."""
    formats, remarks = formats_and_remarks(**wishes)
    assert formats == ("3mf", "png")
    assert "project: left out" in remarks
    assert named in remarks
    with pytest.raises(InputError, match=r"presets.*open the plates one by one"):
        formats_and_remarks(**wishes, formats="project")


def test_one_piece_has_none() -> None:
    """It lies on one plate."""
    assert formats_and_remarks()[0] == ("3mf", "project", "png")
    with pytest.raises(InputError, match="several plates, and this build lies on one; use 3mf"):
        size_job(asked_for("ico", {"edge": "50mm", "formats": "project"}))


def test_presets_of_templates_are_of_their_printer() -> None:
    """Seven printers have them; the names begin as the printer's, the plate is its bed, the nozzle one that it has."""
    known = {name: read_printer_file(preset_or_file("printers", name)) for name in preset_names("printers")}
    having = {name: file.machine.presets for name, file in known.items() if file.machine.presets is not None}
    assert len(having) == 7
    for name, presets in having.items():
        file = known[name]
        assert presets.model == file.title
        assert presets.printer == f"{file.title} {presets.nozzle_mm:g} nozzle"
        assert presets.plate_mm == file.bed[:2]
        (nozzle,) = [one for one in file.nozzles if one.diameter == presets.nozzle_mm]
        assert presets.process.startswith(f"{nozzle.layer_height:.2f}mm ")
