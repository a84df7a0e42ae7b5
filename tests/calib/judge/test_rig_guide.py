"""Guidance before several cameras, by what they would find: no pixels."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
from calib.core.types import Detections
from calib.judge.rig_guide import RigGuide
from calib.rigs.relative import relative
from designer.base.errors import InputError
from tests.support import ring_views
from tests.support.guided_rigs import TrueRig, held_at_ghost, side_by_side
from tests.support.live_frames import CAMERA

LIMITS = str(Path(__file__).parents[2] / "support/lenient.toml")
TARGET = ring_views.board(columns=8, rows=6)
NAMES = ("left", "right")
MOST_MOMENTS, MOST_TRIES = 20, 20
Moment = dict[str, Detections]


def begun(names: tuple[str, ...] = NAMES, made: str | None = "exact") -> RigGuide:
    guide = RigGuide(TARGET, names, made=made, model="pinhole", criteria=LIMITS)
    for name in names:
        guide = guide.sized(name, CAMERA.image_size)
    return guide


def with_moment(guide: RigGuide, moment: Moment) -> RigGuide:
    for camera, found in moment.items():
        guide = guide.with_photo(camera, found)
    return guide


def next_moment(guide: RigGuide, rig: TrueRig, rng: np.random.Generator) -> Moment:
    """Of a person who tries until as many cameras as needed want it."""
    for _ in range(MOST_TRIES):
        seen = rig.seen(held_at_ghost(guide, rig, TARGET, rng), TARGET, rng, f"{len(guide.moments) + 1:04d}.png")
        wanted = [camera for camera, found in seen.items() if guide.look(camera, found).is_wanted]
        if len(wanted) >= guide.wanted_at_once:
            return seen
    raise AssertionError(f"nothing was wanted: {guide.told.headline}")


@pytest.fixture(scope="module")
def rig() -> TrueRig:
    return side_by_side(NAMES, camera=CAMERA)


@pytest.fixture(scope="module")
def moments(rig: TrueRig) -> list[Moment]:
    """All of a person who follows the ghost until it is good."""
    guide, rng, taken = begun(), np.random.default_rng(2), []
    while guide.told.stage in ("first", "guiding") and len(taken) < MOST_MOMENTS:
        taken.append(next_moment(guide, rig, rng))
        guide = with_moment(guide, taken[-1])
    return taken


def after(moments: list[Moment], made: str | None = "exact") -> RigGuide:
    guide = begun(made=made)
    for moment in moments:
        guide = with_moment(guide, moment)
    return guide


def test_who_follows_the_ghost_comes_to_a_good_rig(moments: list[Moment]) -> None:
    """All cameras and their joins are good, nothing more is proposed, and the distance is the true one."""
    guide = after(moments)
    assert guide.is_good, guide.told.headline
    assert guide.told.ghost is None
    assert relative(guide.standing.calibration.rig, 0, 1).baseline_mm == pytest.approx(120.0, abs=0.2)
    assert "pair left right" in [bar.name for bar in guide.told.bars]


def test_the_bend_of_a_board_that_may_be_bent_is_an_unknown_of_the_rig(moments: list[Moment]) -> None:
    """As `calib rig` solves it: not of an exact board."""
    bends = [after(moments, made).standing.calibration.target_bend for made in ("exact", "fdm-board")]
    assert [bend is not None for bend in bends] == [False, True]


def test_a_rig_of_one_camera_is_guided_as_a_camera(moments: list[Moment]) -> None:
    """The same words, bars and proposal as `Guide`, and one camera suffices for a photo."""
    rig = begun(("left",))
    alone = calib.Guide(TARGET, made="exact", model="pinhole", criteria=LIMITS, image_size=CAMERA.image_size)
    for moment in moments[:2]:
        rig, alone = rig.with_photo("left", moment["left"]), alone.with_photo(moment["left"])
    assert rig.wanted_at_once == 1
    assert (rig.told.headline, rig.told.bars) == (alone.told.headline, alone.told.bars)
    np.testing.assert_array_equal(rig.told.ghost.cam_from_target, alone.told.ghost.cam_from_target)


def test_the_order_in_which_cameras_come_does_not_matter(moments: list[Moment]) -> None:
    """Of a moment the right photo may come before the left one."""
    turned = [dict(reversed(moment.items())) for moment in moments[:3]]
    one, other = after(moments[:3]).told, after(turned).told
    assert (one.headline, one.bars) == (other.headline, other.bars)
    assert one.ghost.sentence == other.ghost.sentence


def test_a_deleted_moment_is_taken_out_of_all_cameras(moments: list[Moment]) -> None:
    """The guide is as if it had never been taken; the photos of all cameras go."""
    deleted = after(moments[:3]).without_moment("0003")
    never = after(moments[:2])
    assert deleted.moments == never.moments == ("0001", "0002")
    assert (deleted.told.headline, deleted.told.bars) == (never.told.headline, never.told.bars)


def test_the_proposal_names_its_camera_and_is_drawn_there_alone(moments: list[Moment]) -> None:
    """As long as one camera is not known its own place is proposed."""
    told = after(moments[:1]).told
    drawn = [camera.name for camera in told.cameras if camera.ghost_px]
    assert len(drawn) == 1
    assert told.ghost.short.startswith(f"{drawn[0]}: ")


def test_known_cameras_that_never_saw_it_together_are_told_to(moments: list[Moment]) -> None:
    """Photos of different moments tie no cameras: it is said which, and one camera's photo is not enough."""
    guide = begun()
    for number, moment in enumerate(moments):
        for camera, found in moment.items():
            guide = guide.with_photo(camera, replace(found, image=f"{camera}{number}.png"))
    assert guide.standing is None
    assert guide.told.headline.startswith("hold the target where left and right both see it")
    assert guide.told.stage == "guiding"
    assert guide.wanted_at_once == 2


@pytest.mark.parametrize("names", [("left", "left"), ("a/b", "c"), ()])
def test_cameras_have_names_of_their_own(names: tuple[str, ...]) -> None:
    """Folders are named by them."""
    with pytest.raises(InputError):
        RigGuide(TARGET, names)


def test_a_camera_or_moment_that_there_is_not_is_named() -> None:
    """With what there is."""
    with pytest.raises(InputError, match="there are 'left', 'right'"):
        begun().of("top")
    with pytest.raises(InputError, match="0009"):
        begun().without_moment("0009")
