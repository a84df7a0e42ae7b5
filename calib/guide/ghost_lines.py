"""The outline of a target as a person knows it: the borders of the faces that a camera sees."""

import math

import numpy as np

from calib.cameras import project
from calib.cameras.camera import Camera
from calib.core.se3 import transform
from calib.guide.told import Line
from designer.base.arrays import Array
from designer.target import TargetGeometry

STEPS_A_SIDE = 6
"""A lens bends the side of a face; so many straight pieces do for a drawing."""
EDGE_ON = math.cos(math.radians(88.0))
"""A face seen more from the side than that is a line."""


def ghost_lines(target: TargetGeometry, camera: Camera, cam_from_target: Array) -> tuple[Line, ...]:
    """Closed lines (K, 2) in the image around each face that is turned to the camera and projected as a whole."""
    lines = []
    for target_from_face, outline_mm in zip(target.target_from_face, target.outline_mm, strict=True):
        cam_from_face = cam_from_target @ target_from_face
        step = np.linspace(0, 1, STEPS_A_SIDE, endpoint=False)[:, None]
        side = outline_mm[:, None] + step * (np.roll(outline_mm, -1, axis=0) - outline_mm)[:, None]
        flat = np.concatenate([side.reshape(-1, 2), outline_mm[:1]])
        border = transform(cam_from_face, np.c_[flat, np.zeros(len(flat))])
        middle = border[:-1].mean(axis=0)
        if -cam_from_face[:3, 2] @ middle < EDGE_ON * np.linalg.norm(middle):
            continue
        pixel = project(camera, border)
        if np.isfinite(pixel).all():
            lines.append(pixel.round(1))
    return tuple(lines)
