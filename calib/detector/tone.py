"""The tone curve of a photo: `light = level ** exponent`, one number from all rings, and the photo without it.

Cameras write levels that are no light: gamma, sRGB, or a curve on top. A lens blurs light, and the ring model adds it
up: through a curve all edges move by as many pixels, and their profiles are skewed. Of a small change d of the exponent
levels y change by `d y ln y`. As skewed profiles have other causes, too, that is held against the residuals by an
instrument: edges that move alike, less what a ring's own parameters take up. A curve that is no power is taken for the
power most like it between ink and white.
"""

from collections.abc import Callable
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.detector.candidates import semi_axes_px
from calib.detector.ring_fit import RingFits
from calib.detector.ring_model import BLUR, DARKNESS, E00, E11, INK_LIGHT_U, INK_LIGHT_V, LIGHT_U, LIGHT_V, RATIO, WHITE
from designer.base.arrays import Array

Image: TypeAlias = NDArray[np.generic]
Fit: TypeAlias = Callable[[Image, Array, NDArray[np.int64]], RingFits]

LEAST, MOST = 0.8, 2.2
"""From 1: of usual encodings it is 1.2, with a curve on top up to 1.7. What else leaves a trace alike comes to .75
(whites cut off), or is far more."""
SURE = 5.0
"""Standard deviations, by how rings of a photo differ."""
FEWEST, ENOUGH = 12, 40
"""Rings, that tell it and that suffice for it."""
ROUNDS, SAME = 4, 0.15
"""After a step this small the next would be by a hundredth."""
LIMITS = 1.0, 3.5
WIDE = 4.0
"""The hole's smaller semi-axis in blurs, of rings that tell it: in narrower ones opposite edges run into each other."""


def some_of(able: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """As many rings as suffice, of those that are able, spread over the photo.  # (N,)"""
    rows = np.flatnonzero(able)
    some = np.zeros(len(able), dtype=np.bool_)
    some[rows[:: -(-len(rows) // ENOUGH) or 1]] = True
    return some


def _told(fits: RingFits, is_sound: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Rings that were asked and that can tell.  # (N,)"""
    hole_px = fits.params[:, RATIO] * semi_axes_px(fits.params[:, E00 : E11 + 1])[1]
    return np.asarray(is_sound & (fits.scores.tone[:, 0] != 0) & (hole_px > WIDE * fits.params[:, BLUR]))


def change_of_exponent(fits: RingFits, is_sound: NDArray[np.bool_]) -> tuple[float, float]:
    """By what factor the exponent is to be changed, less 1, and its standard deviation; 0 and infinite: not told."""
    information, score = fits.scores.tone[_told(fits, is_sound)].T
    if len(score) < FEWEST or not information.sum() > 0:
        return 0.0, np.inf
    change = float(score.sum() / information.sum())
    return change, float(np.linalg.norm(score - change * information) / information.sum())


def without_tone(
    image: Image, fits: RingFits, is_sound: NDArray[np.bool_], fit: Fit
) -> tuple[NDArray[np.float32], Array] | None:
    """The photo with its tone curve undone, and parameters to start from; None where levels are light for all one sees.

    Args:
        image: grey levels, uint8 or float32.  # (H, W)
        fits: of the photo as it is.
        is_sound: which to ask.  # (N,)
        fit: of some rows (K,) in another image, from parameters (K, 15).
    """
    change, sigma = change_of_exponent(fits, is_sound)
    if not max(LEAST, SURE * sigma) < change < MOST:
        return None
    rows = np.flatnonzero(_told(fits, is_sound))
    full, exponent = float(np.median(fits.params[is_sound, WHITE])), 1.0
    for _ in range(ROUNDS):
        # To twice or half as much at most: the step is to first order.
        exponent = float(np.clip(exponent * np.clip(1 + change, 0.5, 2.0), *LIMITS))
        if abs(change) < SAME:
            break
        there = fit(_in_light(image, exponent, full), _starts(fits.params[rows], exponent, full), rows)
        change, sigma = change_of_exponent(there, there.ok)
    if not (np.isfinite(sigma) and exponent > 1 + 0.5 * LEAST):
        return None
    return _in_light(image, exponent, full), _starts(fits.params, exponent, full)


def _in_light(image: Image, exponent: float, full: float) -> NDArray[np.float32]:
    """`full (level / full) ** exponent`: the usual white stays as it is."""
    if image.dtype == np.uint8:
        table = full * (np.arange(256) / full) ** exponent
        return np.asarray(table.astype(np.float32)[image.view(np.uint8)])
    share = np.maximum(np.asarray(image, dtype=np.float32) * np.float32(1 / full), 0)
    return np.asarray(cv2.pow(share, exponent), dtype=np.float32) * np.float32(full)


def _starts(params: Array, exponent: float, full: float) -> Array:
    """Parameters to start from there: levels through the curve, light without a gradient."""
    moved, white = params.copy(), np.maximum(params[:, WHITE], 1e-9)
    moved[:, WHITE] = full * (white / full) ** exponent
    moved[:, DARKNESS] = 1 - np.maximum(1 - params[:, DARKNESS], 0) ** exponent
    moved[:, [LIGHT_U, LIGHT_V, INK_LIGHT_U, INK_LIGHT_V]] = 0
    return moved
