"""The next frames of a rig: what they promise is what a solution with them gives."""

from dataclasses import replace

import numpy as np
import pytest

from calib.judge.rig_next_frames import next_frames
from calib.rigs.halves import NoRigHalves, RigHalves, RigSplit
from calib.rigs.relative import relative
from tests.support.rig_views import RigScene, ring, scene_of, solved_slowly, stereo_pair

ALONE = NoRigHalves("not compared")


def with_frame(scene: RigScene, rig_from_target: np.ndarray) -> RigScene:
    """The rig with one more frame."""
    held = np.concatenate([scene.rig_from_target, rig_from_target[None]])
    names, points = scene.observations.camera_names, scene.observations.points
    rng = np.random.default_rng(5)
    return scene_of(names, scene.cameras, scene.cam_from_rig, held, points, rng, scene.noise_px)


@pytest.mark.parametrize("make", [stereo_pair, ring])
def test_a_frame_gives_what_it_promises(make: object) -> None:
    """Solved with the proposed frame, the pair is known as well as was said, or a little better: photos show more.

    So it is where noise is small; with much of it lenses are known badly where nothing was seen, and it says "about".
    """
    scene = make(noise_px=0.005, frames=6)  # type: ignore[operator]
    found = solved_slowly(scene)
    frame = next_frames(found, ALONE)[0]
    names = scene.observations.camera_names
    a, b = (names.index(name) for name in frame.pair)
    assert relative(found.rig, a, b).place_sigma_mm == pytest.approx(frame.sigma_mm_before)
    again = solved_slowly(with_frame(scene, frame.rig_from_target))
    scale = again.scale[0] / found.scale[0]
    assert 0.75 < relative(again.rig, a, b).place_sigma_mm / scale / frame.sigma_mm_after < 1.1


def test_frames_help_one_after_the_other_and_name_who_sees_them() -> None:
    """Each is proposed with those before it, tells of a gain, and says between which cameras to hold the target."""
    frames = next_frames(solved_slowly(ring(frames=5)), ALONE)
    assert 1 <= len(frames) <= 3
    for frame in frames:
        assert frame.sigma_mm_after < 0.97 * frame.sigma_mm_before
        assert len(frame.cameras) >= 2
        assert f" and {frame.cameras[-1]} see it" in frame.sentence
        assert "turned as in frame0" in frame.sentence


def test_deviations_that_halves_enlarge_are_told_enlarged() -> None:
    """What the sentence says is what the table of pairs says."""
    found = solved_slowly(stereo_pair(frames=6))
    wide = RigHalves((RigSplit("by turns", 2.0, 600, 1.0, ()),))
    once, twice = next_frames(found, ALONE)[0], next_frames(found, wide)[0]
    assert twice.sigma_mm_before == pytest.approx(2 * once.sigma_mm_before)
    assert twice.sigma_mm_after == pytest.approx(2 * once.sigma_mm_after, rel=1e-6)


def test_a_board_is_held_as_it_was_whichever_way_its_normal_points() -> None:
    """Points from elsewhere say nothing of a board's front: it is the side that was seen."""
    found = solved_slowly(stereo_pair(frames=5))
    seen = found.observations
    other = replace(seen.points, plane=-seen.points.plane)
    turned = replace(seen, sightings=tuple(replace(one, points=other) for one in seen.sightings))
    one, two = (next_frames(rig, ALONE) for rig in (found, replace(found, observations=turned)))
    assert one
    assert [frame.sentence for frame in one] == [frame.sentence for frame in two]


def test_nothing_is_proposed_where_nothing_is_known() -> None:
    """A rig without covariances has no weakest pair."""
    found = solved_slowly(stereo_pair(frames=4))
    assert next_frames(replace(found, covariance=np.full_like(found.covariance, np.nan)), ALONE) == ()
    assert next_frames(replace(found, status="degenerate"), ALONE) == ()
