"""Our detections in OpenCV's own functions, without a conversion in between."""

from pathlib import Path

import cv2
import numpy as np
import pytest

import calib
from calib.observe.dataset import read_detections, write_detections
from calib.renderer.options import RenderOptions
from calib.renderer.view import render_view
from tests.support.calibrations import board, camera, poses_around

BOARD = board(7, 5, "12mm")
CAMERA = camera("opencv", (640, 480), 700.0)
POSES = poses_around(6, np.random.default_rng(2), half_angle_rad=0.7, distance_mm=150.0)
OPTIONS = RenderOptions(blur_px=0.6, contrast_to_noise=80)


@pytest.fixture(scope="module")
def photos() -> list[np.ndarray]:
    """Rendered photos as OpenCV reads them: blue, green, red."""
    rng = np.random.default_rng(7)
    views = (render_view(BOARD, CAMERA, pose, OPTIONS, rng).image.astype(np.uint8) for pose in POSES)
    return [cv2.cvtColor(view, cv2.COLOR_GRAY2BGR) for view in views]


@pytest.fixture(scope="module")
def found(photos: list[np.ndarray]) -> list[calib.Detections]:
    """What is found in them."""
    detector = calib.Detector(BOARD)
    return [detector.detect(photo, f"{number}.png") for number, photo in enumerate(photos)]


def test_opencv_solves_from_our_detections_what_we_solve(found: list[calib.Detections]) -> None:
    """`cv2.calibrateCamera` and `cv2.solvePnP` take the points as they are, and end where our own solution does.

    The points are float32, so centres are rounded to some 3e-5 px.
    """
    for one in found:
        assert (one.object_points.shape, one.object_points.dtype) == ((len(one.ring), 1, 3), np.float32)
        assert (one.image_points.shape, one.image_points.dtype) == ((len(one.ring), 1, 2), np.float32)
    objects, images = [one.object_points for one in found], [one.image_points for one in found]
    _, matrix, lens, turns, _ = cv2.calibrateCamera(objects, images, (640, 480), None, None)
    ours = calib.solve(found, BOARD, model="opencv", weighted=False).best
    assert ours.camera.matrix == pytest.approx(matrix, abs=0.02)
    assert ours.camera.distortion == pytest.approx(lens.ravel(), rel=0.01, abs=1e-4)
    pose = ours.calibration.cam_from_target[2]
    good, turn, shift = cv2.solvePnP(objects[2], images[2], ours.camera.matrix, ours.camera.distortion)
    assert good
    assert cv2.Rodrigues(turn)[0] == pytest.approx(pose[:3, :3], abs=1e-4)
    assert cv2.Rodrigues(turns[2])[0] == pytest.approx(pose[:3, :3], abs=1e-4)
    assert shift.ravel() == pytest.approx(pose[:3, 3], abs=0.01)


def test_points_of_a_file_are_those_of_the_photo(found: list[calib.Detections], tmp_path: Path) -> None:
    """Detections that were written and read give OpenCV the same points; a part has the part's."""
    write_detections(tmp_path / "d.csv", found, BOARD)
    again = read_detections(tmp_path / "d.csv", BOARD, target_path=tmp_path)
    for one, other in zip(found, again, strict=True):
        assert np.array_equal(one.object_points, other.object_points)
        assert one.image_points == pytest.approx(other.image_points, abs=1e-4)
    assert np.array_equal(found[0].keep(slice(2, 5)).object_points, found[0].object_points[2:5])


def test_what_was_found_can_be_seen(found: list[calib.Detections], photos: list[np.ndarray]) -> None:
    """An overlay of an array is a picture in red, green, blue, which the photo alone is not."""
    detector = calib.Detector(BOARD)
    shown, empty = (detector.draw(photos[0], one) for one in (found[0], found[0].keep(slice(0))))
    assert shown.dtype == np.uint8
    assert shown.shape[2] == 3
    assert np.ptp(shown, axis=2).max() > 50
    assert shown.shape != empty.shape or not np.array_equal(shown, empty)


def test_solve_refuses_what_it_cannot_solve_from(found: list[calib.Detections]) -> None:
    """Detections without a target, and detections of another one, are an InputError each."""
    with pytest.raises(calib.InputError, match="give the target they show"):
        calib.solve(found)
    with pytest.raises(calib.InputError, match="give the target that the photos show"):
        calib.solve(found, board(8, 5, "12mm"))
