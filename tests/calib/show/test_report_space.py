"""The pages of triangulated points and of budgets: built from their folders alone, and from nothing that is damaged."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
from calib.core.se3 import look_at
from calib.records.triangulation_file import TriangulationRecord
from calib.renderer.options import RenderOptions
from calib.show.folder import build_page, origin_in
from calib.show.space.triangulated import checks_of, headline_of
from designer.base.errors import InputError
from designer.page.blocks import Facts, Figure, Section, Table, View3d
from designer.page.shell import page_html
from tests.support.command_scene import BOARD, CAMERA
from tests.support.space_scenes import points_before, row_of_cameras, sighted


@pytest.fixture(scope="module")
def budget_of_pair() -> calib.Budget:
    """The budget of a pair, made once."""
    return calib.budget(row_of_cameras(2), distance_mm=(700, 1500))


def folder_of_points(folder: Path) -> Path:
    """Points of a pair."""
    rig = row_of_cameras(2)
    seen = sighted(rig, points_before(rig, 30, np.random.default_rng(1)), np.random.default_rng(2))
    calib.triangulate(rig, seen).save(folder)
    return folder


def seen_in_part(both: int, only_first: int, only_second: int) -> TriangulationRecord:
    """Points of a pair, most of them seen by one camera."""
    rig = row_of_cameras(2)
    count = both + only_first + only_second
    seen = sighted(rig, points_before(rig, count, np.random.default_rng(1)), np.random.default_rng(2))
    keep = np.where(
        seen.camera == 0, seen.place < both + only_first, (seen.place < both) | (seen.place >= both + only_first)
    )
    part = replace(seen, camera=seen.camera[keep], place=seen.place[keep], center_px=seen.center_px[keep])
    return calib.triangulate(rig, part).record


def tables_of(sections: tuple[Section, ...]) -> list[Table]:
    """All tables of a page."""
    return [block for section in sections for block in section.blocks if isinstance(block, Table)]


def test_a_folder_of_points_tells_what_its_record_holds(tmp_path: Path) -> None:
    """The kind is known without a report.json; headline, tables and scene are of the same numbers."""
    page = build_page(folder_of_points(tmp_path), origin_in(tmp_path))
    record = json.loads((tmp_path / "triangulation.json").read_text())
    assert page.headline is not None
    assert f"{record['placed']} of {record['points']} points" in page.headline.sentence
    errors = tables_of(page.sections)[0]
    assert errors.rows[0][1].value == record["total"]["median_mm"]
    assert any(isinstance(block, View3d) for block in page.lead)
    assert "<script" in page_html(page).decode()


def test_points_of_one_camera_are_counted_and_not_judged() -> None:
    """Those that could be triangulated are good; the others are told with the cameras, and are no reason against."""
    record = seen_in_part(25, 40, 7)
    assert [one.seen_alone for one in record.cameras] == [40, 7]
    headline = headline_of(record)
    assert headline.level == "good"
    assert "25 of 25 points that two cameras or more saw" in headline.sentence
    assert "47 more were seen by one camera only" in headline.sentence
    alone = next(row for row in checks_of(record).rows if row.title == "Seen by one camera only")
    assert (alone.level, alone.measured) == ("note", "47 of 72")
    assert alone.text.startswith("40 by a, 7 by b")


def test_points_of_two_cameras_without_a_position_are_judged_as_before() -> None:
    """A table whose rows were mixed up stays bad, whatever one camera saw alone besides."""
    rig = row_of_cameras(2)
    seen = sighted(rig, points_before(rig, 30, np.random.default_rng(1)), np.random.default_rng(2))
    mixed = replace(seen, place=np.where(seen.camera == 1, np.roll(seen.place, 1), seen.place))
    assert headline_of(calib.triangulate(rig, mixed).record).level == "bad"
    assert headline_of(seen_in_part(0, 3, 2)).sentence == (
        "None of 5 points has a position; 5 were seen by one camera only."
    )


def test_a_budgets_page_shows_depth_planes_and_what_would_help(budget_of_pair: calib.Budget) -> None:
    """Three figures of a pair; each change with what it assumes; the headline's number is the table's."""
    page = budget_of_pair.page()
    figures = [block for section in page.sections for block in section.blocks if isinstance(block, Figure)]
    assert [one.title.split(",")[0] for one in figures] == [
        "Depth error over distance", "Error of a point", "Error of a point"
    ]  # fmt: skip
    first, *_, last = tables_of(page.sections)
    assert page.headline is not None
    assert page.headline.word == f"{first.rows[0][1].text} mm"
    assumed = next(block for section in page.sections for block in section.blocks if isinstance(block, Facts))
    assert [name for name, _ in assumed.rows] == [row[0].text for row in last.rows[1:]]


def test_rings_in_photos_of_a_check_object_become_points(tmp_path: Path) -> None:
    """A folder a camera, by the rig's names: found, triangulated, compared; a folder of no camera is named."""
    rig = row_of_cameras(2)
    eyes = np.array([[-25.0, 0, 150], [25.0, 10, 150]])
    poses = look_at(eyes, np.zeros((2, 3)))
    inverse = np.linalg.inv(poses[0])
    pair = calib.Rig(("a", "b"), (CAMERA, CAMERA), poses @ inverse, None, np.full(2, 0.05))
    for name, pose in zip(pair.names, poses, strict=True):
        options = RenderOptions(contrast_to_noise=50)
        calib.render(BOARD, CAMERA, poses=pose[None], options=options).save(tmp_path / "photos" / name)
    found = calib.triangulate(pair, target=BOARD, photos=tmp_path / "photos")
    assert found.lengths is not None
    assert found.record.placed == found.lengths.points == len(BOARD.ring_face)
    assert found.lengths.rms_mm < 0.1
    assert found.lengths.ratio < 3
    (tmp_path / "photos" / "b").rename(tmp_path / "photos" / "c")
    with pytest.raises(InputError, match="camera 'c': not in the rig"):
        calib.triangulate(rig, target=BOARD, photos=tmp_path / "photos")
