"""What is said of a frame, and what is drawn into it: where to move the target, what it is worth, when it is taken."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from calib.core.se3 import exp_rotation, look_at
from calib.core.types import Detections
from calib.judge.guidance import FrameNote, Look
from calib.judge.guide import Guide
from calib.judge.live_frame import Shutter
from calib.judge.target_hints import ghost_lines, held_at, hint_of, place_short, turn_between
from calib.judge.views import shape_of_points
from calib.observe.observations import known_points
from designer.base.arrays import Array
from tests.support.calibrations import board, camera, icosahedron
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
    guide, rng = Guide(TARGET, image_size=WEBCAM.image_size, made="exact"), np.random.default_rng(2)
    for number in range(6):
        told = guide.told
        assert ", 0.05 px wanted" in told.bars[0].text
        assert ("0.05 px wanted" in told.headline) == (told.stage != "first")
        guide = guide.with_photo(found_at(told.ghost.cam_from_target, TARGET, rng, f"{number}.png"))


def test_the_ghost_held_by_a_person_is_wanted_and_the_last_photo_is_not() -> None:
    """Most of the time at once; the photo itself once more never; what forbids it is heeded; its worth is known."""
    rng, guide, wanted = np.random.default_rng(2), Guide(TARGET, image_size=WEBCAM.image_size, made="exact"), 0
    for number in range(4):
        ghost = guide.told.ghost
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


WANTED = Look(None, (), 1.0, True, "", (), True)
POSE = np.diag([1.0, -1.0, -1.0, 1.0]) + np.array([[0, 0, 0, 0.0], [0, 0, 0, 0], [0, 0, 0, 400], [0, 0, 0, 0]])
VIEW = found_at(POSE, TARGET, np.random.default_rng(0))


def moved(shift_px: Sequence[float]) -> Detections:
    """The view with all rings elsewhere in the image."""
    return replace(VIEW, center_px=VIEW.center_px + np.array(shift_px))


def fired_at(times_s: Array, shift_px: Array, shutter: Shutter, look: Look = WANTED) -> tuple[list[float], Shutter]:
    """When photos are taken of frames with these shifts (N, 2)."""
    fired = []
    for time_s, shift in zip(times_s.tolist(), shift_px.tolist(), strict=True):
        shutter = shutter.after(time_s, moved(shift), look)
        if shutter.is_due:
            fired.append(time_s)
            shutter = shutter.fired()
    return fired, shutter


@pytest.mark.parametrize("rate", [5.0, 12.0, 30.0])
def test_it_fires_once_after_standing_still_for_its_time_at_any_rate(rate: float) -> None:
    """Not before the time is over, not later than a frame after it, and not again of the same view."""
    times = np.arange(0, 3, 1 / rate)
    tremor = 0.3 * np.random.default_rng(1).standard_normal((len(times), 2))
    fired, _ = fired_at(times, tremor, Shutter())
    assert len(fired) == 1
    assert 0.3 <= fired[0] <= 0.3 + 2 / rate


@pytest.mark.parametrize("speed_px_s", [15.0, 60.0, 200.0])
def test_a_target_that_moves_is_not_taken_however_slowly(speed_px_s: float) -> None:
    """Steady motion is no standing still, also where it is small from frame to frame."""
    times = np.arange(0, 0.9, 1 / 30)
    fired, _ = fired_at(times, speed_px_s * times[:, None] * [1.0, 0.0], Shutter())
    assert (len(fired) == 0) or speed_px_s < 20


def test_after_a_photo_another_view_is_taken_and_the_same_only_if_another_is_proposed() -> None:
    """The view must change, or the proposal."""
    times = np.arange(0, 1, 1 / 30)
    still = np.zeros((len(times), 2))
    fired, shutter = fired_at(times, still, Shutter())
    assert len(fired) == 1
    assert fired_at(2 + times, still, shutter)[0] == []
    assert len(fired_at(2 + times, still, shutter.rearmed())[0]) == 1
    assert len(fired_at(2 + times, still + 100.0, shutter)[0]) == 1


def test_what_is_not_wanted_or_was_not_watched_is_not_taken() -> None:
    """A look that wants nothing, a gap between frames, and a frame without the target end the standing still."""
    times = np.arange(0, 1, 1 / 30)
    still = np.zeros((len(times), 2))
    assert fired_at(times, still, Shutter(), replace(WANTED, is_wanted=False))[0] == []
    shutter = Shutter().after(0.0, VIEW, WANTED)
    assert not shutter.after(5.0, VIEW, WANTED).is_due
    none = VIEW.keep(slice(0, 0))
    assert shutter.after(0.2, none, WANTED).after(0.4, VIEW, WANTED).still == 0.0


def test_still_grows_from_none_to_all() -> None:
    """It is shown as a ring that closes."""
    shutter, shown = Shutter(), []
    for time_s in np.arange(0, 0.5, 0.05).tolist():
        shutter = shutter.after(time_s, VIEW, replace(WANTED, is_wanted=False))
        shown.append(shutter.still)
    assert shown == sorted(shown)
    assert (shown[0], shown[-1]) == (0.0, 1.0)


CAMERA = camera("pinhole", (1200, 900), 1400.0)


def facing(distance_mm: float) -> np.ndarray:
    """Straight on the first face of an icosahedron, or on a board."""
    return look_at(np.array([[0.0, 0.0, distance_mm]]), np.zeros((1, 3)), np.zeros(1))[0]


def test_solid_is_drawn_without_gaps_and_without_its_back() -> None:
    """Lines are drawn around the faces turned to the camera alone, and neighbours share their sides."""
    solid = icosahedron()
    lines = ghost_lines(solid, CAMERA, facing(400.0))
    assert 5 <= len(lines) <= 10
    corners = np.concatenate([line[:-1:6] for line in lines])
    apart = np.linalg.norm(corners[:, None] - corners, axis=2)
    assert ((apart < 1.0).sum(axis=1) >= 2).sum() >= len(lines)
    assert all((line[0] == line[-1]).all() for line in lines)


def test_board_is_drawn_by_its_border_unless_from_behind() -> None:
    """A board's line is its paper's border in the image; from behind there is none."""
    flat = board()
    (line,) = ghost_lines(flat, CAMERA, facing(300.0))
    width_mm = np.ptp(flat.outline_mm[0][:, 0])
    assert abs(np.ptp(line[:, 0]) - 1400.0 * width_mm / 300.0) < 0.5
    behind = facing(300.0) @ np.diag([1.0, -1.0, -1.0, 1.0])
    assert ghost_lines(flat, CAMERA, behind) == ()
