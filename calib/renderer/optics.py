"""What a lens does to an image of light (blur, defocus, dark corners), and a sensor to what arrives (noise, a tone)."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.renderer.options import RenderOptions

Array = NDArray[np.float64]
Image = NDArray[np.float32]
BAND_ROWS = 256
TAIL = 4.0
"""Standard deviations at which the point-spread function ends."""
LEVEL_PX = 0.5
"""Step of the blurs between which a depth-dependent blur is interpolated."""
Levels = NDArray[np.uint8] | NDArray[np.uint16] | NDArray[np.float32]


def psf_weights(sigma_px: float) -> Array:
    """A sampled Gaussian whose variance is exactly `sigma_px ** 2`.  # (2 N + 1,)

    A Gaussian sampled at whole pixels has less variance than its parameter says once that is below 0.6 px, so the
    parameter is solved for. The function is symmetric: it moves no edge's place, and no centre.
    """
    radius = max(1, math.ceil(TAIL * sigma_px + 1))
    offset = np.arange(-radius, radius + 1)
    low, high = 1e-3, sigma_px + 1.0
    for _ in range(60):
        middle = (low + high) / 2
        weights: Array = np.exp(-0.5 * (offset / middle) ** 2)
        weights /= weights.sum()
        low, high = (middle, high) if weights @ offset**2 < sigma_px**2 else (low, middle)
    return weights


def blurred(light: Image, sigma_px: float) -> Image:
    """The image through a Gaussian point-spread function."""
    weights = psf_weights(sigma_px)
    return np.asarray(cv2.sepFilter2D(light, -1, weights, weights, borderType=cv2.BORDER_REFLECT_101), dtype=np.float32)


def defocus_sigma_px(depth_mm: Image, focus_mm: float, aperture_mm: float, focal_px: float) -> Image:
    """Standard deviation of the blur at each depth.

    A thin lens spreads a point over a disc of the diameter `f A |1/z - 1/z_focus|`; a disc of diameter c has the
    variance c^2 / 16 along each axis.
    """
    return np.asarray(focal_px * aperture_mm / 4 * np.abs(1 / depth_mm - 1 / focus_mm), dtype=np.float32)


def blurred_by(light: Image, sigma_px: Image) -> Image:
    """The image with a blur of its own at each pixel, interpolated in the variance between a few even blurs."""
    result = np.empty_like(light)
    lowest, highest = float(sigma_px.min()), float(sigma_px.max())
    count = max(1, math.ceil((highest - lowest) / LEVEL_PX))
    levels = np.linspace(lowest, max(highest, lowest + 1e-3), count + 1, dtype=np.float32)
    halo = math.ceil(TAIL * highest + 1) + 1
    for top in range(0, len(light), BAND_ROWS):
        first = max(0, top - halo)
        source = light[first : top + BAND_ROWS + halo]
        rows = slice(top - first, top - first + min(BAND_ROWS, len(light) - top))
        sigma = sigma_px[top : top + BAND_ROWS]
        below = np.clip((sigma - levels[0]) / (levels[1] - levels[0]), 0, count - 1).astype(np.int32)
        share = (sigma**2 - levels[below] ** 2) / (levels[below + 1] ** 2 - levels[below] ** 2)
        band = np.zeros_like(sigma)
        for n in np.flatnonzero(np.bincount(below.ravel(), minlength=count)).tolist():
            is_here = below == n
            for level, weight in ((n, 1 - share), (n + 1, share)):
                even = blurred(source, float(levels[level])) if levels[level] > 0 else source
                np.add(band, weight * even[rows], out=band, where=is_here)
        result[top : top + BAND_ROWS] = band
    return result


def vignette(u: Array, v: Array, image_size: tuple[int, int], loss: float) -> Array:
    """Light that reaches pixels, over that in the middle: `1 - loss (r / r_corner)^2`."""
    middle = (np.array(image_size) - 1) / 2
    square = ((u - middle[0]) ** 2 + (v - middle[1]) ** 2) / max(float(middle @ middle), 1.0)
    light: Array = 1 - loss * square
    return light


def add_noise(light: Image, even_sigma: float, full_well: float, rng: np.random.Generator) -> None:
    """Add even noise, and shot noise in its normal limit: its variance is the light over the full well's electrons."""
    noise = rng.standard_normal(light.shape, dtype=np.float32)
    if full_well:
        noise *= np.sqrt(np.maximum(light, 0) / np.float32(full_well) + np.float32(even_sigma**2))
    else:
        noise *= np.float32(even_sigma)
    light += noise


def quantised(light: Image, options: RenderOptions) -> Levels:
    """Light as the file's numbers: clipped, through the tone curve, rounded; unchanged for 32 bits."""
    if options.bits == 32:
        return light
    shown = np.clip(light, 0, 1)
    if options.gamma != 1:
        shown **= np.float32(1 / options.gamma)
    shown *= 2**options.bits - 1
    np.rint(shown, out=shown)
    return shown.astype(np.uint8) if options.bits == 8 else shown.astype(np.uint16)
