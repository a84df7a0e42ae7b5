"""Points and pixels as arrays, as `cv2.calibrateCamera` takes them."""

import cv2
import numpy as np
import pytest

import calib
from calib.core.types import Observations, RigObservations
from designer.base.errors import InputError
from tests.support import solver_scenes

CAMERA = solver_scenes.CAMERAS["opencv"]
SEEN = solver_scenes.observe(
    CAMERA, solver_scenes.board(), solver_scenes.poses_around(8, np.random.default_rng(0)), np.random.default_rng(0),
    noise_px=0.05,
)  # fmt: skip
OBJECT = [SEEN.points.position_mm[SEEN.point[SEEN.view == k]].astype(np.float32) for k in range(8)]
IMAGE = [SEEN.center_px[SEEN.view == k].astype(np.float32) for k in range(8)]
SIZE = SEEN.image_size


def test_it_is_what_opencv_solves_and_its_results_go_back_into_opencv() -> None:
    """Either of its shapes; matrix, distortion, turns and shifts are in its order."""
    wide = [one[:, None] for one in IMAGE]
    run = calib.solve(object_points=OBJECT, image_points=wide, image_size=SIZE, model="opencv")
    rms, matrix, distortion, *_ = cv2.calibrateCamera(OBJECT, IMAGE, SIZE, None, None)
    camera, found = run.best.camera, run.best.calibration
    np.testing.assert_allclose(camera.matrix, matrix, rtol=3e-3, atol=1e-9)
    again = cv2.projectPoints(OBJECT[3], found.rvecs[3], found.tvecs[3], camera.matrix, camera.distortion)[0]
    assert np.sqrt(((again[:, 0] - IMAGE[3]) ** 2).sum(axis=1).mean()) < 1.1 * rms
    assert distortion.size == camera.distortion.size


def test_a_unit_makes_the_same_observations() -> None:
    """Metres are a thousand mm; what states no unit is taken as mm, and that is said."""
    first = calib.observations(OBJECT, IMAGE, SIZE)
    metres = calib.observations([one / 1000 for one in OBJECT], IMAGE, SIZE, unit="m")
    assert isinstance(first, Observations)
    assert isinstance(metres, Observations)
    np.testing.assert_allclose(metres.points.position_mm, first.points.position_mm, atol=1e-4)
    assert any("taken as mm" in remark for remark in first.remarks)


def test_cameras_that_took_photos_at_once_are_a_rig() -> None:
    """A list each, by name; what one did not see is None."""
    seen = calib.observations(OBJECT, {"left": IMAGE, "right": [None, *(one + 1 for one in IMAGE[1:])]}, SIZE)
    assert isinstance(seen, RigObservations)
    assert [len(rows) for rows in seen.frame] == [8, 7]


@pytest.mark.parametrize(
    ("points", "pixels", "size", "said"),
    [
        (OBJECT, IMAGE[:-1], SIZE, "8 object_points, 7 image_points"),
        ([OBJECT[0][:-1], *OBJECT[1:]], IMAGE, SIZE, "photo 0: 98 object points, 99 image points"),
        (OBJECT, [one.T for one in IMAGE], SIZE, "it is turned, give its .T"),
        (OBJECT, IMAGE, (*SIZE, 3), "give image.shape[1::-1]"),
        (OBJECT, IMAGE, (1200, 2048), "far outside an image of 1200 x 2048"),
        (OBJECT[0], IMAGE, SIZE, "a list with an array (N, 3) a photo"),
        ([one * np.nan for one in OBJECT], IMAGE, SIZE, "no finite number"),
        (OBJECT, ["a.png"] * 8, SIZE, "image_points[0]"),
        ([], [], SIZE, "there are none"),
    ],
)
def test_a_mistake_is_one_line(points: object, pixels: object, size: object, said: str) -> None:
    """Which array, and what it must be."""
    with pytest.raises(InputError) as refused:
        calib.observations(points, pixels, size)  # type: ignore[arg-type]
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


def test_arrays_stand_alone() -> None:
    """What is missing of them is named, and nothing else is given beside."""
    with pytest.raises(InputError, match="missing is image_size"):
        calib.solve(object_points=OBJECT, image_points=IMAGE)
    with pytest.raises(InputError, match="goes with arrays alone"):
        calib.solve(SEEN, object_points=OBJECT, image_points=IMAGE, image_size=SIZE)
    with pytest.raises(InputError, match="sigma_px must be more"):
        calib.observations(OBJECT, IMAGE, SIZE, sigma_px=[0.1] * 3)
