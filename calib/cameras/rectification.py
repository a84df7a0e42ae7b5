"""A pair of cameras turned in thought until rows of one image are rows of the other.

Each camera turns by half of the rotation between them, then both until the baseline lies along the rows, or along the
columns of one camera above the other (Bouguet's method; Bradski and Kaehler 2008, chapter 12). Both get one focal
length and one principal point, so that disparities of far points are zero.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.cameras import rays
from calib.cameras.camera import Camera, linear_part
from calib.core.se3 import exp_rotation, log_rotation
from calib.core.types import freeze
from designer.base.arrays import Array

LEAST_COSINE = 0.5
"""Of the angle by which a camera may turn; pictures of cameras that turn farther overlap in nothing of use."""
CORNER_COSINE = 0.26
"""Corners of the image that are seen farther off the new axis do not say where the middle of the picture is."""


@dataclass(frozen=True, eq=False)
class RectifiedPair:
    """How a pair is rectified: `rectified.projection[1]` is OpenCV's P2. Lengths are in the unit of the pose."""

    rect_from_cam: Array  # (2, 3, 3)
    focal_px: float
    center_px: tuple[float, float]
    shift: float  # along the rows, or the columns, of the second camera's new frame: what T has there
    is_upright: bool  # one camera above the other

    def __post_init__(self) -> None:
        freeze(self, "rect_from_cam")

    @property
    def matrix(self) -> Array:
        """Of both pictures.  # (3, 3)"""
        cx, cy = self.center_px
        return np.array([[self.focal_px, 0.0, cx], [0.0, self.focal_px, cy], [0.0, 0.0, 1.0]])

    @property
    def projection(self) -> Array:
        """Pixels of points in the first camera's new frame.  # (2, 3, 4)"""
        projection = np.zeros((2, 3, 4))
        projection[:, :, :3] = self.matrix
        projection[1, int(self.is_upright), 3] = self.focal_px * self.shift
        return projection

    @property
    def point_from_disparity(self) -> Array:
        """Points of a column, a row and a disparity: OpenCV's Q.  # (4, 4)"""
        cx, cy = self.center_px
        result = np.eye(4)
        result[:2, 3] = -cx, -cy
        result[2] = 0, 0, 0, self.focal_px
        result[3] = 0, 0, -1 / self.shift, 0
        return result


def rectified_pair(cameras: Sequence[Camera], second_from_first: Array) -> RectifiedPair | None:
    """How two cameras of one image size are rectified; None where they see nothing alike.

    Args:
        cameras: two, of any models.
        second_from_first: (4, 4) in any unit of length.
    """
    rotation, shift = second_from_first[:3, :3], second_from_first[:3, 3]
    first, second = cameras
    if first.image_size != second.image_size or not np.linalg.norm(shift) > 0:
        return None
    half = exp_rotation(-0.5 * log_rotation(rotation))  # of the second camera; the first turns the other way
    along = half @ shift
    axis = int(abs(along[1]) >= abs(along[0]))
    aligned = _turned_to(along, axis)
    rect_from_cam = np.stack([aligned @ half.T, aligned @ half])
    if (rect_from_cam[:, 2, 2] < LEAST_COSINE).any():
        return None
    focal = float(np.mean([linear_part(camera).params[1 - axis] for camera in cameras]))
    middles = [_middle_px(camera, turn, focal) for camera, turn in zip(cameras, rect_from_cam, strict=True)]
    center = np.mean(middles, axis=0)
    aside = float((rect_from_cam[1] @ shift)[axis])
    return RectifiedPair(rect_from_cam, focal, (float(center[0]), float(center[1])), aside, bool(axis))


def _turned_to(along: Array, axis: int) -> Array:
    """The smallest rotation (3, 3) that lays a baseline along an axis of the image, to its nearer end."""
    end = np.zeros(3)
    end[axis] = 1.0 if along[axis] >= 0 else -1.0
    turn = np.cross(along, end)
    length = float(np.linalg.norm(turn))
    angle = np.arctan2(length, float(along @ end))
    return exp_rotation(turn * (angle / length if length > 0 else 0.0))


def _middle_px(camera: Camera, rect_from_cam: Array, focal: float) -> Array:
    """The principal point (2,) that puts the middle of a camera's picture in the middle of the new one."""
    width, height = camera.image_size
    last = np.array([width - 1.0, height - 1.0])
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]) * last
    ray = rays(camera, corners) @ rect_from_cam.T
    if not (ray[:, 2] > CORNER_COSINE).all():  # a wide lens: its middle alone
        ray = rays(camera, linear_part(camera).params[None, 2:4]) @ rect_from_cam.T
    middle: Array = last / 2 - focal * (ray[:, :2] / ray[:, 2:]).mean(axis=0)
    return middle
