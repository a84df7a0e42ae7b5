"""Black and white from grey: the paper's global threshold, local thresholds for uneven light, and reduced images."""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

COARSE_PIXELS = 8_000_000
"""Candidates are looked for in images reduced to about this size; centres are always measured in the full image."""


def reduction(shape: tuple[int, int]) -> int:
    """The whole factor, a power of two, that brings an image down to COARSE_PIXELS.  # (H, W)"""
    factor = 1
    while shape[0] * shape[1] > COARSE_PIXELS * factor * factor:
        factor *= 2
    return factor


def reduced(pixels: NDArray[np.generic], factor: int) -> NDArray[np.uint8]:
    """Mean of factor x factor pixels, as 8 bit stretched over the brightness that occurs.  # (H, W) -> (H/f, W/f)

    A light blur keeps noise from becoming speckle where a threshold falls on an even brightness: following the borders
    of a few hundred thousand specks takes seconds.
    """
    height, width = pixels.shape[0] // factor, pixels.shape[1] // factor
    small = pixels
    if factor > 1:
        cropped = np.ascontiguousarray(pixels[: height * factor, : width * factor])
        small = cv2.resize(cropped, (width, height), interpolation=cv2.INTER_AREA)
    small = np.asarray(cv2.GaussianBlur(small.astype(small.dtype.type, copy=False), (3, 3), SPECKLE_BLUR_PX))
    if small.dtype == np.uint8:
        return np.ascontiguousarray(small, dtype=np.uint8)
    low, high = float(small.min()), float(small.max())
    return np.asarray((small.astype(np.float64) - low) * (255.0 / max(high - low, 1e-9)), dtype=np.uint8)


SPECKLE_BLUR_PX = 0.8
MAX_CHANGES = 1_000_000
"""Ten thousand rings of twelve pixels' radius make as many."""


@dataclass(frozen=True)
class Threshold:
    """One way to binarise: a window of 0 is Otsu's threshold, else the local mean less an offset."""

    window: int
    offset: float = 0.0


def thresholds(grey: NDArray[np.uint8]) -> Iterator[Threshold]:
    """The ways to try, in order: Otsu first, then local means over a large and a small window.

    The offset keeps even areas white: noise may not turn them into speckle.
    """
    yield Threshold(0)
    side = min(grey.shape)
    offset = max(6.0, 4 * noise_level(grey))
    yield Threshold(_odd(side / 6), offset)
    yield Threshold(_odd(side / 18), offset)


def is_speckle(binary: NDArray[np.uint8]) -> bool:
    """Whether a binary image changes so often along its rows that following its borders would take minutes."""
    return cv2.norm(binary[:, 1:], binary[:, :-1], cv2.NORM_L1) > 255.0 * MAX_CHANGES


def noise_level(grey: NDArray[np.uint8]) -> float:
    """Standard deviation of the noise, from the median of second differences (insensitive to edges)."""
    second = np.concatenate([_second_differences(grey), _second_differences(grey.T)])
    # |2a - b - c| of Gaussian noise has the median 0.6745 sqrt(6) sigma.
    return float(np.median(second)) / (0.6745 * 6**0.5) if second.size else 0.0


def _second_differences(grey: NDArray[np.uint8]) -> NDArray[np.int16]:
    """Along every seventh row, of those that the image turned upside down would give as well."""
    sample = grey[4 * (len(grey) - 1) % 7 :: 7].astype(np.int16)
    return np.asarray(np.abs(2 * sample[:, 1:-1] - sample[:, :-2] - sample[:, 2:]).ravel(), dtype=np.int16)


def _odd(size: float) -> int:
    return max(11, 2 * int(size / 2) + 1)


def binarise(grey: NDArray[np.uint8], threshold: Threshold) -> NDArray[np.uint8]:
    """255 where bright.  # (H, W)"""
    if threshold.window == 0:
        return np.asarray(cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)[1], dtype=np.uint8)
    local = cv2.boxFilter(grey, -1, (threshold.window, threshold.window), borderType=cv2.BORDER_REPLICATE)
    raised = cv2.add(grey, np.full(1, threshold.offset))
    return np.asarray(cv2.compare(raised, local, cv2.CMP_GT), dtype=np.uint8)
