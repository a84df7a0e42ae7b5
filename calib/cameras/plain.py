"""Cameras of which no more is known than how far they see: where solutions and searches start."""

import numpy as np

from calib.cameras import WIDE, neutral
from calib.cameras.camera import Camera


def plain_camera(model: str, image_size: tuple[int, int], focal_px: float) -> Camera:
    """A camera without distortion, its principal point in the middle of the image."""
    params = neutral(model)
    params[:4] = focal_px, focal_px, 0.5 * (image_size[0] - 1), 0.5 * (image_size[1] - 1)
    return Camera(model, params, image_size)


def even_camera(image_size: tuple[int, int], field_rad: float) -> Camera:
    """The wide camera whose angle off the axis grows evenly from corner to corner of the image."""
    return plain_camera(WIDE, image_size, float(np.hypot(*image_size)) / field_rad)
