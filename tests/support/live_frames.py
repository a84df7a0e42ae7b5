"""Frames of a small board for live sessions, and a person who holds it where the ghost is."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from calib.capture.sources import Frame
from calib.core.se3 import exp_rotation
from calib.judge.guide import Guide
from calib.renderer import RenderOptions, render_view
from calib.renderer.scene import RenderScene, scene_from_target
from designer.base.arrays import Array
from designer.target import TargetGeometry
from tests.support import ring_views
from tests.support.sightings import pinhole

SIZE = (480, 360)
CAMERA = pinhole(*SIZE, 450.0)
_OPTIONS = RenderOptions(blur_px=0.5, contrast_to_noise=60)


@cache
def target() -> TargetGeometry:
    """A board of 8 x 6 rings."""
    return ring_views.board(columns=8, rows=6)


@cache
def _scene() -> RenderScene:
    return scene_from_target(target())


def image_at(cam_from_target: Array, seed: int = 0) -> NDArray[np.uint8]:
    """What the camera sees of the board."""
    rng = np.random.default_rng(seed)
    return np.asarray(render_view(_scene(), CAMERA, cam_from_target, _OPTIONS, rng).image, dtype=np.uint8)


def held(guide: Guide, rng: np.random.Generator) -> Array:
    """Where a person holds it who follows the ghost, 2 degrees and 4 mm off."""
    ghost = guide.told.ghost
    assert ghost is not None
    pose = np.array(ghost.cam_from_target)
    pose[:3, :3] = exp_rotation(rng.normal(0, np.radians(2), 3)) @ pose[:3, :3]
    pose[:3, 3] += rng.normal(0, 4, 3)
    return pose


def frames_of(image: NDArray[np.uint8], first: int, count: int = 6, step_s: float = 0.1) -> list[Frame]:
    """A picture that stands still."""
    return [Frame(0, number, number * step_s, image) for number in range(first, first + count)]
