"""From errors of pixels and of the rig to errors of points: the first-order law of error propagation.

A point X is where `sum |L_c (u_c(X) - m_c)|^2` is least, with `L'L` the inverse covariance of the sighting by camera c.
With `J_c = L_c du_c/dX`, `B_c = L_c du_c/d(unknowns of c)` and `H = sum J_c' J_c` its noise is `H^-1`, and errors d of
the unknowns move it by `-H^-1 sum J_c' B_c d_c`. The errors of a rig are written as independent ones of size one.

What the pixels of a rig depend on: the points in space, and each camera's parameters and pose.

How large an error in space is: one number of a covariance, and three of many.

Points that nobody knows yet, as the cameras of a rig see them.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from calib.cameras import linearise
from calib.cameras.rig import Rig
from calib.core.se3 import skew, transform
from calib.core.types import RigObservations, freeze
from designer.base.arrays import Array, Flags, Rows
from designer.base.errors import InputError
from designer.base.marks import Gap
from designer.base.words import shown

ROUNDING = 1e-14
"""Part of a covariance's largest eigenvalue, its diagonal scaled to one, that is rounding."""


@dataclass(frozen=True, eq=False)
class LinearSight:
    """N points of the rig's frame as one camera sees them, with the derivatives; nan where it does not see."""

    pixel: Array  # (N, 2)
    by_point: Array  # (N, 2, 3) by the point in the rig's frame
    by_params: Array  # (N, 2, P)
    turned: Array  # (N, 3) the point in the camera's axes, before the shift
    by_cam_point: Array  # (N, 2, 3) by the point in the camera's frame

    @cached_property
    def by_unknowns(self) -> Array:
        """By the camera's P parameters and the six of its pose, as `Rig` has them.  # (N, 2, P + 6)"""
        by_turn = -self.by_cam_point @ skew(self.turned)
        return np.concatenate([self.by_params, by_turn, self.by_cam_point], axis=2)


def linear_sight(rig: Rig, camera: int, point_mm: Array) -> LinearSight:
    """Linearise a camera of a rig at points (N, 3) of the rig's frame."""
    rotation, shift = rig.cam_from_rig[camera, :3, :3], rig.cam_from_rig[camera, :3, 3]
    turned = point_mm @ rotation.T
    seen = linearise(rig.cameras[camera], (turned + shift).T)
    by_cam_point = np.ascontiguousarray(seen.by_point.transpose(2, 0, 1))
    return LinearSight(seen.pixel.T, by_cam_point @ rotation, seen.by_params.transpose(2, 0, 1), turned, by_cam_point)


def covariance_factor(covariance: Array) -> Array:
    """Independent errors of size one that make a covariance (K, K): `S = F F'`.  # (K, R)"""
    sigma = np.sqrt(np.diagonal(covariance).clip(min=0.0))
    unit = np.where(sigma > 0, sigma, 1.0)
    value, vector = np.linalg.eigh(covariance / unit[:, None] / unit)
    keeps = value > ROUNDING * value[-1:].clip(min=0.0)
    factor: Array = sigma[:, None] * vector[:, keeps] * np.sqrt(value[keeps])
    return factor


@lru_cache(maxsize=4)
def calibration_factor(rig: Rig) -> Array | None:
    """The rig's own errors likewise (K, R); None where its covariance is not known, or not determined.

    Kept for the next call: of cameras with hundreds of parameters it takes seconds.
    """
    if rig.covariance is None or not np.isfinite(rig.covariance).all():
        return None
    factor = covariance_factor(rig.covariance)
    factor.setflags(write=False)
    return factor


def is_in_image(rig: Rig, camera: int, point_mm: Array) -> Flags:
    """Which points (N, 3) of the rig's frame a camera shows within its image.  # (N,)"""
    pixel = rig.cameras[camera].project(transform(rig.cam_from_rig[camera], point_mm))
    width, height = rig.cameras[camera].image_size
    off = np.abs(pixel - np.array([width - 1, height - 1]) / 2)
    return np.asarray((off <= [width / 2, height / 2]).all(axis=-1))


def rays_in_rig(rig: Rig, camera: int, pixel: Array) -> Array:
    """Unit directions (N, 3), in the rig's axes, of what pixels (N, 2) of a camera see."""
    rays: Array = rig.cameras[camera].rays(pixel) @ rig.cam_from_rig[camera, :3, :3]
    return rays


MOST = 95
"""Per cent of the points that are better than what is told of most."""


@dataclass(frozen=True)
class PointErrors:
    """Root mean square lengths of errors in space, of many points; nan where they are not known."""

    median_mm: Gap
    most_mm: Gap  # 95 % of the points are better
    worst_mm: Gap


NOT_KNOWN = PointErrors(float("nan"), float("nan"), float("nan"))


def rms_error_mm(covariance_mm2: Array) -> Array:
    """The root mean square of the length of an error (N,) with a covariance (N, 3, 3)."""
    sigma: Array = np.sqrt(np.trace(covariance_mm2, axis1=1, axis2=2))
    return sigma


def errors_of(length_mm: Array) -> PointErrors:
    """Three numbers of many (N,); nan of those that are not known, and of none."""
    known = length_mm[np.isfinite(length_mm)]
    if not len(known):
        return NOT_KNOWN
    return PointErrors(*(float(value) for value in (*np.percentile(known, [50, MOST]), known.max())))


def rms_errors(covariance_mm2: Array | None) -> PointErrors:
    """Three numbers of the errors of many points with covariances (N, 3, 3); nan if these are not known."""
    return NOT_KNOWN if covariance_mm2 is None else errors_of(rms_error_mm(covariance_mm2))


SINGULAR = 1e-13
"""Determinant of a matrix, its diagonal scaled to one, that is rounding."""
_TRIANGLE = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


@dataclass(frozen=True, eq=False)
class Rays:
    """M sightings of N points: by which camera, of which point, and what whitens their errors."""

    count: int  # N
    camera: Rows  # (M,)
    place: Rows  # (M,)
    whiten: Array  # (M, 2, 2) L, with L'L the inverse covariance

    def of_cameras(self) -> Iterator[tuple[int, Rows]]:
        """Each camera that sees something, and the rows of what it sees."""
        for camera in np.unique(self.camera).tolist():
            yield camera, np.flatnonzero(self.camera == camera)


@dataclass(frozen=True, eq=False)
class PointSpread:
    """How N points scatter."""

    noise_mm2: Array  # (N, 3, 3) by the pixels
    by_calibration: Array | None  # (N, 3, R) by each of R independent errors of the rig, of size one; None: not known

    @property
    def calibration_mm2(self) -> Array | None:
        """By the rig's own errors.  # (N, 3, 3)"""
        if self.by_calibration is None:
            return None
        return self.by_calibration @ self.by_calibration.transpose(0, 2, 1)

    @property
    def covariance_mm2(self) -> Array:
        """By all that is known.  # (N, 3, 3)"""
        shared = self.calibration_mm2
        return self.noise_mm2 if shared is None else self.noise_mm2 + shared


@dataclass(frozen=True, eq=False)
class Propagated(PointSpread):
    """How N points scatter that are seen so."""

    misclosure: Array  # (N,) what the rig's errors add to the sum of squared whitened residuals, on average


def whitening(cov_px2: Array) -> Array:
    """Lower triangles L (M, 2, 2) with `L'L` the inverse of covariances (M, 2, 2); nan of what is none."""
    with np.errstate(invalid="ignore", divide="ignore"):
        first = 1 / np.sqrt(cov_px2[:, 0, 0])
        slope = cov_px2[:, 0, 1] / cov_px2[:, 0, 0]
        second = 1 / np.sqrt(cov_px2[:, 1, 1] - slope * cov_px2[:, 0, 1])
    lower = np.zeros_like(cov_px2)
    lower[:, 0, 0], lower[:, 1, 0], lower[:, 1, 1] = first, -slope * second, second
    return lower


def sums_at(place: Rows, rows: Array, count: int) -> Array:
    """Sums (count,) of numbers (M,) point by point."""
    return np.asarray(np.bincount(place, rows, count), dtype=np.float64)


def normal_matrices(place: Rows, jacobian: Array, count: int) -> Array:
    """`sum J'J` (N, 3, 3) of whitened derivatives (M, 2, 3)."""
    normal = np.empty((count, 3, 3))
    for i, j in _TRIANGLE:
        product = jacobian[:, 0, i] * jacobian[:, 0, j] + jacobian[:, 1, i] * jacobian[:, 1, j]
        normal[:, i, j] = normal[:, j, i] = sums_at(place, product, count)
    return normal


def inverse_3x3(matrix: Array) -> Array:
    """The inverses of symmetric positive definite matrices (N, 3, 3) by their cofactors, nan of singular ones.

    A hundred times as fast as a factorisation of each, for the millions of points that there may be.
    """
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        scale = 1 / np.sqrt(np.diagonal(matrix, axis1=1, axis2=2))
        a, b, c = ((matrix[:, i, j] * scale[:, i] * scale[:, j]) for i, j in ((0, 1), (0, 2), (1, 2)))
        determinant = 1 + 2 * a * b * c - a * a - b * b - c * c
        determinant = np.where(determinant > SINGULAR, determinant, np.nan)
        cofactor = {
            (0, 0): 1 - c * c, (1, 1): 1 - b * b, (2, 2): 1 - a * a,
            (0, 1): b * c - a, (0, 2): a * c - b, (1, 2): a * b - c,
        }  # fmt: skip
        inverse = np.empty_like(matrix)
        for (i, j), value in cofactor.items():
            inverse[:, i, j] = inverse[:, j, i] = value / determinant * scale[:, i] * scale[:, j]
    return inverse


def propagate(rig: Rig, factor: Array | None, position_mm: Array, rays: Rays) -> Propagated:
    """How points (N, 3) of the rig's frame scatter that are triangulated from some rays.

    Args:
        rig: that sees them.
        factor: of its covariance (K, R), see `calibration_factor`; None: not known.
        position_mm: the points.  # (N, 3)
        rays: that they are triangulated from.
    """
    jacobian = np.full((len(rays.place), 2, 3), np.nan)
    sights: list[tuple[int, Rows, LinearSight]] = []
    for camera, rows in rays.of_cameras():
        sight = linear_sight(rig, camera, position_mm[rays.place[rows]])
        jacobian[rows] = rays.whiten[rows] @ sight.by_point
        sights.append((camera, rows, sight))
    normal = normal_matrices(rays.place, jacobian, rays.count)
    noise = inverse_3x3(normal)
    if factor is None:
        return Propagated(noise, None, np.zeros(rays.count))
    pulled = np.zeros((rays.count, 3, factor.shape[1]))
    squares = np.zeros(rays.count)
    for camera, rows, sight in sights:
        first, last = rig.first_row[camera], rig.first_row[camera + 1]
        white = rays.whiten[rows] @ sight.by_unknowns
        # One product for all: point by point it takes ten times as long.
        shift = (white.reshape(-1, last - first) @ factor[first:last]).reshape(len(rows), 2, -1)
        place = rays.place[rows]  # of a camera each another
        pulled[place] += jacobian[rows].transpose(0, 2, 1) @ shift
        squares[place] += np.einsum("mir,mir->m", shift, shift)
    moved = -noise @ pulled
    # What is left of the shifts when the points have followed them, by Pythagoras.
    return Propagated(noise, moved, squares + np.einsum("nir,nir->n", pulled, moved))


@dataclass(frozen=True, eq=False)
class PointSightings:
    """M sightings of N points, each in a frame, by the cameras of a rig: `calib.triangulate(rig, sightings)`.

    A point that moves from frame to frame is another one in each of them.
    """

    frame_names: tuple[str, ...]  # (V,)
    point_names: tuple[str, ...]  # (K,)
    frame: Rows  # (N,) rows of `frame_names`
    point: Rows  # (N,) rows of `point_names`; a frame and a point stand together once
    camera: Rows  # (M,) rows of the rig's cameras
    place: Rows  # (M,) rows of `frame` and `point`; a camera sees each once at most
    center_px: Array  # (M, 2)
    cov_px2: Array | None = None  # (M, 2, 2) as stated, nan of those that state none; None: of all
    remarks: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        freeze(self, "frame", "point", "camera", "place", dtype=np.int64)
        freeze(self, "center_px", "cov_px2")

    @property
    def count(self) -> int:
        """N."""
        return len(self.frame)

    def name(self, place: int) -> str:
        """What a point is called: its frame's name and its own."""
        point, frame = self.point_names[self.point[place]], self.frame_names[self.frame[place]]
        return f"{frame}/{point}" if len(self.frame_names) > 1 else point


def of_rows(
    camera: Rows, frames: tuple[str, ...], points: tuple[str, ...], center_px: Array, cov_px2: Array | None = None
) -> PointSightings:
    """Sightings from columns of equal length M: camera rows, names of frames and points, pixels, covariances."""
    frame_names, point_names = tuple(dict.fromkeys(frames)), tuple(dict.fromkeys(points))
    frame_row = {name: row for row, name in enumerate(frame_names)}
    point_row = {name: row for row, name in enumerate(point_names)}
    key = np.array([frame_row[name] for name in frames], dtype=np.int64) * max(len(point_names), 1)
    key += np.array([point_row[name] for name in points], dtype=np.int64)
    kept, place = np.unique(key, return_inverse=True)
    frame, point = np.divmod(kept, max(len(point_names), 1))
    return PointSightings(frame_names, point_names, frame, point, camera, place, center_px, cov_px2)


def as_points(rig: Rig, observations: RigObservations) -> PointSightings:
    """What cameras saw of a target as sightings of unknown points, all of the target's points by their rows.

    Raises:
        InputError: a camera that is not in the rig, or photos of another size than its own.
    """
    camera, frame, point, center, cov = [], [], [], [], []
    for name, seen, frames in zip(observations.camera_names, observations.sightings, observations.frame, strict=True):
        row = rig.row(name)
        if seen.image_size != rig.cameras[row].image_size:
            raise InputError(
                f"camera {shown(name)}: photos of {seen.image_size[0]} x {seen.image_size[1]} px, but the rig's camera "
                f"has {rig.cameras[row].image_size[0]} x {rig.cameras[row].image_size[1]} px"
            )
        camera.append(np.full(len(seen.view), row))
        frame.append(frames[seen.view])
        point.append(seen.point)
        center.append(seen.center_px)
        cov.append(np.full((len(seen.view), 2, 2), np.nan) if seen.cov_px2 is None else seen.cov_px2)
    count = len(observations.points.position_mm)
    kept, place = np.unique(np.concatenate(frame) * count + np.concatenate(point), return_inverse=True)
    return PointSightings(
        observations.frame_names, tuple(map(str, range(count))), kept // count, kept % count, np.concatenate(camera),
        place, np.concatenate(center), np.concatenate(cov), observations.remarks,
    )  # fmt: skip


def with_noise(sightings: PointSightings, noise_px: Array) -> Array:
    """Covariances (M, 2, 2) of all sightings: as stated, or by each camera's noise (C,)."""
    usual: Array = noise_px[sightings.camera, None, None] ** 2 * np.eye(2)
    if sightings.cov_px2 is None:
        return usual
    states_it = np.asarray(np.isfinite(sightings.cov_px2).all(axis=(1, 2)))
    return np.where(states_it[:, None, None], sightings.cov_px2, usual)


def keep_places(sightings: PointSightings, keep: Flags) -> PointSightings:
    """The sightings of some of the points (N,), which are numbered anew."""
    rows = keep[sightings.place]
    return replace(
        sightings, frame=sightings.frame[keep], point=sightings.point[keep], camera=sightings.camera[rows],
        place=(np.cumsum(keep) - 1)[sightings.place[rows]], center_px=sightings.center_px[rows],
        cov_px2=None if sightings.cov_px2 is None else sightings.cov_px2[rows],
    )  # fmt: skip
