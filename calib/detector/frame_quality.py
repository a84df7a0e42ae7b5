"""What is wrong with a frame, told from the edges of the rings found in it: `frame_quality(pixels, found, target)`.

The outer edges of many rings are looked at together, by the direction they face. Blur widens an edge by the standard
deviation of what blurs along the edge's normal,

    sigma^2(phi) = n' S n,    n = (cos phi, sin phi),

S being the second moments of the point-spread function (2, 2). Defocus widens all edges alike; motion by a length L in
one direction adds L^2 / 12 along it alone, so that the larger eigenvalue of S less the smaller one tells L, and its
eigenvector the direction.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.core.types import Detections
from calib.detector.where_expected import face_map
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
TWO_ALIKE = 0.1
"""Of a variance: by less edges of two directions only do not tell a motion."""


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
    across, along = found.ellipse_px[:, 2], found.ellipse_px[:, 3]
    full = _full_scale(pixels)
    if target.radius_outer_mm[found.ring].all():
        levels = _around(pixels, found.ellipse_px[rows], np.array([INK_AT, WHITE_AT])) / full  # (N, D, 2)
        ratio = target.radius_inner_mm[found.ring] / target.radius_outer_mm[found.ring]
        edges = _edges_of_rings(found.ellipse_px[rows], 1 - ratio[rows].clip(0.2, 0.8))
    else:
        axes = _axes_of_corners(found, target)[rows]
        assert target.marks is not None  # noqa: S101 - points without marks are not found
        clear_mm = np.array([marks.clear_mm for marks in target.marks])[target.ring_face[found.ring[rows]]]
        clear = clear_mm / target.reach_mm[found.ring[rows]]
        levels = _around_corners(pixels, found.center_px[rows], clear[:, None, None] * axes) / full
        edges = _edges_of_corners(pixels, found.center_px[rows], axes, clear)
    if target.marks is not None:  # light circles, and squares of either colour
        is_light = np.array([marks.is_light for marks in target.marks])[target.ring_face[found.ring[rows]]]
        edges = replace(edges, normal=np.where(is_light[:, None, None], -1.0, 1.0) * edges.normal)
        levels = np.sort(levels, axis=2)
    ink, white = levels[..., 0], levels[..., 1]
    usable = np.isfinite(levels).all(axis=2)
    contrast = float(np.nanmedian(white - ink)) if usable.any() else math.nan
    moments = _moments(pixels, edges) if contrast > 0 else None
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


@dataclass(frozen=True, eq=False)
class _Edges:
    """D places on the edges of each of N marks."""

    place: Array  # (N, D, 2)
    normal: Array  # (N, D, 2) of length 1, towards the white
    depth: Array  # (N, D) how far across nothing else begins, px
    are_two: bool = False  # directions only: of the first and of the last D / 2


def _edges_of_rings(ellipse: Array, ink: Array) -> _Edges:
    """Outer edges; the width of the ink is given, of the outer radius."""
    first, second = _axes(ellipse)
    angle = 2 * math.pi * (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS
    cosine, sine = np.cos(angle)[None, :, None], np.sin(angle)[None, :, None]
    edge = ellipse[:, None, :2] + cosine * first[:, None] + sine * second[:, None]  # (N, D, 2)
    tangent = cosine * second[:, None] - sine * first[:, None]
    normal = np.stack([tangent[..., 1], -tangent[..., 0]], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    # How far it is across the ink along the normal; the white beside it is about as wide.
    return _Edges(edge, normal, REACH * ink[:, None] * ((edge - ellipse[:, None, :2]) * normal).sum(axis=-1))


def _axes_of_corners(found: Detections, target: TargetGeometry) -> Array:
    """How far the edges of corners reach along x and y of their faces, px, as columns.  # (N, 2, 2)"""
    axes = np.full((len(found.ring), 2, 2), np.nan)
    for face in np.unique(target.ring_face[found.ring]).tolist():
        own = target.ring_face[found.ring] == face
        at_mm = target.center_in_face_mm[found.ring[own], :2]
        axes[own] = face_map(at_mm, found.center_px[own]).at(at_mm)[1]
    return np.asarray(target.reach_mm[found.ring, None, None] * axes)


def _around_corners(pixels: NDArray[np.generic], center: Array, axes: Array) -> Array:
    """Levels of the four fields at each corner, two and two across it.  # (N, 2, 2)"""
    fields = np.array([[[1.0, 1.0], [1.0, -1.0]], [[-1.0, -1.0], [-1.0, 1.0]]]) / 2
    return _sampled(pixels, center[:, None, None] + np.einsum("nij,abj->nabi", axes, fields))


def _edges_of_corners(pixels: NDArray[np.generic], center: Array, axes: Array, clear: Array) -> _Edges:
    """Half way along the four edges at each corner; so much of their reach is clear across them."""
    along = axes[:, :, [0, 0, 1, 1]].transpose(0, 2, 1)  # (N, 4, 2)
    place = center[:, None] + np.array([0.5, -0.5, 0.5, -0.5])[:, None] * along
    length = np.linalg.norm(along, axis=2, keepdims=True)
    normal = np.stack([along[..., 1], -along[..., 0]], axis=2) / length
    # Of a square half: beyond its middle it may not be even in a picture that is blurred.
    part = np.where(clear < 1, clear, 0.5)
    depth = REACH * (part * np.abs(np.linalg.det(axes)))[:, None] / length[..., 0]
    rises = _sampled(pixels, place + depth[..., None] * normal) - _sampled(pixels, place - depth[..., None] * normal)
    return _Edges(place, np.where(rises[..., None] < 0, -1.0, 1.0) * normal, depth, are_two=True)


def _moments(pixels: NDArray[np.generic], edges: _Edges) -> Array | None:
    """Second moments S of the blur, from the widths of edges by their direction; None: they cannot be told.  # (2, 2)

    Edges of two directions tell two of three numbers; S is then the one that is most alike in all directions.
    """
    edge, normal, depth = edges.place, edges.normal, edges.depth
    reach = float(np.nanmedian(depth))
    step = np.linspace(-reach, reach, STEPS)
    level = _sampled(pixels, edge[:, :, None] + step[:, None] * normal[:, :, None])  # (N, D, K)
    usable = np.isfinite(level).all(axis=2) & (depth > 0.6 * reach)
    low, high = level[..., :3].mean(axis=2, keepdims=True), level[..., -3:].mean(axis=2, keepdims=True)
    usable &= (high - low)[..., 0] > 0.5 * np.nanmedian(high - low)
    share = (level - low) / np.where(usable[..., None], high - low, 1.0)
    facing = np.arctan2(normal[..., 1], normal[..., 0]) % math.pi
    bins = 2 if edges.are_two else DIRECTIONS // PER_BIN
    number = np.minimum((facing / math.pi * bins).astype(np.int64), bins - 1)
    if edges.are_two:
        number[:] = np.arange(facing.shape[1]) // (facing.shape[1] // 2)
    equations, variances = [], []
    for one in range(bins):
        mine = usable & (number == one)
        if mine.sum() < FEWEST_RINGS:
            continue
        phi = float(np.angle(np.exp(2j * facing[mine]).mean())) / 2
        equations.append((math.cos(phi) ** 2, 2 * math.cos(phi) * math.sin(phi), math.sin(phi) ** 2))
        variances.append(_variance(step, share[mine].mean(axis=0)))
    if len(variances) < (2 if edges.are_two else 4):
        return None
    even = float(np.mean(variances))
    if edges.are_two and np.ptp(variances) < TWO_ALIKE * max(variances):
        return even * np.eye(2)
    off = np.linalg.lstsq(np.array(equations), np.array(variances) - even, rcond=1e-6)[0]
    xx, xy, yy = (off + even * np.array([1.0, 0.0, 1.0])).tolist()
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
