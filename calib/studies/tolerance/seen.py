"""What a camera sees of a target: which rings, how exactly their centres are detected, and whether all of it fits.

An edge gives its place across itself, so an outer contour with the unit normal n carries the information
`integral of n n' dl` (per variance of an edge's place times px), which for an ellipse is diagonal in its axes. The
inner contour has the same shape and adds its share. Fitted to what the detector states for 51,000 observations of an
icosahedron's rings and 77,000 of a board's in rendered photos (area sampling, contrast over noise 100, blur 0.7 px),
with minor semi-axes of 2.5 to 28 px:

- above 10 px the formula alone holds, with 0.00058 px^2 px;
- flatter rings run into the blur of the opposite edge: the covariances stated by the detector grow by
  `1 + (b0 / b)^p`, more along the major axis;
- rings of a mean radius above 24 px are measured on a sample of their pixels: a factor of 2.2 at once.

Single stated variances scatter about the model by 15 % above 10 px, by a third from 4 to 10 px, by a half below. The
true errors of those detections are smaller: their squares are 0.73 (icosahedron) and 0.75 (board) times the stated
variance, along the major axis of rings below 6 px 0.2 to 0.6 times. So the noise drawn is on the safe side by a sixth.
Nothing that a ring has beyond its stated covariance is in it: the noise of observations is independent, while a bias of
the fit would be the same each time a ring is seen from one side. Other contrasts scale all variances by the square of
the noise, which was not measured.

How far a camera is off over the image, its best rotation removed, fast: as `calib.cameras.refit`.

The pixels and rays of the true camera are the same each time, so the rays are computed once. Only the part of the image
counts in which rings were seen, their convex hull: beyond it a lens polynomial is extrapolated, and means nothing.
"""

import math
from dataclasses import dataclass

import numpy as np

from calib.cameras import linearise, project, rays
from calib.cameras.camera import Camera, linear_part
from calib.core.se3 import exp_rotation, transform
from calib.core.types import LEAST_RADIUS_PX, Observations
from calib.observe.observations import known_points
from calib.renderer.faces import target_fits
from calib.renderer.poses import PoseGrid, grid_poses, photo_poses
from designer.base.arrays import Array, Flags, Rows
from designer.kinds.layout import Viewpoints
from designer.target import TargetGeometry, bounding_radius_mm

MAX_INCIDENCE_RAD = math.radians(75)
LEAST_MINOR_PX = 2.5
"""Half the minor axis of 5 px from which the detector measures rings well."""
LEAST_RINGS = 6
"""Of a view that counts."""
MARGIN_PX = 2.0
CAP_RAD = math.radians(60)
"""Half angle of the cap around a board's normal that it is photographed from."""
EDGE_VARIANCE = 5.8e-4
"""Of an edge's place, px^2 per px of contour, at `CONTRAST_TO_NOISE`."""
CONTRAST_TO_NOISE = 100.0
CORNER_BOUND, CORNER_VARIANCE = 2.48e-4, 3.65e-4
"""The same of a corner's edges: `2 sqrt(pi) blur / (C / noise)^2`; and as the fit of corners states it, and is off, in
rendered photos of chessboards, ChArUco boards and AprilGrids: it does not use all pixels."""
USED_PX, NEXT_PX = 30.0, 1.6
"""How much of an edge `calib.detector.corner_fit` uses at most, and how far from the next corner it stays."""
CROSSED_PX = 0.8
"""Of each edge at a crossing of lines blurred by .7 px: the integral of 1 - erf^2."""
FLAT_MAJOR = (7.3, 3.3)
"""Along the major axis, minor semi-axis in px and power of the growth for flat rings."""
FLAT_MINOR = (5.3, 4.0)
SAMPLED_RADIUS_PX = 24.0
SAMPLED_FACTOR = 2.2
_ANGLE = (np.arange(64) + 0.5) * (np.pi / 32)
CHECKED_VIEWS = 60
FARTHEST = 64.0
CLOSE = 1.01


def views_from(target: TargetGeometry, camera: Camera, photos: Viewpoints, views: int, seed: int) -> Array:
    """Poses on a Fibonacci grid around a target, of a board from a cap on each of its sides, rolled at random.

    The same as `calib render` takes with these options.  # (V, 4, 4)
    """
    return photo_poses(_grid(target, photos, views), camera, seed)[0]


def _grid(target: TargetGeometry, photos: Viewpoints, views: int) -> PoseGrid:
    return PoseGrid(
        views, photos.half_angle_rad, photos.distance_mm, random_roll=True, aim_offset_mm=photos.aim_offset_mm,
        is_two_sided=target.has_back,
    )  # fmt: skip


def aimed_at(target: TargetGeometry, distance_mm: float) -> Viewpoints:
    """Photos from one distance that all look at the target's origin: `aimed_at(target, 400.0)`."""
    return Viewpoints((distance_mm, distance_mm), 0.0, CAP_RAD if target.faces_up else math.pi)


def seen_in(
    target: TargetGeometry, camera: Camera, cam_from_target: Array, contrast_to_noise: float
) -> tuple[Rows, Array, Array]:
    """Rings that a view sees (N,), their pixels (N, 2) and the covariances of these (N, 2, 2)."""
    center = transform(cam_from_target, target.center_mm)
    frame = cam_from_target[:3, :3] @ target.target_from_face[target.ring_face, :3, :3]
    cosine = -(frame[:, :, 2] * center).sum(axis=1) / np.linalg.norm(center, axis=1)
    has_image = np.isfinite(project(camera, center)).all(axis=1)
    front = np.flatnonzero((cosine >= math.cos(MAX_INCIDENCE_RAD)) & has_image)
    linear = linearise(camera, np.ascontiguousarray(center[front].T))
    on_face = linear.by_point.transpose(2, 0, 1) @ frame[front, :, :2]  # (N, 2, 2) px per mm
    circle = on_face * target.reach_mm[front, None, None]
    pixel = linear.pixel.T
    reach = np.linalg.norm(circle, axis=2) + MARGIN_PX  # half of the box around the ellipse (N, 2)
    last = np.array(camera.image_size, dtype=np.float64) - 1
    with np.errstate(invalid="ignore"):
        inside = ((pixel - reach >= 0) & (pixel + reach <= last)).all(axis=1)
    good = np.flatnonzero(inside)
    minor = np.linalg.svd(circle[good], compute_uv=False)[:, 1]
    good = good[minor >= LEAST_MINOR_PX]
    ring = front[good]
    covariance = np.empty((len(ring), 2, 2))
    is_corner = target.radius_outer_mm[ring] == 0
    own = ring[~is_corner]
    ratio = target.radius_inner_mm[own] / target.radius_outer_mm[own]
    covariance[~is_corner] = centre_covariances(circle[good][~is_corner], ratio, contrast_to_noise)
    crosses = np.array([marks.is_crossing for marks in target.marks or ()], dtype=np.bool_)
    crossing = crosses[target.ring_face[ring[is_corner]]] if is_corner.any() else np.zeros(0, np.bool_)
    # Edges go on to the next corner, before which its blur ends what is used of them.
    whole = 2 * circle[good][is_corner]
    left = 1 - np.minimum(NEXT_PX / np.maximum(np.linalg.norm(whole, axis=1, keepdims=True), 1e-9), 0.75)
    covariance[is_corner] = corner_covariances(left * whole, crossing, contrast_to_noise)
    return ring, pixel[good], covariance


def views_of(
    target: TargetGeometry, camera: Camera, cam_from_target: Array, contrast_to_noise: float
) -> tuple[Rows, Observations]:
    """The poses (V, 4, 4) from which enough rings are seen, and what is: exact pixels, and covariances of noise."""
    found = [seen_in(target, camera, pose, contrast_to_noise) for pose in cam_from_target]
    kept = [view for view, (ring, _, _) in enumerate(found) if len(ring) >= LEAST_RINGS]
    nothing = np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros((0, 2, 2))
    ring, pixel, covariance = (np.concatenate([nothing[k], *(found[view][k] for view in kept)]) for k in range(3))
    names = tuple(f"view {view}" for view in kept)
    view = np.repeat(np.arange(len(kept)), [len(found[number][0]) for number in kept])
    points = known_points(target)
    return np.array(kept, np.int64), Observations(camera.image_size, names, view, ring, pixel, covariance, points)


def centre_covariances(image_of_circle: Array, ratio: Array, contrast_to_noise: float = CONTRAST_TO_NOISE) -> Array:
    """Covariances (M, 2, 2) in px^2 of detected centres.

    Args:
        image_of_circle: what takes the unit circle to a ring's outer ellipse (M, 2, 2), in px.
        ratio: inner radius over outer (M,); 0 for dots.
        contrast_to_noise: of the photos.
    """
    axes, semi, _ = np.linalg.svd(image_of_circle)
    information = _contour_information(semi) * (1 + ratio[:, None])
    minor = semi[:, 1:]
    power = np.array([FLAT_MAJOR[1], FLAT_MINOR[1]])
    growth = 1 + (np.array([FLAT_MAJOR[0], FLAT_MINOR[0]]) / minor) ** power
    mean_radius = np.sqrt(semi.prod(axis=1))[:, None]
    sampled = np.where(mean_radius > SAMPLED_RADIUS_PX, SAMPLED_FACTOR * mean_radius / SAMPLED_RADIUS_PX, 1.0)
    variance = EDGE_VARIANCE * (CONTRAST_TO_NOISE / contrast_to_noise) ** 2 * growth * sampled / information
    covariance: Array = (axes * variance[:, None, :]) @ axes.transpose(0, 2, 1)
    return 0.5 * (covariance + covariance.transpose(0, 2, 1))


def corner_covariances(edges: Array, is_crossing: Flags, contrast_to_noise: float = CONTRAST_TO_NOISE) -> Array:
    """Covariances (M, 2, 2) in px^2 of corners, the Cramer-Rao bound of the two lines that meet there.

    Args:
        edges: columns: how far the two edges reach from the corner (M, 2, 2), in px.
        is_crossing: lines cross there, so that their directions cost nothing (M,); else they end.
        contrast_to_noise: of the photos.
    """
    length = np.linalg.norm(edges, axis=1)  # (M, 2)
    along = edges / np.maximum(length, 1e-9)[:, None]
    length = np.minimum(length, USED_PX)
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1)
    # Where lines cross, the blur takes the contrast off them; where they end, the direction is to be found, too.
    clear = np.maximum(length - CROSSED_PX, 0.1 * length)
    told = np.where(is_crossing[:, None], 2.0, 0.25) * clear
    variance = CORNER_VARIANCE * (CONTRAST_TO_NOISE / contrast_to_noise) ** 2
    # Lines seen edge-on tell nothing across them.
    information = (normal * told[:, None]) @ normal.transpose(0, 2, 1) + 1e-9 * np.eye(2)
    return variance * np.asarray(np.linalg.inv(information))


def _contour_information(semi: Array) -> Array:
    """`integral of n n' dl` along the axes of ellipses with semi-axes (M, 2), major and minor.  # (M, 2)"""
    along, across = semi[:, :1] * np.sin(_ANGLE), semi[:, 1:] * np.cos(_ANGLE)
    length = np.hypot(along, across)
    information: Array = 2 * np.pi * np.stack([(across**2 / length).mean(axis=1), (along**2 / length).mean(axis=1)], 1)
    return information


@dataclass(frozen=True)
class ViewFit:
    """How a target sits in the photos from one distance."""

    distance_mm: float
    fitting: float  # share of the views that show all of it
    fits_from_mm: float  # distance from which all do; inf: none as far as was tried
    radius_px: float  # of the largest ring, facing the camera
    large_to_mm: float  # distance up to which the rings are large enough
    features: str = "rings"  # what they are

    @property
    def remark(self) -> str:
        """What is wrong and the distances that would do; "" if nothing is."""
        parts = []
        if self.fitting < 1:
            parts.append(f"the target reaches beyond the image in {1 - self.fitting:.0%} of the views")
        if self.radius_px < LEAST_RADIUS_PX:
            size = "edges below" if self.features == "corners" else "a radius below"
            parts.append(f"its {self.features} that face the camera have {size} {LEAST_RADIUS_PX:g}px")
        if not parts:
            return ""
        fits = "no distance shows all of it with this camera"
        if math.isfinite(self.fits_from_mm):
            fits = f"it fits from --distance {math.ceil(self.fits_from_mm)}mm on"
        large = f"its {self.features} are large enough up to --distance {math.floor(self.large_to_mm)}mm"
        return f"at {self.distance_mm:g}mm {' and '.join(parts)}; {fits}, {large}"


def view_fit(target: TargetGeometry, camera: Camera, distance_mm: float) -> ViewFit:
    """How a target sits in photos from all sides, or of a board from a cap, that look at its origin."""
    grid = _grid(target, aimed_at(target, distance_mm), CHECKED_VIEWS)
    poses = grid_poses(grid, np.random.default_rng(0))
    nearest = float(np.linalg.norm(target.center_mm, axis=1).min())
    focal_px = float(linear_part(camera).params[0])
    largest = float(target.reach_mm.max())
    return ViewFit(
        distance_mm,
        _fitting(target, camera, poses, 1.0),
        distance_mm * _least_factor(target, camera, poses),
        focal_px * largest / (distance_mm - nearest),
        nearest + focal_px * largest / LEAST_RADIUS_PX,
        target.feature_word,
    )


def _fitting(target: TargetGeometry, camera: Camera, poses: Array, factor: float) -> float:
    """Share of the views that show all corners of the target, so many times as far away."""
    moved = np.array(poses)
    moved[:, :3, 3] *= factor
    return float(np.mean([target_fits(target, camera, pose) for pose in moved]))


def _least_factor(target: TargetGeometry, camera: Camera, poses: Array) -> float:
    """The least multiple of the distance at which all views show all of the target; inf if that is too far."""
    inside = bounding_radius_mm(target) / float(np.linalg.norm(poses[:, :3, 3], axis=1).min())
    low, high = inside, max(2 * inside, 1.0)
    while _fitting(target, camera, poses, high) < 1:
        low, high = high, 2 * high
        if high > FARTHEST:
            return math.inf
    while high / low > CLOSE:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if _fitting(target, camera, poses, middle) == 1 else (middle, high)
    return high


COLUMNS = 24
STEPS = 5
SMALL_RAD = 1e-10


@dataclass(frozen=True, eq=False)
class ImageGrid:
    """Pixels of the true camera, evenly spread over the part of the image that was seen."""

    pixel: Array  # (2, N)
    ray: Array  # (3, N)


def grid_of(camera: Camera, seen_px: Array) -> ImageGrid:
    """The grid of a true camera within the convex hull of pixels (M, 2)."""
    import cv2

    hull = cv2.convexHull(seen_px.astype(np.float32))
    low, high = seen_px.min(axis=0), seen_px.max(axis=0)
    across, down = (high - low).tolist()
    rows = max(2, round(down / max(across, 1.0) * COLUMNS))
    u, v = np.meshgrid(np.linspace(low[0], high[0], COLUMNS), np.linspace(low[1], high[1], min(rows, 4 * COLUMNS)))
    pixel = np.column_stack([u.ravel(), v.ravel()])
    inside = np.array([cv2.pointPolygonTest(hull, (x, y), measureDist=False) >= 0 for x, y in pixel.tolist()])
    ray = rays(camera, pixel)
    known = inside & np.isfinite(ray).all(axis=1)
    return ImageGrid(np.ascontiguousarray(pixel[known].T), np.ascontiguousarray(ray[known].T))


def map_error_px(grid: ImageGrid, camera: Camera) -> float:
    """Root mean square distance; nan if the camera does not show all of the rays."""
    rotation = np.eye(3)
    residual = np.full_like(grid.pixel, np.nan)
    for _ in range(STEPS):
        point = np.ascontiguousarray(rotation @ grid.ray)
        linear = linearise(camera, point)
        residual = (linear.pixel - grid.pixel).reshape(-1)
        if not np.isfinite(residual).all():
            return float("nan")
        jacobian = turn_jacobian(point, linear.by_point)
        step = np.asarray(np.linalg.solve(jacobian.T @ jacobian, -(jacobian.T @ residual)))
        if np.abs(step).max() < SMALL_RAD:
            break
        rotation = exp_rotation(step) @ rotation
    return float(np.sqrt((residual @ residual) / (len(residual) // 2)))


def turn_jacobian(point: Array, by_point: Array) -> Array:
    """Derivatives (2 N,) of pixels by a turn of points (3, N): a gradient g by y is y x g by w.  # (2 N, 3)"""
    columns = [np.cross(point, gradient, axis=0) for gradient in by_point]
    return np.concatenate(columns, axis=1).T
