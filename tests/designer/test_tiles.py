"""A solid in tiles as the command makes it: files, plates, page."""

import io
import re
import zipfile
from functools import cache

import pytest

from designer.app.design import DesignedTarget, design
from designer.builds.plates import plate_picture
from designer.builds.tiles import assembly_of
from designer.formats.folder import OutputFile
from designer.make.mounts import MOUNTS as BUILT_MOUNTS
from designer.spec.build import MOUNTS
from tests.support.designs import COARSE


@cache
def target_of(ink_side: str = "down") -> DesignedTarget:
    """A small cube in tiles."""
    return design("cube", edge="50mm", build="tiles", chord_error=COARSE, ink_side=ink_side)


@cache
def files_of() -> dict[str, OutputFile]:
    """Its files by what follows the name."""
    made = target_of()
    return {file.name.removeprefix(f"{made.name}."): file for file in made.files()}


def test_plates_hold_all_tiles_and_all_of_the_core() -> None:
    """Tiles by their numbers, then the core's parts and nothing else."""
    made = target_of().design
    names = [piece.name for plate in made.plates for piece in plate.pieces]
    tiles = [f"tile {face}" for face in range(made.target.face_count)]
    assert names[: len(tiles)] == tiles
    assert set(names[len(tiles) :]) == {part.name for part in assembly_of(made).core}


def test_a_plate_holds_one_object_a_tile_in_both_layouts() -> None:
    """As many objects as pieces; a tile for PrusaSlicer has two volumes."""
    plate, packages = target_of().design.plates[0], {}
    for slicer in ("prusa", "bambu"):
        packages[slicer] = zipfile.ZipFile(io.BytesIO(files_of()[f"plate-1.{slicer}.3mf"].content))
        assert packages[slicer].read("3D/3dmodel.model").count(b"<item ") == len(plate.pieces)
    config = packages["prusa"].read("Metadata/Slic3r_PE_model.config").decode()
    assert config.count("<object ") == len(plate.pieces)
    assert config.count('key="extruder" value="2"') == sum(piece.part.ink is not None for piece in plate.pieces)
    assert config.count("<volume ") == 2 * len(plate.pieces)


def test_ink_is_in_the_first_layers_or_in_the_last() -> None:
    """As --ink-side says, and nowhere else; the back then lies up or down."""
    for side in ("down", "up"):
        made = target_of(ink_side=side).design
        top = assembly_of(made).sizes.thickness_mm
        for piece in made.plates[0].pieces:
            ink = piece.as_it_lies.ink
            assert ink is not None
            low, high = ink.vertices_mm[:, 2].min(), ink.vertices_mm[:, 2].max()
            assert (low, high) == pytest.approx((0.0, 0.6) if side == "down" else (top - 0.6, top), abs=1e-6)


def test_the_target_is_that_of_one_piece() -> None:
    """How a target is built changes no number of its geometry."""
    assert target_of().geometry.geometry_id == design("cube", edge="50mm").geometry.geometry_id


def test_the_page_tells_the_way_from_plates_to_a_measured_solid() -> None:
    """Every plate with its files, the order of all tiles, the command at the end."""
    made = target_of()
    text = files_of()["index.html"].content.decode()
    for plate in made.design.plates:
        assert f"{made.name}.{plate.name}.prusa.3mf" in text
        assert plate.words in text
    assert "calib measure" in text
    assert "Taken apart" in text


def test_mounts_are_those_that_options_name() -> None:
    """What is offered is what is made, in the same order."""
    assert tuple(BUILT_MOUNTS) == MOUNTS


@pytest.mark.parametrize("ink_side", ["down", "up"])
def test_pictures_of_plates_show_rings_as_rings_dots_as_dots_and_what_lies_below_in_dashes(ink_side: str) -> None:
    """A dot is one disc, a ring has a hole; ink on the bed is dashed, and the area that the bed excludes is drawn."""
    made = target_of(ink_side=ink_side).design
    target, pictures = made.target, [plate_picture(made, plate).content.decode() for plate in made.plates]
    circles = [one for picture in pictures for one in re.findall(r"<circle [^>]*>", picture)]
    rings, dots = target.ring_count - int(target.is_dot.sum()), int(target.is_dot.sum())
    if ink_side == "down":
        assert all("stroke-dasharray" in one for one in circles)
        assert len(circles) == 2 * rings + dots
    else:
        assert not any("stroke-dasharray" in one for one in circles)
        assert sum('fill="none"' in one for one in circles) == rings
        assert len(circles) == rings + dots
    assert all('fill="url(#excluded)"' in picture for picture in pictures)
