"""Clips of a target that is moved from view to view, and stands still at each."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from calib.cameras.camera import Camera
from calib.core.se3 import exp_rotation, log_rotation, make_pose
from calib.renderer.options import RenderOptions
from calib.renderer.view import render_view
from designer.base.arrays import Array
from designer.target import TargetGeometry

RATE_HZ = 10.0


def moved(views: Array, *, seed: int = 0) -> Array:
    """Poses frame by frame: half a second to a second at a view, and as long on the way to the next.  # (N, 4, 4)"""
    rng = np.random.default_rng(seed)
    poses = [views[0]] * 6
    for a, b in pairwise(views):
        moves, stands = rng.integers(4, 9), rng.integers(5, 11)
        turn = log_rotation(b[:3, :3] @ a[:3, :3].T)
        for share in (np.arange(moves) + 0.5) / moves:
            shift = (1 - share) * a[:3, 3] + share * b[:3, 3]
            poses.append(make_pose(exp_rotation(share * turn) @ a[:3, :3], shift))
        poses += [b] * stands
    return np.array(poses)


def write_clip(
    path: Path, target: TargetGeometry, camera: Camera, poses: Sequence[Array] | Array, *, codec: str = "MJPG"
) -> None:
    """Render a clip of ten frames a second; what moves is smeared along the rows."""
    rng, options = np.random.default_rng(3), RenderOptions(blur_px=0.6, contrast_to_noise=60)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*codec), RATE_HZ, camera.image_size)
    before = poses[0]
    for pose in poses:
        image = render_view(target, camera, pose, options, rng).image.astype(np.uint8)
        if not np.array_equal(pose, before):
            image = cv2.blur(image, (9, 1))
        before = pose
        writer.write(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
    writer.release()
