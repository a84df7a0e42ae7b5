"""What a guide says of photos that are no good; and who follows it comes to a good camera, sooner than who waves."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import islice

import numpy as np
import pytest

import calib
from calib.core.se3 import exp_rotation
from calib.core.types import Detections
from calib.judge.guide import Guide
from calib.judge.guide_state import FEWEST_PHOTOS
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.target import TargetGeometry
from tests.benchmarks.simulated_person import scene_of, taken_with, waved
from tests.support.guided_scenes import WEBCAM, board_target, found_at, held_by_person, ico_target

TARGET = board_target()


@cache
def five() -> list[Detections]:
    """Photos of a board as it is proposed, one after the other."""
    guide, rng, found = new(), np.random.default_rng(0), list[Detections]()
    for number in range(5):
        ghost = guide.told.ghost
        found.append(found_at(held_by_person(ghost.cam_from_target, TARGET, rng), TARGET, rng, f"{number}.png"))
        guide = guide.with_photo(found[-1])
    return found


def new() -> Guide:
    """A guide that knows nothing yet."""
    return calib.Guide(TARGET, image_size=WEBCAM.image_size, made="exact")


@cache
def after_five() -> Guide:
    """After the five."""
    return with_all(five())


def noise() -> Array:
    """A shift that makes a photo another one."""
    return np.random.default_rng(8).normal(0, 0.05, 2)


def with_all(found: list[Detections]) -> Guide:
    """After some photos."""
    guide = new()
    for one in found:
        guide = guide.with_photo(one)
    return guide


@pytest.mark.parametrize(
    ("said", "spoil"),
    [
        ("nothing was named", lambda found: found.keep(slice(0, 0))),
        ("only 3 points", lambda found: found.keep(slice(0, 3))),
        ("another target", lambda found: replace(found, layout_id="f" * 12)),
        ("640 x 480", lambda found: replace(found, image_size=(640, 480))),
        ("once more", lambda found: found),
    ],
)
def test_a_photo_that_is_no_good_is_named_and_does_not_count(
    said: str, spoil: Callable[[Detections], Detections]
) -> None:
    """It is told why; all that is known of the camera is as without it."""
    before = after_five()
    after = before.with_photo(replace(spoil(five()[4]), image="bad.png"))
    told = after.told.photos[-1]
    assert (told.name, told.is_counted) == ("bad.png", False)
    assert said in told.remark
    np.testing.assert_array_equal(after.calibration.camera.params, before.calibration.camera.params)
    assert [photo.is_counted for photo in after.told.photos[:-1]] == [True] * 5


def test_a_photo_that_contradicts_the_others_is_named_and_does_not_count() -> None:
    """Rings that moved against each other while it was taken: the camera is as good as without it."""
    bad = replace(
        five()[0], image="bad.png", center_px=five()[0].center_px * [1.02, 1.0] + 3.0 * (five()[0].ring % 2)[:, None]
    )
    after = after_five().with_photo(bad)
    assert [photo.is_counted for photo in after.told.photos] == [True] * 5 + [False]
    assert "contradicts" in after.told.photos[-1].remark
    np.testing.assert_allclose(after.calibration.camera.params[:2], WEBCAM.params[:2], rtol=2e-3)


def test_a_photo_with_another_centre_is_named_and_does_not_count() -> None:
    """Its residuals are as those of the others, as its pose takes the shift up: the others tell it."""
    shifted = replace(five()[2], image="bad.png", center_px=five()[2].center_px + np.array([12.0, 0.0]))
    others = [replace(one, image=f"again-{one.image}", center_px=one.center_px + noise()) for one in five()]
    after = with_all([*five(), *others[:2], *others[3:]]).with_photo(shifted)
    assert "shifted by about" in after.told.photos[-1].remark
    assert [photo.is_counted for photo in after.told.photos] == [True] * 9 + [False]


def test_a_lens_that_is_wide_is_solved_as_one_without_being_told() -> None:
    """Ordinary models squeeze it into what they can show; a few photos tell that it is another one."""
    wide = replace(WEBCAM, model="fisheye", params=np.array([450.0, 450, 640, 360, 0.01, -0.005, 0.001, 0.0]))
    guide, rng = new(), np.random.default_rng(6)
    while guide.told.stage != "good" and len(guide.photos) < 6:
        ghost = guide.told.ghost
        name = f"{len(guide.photos)}.png"
        found = found_at(held_by_person(ghost.cam_from_target, TARGET, rng), TARGET, rng, name, camera=wide)
        guide = guide.with_photo(found)
    assert (guide.calibration.camera.model, guide.calibration.status) == ("fisheye", "converged")


def test_a_board_is_solved_as_it_will_be_of_all_photos() -> None:
    """The camera, and what noise and the board's bend leave open of it, are those that `calib.solve` states."""
    guide = calib.Guide(TARGET, image_size=WEBCAM.image_size, model="opencv")
    for one in five():
        guide = guide.with_photo(one)
    solved = calib.solve(list(guide.photos), TARGET, model="opencv").solutions[0].calibration
    np.testing.assert_allclose(guide.calibration.camera.params, solved.camera.params, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(guide.calibration.param_covariance, solved.param_covariance, rtol=1e-6)
    np.testing.assert_allclose(guide.observations.points.position_mm, guide.settings.points.position_mm, atol=1e-12)


def test_deleting_photos_is_as_if_they_had_not_been_taken() -> None:
    """Down to none; of a name that is not there it is bad input."""
    guide, fewer = after_five(), with_all(five()[:2])
    for number in (4, 3, 2):
        guide = guide.without_photo(f"{number}.png")
    assert guide.told.headline == fewer.told.headline
    assert guide.without_photo("0.png").without_photo("1.png").told.stage == "first"
    with pytest.raises(InputError, match="no photo is called so"):
        guide.without_photo("none.png")


def test_each_number_of_photos_gives_a_guide_that_can_be_shown() -> None:
    """From none on: a stage, bars with shares from 0 to 1, and a ghost whose middle is in the image."""
    for count in range(5):
        told = with_all(five()[:count]).told
        assert told.ghost is not None
        assert all(0 <= bar.share <= 1 for bar in told.bars)
        assert told.stage == ("first" if count == 0 else told.stage)
        middle = np.median(np.concatenate(told.cameras[0].ghost_px), axis=0)
        assert ((middle > 0) & (middle < WEBCAM.image_size)).all()
        assert (told.cameras[0].map is None) == (told.stage == "first")


def test_photos_of_a_board_that_is_never_tilted_tell_no_camera() -> None:
    """The stage stays the first one, and what is proposed is tilted."""
    rng, guide = np.random.default_rng(3), new()
    for number, depth in enumerate((300.0, 400.0, 500.0)):
        pose = np.eye(4)
        pose[:3, :3] = exp_rotation(np.array([np.pi, 0.0, 0.0]))
        pose[:3, 3] = 5.0 * number, 0.0, depth
        guide = guide.with_photo(found_at(pose, TARGET, rng, f"{number}.png"))
    assert guide.told.stage == "first"
    assert guide.calibration is None
    assert guide.told.ghost.tilt_deg > 20


def test_one_photo_of_a_solid_gives_a_first_camera() -> None:
    """Its focal length is right to a few per cent, and it is said to be rough; a wide lens does not mislead it."""
    target, rng = ico_target(), np.random.default_rng(5)
    guide = calib.Guide(target, image_size=WEBCAM.image_size, made="exact")
    ghost = guide.told.ghost
    guide = guide.with_photo(found_at(ghost.cam_from_target, target, rng))
    assert abs(guide.calibration.camera.params[0] / WEBCAM.params[0] - 1) < 0.06
    assert guide.told.ghost.is_rough


def test_a_proposal_stays_until_it_is_skipped() -> None:
    """The same photos give the same one; skipped, another one comes, and not the first again after the next photo."""
    guide = with_all(five()[:3])
    first, again = guide.told.ghost, with_all(five()[:3]).told.ghost
    np.testing.assert_array_equal(first.cam_from_target, again.cam_from_target)
    other = guide.skipping()
    for one in (other, other.with_photo(five()[3])):
        ghost = one.told.ghost
        off_mm = np.linalg.norm(ghost.cam_from_target[:3, 3] - first.cam_from_target[:3, 3])
        turned = ghost.cam_from_target[:3, 2] @ first.cam_from_target[:3, 2]
        assert off_mm > 20 or turned < np.cos(np.radians(10))
    assert other.calibration is guide.calibration


def test_a_wrong_first_guess_does_no_harm() -> None:
    """A camera with half the focal length makes the first ghost another one, and nothing after that."""
    guess = replace(WEBCAM, params=WEBCAM.params * [0.5, 0.5, 1, 1, 0, 0, 0, 0, 0])
    guide = calib.Guide(TARGET, camera=guess, made="exact")
    for one in five():
        guide = guide.with_photo(one)
    plain = after_five().calibration
    np.testing.assert_array_equal(guide.calibration.camera.params, plain.camera.params)


def test_words_that_mean_nothing_are_bad_input() -> None:
    """A model that is none, and something that is no detection."""
    with pytest.raises(InputError, match="none that is solved"):
        calib.Guide(TARGET, model="opnecv")
    with pytest.raises(InputError, match="give what was detected"):
        new().with_photo("photo.png")  # type: ignore[arg-type]  # what a person may do


MOST_TRIES, MOST_PHOTOS = 20, 30


def one_more(guide: Guide, target: TargetGeometry, rng: np.random.Generator) -> Guide:
    """After the next photo of a person who tries until the frame is wanted."""
    ghost = guide.told.ghost
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
    np.testing.assert_allclose(guide.calibration.camera.params[:4], WEBCAM.params[:4], atol=1.0)


@pytest.mark.parametrize("number", [0, 4], ids=["board", "icosahedron"])
def test_who_follows_is_done_before_who_waves(number: int) -> None:
    """The camera is good after a few guided photos, and not after twice as many random ones."""
    scene, rng = scene_of(number), np.random.default_rng(number)
    start = guide = Guide(scene.target, made=scene.made, image_size=scene.camera.image_size)
    while guide.told.ghost is not None and len(guide.photos) < 15:
        guide, _ = taken_with(guide, scene, rng)
    assert guide.told.stage == "good", guide.told.headline
    for found in islice(waved(scene, rng), 2 * len(guide.photos)):
        start = start.with_photo(found)
    assert start.verdict is None or start.verdict.grade != "good"


def test_a_small_target_held_near_is_not_given_up_after_a_photo() -> None:
    """Where all that can be proposed is near the first photo, that is no reason to propose nothing."""
    scene, rng = scene_of(35), np.random.default_rng([21, 35000])
    guide = Guide(scene.target, made=scene.made, image_size=scene.camera.image_size)
    guide, _ = taken_with(guide, scene, rng)
    assert guide.told.stage == "guiding"
