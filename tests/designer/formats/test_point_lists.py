"""Points for other tools: what their own readers make of the files."""

from pathlib import Path

import cv2
import numpy as np
import pycolmap
import pytest
import yaml

from calib.app.target import target
from calib.observe.point_target import read_points
from designer.app.convert import convert
from designer.base.errors import InputError
from designer.formats.point_lists import POINT_FORMATS
from designer.target import target_to_json
from tests.support.command_line import design
from tests.support.designs import small

ICO, BOARD = small("ico").target, small("board").target


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """Target files of both."""
    for name, one in (("ico", ICO), ("board", BOARD)):
        (tmp_path / f"{name}.target.json").write_text(target_to_json(one))
    return tmp_path


def test_names_are_each_its_own() -> None:
    """A name belongs to one point."""
    assert len(set(ICO.point_names)) == ICO.ring_count


def test_a_table_is_read_back_bit_for_bit(files: Path) -> None:
    """By `calib target --from`: places, ids and faces."""
    (made,) = convert(files / "ico.target.json", to="csv").save(files / "points.csv")
    read = read_points(made)
    assert np.array_equal(read.position_mm, ICO.center_mm)
    assert np.array_equal(read.ids, np.arange(ICO.ring_count))
    assert [int(name) for name in read.plane] == ICO.ring_face.tolist()
    (said,) = target(points=made, out=files / "back.target.json").remarks
    assert "no use for: name, kind, diameter_mm" in said
    for name in POINT_FORMATS.keys() - {"csv", "kalibr"}:  # which keep less, and are no tables of this kind
        (made,) = convert(files / "ico.target.json", to=name).save(files / name)
        with pytest.raises(InputError, match="column 'X' is missing"):
            target(points=made, out=files / "back.target.json")


def test_others_read_their_files(files: Path) -> None:
    """COLMAP's reader, OpenCV's and a reader of tables find every point where it is."""
    for name in ("colmap", "opencv", "metashape"):
        answer = design("convert", files / "ico.target.json", "--to", name)
        assert answer.code == 0, answer.err
    folder = files / "colmap"
    folder.mkdir()
    (folder / "points3D.txt").write_text((files / "ico.points3D.txt").read_text())
    for name in ("cameras", "images", "rigs", "frames"):
        (folder / f"{name}.txt").write_text("")
    points = pycolmap.Reconstruction(str(folder)).points3D
    assert np.array_equal([points[row + 1].xyz for row in range(ICO.ring_count)], ICO.center_mm)
    storage = cv2.FileStorage(str(files / "ico.points.yml"), cv2.FILE_STORAGE_READ)
    assert np.array_equal(storage.getNode("object_points").mat(), ICO.center_mm)
    table = np.loadtxt(files / "ico.markers.csv", delimiter=",", usecols=(1, 2, 3))
    np.testing.assert_allclose(1000 * table, ICO.center_mm, atol=1e-9)


def test_a_grid_of_circles_is_a_full_square_one(files: Path) -> None:
    """Kalibr's file has the board's grid in metres; a target that is none is refused with another format."""
    grid = yaml.safe_load(convert(files / "board.target.json", to="kalibr").text)
    assert (grid["targetCols"], grid["targetRows"]) == (5, 5)
    assert grid["spacingMeters"] == pytest.approx(0.01)
    with pytest.raises(InputError, match=r"one full square grid.*--to csv"):
        convert(files / "ico.target.json", to="kalibr")
    with pytest.raises(InputError, match=r"no such format.*csv"):
        convert(files / "ico.target.json", to="foo")


def test_somebody_elses_file_stays(files: Path) -> None:
    """Its own file is replaced, another one is not."""
    for _ in range(2):
        assert design("convert", files / "ico.target.json", "--to", "csv", "-o", files / "mine.csv").code == 0
    (files / "other.csv").write_text("X,Y,Z\n1,2,3\n")
    answer = design("convert", files / "ico.target.json", "--to", "csv", "-o", files / "other.csv")
    assert answer.code == 2
    assert (files / "other.csv").read_text() == "X,Y,Z\n1,2,3\n"
