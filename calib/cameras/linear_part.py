"""What a camera is in the middle of its image: the pinhole with the same scale there, and how sure that is."""

from dataclasses import replace

import numpy as np

from calib.cameras import ABILITIES, LINEAR, linearise
from calib.cameras.camera import Camera
from designer.base.arrays import Array

AXIS = np.array([[0.0], [0.0], [1.0]])
RELATIVE_STEP = 1e-6


def linear_part(camera: Camera) -> Camera:
    """The pinhole that shows the middle of the photos in their size: `linear_part(camera).params[0]`.

    The focal parameter of a wide model need not tell it: where a lens has a `xi`, light off the axis moves by less.
    """
    params = camera.params[:4].copy()
    if ABILITIES[camera.model].is_wide:
        scale = np.diagonal(linearise(camera, AXIS).by_point[:, :2, 0])
        params[:2] = np.where(scale > 0, scale, params[:2])
    return Camera(LINEAR, params, camera.image_size)


def focal_px(camera: Camera, param_covariance: Array) -> tuple[float, float]:
    """The focal length along u in the middle of the image and its standard deviation, nan if that is not known.

    Args:
        camera: of any model.
        param_covariance: of its parameters.  # (P, P)
    """
    value, count = float(linear_part(camera).params[0]), len(camera.params)
    if value == camera.params[0]:
        variance = float(param_covariance[0, 0])
    else:
        step = RELATIVE_STEP * np.maximum(np.abs(camera.params), 1.0)
        ends = camera.params + np.stack([np.diag(step), -np.diag(step)])  # (2, P, P)
        up, down = ([float(linear_part(replace(camera, params=end)).params[0]) for end in side] for side in ends)
        slope = (np.array(up) - np.array(down)) / (2 * step)
        covariance = param_covariance[:count, :count]
        variance = float(slope @ covariance @ slope)
    return value, float(np.sqrt(variance)) if variance > 0 else np.nan
