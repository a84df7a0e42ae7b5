"""Guidance from the first photo to a camera that is good, with a person who holds the target about as told."""

import numpy as np
import pytest

import calib
from calib.judge.guide import Guide
from calib.judge.standing import FEWEST_PHOTOS
from designer.target import TargetGeometry
from tests.support.guided_scenes import WEBCAM, board_target, found_at, held_by_person, ico_target

MOST_TRIES, MOST_PHOTOS = 20, 30


def one_more(guide: Guide, target: TargetGeometry, rng: np.random.Generator) -> Guide:
    """After the next photo of a person who tries until the frame is wanted."""
    ghost = guide.told.ghost
    assert ghost is not None
    for _ in range(MOST_TRIES):
        pose = held_by_person(ghost.cam_from_target, target, rng)
        found = found_at(pose, target, rng, f"{len(guide.photos):04d}.png", noise_px=0.03)
        if guide.look(found).is_wanted:
            return guide.with_photo(found)
    raise AssertionError(f"nothing was wanted of {ghost.sentence}")


@pytest.mark.parametrize("target", [board_target(), ico_target()], ids=["board", "icosahedron"])
def test_who_follows_the_ghost_comes_to_a_good_camera(target: TargetGeometry) -> None:
    """Within thirty photos it is good, says so, and proposes nothing more; the camera is the true one."""
    guide, rng = calib.Guide(target, image_size=WEBCAM.image_size, made="exact"), np.random.default_rng(1)
    assert guide.told.stage == "first"
    while guide.told.ghost is not None and len(guide.photos) < MOST_PHOTOS:
        guide = one_more(guide, target, rng)
    told = guide.told
    assert guide.is_good, told.headline
    assert len(guide.photos) >= FEWEST_PHOTOS  # halves of fewer agree by chance
    assert told.headline.startswith("good: ")
    assert {bar.grade for bar in told.bars} == {"good"}
    assert guide.calibration is not None
    np.testing.assert_allclose(guide.calibration.camera.params[:4], WEBCAM.params[:4], atol=1.0)
