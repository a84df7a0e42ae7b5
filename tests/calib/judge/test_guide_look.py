"""What is said of a frame: where to move the target as a person sees it, and what it is worth."""

from dataclasses import replace

import numpy as np
import pytest

from calib.core.se3 import exp_rotation
from calib.judge.guide import Guide
from calib.judge.guide_held import held_at, turn_between
from calib.judge.guide_told import FrameNote
from calib.judge.hints import hint_of, place_short
from calib.judge.telling import bars_of, headline_of
from calib.judge.views import shape_of_points
from calib.observe.observations import known_points
from designer.base.arrays import Array
from tests.support.guided_scenes import WEBCAM, board_target, found_at, held_by_person

TARGET = board_target()
POINTS = known_points(TARGET)
SHAPE = shape_of_points(POINTS, POINTS.plane[:, :3])
FACING = np.stack([SHAPE.axes[0], SHAPE.axes[1], -SHAPE.axes[2]])


def pose(turn_deg: tuple[float, float, float] = (0, 0, 0), at_mm: tuple[float, float, float] = (0, 0, 400)) -> Array:
    """A board that faces the camera, turned about the axes of the camera."""
    found = np.eye(4)
    found[:3, :3] = exp_rotation(np.radians(turn_deg)) @ FACING
    found[:3, 3] = np.array(at_mm) - found[:3, :3] @ SHAPE.center_mm
    return found


@pytest.mark.parametrize(
    ("now", "said"),
    [
        (pose(at_mm=(90, 0, 400)), "to the left"),
        (pose(at_mm=(-90, 0, 400)), "to the right"),
        (pose(at_mm=(0, 60, 400)), "up"),
        (pose(at_mm=(0, -60, 400)), "down"),
        (pose(at_mm=(0, 0, 600)), "closer"),
        (pose(at_mm=(0, 0, 250)), "farther away"),
        (pose((0, 0, 40)), "turn it counterclockwise"),
        (pose((0, 0, -40)), "turn it clockwise"),
        (pose(), ""),
    ],
)
def test_a_hint_leads_from_where_the_target_is_to_where_it_is_wanted(now: Array, said: str) -> None:
    """Right and down are the image's; what is turned clockwise as the camera sees it is to be turned back."""
    wanted, held = held_at(WEBCAM, SHAPE, pose()), held_at(WEBCAM, SHAPE, now)
    assert hint_of(SHAPE, wanted, held, 1280) == said


@pytest.mark.parametrize(
    ("turn_deg", "said"),
    [((0, -30, 0), "right side"), ((0, 30, 0), "left side"), ((30, 0, 0), "bottom side"), ((-30, 0, 0), "top side")],
)
def test_a_tilt_is_told_by_the_side_that_goes_away(turn_deg: tuple[float, float, float], said: str) -> None:
    """The rings on that side of the board are farther from the camera than its middle."""
    wanted = held_at(WEBCAM, SHAPE, pose(turn_deg))
    hint = hint_of(SHAPE, wanted, held_at(WEBCAM, SHAPE, pose()), 1280)
    assert hint == f"tilt the {said} away"
    place = (pose(turn_deg)[:3, :3] @ TARGET.center_mm.T).T
    axis, sign = (0, 1) if "right" in said else (0, -1) if "left" in said else (1, 1) if "bottom" in said else (1, -1)
    on_side = sign * place[:, axis] > 0
    assert place[on_side, 2].mean() > place[~on_side, 2].mean()


def test_a_board_upside_down_is_as_good_and_across_is_not() -> None:
    """It is longer than wide: a half turn is none, a quarter turn is one."""
    here = held_at(WEBCAM, SHAPE, pose())
    for turn_deg, left_deg in ((180.0, 0.0), (90.0, 90.0), (10.0, 10.0)):
        tilt, turn = turn_between(SHAPE, here, held_at(WEBCAM, SHAPE, pose((0, 0, turn_deg))))
        assert tilt == pytest.approx(0.0, abs=1e-6)
        assert abs(np.degrees(turn)) == pytest.approx(left_deg, abs=1e-6)


def test_places_have_short_names() -> None:
    """As a person reads them from afar."""
    words = [place_short(place) for place in ((0.0, 0.0), (-1.0, 1.0), (0.0, -0.5), (1.0, 0.2))]
    assert words == ["middle", "bottom left", "top", "right"]


def test_a_limit_is_told_alike_everywhere() -> None:
    """As the verdict's checks have it: 0.05 px, before a camera is known and after."""
    settings = Guide(TARGET, image_size=WEBCAM.image_size, made="exact").settings
    bars = bars_of(0.3, 0.21, None, settings)
    assert bars[0].text.endswith(", 0.05 px wanted")
    assert "0.05 px wanted" in headline_of("guiding", 0.21, 0.3, None, settings, 2)


def test_the_ghost_held_by_a_person_is_wanted_and_the_last_photo_is_not() -> None:
    """Most of the time at once; the photo itself once more never; what forbids it is heeded; its worth is known."""
    rng, guide, wanted = np.random.default_rng(2), Guide(TARGET, image_size=WEBCAM.image_size, made="exact"), 0
    for number in range(4):
        ghost = guide.told.ghost
        assert ghost is not None
        exact = guide.look(found_at(ghost.cam_from_target, TARGET, rng))
        assert exact.is_wanted
        if guide.told.stage != "first":  # then the picture is to fit, not the distance, which nobody knows
            assert (exact.is_match, exact.hint) == (True, "")
            assert exact.worth > 0.85
        frames = [found_at(held_by_person(ghost.cam_from_target, TARGET, rng), TARGET, rng) for _ in range(6)]
        wanted += sum(guide.look(found).is_wanted for found in frames)
        spoilt = guide.look(frames[0], [FrameNote("motion", "hold still", forbids=True)])
        assert not spoilt.is_wanted
        guide = guide.with_photo(replace(frames[0], image=f"{number}.png"))
        assert not guide.look(frames[0]).is_wanted
    assert wanted >= 15, wanted


def test_a_frame_without_the_target_or_of_another_size_says_so() -> None:
    """No pose, nothing wanted, and what to do."""
    guide, rng = Guide(TARGET, image_size=WEBCAM.image_size, made="exact"), np.random.default_rng(3)
    found = found_at(pose((0, 30, 0)), TARGET, rng)
    nothing = guide.look(found.keep(slice(0, 0)))
    assert (nothing.cam_from_target, nothing.is_wanted, nothing.hint) == (None, False, "show the target")
    other = guide.look(replace(found, image_size=(640, 480)))
    assert not other.is_wanted
    assert other.notes[0].forbids
