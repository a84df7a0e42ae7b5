"""How far two cameras of one image size differ, in pixels over the image, their best rotation removed.

Light that reaches a pixel of camera A comes from a direction; a second calibration of the same camera sees that
direction in another pixel. The frames of two calibrations need not be parallel, so directions are first turned by the
rotation that makes the differences least (as `mrcal.projection_diff` does for far points; mrcal's documentation,
"A method to compare camera models").
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.cameras import linearise, project, rays
from calib.cameras.camera import Camera
from calib.cameras.refit import image_grid
from calib.core.linear_algebra import least_squares
from calib.core.se3 import exp_rotation, log_rotation
from calib.core.types import frozen_array
from designer.base.errors import InputError

Array = NDArray[np.float64]

MIN_PIXELS = 3
MAX_STEPS = 10


@dataclass(frozen=True, eq=False)
class CameraDifference:
    """The difference of camera B from camera A, on a grid of A's pixels."""

    image_size: tuple[int, int]
    pixel: Array  # (R, C, 2) in A
    difference_px: Array  # (R, C, 2) where B sees the same direction, less where A does; nan where either does not
    b_from_a: Array  # (3, 3) the rotation removed
    radius_px: float  # about the image's centre, of the pixels that the rotation was fitted to; 0: none was

    def __post_init__(self) -> None:
        for name in ("pixel", "difference_px", "b_from_a"):
            object.__setattr__(self, name, frozen_array(getattr(self, name)))

    @property
    def length_px(self) -> Array:
        """Lengths (R, C)."""
        length: Array = np.linalg.norm(self.difference_px, axis=-1)
        return length

    @property
    def off_centre_px(self) -> Array:
        """Distances (R, C) of the pixels from the image's centre."""
        off: Array = np.linalg.norm(self.pixel - image_centre(self.image_size), axis=-1)
        return off

    @property
    def turn_rad(self) -> float:
        """How far the frames are turned against each other."""
        return float(np.linalg.norm(log_rotation(self.b_from_a)))


def image_centre(image_size: tuple[int, int]) -> Array:
    """The pixel (2,) in the middle."""
    return (np.array(image_size, dtype=np.float64) - 1) / 2


def camera_difference(a: Camera, b: Camera, *, radius_px: float | None = None, columns: int = 60) -> CameraDifference:
    """The difference of two cameras.

    Args:
        a: the camera whose pixels are looked at.
        b: another camera of the same image size.
        radius_px: fit the rotation to pixels this near to the image's centre; 0: fit none; None: to the whole image.
        columns: of the grid.

    Raises:
        InputError: other image sizes, or too few pixels where both cameras have rays.
    """
    if a.image_size != b.image_size:
        sizes = " and ".join(f"{width} x {height}" for width, height in (a.image_size, b.image_size))
        raise InputError(f"cameras of {sizes} pixels cannot be compared; both must belong to images of one size")
    pixel = image_grid(a.image_size, columns)
    flat = pixel.reshape(-1, 2)
    ray_a, ray_b = rays(a, flat), rays(b, flat)
    radius = float(np.hypot(*a.image_size)) if radius_px is None else radius_px
    rotation = np.eye(3)
    if radius > 0:
        near = np.linalg.norm(flat - image_centre(a.image_size), axis=1) <= radius
        near &= np.isfinite(ray_a).all(axis=1) & np.isfinite(ray_b).all(axis=1)
        if near.sum() < MIN_PIXELS:
            raise InputError(
                f"both cameras have rays at {near.sum()} of the pixels looked at; a rotation needs {MIN_PIXELS}: "
                "use a larger radius, or 0 for no rotation"
            )
        rotation = _least_squares_turn(b, flat[near], ray_a[near], _nearest_turn(ray_a[near], ray_b[near]))
    difference = project(b, ray_a @ rotation.T) - flat
    if not np.isfinite(difference).all(axis=1).any():
        raise InputError("the cameras share no pixel that both know the light of; check that they are of one lens")
    return CameraDifference(a.image_size, pixel, difference.reshape(pixel.shape), rotation, radius)


def _nearest_turn(ray_a: Array, ray_b: Array) -> Array:
    """The rotation that brings the unit directions (N, 3) of A nearest to those of B (Kabsch 1976)."""
    unit_a, unit_b = (ray / np.linalg.norm(ray, axis=1, keepdims=True) for ray in (ray_a, ray_b))
    left, _, right = np.linalg.svd(unit_b.T @ unit_a)
    return np.asarray(left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right)


def _least_squares_turn(camera: Camera, pixel: Array, ray: Array, rotation: Array) -> Array:
    """The rotation, from one close to it, that makes the squares of the differences in pixels least: Gauss-Newton."""
    for _ in range(MAX_STEPS):
        point = np.ascontiguousarray((ray @ rotation.T).T)
        linear = linearise(camera, point)
        # A turn by w moves a point y by w x y, so a gradient g by y has the gradient y x g by w.
        jacobian = np.vstack([np.cross(point, gradient, axis=0).T for gradient in linear.by_point])
        residual = (linear.pixel - pixel.T).reshape(-1)
        seen = np.isfinite(residual)
        step = least_squares(jacobian[seen], -residual[seen])
        rotation = exp_rotation(step) @ rotation
        if np.linalg.norm(step) < 1e-14:
            break
    return rotation
