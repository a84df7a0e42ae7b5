"""Where the light of a wide lens ends, as photos show it: `with_image_circle(camera, brightest_of(photos, size))`.

A model of a lens says where a direction is seen, not whether light arrives there. In many photos of different scenes
every part of the image is bright at some time, but for the dark around an image circle.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.cameras import MODELS, rays
from calib.cameras.camera import Camera
from calib.images.headers import DamagedError
from calib.images.photo import MAX_PIXELS, grey_of, read_preview
from designer.base.arrays import Array

COLUMNS = 240
"""Of the grid of cells."""
MOST_PHOTOS = 24
"""So many, evenly spread over their order, are looked at."""
DARK = 0.3
"""Of the light in the middle: a part of the image that is lighter than this in some photo is not dark."""
LIT = 0.15
"""Of the way from the dark to the light in the middle: what is lighter is lit."""
MIDDLE_RAD = math.radians(30)
SURE = 0.8
"""Of the cells beyond the circle, so many must be dark."""
STEP_RAD = math.radians(1)
FEW_CELLS = 0.01
"""Of all cells: so few without a ray are no part of the image that is worth a word."""


@dataclass(frozen=True, eq=False)
class EndOfLight:
    """A camera with the end of its light, or what keeps that from being known."""

    camera: Camera
    remark: str = ""


def brightest_of(photos: Sequence[Path], image_size: tuple[int, int]) -> Array | None:
    """The most light that each cell of the image has in any of some photos, of full scale; None if none is read.

    Args:
        photos: files.
        image_size: width, height in px.

    Returns:
        (R, C) means over cells, about square.
    """
    import cv2

    width, height = image_size
    shape = max(1, round(COLUMNS * height / width)), COLUMNS
    picked = np.unique(np.linspace(0, len(photos) - 1, min(len(photos), MOST_PHOTOS)).round().astype(int)).tolist()
    most = np.full(shape, np.nan)
    for path in (photos[row] for row in picked):
        try:
            grey = grey_of(read_preview(path, COLUMNS, MAX_PIXELS).pixels)
        except DamagedError:
            continue
        scale = float(np.iinfo(grey.dtype).max)
        small = cv2.resize(grey, (shape[1], shape[0]), interpolation=cv2.INTER_AREA).astype(np.float64)
        most = np.fmax(most, small / scale)
    return None if np.isnan(most).all() else most


def with_image_circle(camera: Camera, brightest: Array) -> EndOfLight:
    """The camera of a wide lens with the angle across its image circle, to about a degree.

    Where no part of the image is dark it is that of the farthest pixel; cameras of other models stay as they are then.

    Args:
        camera: as it was solved.
        brightest: of `brightest_of`.
    """
    rows, columns = brightest.shape
    size = np.array(camera.image_size)
    cell = np.stack(np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5), axis=-1)
    ray = rays(replace(camera, field_rad=None), cell * size / (columns, rows) - 0.5)
    angle = np.arctan2(np.hypot(ray[..., 0], ray[..., 1]), ray[..., 2])
    middle = brightest[angle < MIDDLE_RAD]
    if not middle.size:
        return EndOfLight(camera)
    light, dark = float(np.median(middle)), float(np.percentile(brightest, 1))
    is_lit = brightest > dark + LIT * (light - dark) if dark < DARK * light else np.ones(brightest.shape, dtype=bool)
    end = _end_rad(angle, is_lit)
    if end is None and not camera.has_dark_corners:
        return EndOfLight(camera)
    unseen = np.isnan(angle)
    if end is None and (is_lit & unseen).mean() > FEW_CELLS:
        part = f"{100 * (is_lit & unseen).mean():.0f} % of the image"
        remedy = MODELS[camera.model].remedy
        return EndOfLight(camera, f"the photos show light in {part} where model {camera.model} has no ray: {remedy}")
    end = float(np.nanmax(angle)) + STEP_RAD if end is None else end
    return EndOfLight(replace(camera, field_rad=min(2 * end, 2 * math.pi)))


def _end_rad(angle: Array, is_lit: NDArray[np.bool_]) -> float | None:
    """The angle off the axis at which half of the cells cease to be lit, and beyond which they are dark; None: none."""
    known = np.isfinite(angle)
    step = (angle[known] / STEP_RAD).astype(np.int64)
    count, lit = np.bincount(step), np.bincount(step, is_lit[known])
    share = np.where(count > 0, lit / np.maximum(count, 1), np.nan)
    bright = np.flatnonzero(share >= 1 / 2)
    last = int(bright[-1]) if len(bright) else -1
    if last < 0 or last + 1 >= len(share):
        return None
    beyond = angle > (last + 1) * STEP_RAD
    if not beyond.any() or is_lit[beyond].mean() > 1 - SURE:
        return None
    # From the share of this degree to that of the next one, at half.
    first, then = share[last], np.nan_to_num(share[last + 1])
    return float((last + 0.5 + (first - 0.5) / max(first - then, 1e-9)) * STEP_RAD)
