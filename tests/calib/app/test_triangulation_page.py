"""Triangulated points as they are told."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
from calib.core.se3 import look_at
from calib.renderer.options import RenderOptions
from designer.base.errors import InputError
from designer.page.blocks import Findings, Headline, Table, View3d
from tests.support.command_scene import BOARD, CAMERA
from tests.support.space_scenes import points_before, row_of_cameras, sighted


def points_of_a_pair() -> calib.Triangulation:
    """Thirty of them."""
    rig = row_of_cameras(2)
    seen = sighted(rig, points_before(rig, 30, np.random.default_rng(1)), np.random.default_rng(2))
    return calib.triangulate(rig, seen)


def seen_in_part(both: int, only_first: int, only_second: int) -> calib.Triangulation:
    """Points of a pair, most of them seen by one camera."""
    rig = row_of_cameras(2)
    count = both + only_first + only_second
    seen = sighted(rig, points_before(rig, count, np.random.default_rng(1)), np.random.default_rng(2))
    keep = np.where(
        seen.camera == 0, seen.place < both + only_first, (seen.place < both) | (seen.place >= both + only_first)
    )
    part = replace(seen, camera=seen.camera[keep], place=seen.place[keep], center_px=seen.center_px[keep])
    return calib.triangulate(rig, part)


def headline_of(found: calib.Triangulation) -> Headline:
    """The answer, on its page."""
    headline = found.page().headline
    assert headline is not None
    return headline


def test_a_page_of_points_tells_what_the_file_holds(tmp_path: Path) -> None:
    """Headline, tables and scene are of the same numbers."""
    found = points_of_a_pair()
    found.save(tmp_path)
    record, page = json.loads((tmp_path / "triangulation.json").read_text()), found.page()
    assert f"{record['placed']} of {record['points']} points" in headline_of(found).sentence
    errors = next(block for section in page.sections for block in section.blocks if isinstance(block, Table))
    assert errors.rows[0][1].value == record["total"]["median_mm"]
    assert any(isinstance(block, View3d) for block in page.lead)


def test_points_alone_are_the_folders_table(tmp_path: Path) -> None:
    """A name that ends in .csv takes the points and nothing else."""
    found = points_of_a_pair()
    assert found.save(tmp_path / "mine.csv") == (tmp_path / "mine.csv",)
    found.save(tmp_path / "folder", has_page=False)
    assert (tmp_path / "mine.csv").read_bytes() == (tmp_path / "folder/points.csv").read_bytes()


def test_points_of_one_camera_are_counted_and_not_judged() -> None:
    """Those that could be triangulated are good; the others are told with the cameras, and are no reason against."""
    record = seen_in_part(25, 40, 7)
    assert [one.seen_alone for one in record.cameras] == [40, 7]
    headline = headline_of(record)
    assert headline.level == "good"
    assert "25 of 25 points that two cameras or more saw" in headline.sentence
    assert "47 more were seen by one camera only" in headline.sentence
    checks = next(block for block in record.page().sections[0].blocks if isinstance(block, Findings))
    alone = next(row for row in checks.rows if row.title == "Seen by one camera only")
    assert (alone.level, alone.measured) == ("note", "47 of 72")
    assert alone.text.startswith("40 by a, 7 by b")


def test_points_of_two_cameras_without_a_position_are_judged_as_before() -> None:
    """A table whose rows were mixed up stays bad, whatever one camera saw alone besides."""
    rig = row_of_cameras(2)
    seen = sighted(rig, points_before(rig, 30, np.random.default_rng(1)), np.random.default_rng(2))
    mixed = replace(seen, place=np.where(seen.camera == 1, np.roll(seen.place, 1), seen.place))
    assert headline_of(calib.triangulate(rig, mixed)).level == "bad"
    assert headline_of(seen_in_part(0, 3, 2)).sentence == (
        "None of 5 points has a position; 5 were seen by one camera only."
    )


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
    assert found.placed == found.lengths.points == len(BOARD.ring_face)
    assert found.lengths.rms_mm < 0.1
    assert found.lengths.ratio < 3
    (tmp_path / "photos" / "b").rename(tmp_path / "photos" / "c")
    with pytest.raises(InputError, match="camera 'c': not in the rig"):
        calib.triangulate(rig, target=BOARD, photos=tmp_path / "photos")
