"""How far a solved camera's pixels may be off: the parameters' covariance, seen in the image.

A camera that is turned a little shows the same with its poses turned back. So of every change of the parameters the
rotation that best explains it over the image is taken off, as mrcal does ("projection uncertainty"), with the points at
infinity: what remains is the error of the angles between directions.
"""

import numpy as np
from numpy.typing import NDArray

from calib.cameras import linearise, rays
from calib.cameras.camera import Camera
from calib.cameras.refit import image_grid
from calib.core.linear_algebra import least_squares

Array = NDArray[np.float64]

GRID = (24, 18)
"""Pixels over which the best rotation is found."""
SHARE_PERCENT = 95
"""Of the image, where one number stands for all of it."""


def projected_change(camera: Camera, pixel: Array) -> Array:
    """How each parameter moves where the camera shows the directions it has at pixels (N, 2, P); nan where it has none.

    With G = du/dparams and R = du/drotation at a pixel, and W the least-squares rotation over the image for each
    parameter, that is `G + R W`.
    """
    by_params, by_rotation = _derivatives(camera, image_grid(camera.image_size, *GRID).reshape(-1, 2))
    seen: NDArray[np.bool_] = np.asarray(np.isfinite(by_params).all(axis=(1, 2)))
    turn = least_squares(by_rotation[seen].reshape(-1, 3), -by_params[seen].reshape(-1, by_params.shape[2]))
    here_params, here_rotation = _derivatives(camera, pixel)
    change: Array = here_params + here_rotation @ turn
    return change


def projected_covariance_px2(camera: Camera, param_covariance: Array, pixel: Array) -> Array:
    """Covariances (N, 2, 2) of where the camera shows the directions it has at pixels (N, 2); nan where it has none."""
    change = projected_change(camera, pixel)
    covariance: Array = change @ param_covariance @ change.transpose(0, 2, 1)
    return covariance


def projected_sigma_px(camera: Camera, param_covariance: Array, pixel: Array) -> Array:
    """Standard deviations (N,) of the same along their worse axes."""
    covariance = projected_covariance_px2(camera, param_covariance, pixel)
    known: NDArray[np.bool_] = np.asarray(np.isfinite(covariance).all(axis=(1, 2)))
    largest = np.linalg.eigvalsh(np.where(known[:, None, None], covariance, 0.0))[:, 1]
    return np.where(known, np.sqrt(np.maximum(largest, 0.0)), np.nan)


def sigma_over_image_px(camera: Camera, param_covariance: Array) -> float:
    """What 95 % of the image stays within; infinite if less of it is known."""
    sigma = projected_sigma_px(camera, param_covariance, image_grid(camera.image_size).reshape(-1, 2))
    everywhere = np.where(np.isfinite(sigma), sigma, np.inf)
    return float(np.percentile(everywhere, SHARE_PERCENT, method="inverted_cdf"))


def _derivatives(camera: Camera, pixel: Array) -> tuple[Array, Array]:
    """Derivatives of the image of each pixel's direction by the parameters (N, 2, P) and by a rotation (N, 2, 3)."""
    ray = rays(camera, pixel)
    known: NDArray[np.bool_] = np.asarray(np.isfinite(ray).all(axis=1))
    point = np.where(known[:, None], ray, [0.0, 0.0, 1.0])
    seen = linearise(camera, np.ascontiguousarray(point.T))
    by_params = seen.by_params.transpose(2, 0, 1)
    by_rotation = np.cross(point[:, None, :], seen.by_point.transpose(2, 0, 1))
    lost = ~known[:, None, None]
    return np.where(lost, np.nan, by_params), np.where(lost, np.nan, by_rotation)
