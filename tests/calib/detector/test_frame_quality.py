from functools import cache

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calib.cameras.camera import Camera
from calib.core.se3 import transform
from calib.core.types import Detections
from calib.detector import pipeline
from calib.detector.frame_quality import FrameQuality, frame_quality
from calib.judge.live_frame import notes_of
from calib.renderer import render_view
from calib.renderer.options import RenderOptions
from calib.renderer.scene import scene_from_target
from designer.base.arrays import Array
from designer.marks.charuco import Charuco
from designer.marks.chessboard import Chessboard
from designer.marks.circles import Circles
from designer.marks.face_marks import FaceMarks
from designer.target import TargetGeometry, target_of_marks
from tests.support import ring_views
from tests.support.moving_frames import Shutter, moving_frame

CAMERA = Camera("pinhole", np.array([500.0, 500.0, 199.5, 149.5]), (400, 300))
DISTANCE_MM = 150.0
PX_PER_MM = 500.0 / DISTANCE_MM


@cache
def board() -> TargetGeometry:
    """Rings of 7.5 px radius."""
    return ring_views.board(columns=8, rows=6)


@cache
def frame(speed_px_s: tuple[float, float] = (0.0, 0.0), blur_px: float = 0.6, gain: float = 1.0) -> NDArray[np.uint8]:
    """Of a board that faces the camera and moves while it is exposed for 10 ms, through where it stands at rest."""

    def pose_at(time_s: float) -> Array:
        pose = np.diag([1.0, -1.0, -1.0, 1.0])
        pose[:3, 3] = *(np.array(speed_px_s) * (time_s - 0.005) / PX_PER_MM), DISTANCE_MM
        return pose

    options = RenderOptions(blur_px=blur_px, contrast_to_noise=60)
    scene = scene_from_target(board())
    return moving_frame(scene, CAMERA, pose_at, Shutter(0.01, gain=gain), options, np.random.default_rng(1)).image


def quality_of(image: NDArray[np.uint8]) -> FrameQuality:
    """Of a frame, with what the detector finds in one at rest."""
    found = pipeline.detect(frame(), board(), name="at rest")
    quality = frame_quality(image, found, board())
    assert quality is not None
    return quality


@pytest.mark.parametrize("angle_deg", [0, 40, 90, 150])
def test_motion_is_told_from_one_frame(angle_deg: float) -> None:
    """Its length to a quarter, and its direction to ten degrees."""
    angle = np.radians(angle_deg)
    told = quality_of(frame((400 * np.cos(angle), 400 * np.sin(angle))))
    assert told.motion_px == pytest.approx(4.0, rel=0.25)
    off_deg = (np.degrees(told.motion_rad) - angle_deg + 90) % 180 - 90
    assert abs(off_deg) < 10


def test_what_is_out_of_focus_does_not_move() -> None:
    """Blur in all directions is told as blur, the more of it the more, and as no motion."""
    told = [quality_of(frame(blur_px=blur)) for blur in (0.6, 1.0, 1.5)]
    assert [one.blur_px for one in told] == pytest.approx([0.6, 1.0, 1.5], rel=0.25)
    assert all(one.motion_px < 1 for one in told)


def test_each_fault_is_said_and_a_good_frame_has_none() -> None:
    """A person is told what to change, and a frame with a fault is not taken by itself."""
    sharpest = quality_of(frame()).blur_px
    assert notes_of(quality_of(frame()), sharpest) == ()
    moved = notes_of(quality_of(frame((0.0, 400.0))), sharpest)
    assert [note.name for note in moved] == ["motion"]
    assert "up and down" in moved[0].sentence
    for image, name in ((frame(blur_px=1.5), "focus"), (frame(gain=1.6), "bright"), (frame(gain=0.1), "dark")):
        notes = notes_of(quality_of(image), sharpest)
        assert name in [note.name for note in notes if note.forbids], name


def test_sixteen_bits_tell_the_same() -> None:
    """A frame of sixteen bits is judged as its bytes are."""
    image = frame((400.0, 0.0))
    found = pipeline.detect(frame(), board(), name="at rest")
    deep = frame_quality(image.astype(np.uint16) * 257, found, board())
    told = frame_quality(image, found, board())
    assert deep is not None
    assert told is not None
    assert deep.motion_px == pytest.approx(told.motion_px, abs=0.05)
    assert deep.contrast == pytest.approx(told.contrast, abs=0.05)


def test_nothing_found_tells_nothing() -> None:
    """Without rings there is no word on sharpness."""
    nothing: Detections = pipeline.detect(np.full((300, 400), 120, np.uint8), board(), name="blank")
    assert frame_quality(np.full((300, 400), 120, np.uint8), nothing, board()) is None
    assert notes_of(None) == ()


@pytest.mark.parametrize(
    "marks",
    [Chessboard((8, 6), 12.0), Charuco((8, 6), 12.0, 8.0, "DICT_4X4_50"), Circles((6, 4), 18.0, 11.0, light=True)],
)
def test_frames_of_other_boards_are_judged_alike(marks: FaceMarks) -> None:
    """Contrast, blur and a motion across the lines of corners or circles are told by a quick look at them."""
    target = target_of_marks([marks], np.eye(4)[None], 3.0)
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[:3, 3] = 0, 0, DISTANCE_MM
    options = RenderOptions(blur_px=0.8, contrast_to_noise=60)
    image = render_view(target, CAMERA, pose, options, np.random.default_rng(1)).image
    found = known_at(target, pose)
    still = frame_quality(image, found, target)
    moved = frame_quality(cv2.blur(image, (5, 1)), found, target)
    assert still is not None
    assert moved is not None
    assert still.contrast == pytest.approx(0.7, abs=0.05)
    assert still.blur_px == pytest.approx(0.8, rel=0.3)
    assert still.motion_px < 1
    assert still.facing > 0.99
    assert still.radius_px == pytest.approx(marks.reach_mm * PX_PER_MM, rel=0.02)
    assert moved.motion_px == pytest.approx(5.0, rel=0.25)
    assert abs(np.sin(moved.motion_rad)) < 0.2


def known_at(target: TargetGeometry, cam_from_target: Array) -> Detections:
    """What a quick look would tell of a board that faces the camera."""
    center = CAMERA.project(transform(cam_from_target, target.center_mm))
    count, radius = target.ring_count, target.reach_mm * PX_PER_MM
    return Detections(
        "known", (400, 300), target.layout_id, target.geometry_id, np.arange(count), target.center_mm, center,
        np.tile(np.eye(2), (count, 1, 1)), np.column_stack([center, radius, radius, np.zeros(count)]), (), (),
    )  # fmt: skip
