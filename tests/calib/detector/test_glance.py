"""The quick look of live video, held against the exact pass."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

import calib
from calib.cameras.camera import Camera
from calib.core.se3 import exp_rotation, look_at
from calib.detector import wide_guess
from calib.detector.glance import glance
from calib.detector.plan import plan_for
from calib.renderer import RenderOptions, render_view
from calib.renderer.scene import scene_from_target
from designer.marks.chessboard import Chessboard
from designer.target import TargetGeometry, target_of_marks
from tests.support.ring_views import board, ico, misplaced, view_of

TARGETS = {"board": board(), "ico": ico(), "triangular": board("triangular", columns=10, rows=9)}


@pytest.mark.parametrize("name", TARGETS)
@pytest.mark.parametrize("seed", range(2))
def test_a_glance_names_nothing_as_the_exact_pass_does_not(name: str, seed: int) -> None:
    """Names are those of the exact pass, if fewer; centres are off by no more than some tenths of a pixel."""
    target, view = TARGETS[name], view_of(TARGETS[name], seed)
    seen, exact = glance(view.image, plan_for(target)), calib.detect(view.image, target)
    both, at_seen, at_exact = np.intersect1d(seen.ring, exact.ring, return_indices=True)
    apart = np.linalg.norm(seen.center_px[at_seen] - exact.center_px[at_exact], axis=1)
    assert len(both) >= 0.8 * len(exact.ring)
    assert np.sqrt(np.mean(apart**2)) < 0.3
    assert (misplaced(seen, view) < 2).all()


def test_a_glance_at_a_chessboard_names_it_as_the_exact_pass_does() -> None:
    """In a frame that is reduced for it; places are off by about what is stated."""
    target = target_of_marks([Chessboard((7, 6), 20.0)], np.eye(4)[None], 10.0)
    camera = Camera("pinhole", np.array([1200.0, 1200.0, 640.0, 480.0]), (1280, 960))
    pose = look_at(np.array([60.0, 90.0, 300.0]), np.zeros(3), 0.2)
    view = render_view(target, camera, pose, RenderOptions(blur_px=0.7, contrast_to_noise=50), np.random.default_rng(0))
    detector = calib.Detector(target)
    seen, exact = detector.glance(view.image), detector.detect(view.image)
    np.testing.assert_array_equal(seen.ring, exact.ring)
    off_px = np.linalg.norm(seen.center_px - view.center_px[seen.ring], axis=1)
    assert np.sqrt(np.mean(off_px**2)) < 2 * np.sqrt(np.trace(seen.cov_px2[0])) < 2
    assert not len(detector.glance(np.full((960, 1280), 128, np.uint8)).ring)


def test_covariances_cover_what_centres_are_off_by() -> None:
    """What is stated of a glance's centres is no less than what they are off by, nor ten times as much."""
    ratios = []
    for target in (board(), ico()):
        for seed in range(3):
            view = view_of(target, seed)
            seen = glance(view.image, plan_for(target))
            ratios.append(np.mean(misplaced(seen, view) ** 2) / np.mean(np.trace(seen.cov_px2, axis1=1, axis2=2)))
    assert 0.01 < np.mean(ratios) < 1


def test_a_frame_seen_twice_is_told_alike() -> None:
    """What a detector says of a frame does not hang on the frames before."""
    detector = calib.Detector(board())
    first, other = view_of(board(), 1).image, view_of(board(), 2).image
    before = detector.glance(first)
    detector.glance(other)
    after = detector.glance(first)
    np.testing.assert_array_equal(before.ring, after.ring)
    np.testing.assert_array_equal(before.center_px, after.center_px)


def test_a_board_moved_by_a_pitch_keeps_its_own_names() -> None:
    """Rings that come to lie where their neighbours were do not take over their names."""
    target, view = board(), view_of(board(), 1)
    detector = calib.Detector(target)
    before = detector.glance(view.image)
    left = np.flatnonzero((target.ring_index == target.ring_index.max(axis=0) // 2).all(axis=1))[0]
    right = np.flatnonzero((target.ring_index == target.ring_index[left] + [1, 0]).all(axis=1))[0]
    step = np.rint(view.center_px[right] - view.center_px[left])
    moved = cv2.warpAffine(view.image, np.column_stack([np.eye(2), step]), view.image.shape[::-1], borderValue=128)
    after = detector.glance(moved)
    assert len(before.ring) > 50
    assert len(after.ring) > 50
    off = after.center_px - step - view.center_px[after.ring]
    assert np.linalg.norm(off, axis=1).max() < 1


def test_dots_that_are_hidden_name_nothing() -> None:
    """A board whose dots are covered is not named by where it was a moment ago."""
    target, view = board(), view_of(board(), 1)
    detector = calib.Detector(target)
    assert len(detector.glance(view.image).ring)
    covered = view.image.copy()
    for u, v in view.center_px[target.is_dot]:
        cv2.circle(covered, (round(u), round(v)), 25, 90.0, -1)
    assert not len(detector.glance(covered).ring)


@pytest.mark.parametrize(
    ("shown", "wanted"),
    [(board(columns=12, rows=9), board()), (ico(), board()), (board(), ico()), (board(), board("triangular"))],
)
def test_another_target_has_no_names_and_a_remark(shown: TargetGeometry, wanted: TargetGeometry) -> None:
    """Another target in view gets no name, and the reason is said."""
    seen = calib.Detector(wanted).glance(view_of(shown, 1).image)
    assert not len(seen.ring)
    assert seen.remarks


def test_a_mirrored_frame_is_told() -> None:
    """A frame flipped as web pages flip it names nothing, and says so."""
    seen = calib.Detector(board()).glance(np.ascontiguousarray(view_of(board(), 1).image[:, ::-1]))
    assert not len(seen.ring)
    assert "mirror" in " ".join(seen.remarks)


def test_frames_of_any_kind() -> None:
    """Blank and tiny frames hold nothing, with a reason; colour and sixteen bits give what grey gives."""
    detector, image = calib.Detector(board()), view_of(board(), 1).image
    for nothing in (np.full((240, 320), 128, np.uint8), np.zeros((5, 5), np.uint8)):
        seen = detector.glance(nothing)
        assert not len(seen.ring)
        assert seen.remarks
    grey = detector.glance(image)
    assert len(grey.ring)
    for same in (cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), image.astype(np.uint16) * 257):
        np.testing.assert_array_equal(detector.glance(same).ring, grey.ring)


def test_a_large_frame_is_reduced() -> None:
    """A frame of four times the pixels has the same names at twice the places."""
    view = view_of(board(), 1)
    small = glance(view.image, plan_for(board()))
    large = cv2.resize(view.image, None, fx=2, fy=2, interpolation=cv2.INTER_LINEAR)
    seen = glance(large, plan_for(board()))
    both, at_small, at_large = np.intersect1d(small.ring, seen.ring, return_indices=True)
    assert len(both) >= 0.9 * len(small.ring)
    assert np.abs(seen.center_px[at_large] - (2 * small.center_px[at_small] + 0.5)).max() < 0.6


def test_a_likely_camera_saves_the_guess_and_a_wrong_one_does_no_harm(monkeypatch: pytest.MonkeyPatch) -> None:
    """A lens that bends is not guessed where the photos told it already; one that does not fit counts for nothing."""
    camera, pose = Camera("fisheye", np.array([400.0, 400, 639.5, 359.5, 0, 0, 0, 0]), (1280, 720)), np.eye(4)
    pose[:3, :3] = exp_rotation(np.array([0.2, 0.6, 0.1])) @ np.diag([1.0, -1.0, -1.0])
    pose[:3, 3] = np.array([20.0, 10.0, 90.0]) - pose[:3, :3] @ board().center_mm.mean(axis=0)
    options = RenderOptions(blur_px=0.5, contrast_to_noise=60)
    image = render_view(scene_from_target(board()), camera, pose, options, np.random.default_rng(0)).image
    detector, guesses = calib.Detector(board()), []
    wide = wide_guess._wide_lens
    monkeypatch.setattr(wide_guess, "_wide_lens", lambda *given: guesses.append(1) or wide(*given))
    alone = detector.glance(image)
    assert len(alone.ring) > 60
    assert guesses
    guesses.clear()
    seen = detector.glance(image, likely=camera)
    assert not guesses
    assert len(seen.ring) >= len(alone.ring)
    wrong = detector.glance(image, likely=replace(camera, params=camera.params * [3, 3, 1, 1, 1, 1, 1, 1]))
    np.testing.assert_array_equal(wrong.ring, alone.ring)
    np.testing.assert_array_equal(wrong.center_px, alone.center_px)
    assert len(detector.glance(image, likely=replace(camera, image_size=(640, 480))).ring) == len(alone.ring)
