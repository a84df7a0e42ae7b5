"""When a photo is taken by itself."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from calib.core.types import Detections
from calib.judge.guide_told import Look
from calib.judge.shutter import Shutter
from designer.base.arrays import Array
from tests.support.guided_scenes import board_target, found_at

WANTED = Look(None, (), 1.0, True, "", (), True)
TARGET = board_target()
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
