"""The linear pinhole: `u = fx X/Z + cx`, `v = fy Y/Z + cy`."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.cameras.parameters import FOCAL_AND_CENTRE, Linearised, Parameter
from calib.types import Camera

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Pinhole:
    """A camera without distortion."""

    name: str = "pinhole"
    remedy: str = "models with a lens may reach them"
    parameters: tuple[Parameter, ...] = FOCAL_AND_CENTRE

    def rays(self, camera: Camera, pixel: Array) -> Array:
        """Directions (..., 3) with z = 1."""
        pixel = np.asarray(pixel, dtype=np.float64)
        direction = (pixel - camera.params[2:]) / camera.params[:2]
        return np.concatenate([direction, np.ones((*pixel.shape[:-1], 1))], axis=-1)

    def project(self, camera: Camera, point: Array) -> Array:
        """Pixels (..., 2); nan behind the camera."""
        point = np.asarray(point, dtype=np.float64)
        depth = np.where(point[..., 2:] > 0, point[..., 2:], np.nan)
        pixel: Array = camera.params[:2] * point[..., :2] / depth + camera.params[2:]
        return pixel

    def linearise(self, camera: Camera, point: Array) -> Linearised:
        """Pixels of points (3, N) with their derivatives."""
        inverse_depth = 1 / np.where(point[2] > 0, point[2], np.nan)
        x, y = point[:2] * inverse_depth
        fx, fy, cx, cy = camera.params
        zero, one = np.zeros_like(x), np.ones_like(x)
        by_point = np.stack([[fx * one, zero, -fx * x], [zero, fy * one, -fy * y]]) * inverse_depth
        by_params = np.stack([[x, zero, one, zero], [zero, y, zero, one]])
        return Linearised(np.stack([fx * x + cx, fy * y + cy]), by_point, by_params)
