"""Things around the target: clutter behind it, occluders in front of it."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]

SHIFT = 4  # bits of sub-pixel places in OpenCV's drawing
BLOB_CORNERS = 48
MASK_SIDE_PX = 256
MAX_SHAPES, MAX_TRIES = 60, 400
OVERSHOOT = 0.02
RING_RADIUS = (0.003, 0.02)  # of the image's width
SHAPE_SIZE = (0.01, 0.12)


@dataclass(frozen=True, eq=False)
class Occluders:
    """What stands in front of the target."""

    grey: Grey  # (H, W) its light, 255 = full scale
    share: Grey  # (H, W) how much of the pixel it covers, 255 = all


def fill(image: Grey, polygon_px: Array, grey: int) -> None:
    """Draw an anti-aliased polygon (K, 2)."""
    points = np.clip(np.rint(polygon_px * 2**SHIFT), -(2**26), 2**26).astype(np.int32)
    cv2.fillPoly(image, [points], (grey,), lineType=cv2.LINE_AA, shift=SHIFT)


def blob(middle_px: Array, radius_px: float, rng: np.random.Generator) -> Array:
    """A smooth closed curve around a point.  # (K, 2)"""
    angle = 2 * np.pi * np.arange(BLOB_CORNERS) / BLOB_CORNERS
    radius = np.ones(BLOB_CORNERS)
    for order in range(1, 5):
        radius += 0.35 / order * rng.uniform() * np.cos(order * angle + rng.uniform(0, 2 * np.pi))
    radius *= radius_px / math.sqrt(float((radius**2).mean()))
    curve: Array = middle_px + radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    return curve


def rod(middle_px: Array, length_px: float, width_px: float, rng: np.random.Generator) -> Array:
    """A long thin rectangle in a random direction.  # (4, 2)"""
    angle = rng.uniform(0, 2 * np.pi)
    along = np.array([np.cos(angle), np.sin(angle)]) * length_px / 2
    across = np.array([-np.sin(angle), np.cos(angle)]) * width_px / 2
    corners: Array = middle_px + np.array([along + across, along - across, -along - across, across - along])
    return corners


def clutter(image_size: tuple[int, int], count: int, background: float, rng: np.random.Generator) -> Grey:
    """A background (H, W) with shapes, every second of them rings that are not the target's."""
    width, height = image_size
    image = np.full((height, width), round(255 * background), dtype=np.uint8)
    for number in range(count):
        middle = rng.uniform([0, 0], [width, height])
        if number % 2:
            _draw_rings(image, middle, width * rng.uniform(*RING_RADIUS), rng)
        else:
            size = width * rng.uniform(*SHAPE_SIZE)
            is_rod = rng.uniform() < 0.4
            shape = rod(middle, 4 * size, 0.3 * size, rng) if is_rod else blob(middle, size, rng)
            fill(image, shape, int(rng.integers(256)))
    return image


def _draw_rings(image: Grey, middle_px: Array, radius_px: float, rng: np.random.Generator) -> None:
    """One to six rings or dots on a light patch, in rows as on a target but tilted and squeezed."""
    turn, squeeze = rng.uniform(0, np.pi), rng.uniform(0.3, 1.0)
    cosine, sine = np.cos(turn), np.sin(turn)
    affine = radius_px * np.array([[cosine, -sine * squeeze], [sine, cosine * squeeze]])
    columns, rows = int(rng.integers(1, 4)), int(rng.integers(1, 3))
    dark, pale = int(rng.integers(0, 80)), int(rng.integers(150, 256))
    pitch = rng.uniform(2.3, 3.5)
    half = np.array([columns, rows]) * pitch / 2
    patch = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    fill(image, middle_px + patch @ affine.T, pale)
    angle = 2 * np.pi * np.arange(BLOB_CORNERS) / BLOB_CORNERS
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    for column in range(columns):
        for row in range(rows):
            place = (np.array([column, row]) - (np.array([columns, rows]) - 1) / 2) * pitch
            fill(image, middle_px + (place + circle) @ affine.T, dark)
            if rng.uniform() < 0.8:
                fill(image, middle_px + (place + rng.uniform(0.3, 0.7) * circle) @ affine.T, pale)


def occlude(
    image_size: tuple[int, int], silhouette_px: list[Array], hidden: float, rng: np.random.Generator
) -> Occluders:
    """Blobs and rods in front of the target that hide a share of its silhouette.

    Args:
        image_size: width, height.
        silhouette_px: convex polygons (K, 2) whose union is the target's image.
        hidden: share of the silhouette's area inside the image.
        rng: draws the shapes.
    """
    width, height = image_size
    result = Occluders(np.zeros((height, width), np.uint8), np.zeros((height, width), np.uint8))
    corners = np.concatenate([np.zeros((0, 2)), *silhouette_px])
    if not len(corners):
        return result
    low = np.clip(corners.min(axis=0), 0, [width - 1, height - 1])
    high = np.clip(corners.max(axis=0), 0, [width - 1, height - 1])
    scale = MASK_SIDE_PX / max(float((high - low).max()), 1.0)
    mask = np.zeros(np.ceil((high - low)[::-1] * scale).astype(int) + 1, np.uint8)
    for polygon in silhouette_px:
        fill(mask, (polygon - low) * scale, 255)
    inside = mask >= 128
    whole = max(1, int(inside.sum()))
    covered = np.zeros_like(mask)
    shapes = 0
    for _ in range(MAX_TRIES):
        missing = hidden - float((covered[inside] >= 128).sum()) / whole
        if missing <= OVERSHOOT / 2 or shapes == MAX_SHAPES:
            break
        shape = _occluder(low, high, missing * whole / scale**2, rng)
        trial = covered.copy()
        fill(trial, (shape - low) * scale, 255)
        if float((trial[inside] >= 128).sum()) / whole > hidden + OVERSHOOT:
            continue
        covered, shapes = trial, shapes + 1
        fill(result.grey, shape, int(rng.integers(0, 230)))
        fill(result.share, shape, 255)
    # Where a shape's edge is anti-aliased its grey is mixed with nothing; widen it so that `share` alone mixes.
    cv2.dilate(result.grey, np.ones((3, 3), np.uint8), dst=result.grey)
    return result


def _occluder(low_px: Array, high_px: Array, area_px2: float, rng: np.random.Generator) -> Array:
    """A shape in a box that covers at most about the area asked for."""
    middle = rng.uniform(low_px, high_px)
    size = float(np.linalg.norm(high_px - low_px))
    if rng.uniform() < 0.3:
        width = min(area_px2 / size * 1.5, size * rng.uniform(0.01, 0.06))
        return rod(middle, 2 * size, max(width, 1.0), rng)
    radius = min(math.sqrt(area_px2 / math.pi) * rng.uniform(0.4, 1.0), 0.25 * size)
    return blob(middle, max(radius, 1.0), rng)
