"""How uncertain a camera is at each pixel, as figures draw it and captions say it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.refit import image_grid
from calib.solver.uncertainty import projected_sigma_px, sigma_over_image_px
from calib.types import Calibration

Array = NDArray[np.float64]

MAP = (49, 37)
"""Columns and rows: both odd, so that one pixel is the middle."""
SHARE_SHOWN, MOST_BEYOND = 95, 2.5
"""Colours end at this percentile if the largest value is so many times more: a lens runs away in its corners."""


@dataclass(frozen=True, eq=False)
class SigmaMap:
    """Standard deviations of a camera's pixels along their worse axes, less a common rotation."""

    image_size: tuple[int, int]
    pixel: Array  # (R, C, 2)
    sigma_px: Array  # (R, C) nan where the camera has no rays
    most_px: float  # what 95 % of the image do not exceed; infinite if less is known

    @property
    def known_px(self) -> Array:
        """The deviations that are known.  # (N,)"""
        return self.sigma_px[np.isfinite(self.sigma_px)]

    @property
    def is_known(self) -> bool:
        """Whether there is anything but zeros and gaps."""
        return bool(len(self.known_px) and self.known_px.max() > 0)

    @property
    def known_share(self) -> float:
        """The part of the image where it is known, 0 to 1."""
        return len(self.known_px) / self.sigma_px.size

    @property
    def centre_px(self) -> float:
        """In the image's middle; nan if not known."""
        rows, columns = self.sigma_px.shape
        return float(self.sigma_px[rows // 2, columns // 2])

    @property
    def worst_px(self) -> float:
        """The largest."""
        return float(self.known_px.max())

    @property
    def worst_place(self) -> str:
        """Where the largest is, in words: "in the top left corner"."""
        row, column = np.unravel_index(np.nanargmax(self.sigma_px), self.sigma_px.shape)
        return place_in_image(self.pixel[row, column], self.image_size)


def sigma_map(calibration: Calibration) -> SigmaMap:
    """The map of a calibration's camera."""
    size = calibration.camera.image_size
    pixel = image_grid(size, *MAP)
    sigma = projected_sigma_px(calibration.camera, calibration.param_covariance, pixel.reshape(-1, 2))
    most_px = sigma_over_image_px(calibration.camera, calibration.param_covariance)
    return SigmaMap(size, pixel, sigma.reshape(pixel.shape[:2]), most_px)


def scale_end(values: Array) -> tuple[float, bool]:
    """The end of a scale of colours for values that are known, and whether there are some beyond it."""
    usual, largest = float(np.percentile(values, SHARE_SHOWN)), float(values.max())
    return (usual, True) if largest > MOST_BEYOND * usual > 0 else (largest, False)


def place_in_image(pixel: Array, image_size: tuple[int, int]) -> str:
    """A place of an image in words, by its thirds: "in the top left corner", "at the left edge", "in the middle"."""
    third = [min(max(int(3 * (at + 0.5) / side), 0), 2) for at, side in zip(pixel.tolist(), image_size, strict=True)]
    across, down = ("left", "", "right")[third[0]], ("top", "", "bottom")[third[1]]
    if across and down:
        return f"in the {down} {across} corner"
    return f"at the {across or down} edge" if across or down else "in the middle"
