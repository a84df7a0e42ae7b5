"""How uncertain a camera is at each pixel, as figures draw it and captions say it."""

import math
from dataclasses import dataclass

import numpy as np

from calib.cameras import rays
from calib.cameras.refit import image_grid
from calib.judge.coverage import lit_part, sigma_over_lit_px
from calib.solver.accuracy import projected_sigma_px
from calib.solver.calibration import Calibration
from designer.base.arrays import Array, Flags
from designer.base.words import capital
from designer.base.words import figure as digits

MAP = (49, 37)
"""Columns and rows: both odd, so that one pixel is the middle."""
SHARE_SHOWN, MOST_BEYOND = 95, 2.5
"""Colours end at this percentile if the largest value is so many times more: a lens runs away in its corners."""
OUTER = 1 / 6
"""Of the image's side: what lies in it is at the edge."""


@dataclass(frozen=True, eq=False)
class SigmaMap:
    """Standard deviations of a camera's pixels along their worse axes, less a common rotation."""

    image_size: tuple[int, int]
    pixel: Array  # (R, C, 2)
    sigma_px: Array  # (R, C) nan where the camera has no rays
    most_px: float  # what 95 % of the image do not exceed; infinite if less is known
    known_share: float  # the part of the image where the camera has rays, 0 to 1
    is_map_exact: bool  # the error of a learned map is not in it
    area: str = "image"  # what is asked for, in words
    end: str = ""  # where that ends off the axis; "": at the image's border

    @property
    def known_px(self) -> Array:
        """The deviations that are known.  # (N,)"""
        return self.sigma_px[np.isfinite(self.sigma_px)]

    @property
    def is_known(self) -> bool:
        """Whether there is anything but zeros and gaps."""
        return bool(len(self.known_px) and self.known_px.max() > 0)

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
        return place_on_map(self.pixel, np.isfinite(self.sigma_px), (int(row), int(column)), self.image_size)

    @property
    def words(self) -> str:
        """The finding, as a sentence without its full stop."""
        if not self.is_known:
            return "No parameter was estimated" if len(self.known_px) else "The photos do not determine it"
        middle = f"{digits(self.centre_px, 2)} px in the middle, " if math.isfinite(self.centre_px) else ""
        most = (
            f"95 % of the {self.area} is within {digits(self.most_px, 2)} px"
            if math.isfinite(self.most_px)
            else f"{100 * (1 - self.known_share):.0f} % of the image has no directions"
        )
        words = f"{middle}{digits(self.worst_px, 2)} px {self.worst_place}; {most}"
        return capital(words)


def sigma_map(calibration: Calibration) -> SigmaMap:
    """The map of a calibration's camera."""
    size, lit, is_exact = calibration.camera.image_size, lit_part(calibration), calibration.camera.learned is not None
    pixel, every = image_grid(size, *MAP), image_grid(size).reshape(-1, 2)
    sigma = projected_sigma_px(lit.camera, calibration.stated_covariance, pixel.reshape(-1, 2))
    most_px = sigma_over_lit_px(lit, calibration.stated_covariance)
    # Of the same pixels as the verdict's share, so that both are one number.
    known = float(np.isfinite(rays(lit.camera, every[lit.is_lit(every)])).all(axis=1).mean())
    return SigmaMap(size, pixel, sigma.reshape(pixel.shape[:2]), most_px, known, is_exact, lit.name, lit.end_words)


def scale_end(values: Array) -> tuple[float, bool]:
    """The end of a scale of colours for values that are known, and whether there are some beyond it."""
    usual, largest = float(np.percentile(values, SHARE_SHOWN)), float(values.max())
    return (usual, True) if largest > MOST_BEYOND * usual > 0 else (largest, False)


def place_on_map(pixel: Array, is_known: Flags, at: tuple[int, int], image_size: tuple[int, int]) -> str:
    """A place of a map over the image in words; what is known there may end short of the corner or edge.

    Args:
        pixel: of the map (R, C, 2).
        is_known: where it has values (R, C).
        at: row and column of the place.
        image_size: width, height in px.
    """
    border = []
    for index, count in zip(at, is_known.shape, strict=True):
        part = index / max(count - 1, 1)
        border.append(0 if part < OUTER else count - 1 if part > 1 - OUTER else index)
    return place_in_image(pixel[at], image_size, is_reached=bool(is_known[border[0], border[1]]))


def place_in_image(pixel: Array, image_size: tuple[int, int], *, is_reached: bool = True) -> str:
    """A place of an image in words, by its thirds: "in the top left corner", "at the left edge", "in the middle".

    What lies short of the outer sixth is only "towards the top left".

    Args:
        pixel: the place (2,).
        image_size: width, height in px.
        is_reached: something is known as far as the corner or edge itself.
    """
    part = [(at + 0.5) / side for at, side in zip(pixel.tolist(), image_size, strict=True)]
    third = [min(max(int(3 * along), 0), 2) for along in part]
    across, down = ("left", "", "right")[third[0]], ("top", "", "bottom")[third[1]]
    if not across and not down:
        return "in the middle"
    outer = [min(along, 1 - along) < OUTER for along, name in zip(part, (across, down), strict=True) if name]
    if not all(outer) or not is_reached:
        return f"towards the {down} {across}".replace("  ", " ").rstrip()
    return f"in the {down} {across} corner" if across and down else f"at the {across or down} edge"
