"""`calib check`: what a folder or a file stands for, and what is said of cameras whose file tells less."""

import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure as MplFigure

import calib
from calib.app.check import CameraCheck
from calib.app.check_history import _draw
from calib.app.check_inputs import NOT_AS_SOLVED
from calib.cameras.camera import load_camera
from calib.cameras.rig import Rig
from calib.observe.calibration_file import Provenance, write_calibration
from calib.solver.calibration import Calibration
from designer.target import target_of_marks
from tests.support import drift_scenes, solver_scenes
from tests.support.boards import BOARDS
from tests.support.command_line import write_correspondences
from tests.support.drift_scenes import CAMERA, photos_of, scaled

POINTS = solver_scenes.board()


@cache
def solved() -> Calibration:
    return drift_scenes.solved(POINTS, np.random.default_rng(1))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A calibration on disk."""
    write_calibration(tmp_path / "opencv", solved(), Provenance("test 1"))
    return tmp_path / "opencv"


def checked(camera: Path, focal: float = 1.0, *, noise_px: float = 0.05) -> CameraCheck:
    """By three new photos of the camera, of other focal lengths."""
    seen = photos_of(scaled(CAMERA, focal), POINTS, 3, np.random.default_rng(4), noise_px=noise_px)
    return calib.check(camera, None, seen, made="exact")


def test_a_camera_file_beside_its_calibration_is_what_is_checked(folder: Path) -> None:
    """What a person wrote into it is found, by the standard deviations of the calibration, not passed over."""
    assert checked(folder).verdict == "yes"
    scaled(solved().camera, 1.003).save(folder / "camera.json")
    for place in (folder, folder / "camera.json"):
        found = checked(place)
        assert (found.verdict, found.causes[0].what, found.remarks) == ("no", "focal length", (NOT_AS_SOLVED,))
    assert checked(folder / "calibration.json").verdict == "yes"


def test_of_several_models_that_of_the_verdict_is_checked(folder: Path) -> None:
    """Which is said; without a verdict they are named."""
    shutil.copytree(folder, folder.parent / "luhmann")
    with pytest.raises(calib.InputError, match="name the folder of one"):
        checked(folder.parent)
    (folder.parent / "verdict.json").write_text('{"verdict": {"model": "opencv"}, "halves": "' + "." * 2**21 + '"}')
    found = checked(folder.parent)
    assert found.verdict == "yes"
    assert "the verdict names is taken, opencv" in found.remarks[0]
    scaled(solved().camera, 1.003).save(folder / "camera.json")
    found = checked(folder.parent)
    assert (found.verdict, found.remarks[1:]) == ("no", (NOT_AS_SOLVED,))


def test_a_file_alone_is_not_called_changed_where_a_lens_may_never_have_fitted(folder: Path) -> None:
    """A small change is only said beside what the calibration left over; a large one is one in any case."""
    camera = shutil.copy(folder / "camera.json", folder.parent / "alone.json")
    assert np.array_equal(load_camera(camera).params, solved().camera.params)
    assert checked(camera, 1.003, noise_px=0.2).verdict == "cannot say"
    assert checked(camera, 1.02).verdict == "no"


def test_a_calibration_that_misfits_says_so() -> None:
    """A lens by too few terms: nothing changed, and no photo says so."""
    camera = replace(CAMERA, params=CAMERA.params * np.where(np.arange(len(CAMERA.params)) == 4, 2, 1))  # k1
    seen = photos_of(camera, POINTS, 40, np.random.default_rng(2), half_angle_deg=50.0)
    misfit = calib.solve(replace(seen, cov_px2=None), model="division").best.calibration
    new = photos_of(camera, POINTS, 3, np.random.default_rng(3))
    found = calib.check(misfit, None, replace(new, cov_px2=None), made="exact")
    assert found.verdict == "cannot say"
    assert "the calibration itself misfits" in found.reason


def test_a_history_takes_a_clock_that_goes_back_and_refuses_what_is_no_time(folder: Path) -> None:
    """Checks are drawn in the order of time; a damaged row is named before any work is done."""
    days = folder.parent / "days"
    seen = photos_of(CAMERA, POINTS, 1, np.random.default_rng(5))
    calib.check(folder, None, seen, made="exact", history=days)
    table = days / "history.csv"
    head, row = table.read_text().rsplit("\n", 2)[:2]
    later, before = ("2100-01-01T00:00:00Z" + row[20:], "1999-01-01T00:00:00Z" + row[20:])
    table.write_text("\n".join((head, later, before, "")))
    found = calib.check(folder, None, seen, made="exact", history=days)
    assert [one.time[:4] for one in found.history[:2]] == ["2100", "1999"]
    lines = [line for line in drawn(found).lines if len(line.get_xdata()) == 3]
    assert np.all(np.diff(lines[0].get_xdata()) > 0)
    for bad in ("yesterday" + row[20:], row[:30]):
        table.write_text("\n".join((head, row, bad, "")))
        with pytest.raises(calib.InputError, match=r"history\.csv: "):
            calib.check(folder, None, seen, made="exact", history=days)


def drawn(found: CameraCheck) -> Axes:
    """The plot of its history."""
    axes = MplFigure().subplots()
    _draw(list(found.history), 0, axes)
    return axes


def test_a_table_with_points_needs_no_target(folder: Path) -> None:
    """It stands where the target would; what it says is what its sightings in memory say."""
    table = folder.parent / "seen.csv"
    seen = replace(photos_of(CAMERA, POINTS, 3, np.random.default_rng(4)), cov_px2=None)
    write_correspondences(table, seen)
    assert calib.check(folder, table, made="exact").photos == calib.check(folder, None, seen, made="exact").photos


def test_photos_of_a_rig_are_given_as_calib_rig_takes_them(tmp_path: Path) -> None:
    """All in one folder, by a pattern, and what is not named so is said; clips are no folders."""
    rig = Rig(("left", "right"), (CAMERA, CAMERA), np.stack([np.eye(4)] * 2))
    target = target_of_marks([BOARDS["chessboard"]], np.eye(4)[None], 0.0)
    for name in ("left01.png", "right01.png", "notes.png"):
        cv2.imwrite(str(tmp_path / name), np.full(CAMERA.image_size[::-1], 128, np.uint8))
    found = calib.check(rig, target, tmp_path, pattern="{camera}{frame}.png")
    assert (found.verdict, found.reason) == ("cannot say", "no photo shows enough of the target")
    assert {one.frame for one in found.left_out} == {"left: left01.png", "right: right01.png"}
    assert "'notes.png'" in "".join(found.remarks)
    (tmp_path / "left.mp4").touch()
    with pytest.raises(calib.InputError, match="give a clip a camera"):
        calib.check(rig, target, tmp_path / "left.mp4")
    with pytest.raises(calib.InputError, match="pattern: tells the cameras of a rig"):
        calib.check(CAMERA, target, tmp_path, pattern="{camera}{frame}.png")
