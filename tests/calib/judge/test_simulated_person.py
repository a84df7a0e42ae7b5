"""Who follows the guide needs fewer photos than who waves a target about; and the rules of ROS' bars."""

from itertools import islice

import numpy as np
import pytest

from calib.judge.guide import Guide
from tests.support.simulated_person import RosBars, filling_bars, photograph, ros_sample, scene_of, taken_with, waved

MOST_PHOTOS = 15


@pytest.mark.parametrize("number", [0, 4], ids=["board", "icosahedron"])
def test_who_follows_is_done_before_who_waves(number: int) -> None:
    """The camera is good after a few guided photos, and not after twice as many random ones."""
    scene, rng = scene_of(number), np.random.default_rng(number)
    start = guide = Guide(scene.target, made=scene.made, image_size=scene.camera.image_size)
    while guide.told.ghost is not None and len(guide.photos) < MOST_PHOTOS:
        guide, _ = taken_with(guide, scene, rng)
    assert guide.told.stage == "good", guide.told.headline
    for found in islice(waved(scene, rng), 2 * len(guide.photos)):
        start = start.with_photo(found)
    assert start.verdict is None or start.verdict.grade != "good"


def test_bars_are_full_when_photos_range_over_enough_or_are_many() -> None:
    """Size and skew count from zero, place from the least; a photo like another one is not taken; forty are enough."""
    bars = RosBars().plus((0.1, 0.1, 0.4, 0.2))
    assert not bars.takes((0.15, 0.15, 0.45, 0.2))
    assert bars.takes((0.2, 0.2, 0.45, 0.2))
    assert not bars.plus((0.8, 0.7, 0.4, 0.5)).are_full
    assert bars.plus((0.8, 0.8, 0.3, 0.5)).are_full
    assert RosBars(((0.0, 0.0, 0.0, 0.0),) * 40).are_full


def test_bars_are_measured_of_boards_that_are_seen_whole() -> None:
    """A board in the middle, straight on, is at a half and a half and not skewed; without a corner it is no sample."""
    scene = scene_of(0)
    focal, height = scene.camera.params[0], scene.camera.image_size[1]
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = scene.extent_mm * focal / (0.5 * height)
    found = next(
        one
        for seed in range(20)
        if ros_sample(scene, one := photograph(scene, pose, np.random.default_rng(seed), "a.png")) is not None
    )
    x, y, size, skew = ros_sample(scene, found) or (0.0,) * 4
    np.testing.assert_allclose([x, y, skew], [0.5, 0.5, 0.0], atol=0.05)
    assert 0.2 < size < 0.5
    photos = [found for found, _ in islice(filling_bars(scene, np.random.default_rng(1)), 3)]
    assert all(ros_sample(scene, one) is not None for one in photos)


def test_a_small_target_held_near_is_not_given_up_after_a_photo() -> None:
    """Where all that can be proposed is near the first photo, that is no reason to propose nothing."""
    scene, rng = scene_of(35), np.random.default_rng([21, 35000])
    guide = Guide(scene.target, made=scene.made, image_size=scene.camera.image_size)
    guide, _ = taken_with(guide, scene, rng)
    assert guide.told.stage == "guiding"
