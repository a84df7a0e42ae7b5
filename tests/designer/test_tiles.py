"""A solid in tiles as the command makes it: files, plates, page."""

import io
import re
import zipfile
from functools import cache

import lib3mf
import numpy as np
import pytest

from designer.builds.tiles import assembly_of
from designer.designing import DesignedTarget, design
from designer.formats.folder import OutputFile
from designer.kinds.sizing import size_job
from designer.make.mounts import MOUNTS as BUILT_MOUNTS
from designer.produce import Design
from designer.report.plates import plate_picture
from designer.spec.build import MOUNTS
from tests.support.designs import COARSE, asked_for

FACES = 20


@cache
def target_of(**wishes: str) -> DesignedTarget:
    """A small icosahedron in tiles."""
    return design("ico", edge="50mm", build="tiles", chord_error=COARSE, **wishes)


@cache
def files_of() -> dict[str, OutputFile]:
    """Its files by what follows the name."""
    made = target_of()
    return {file.name.removeprefix(f"{made.name}."): file for file in made.files()}


def test_every_piece_lies_on_a_plate_once_within_the_bed_and_apart() -> None:
    """All tiles by their numbers, all of the core; on the bed, none over another."""
    made = target_of().design
    names = [piece.name for plate in made.plates for piece in plate.pieces]
    assert names[:FACES] == [f"tile {face}" for face in range(FACES)]
    assert set(names[FACES:]) == {part.name for part in assembly_of(made).core}
    bed = np.array(made.job.printing.printer.bed_mm)
    for plate in made.plates:
        for piece in plate.pieces:
            corners = piece.as_it_lies.body.vertices_mm
            assert corners[:, 2].min() == pytest.approx(0.0, abs=1e-6)
            assert (corners.min(axis=0) > -1e-6).all()
            assert (corners.max(axis=0) < bed).all()
            assert (
                not ((corners[:, 0] > bed[0] - 60) & (corners[:, 1] > bed[1] - 60)).any() or not plate.is_two_filament
            )


def test_a_plate_holds_one_object_a_tile_in_both_layouts() -> None:
    """Read strictly by lib3mf: as many objects as pieces; a tile for PrusaSlicer has two volumes."""
    plate = target_of().design.plates[0]
    for slicer in ("prusa", "bambu"):
        content = files_of()[f"plate-1.{slicer}.3mf"].content
        model = lib3mf.get_wrapper().CreateModel()
        reader = model.QueryReader("3mf")
        reader.SetStrictModeActive(True)
        reader.ReadFromBuffer(content)
        assert reader.GetWarningCount() == 0
        items = model.GetBuildItems()
        assert items.Count() == len(plate.pieces)
    with zipfile.ZipFile(io.BytesIO(files_of()["plate-1.prusa.3mf"].content)) as package:
        config = package.read("Metadata/Slic3r_PE_model.config").decode()
    assert config.count("<object ") == len(plate.pieces)
    assert config.count('key="extruder" value="2"') == sum(piece.part.ink is not None for piece in plate.pieces)
    assert config.count("<volume ") == 2 * len(plate.pieces)


def test_ink_is_in_the_first_layers_or_in_the_last() -> None:
    """As --ink-side says, and nowhere else; the back then lies up or down."""
    for side, height in (("down", 0.0), ("up", None)):
        made = target_of(ink_side=side).design
        sizes = assembly_of(made).sizes
        top = sizes.thickness_mm
        for piece in made.plates[0].pieces:
            ink = piece.as_it_lies.ink
            assert ink is not None
            low, high = ink.vertices_mm[:, 2].min(), ink.vertices_mm[:, 2].max()
            assert (low, high) == pytest.approx((0.0, 0.6) if height == 0.0 else (top - 0.6, top), abs=1e-6)


def test_the_target_is_that_of_one_piece() -> None:
    """How a target is built changes no number of its geometry."""
    assert target_of().geometry.geometry_id == design("ico", edge="50mm").geometry.geometry_id


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
    values = {"edge": "50mm", "build": "tiles", "ink_side": ink_side, "chord_error": COARSE}
    made = Design(size_job(asked_for("cube", values)).job)
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
