"""What is wrong with a frame, told from the edges of the rings found in it: `frame_quality(pixels, found, target)`.

The outer edges of many rings are looked at together, by the direction they face. Blur widens an edge by the standard
deviation of what blurs along the edge's normal,

    sigma^2(phi) = n' S n,    n = (cos phi, sin phi),

S being the second moments of the point-spread function (2, 2). Defocus widens all edges alike; motion by a length L in
one direction adds L^2 / 12 along it alone, so that the larger eigenvalue of S less the smaller one tells L, and its
eigenvector the direction.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.core.linear_algebra import least_squares
from calib.core.types import Detections
from designer.base.arrays import Array
from designer.target import TargetGeometry

RINGS = 60
"""Of a frame, spread over all that were found."""
DIRECTIONS, PER_BIN = 48, 4
"""Around each ring, and neighbours that are averaged."""
STEPS = 25
REACH = 0.8
"""Of the ink's width, and of the white beside: so far across an edge is looked."""
WHITE_AT, INK_AT = 1.22, 0.72
"""Of the outer radius: where white is white and ink is ink at least."""
OF_PIXELS = 1 / 12 + 1 / 6
"""Variance that a pixel's square adds to an edge, and linear interpolation between pixels, on average."""
FULL_SHARE = 0.995
"""Of full scale: what is as bright or brighter is full."""
FEWEST_RINGS = 4


@dataclass(frozen=True)
class FrameQuality:
    """How a frame shows the rings that were found in it."""

    rings: int
    radius_px: float  # the smaller semi-axis of the outer contour, of the usual ring
    facing: float  # smaller over larger semi-axis of the usual ring: 1 straight on
    blur_px: float  # standard deviation along the direction of least blur; nan: not to be told
    motion_px: float  # how far the target moved while the frame was exposed
    motion_rad: float  # in which direction, 0 to pi, from right to down
    contrast: float  # white less ink, of full scale
    full_share: float  # of the white that is at full scale
    black_share: float  # of the ink that is at nothing


def frame_quality(pixels: NDArray[np.generic], found: Detections, target: TargetGeometry) -> FrameQuality | None:
    """What a frame is worth: `frame_quality(frame, detector.glance(frame), target)`.

    Args:
        pixels: grey levels, uint8, uint16 or float32 of 0 to 1.  # (H, W)
        found: in it; the outer contours need to be good to a third of a pixel.
        target: that was found.

    Returns:
        None if too few rings were found to tell.
    """
    if len(found.ring) < FEWEST_RINGS:
        return None
    rows = np.unique(np.linspace(0, len(found.ring) - 1, min(len(found.ring), RINGS)).round().astype(np.int64))
    ratio = target.radius_inner_mm[found.ring] / target.radius_outer_mm[found.ring]
    across, along = found.ellipse_px[:, 2], found.ellipse_px[:, 3]
    full = _full_scale(pixels)
    levels = _around(pixels, found.ellipse_px[rows], np.array([INK_AT, WHITE_AT])) / full  # (N, D, 2)
    ink, white = levels[..., 0], levels[..., 1]
    usable = np.isfinite(levels).all(axis=2)
    contrast = float(np.nanmedian(white - ink)) if usable.any() else math.nan
    moments = _moments(pixels, found.ellipse_px[rows], 1 - ratio[rows].clip(0.2, 0.8)) if contrast > 0 else None
    blur, motion, direction = (math.nan,) * 3 if moments is None else _blur_and_motion(moments)
    return FrameQuality(
        len(found.ring), float(np.median(along)), float(np.median(along / across)), blur, motion, direction, contrast,
        float((white[usable] >= FULL_SHARE).mean()) if usable.any() else math.nan,
        float((ink[usable] <= 0).mean()) if usable.any() else math.nan,
    )  # fmt: skip


def _full_scale(pixels: NDArray[np.generic]) -> float:
    """The level of full pixels; of sixteen bits that of those that are used."""
    if pixels.dtype == np.uint8:
        return 255.0
    if pixels.dtype == np.uint16:
        return float(2 ** max(8, int(pixels.max()).bit_length()) - 1)
    return 1.0


def _axes(ellipse: Array) -> tuple[Array, Array]:
    """Semi-axes as vectors.  # (N, 2), (N, 2)"""
    turn = np.stack([np.cos(ellipse[:, 4]), np.sin(ellipse[:, 4])], axis=1)
    return ellipse[:, 2:3] * turn, ellipse[:, 3:4] * np.stack([-turn[:, 1], turn[:, 0]], axis=1)


def _around(pixels: NDArray[np.generic], ellipse: Array, radii: Array) -> Array:
    """Levels on circles of some radii around rings, in many directions; nan outside.  # (N, D, K)"""
    first, second = _axes(ellipse)
    angle = 2 * math.pi * np.arange(DIRECTIONS) / DIRECTIONS
    out = np.cos(angle)[None, :, None] * first[:, None] + np.sin(angle)[None, :, None] * second[:, None]
    return _sampled(pixels, ellipse[:, None, None, :2] + out[:, :, None] * radii[None, None, :, None])


def _sampled(pixels: NDArray[np.generic], place: Array) -> Array:
    """Bilinear levels at places (..., 2); nan outside."""
    height, width = pixels.shape
    u, v = place[..., 0], place[..., 1]
    inside = (u >= 0) & (v >= 0) & (u <= width - 1) & (v <= height - 1)
    u, v = np.where(inside, u, 0), np.where(inside, v, 0)
    left, top = np.minimum(u.astype(np.int64), width - 2), np.minimum(v.astype(np.int64), height - 2)
    du, dv = u - left, v - top
    upper = (1 - du) * pixels[top, left] + du * pixels[top, left + 1]
    lower = (1 - du) * pixels[top + 1, left] + du * pixels[top + 1, left + 1]
    return np.where(inside, (1 - dv) * upper + dv * lower, np.nan)


def _moments(pixels: NDArray[np.generic], ellipse: Array, ink: Array) -> Array | None:
    """Second moments S of the blur, from the widths of edges by their direction; None: they cannot be told.  # (2, 2)

    Args:
        pixels: of the frame.
        ellipse: of rings.
        ink: width of their ink, of the outer radius.
    """
    first, second = _axes(ellipse)
    angle = 2 * math.pi * (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS
    cosine, sine = np.cos(angle)[None, :, None], np.sin(angle)[None, :, None]
    edge = ellipse[:, None, :2] + cosine * first[:, None] + sine * second[:, None]  # (N, D, 2)
    tangent = cosine * second[:, None] - sine * first[:, None]
    normal = np.stack([tangent[..., 1], -tangent[..., 0]], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    # How far it is across the ink along the normal; the white beside it is about as wide.
    depth = REACH * ink[:, None] * ((edge - ellipse[:, None, :2]) * normal).sum(axis=-1)  # (N, D)
    reach = float(np.median(depth))
    step = np.linspace(-reach, reach, STEPS)
    level = _sampled(pixels, edge[:, :, None] + step[:, None] * normal[:, :, None])  # (N, D, K)
    usable = np.isfinite(level).all(axis=2) & (depth > 0.6 * reach)
    low, high = level[..., :3].mean(axis=2, keepdims=True), level[..., -3:].mean(axis=2, keepdims=True)
    usable &= (high - low)[..., 0] > 0.5 * np.nanmedian(high - low)
    share = (level - low) / np.where(usable[..., None], high - low, 1.0)
    facing = np.arctan2(normal[..., 1], normal[..., 0]) % math.pi
    bins = DIRECTIONS // PER_BIN
    number = np.minimum((facing / math.pi * bins).astype(np.int64), bins - 1)
    equations, variances = [], []
    for one in range(bins):
        mine = usable & (number == one)
        if mine.sum() < FEWEST_RINGS:
            continue
        phi = float(np.angle(np.exp(2j * facing[mine]).mean())) / 2
        equations.append((math.cos(phi) ** 2, 2 * math.cos(phi) * math.sin(phi), math.sin(phi) ** 2))
        variances.append(_variance(step, share[mine].mean(axis=0)))
    if len(variances) < 4:
        return None
    xx, xy, yy = least_squares(np.array(equations), np.array(variances)).tolist()
    return np.array([[xx, xy], [xy, yy]])


def _variance(step: Array, share: Array) -> float:
    """Of the blur of an edge that rises along steps, beyond that of pixels and of reading between them.

    Where the ink ends on its other side, and where the next ring begins, it falls again, which is none of the edge.
    """
    middle = len(share) // 2
    inward, outward = np.minimum.accumulate(share[middle::-1])[::-1], np.maximum.accumulate(share[middle:])
    weight, at = np.diff(np.concatenate([inward, outward[1:]])), 0.5 * (step[1:] + step[:-1])
    weight /= max(float(weight.sum()), 1e-9)
    mean = (weight * at).sum()
    return max(float((weight * (at - mean) ** 2).sum()) - OF_PIXELS, 0.0)


def _blur_and_motion(moments: Array) -> tuple[float, float, float]:
    """Standard deviation of the least blur, length and direction of the motion."""
    value, vector = np.linalg.eigh(moments)
    least, most = (max(float(one), 0.0) for one in value)
    direction = math.atan2(vector[1, 1], vector[0, 1]) % math.pi
    return math.sqrt(least), math.sqrt(12 * (most - least)), direction
