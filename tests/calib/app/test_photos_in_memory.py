"""Photos that are no files: arrays, and whatever else gives pixels when it is asked."""

from pathlib import Path

import cv2
import numpy as np
import pytest

import calib
from calib.images.photo import Grey, Photo
from calib.observe.photos import FoundPhotos, PhotoFile, photos_of_arrays
from calib.observe.rig_photos import photos_of_images
from calib.observe.robot_poses import RobotPoses
from calib.observe.search import PhotoSearch
from calib.renderer.options import RenderOptions
from calib.renderer.view import render_view
from designer.base.errors import InputError
from tests.support.calibrations import board, camera, poses_around

BOARD = board(7, 5, "12mm")
CAMERA = camera("opencv", (640, 480), 700.0)


@pytest.fixture(scope="module")
def images() -> list[Grey]:
    """Of a board, eight bits."""
    rng = np.random.default_rng(2)
    poses, options = poses_around(5, rng, half_angle_rad=0.7, distance_mm=150.0), RenderOptions(0.6, 80)
    return [render_view(BOARD, CAMERA, pose, options, rng).image.astype(np.uint8) for pose in poses]


def test_arrays_give_what_their_files_give(images: list[Grey], tmp_path: Path) -> None:
    """Bit for bit, in grey and in three equal colours, and a run of them is written whole."""
    for number, image in enumerate(images, start=1):
        cv2.imwrite(str(tmp_path / f"image-{number}.png"), image)
    files = calib.run(BOARD, str(tmp_path), model="opencv", made="exact")
    coloured = [cv2.cvtColor(one, cv2.COLOR_GRAY2BGR) if one is images[0] else one for one in images]
    arrays = calib.run(BOARD, images=iter(coloured), model="opencv", made="exact", out=tmp_path / "run")
    np.testing.assert_array_equal(arrays.best.camera.params, files.best.camera.params)
    assert arrays.best.calibration.observations.view_names == tuple(f"image-{n}" for n in range(1, 6))
    assert len(list((tmp_path / "run" / "overlays").glob("image-*.overlay.jpg"))) == 5


def test_photos_or_images_are_given_not_both(images: list[Grey]) -> None:
    """And what is no image is refused by its number."""
    with pytest.raises(InputError, match="photos and images: give one of them"):
        calib.run(BOARD, "photos", images=images)
    with pytest.raises(InputError, match="no photos; give files"):
        calib.run(BOARD)
    with pytest.raises(InputError, match="image-2: an image of int64"):
        calib.run(BOARD, images=[images[0], images[0].astype(np.int64)])
    with pytest.raises(InputError, match="leave photos and tables out"):
        calib.rig(BOARD, ["left", "right"], images={"left": images, "right": images})
    with pytest.raises(InputError, match="images: there are none"):
        calib.hand_eye(BOARD, images=[], robot=RobotPoses(("a",), np.eye(4)[None], "here"))


def test_a_photo_that_cannot_be_read_is_named_and_the_others_are_searched(images: list[Grey]) -> None:
    """Pixels are asked for when a photo is searched; what goes wrong then is that photo's failure alone."""

    def gone() -> Photo:
        raise InputError("run.bag/left/2: is cut off")

    given = (*photos_of_arrays(images[:1]).photos, PhotoFile(Path("run.bag/left/2"), time_s=2.0, opened=gone))
    search = PhotoSearch(BOARD, FoundPhotos(given)).once()
    assert search.failures == ("run.bag/left/2: is cut off",)
    assert [len(one.ring) > 0 for one in search.detections] == [True]
    assert [one.photo.name for one in search.results] == ["image-1", "2"]


def test_arrays_of_a_rig_are_joined_by_their_order(images: list[Grey]) -> None:
    """The first of each camera are a frame; a camera may have fewer."""
    found = photos_of_images({"left": images, "right": images[:3]})
    assert found.camera_names == ("left", "right")
    assert found.frame_names == tuple(f"image-{n}" for n in range(1, 6))
    assert [one.frame for one in found.of("right")] == ["image-1", "image-2", "image-3"]
