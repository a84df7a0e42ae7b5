"""What photos tell of a camera, before they are taken: Fisher information with the pose of each photo eliminated.

The camera's parameters are written `p = p0 + basis q` with q of unit covariance, so that what is known now is the
identity and a photo adds `A - B C^-1 B'` to it: A of q with itself, C of the pose with itself, B of both (Schur
complement; Triggs et al. 2000, section 6). What a photo does not tell stays as well known as it was.

A camera's error e is the noise, enlarged by what halves of the photos show, and what the target is off. Photos with the
information X on q, and Y between q and the numbers s of the target's shape, move the solution; its error is then

    e' = (1 + X)^-1 (e - Y s + noise of the photos).

What of the target's error the photos share with those before stays, however many they are, and what the camera took of
a field that is fixed in the image stays whole.
"""

import math
from dataclasses import dataclass

import numpy as np

from calib.cameras import linearise
from calib.cameras.camera import Camera
from calib.cameras.refit import COLUMNS, image_grid
from calib.core.linear_algebra import covariance_with_prior, pseudo_inverse, symmetric_inverse
from calib.core.se3 import transform
from calib.core.types import keep_views, sightings_per_view
from calib.judge.coverage import lit_part
from calib.solver.accuracy import SHARE_PERCENT, projected_change, share_px
from calib.solver.blocks import RobustLoss, view_blocks
from calib.solver.calibration import Calibration
from calib.solver.problem import SolveOptions, origin_poses, pack, tie_parameters
from calib.solver.schur import reduced_normal
from calib.solver.target_error import LeftOpen
from designer.base.arrays import Array

TIED = 1e-12
"""Directions of the parameters with less of their variance are fixed or shared, not estimated."""
CHUNK = 8_000
"""Points at a time."""
UNDETERMINED = 1e-12
"""Of a pose's normal matrix with a diagonal of ones: smaller eigenvalues, as parts of the largest, are rounding."""
LENS_UNSURE = 1.0
"""Standard deviation of a lens coefficient of which nothing is known."""


@dataclass(frozen=True, eq=False)
class Knowledge:
    """What is known of a camera from the photos that were taken."""

    camera: Camera  # without rays where nothing is asked of it
    basis: Array  # (P, Q) `basis @ basis.T` is the covariance of the parameters
    noise_px: float  # standard deviation of a coordinate of an observation
    is_determined: bool  # without: the covariance holds a guess of what a camera is like


def knowledge_of(calibration: Calibration) -> Knowledge:
    """What a calibration knows of its camera; it must state a scale."""
    noise_px, stated = calibration.scale, calibration.observations.cov_px2
    if calibration.weighted and stated is not None:  # weighted observations by their mean weight
        variance = 0.5 * np.trace(stated[~calibration.is_outlier], axis1=1, axis2=2)
        noise_px /= math.sqrt(float((1 / variance).mean()))
    covariance = calibration.param_covariance
    is_determined = bool(np.isfinite(covariance).all()) and calibration.status != "degenerate"
    if not is_determined:
        covariance = _covariance_with_guess(calibration)
    deviation = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    scale = np.where(deviation > 0, deviation, 1.0)
    value, vector = np.linalg.eigh(covariance / (scale[:, None] * scale))
    free = value > TIED * max(float(value[-1]), 1e-300)
    basis = scale[:, None] * vector[:, free] * np.sqrt(value[free])
    return Knowledge(lit_part(calibration).camera, basis, noise_px, is_determined)


def _covariance_with_guess(calibration: Calibration) -> Array:
    """The parameters' covariance where the photos leave some open: with a guess of what cameras are like.

    The focal lengths by half, the centre by a quarter of the image, lens coefficients by one.
    """
    camera = calibration.camera
    tie = tie_parameters(camera.model, SolveOptions(fixed=tuple((name, None) for name in calibration.fixed)))
    has_some = sightings_per_view(calibration.observations) > 0
    problem = pack(keep_views(calibration.observations, has_some), weighted=calibration.weighted)
    pose = origin_poses(problem, calibration.cam_from_target[has_some])
    try:
        normal, _ = reduced_normal(view_blocks(problem, camera, pose, RobustLoss()).products, tie.row)
    except np.linalg.LinAlgError:  # not even a pose is determined
        normal = np.zeros((int(tie.row.max(initial=-1)) + 1,) * 2)
    longer = max(camera.image_size)
    guess = [LENS_UNSURE] * len(camera.params)
    guess[:4] = [0.5 * float(camera.params[0]), 0.5 * float(camera.params[1]), 0.25 * longer, 0.25 * longer]
    free = np.flatnonzero(tie.row >= 0)
    deviation = np.array(guess)[free]
    told = normal * deviation[:, None] * deviation / calibration.scale**2
    covariance = np.zeros((len(guess), len(guess)))
    covariance[np.ix_(free, free)] = covariance_with_prior(told) * deviation[:, None] * deviation
    return covariance


@dataclass(frozen=True, eq=False)
class PlaceInRig:
    """Where a camera sits in a rig, in whose frame the target's pose then is."""

    cam_from_rig: Array  # (4, 4)
    by_pose: Array  # (6, Q) how the unknowns q turn and shift it


def view_information(
    known: Knowledge, cam_from_target: Array, position_mm: Array, weight: Array, modes_mm: Array | None = None
) -> Array:
    """What each of C photos would add (C, Q + S, Q + S), if their poses must be found too; arguments as below."""
    return eliminated(photo_products(known, cam_from_target, position_mm, weight, modes_mm))


def photo_products(
    known: Knowledge, cam_from_target: Array, position_mm: Array, weight: Array, modes_mm: Array | None = None,
    seat: PlaceInRig | None = None,
) -> Array:  # fmt: skip
    """Normal matrices (C, Q + S + 6, Q + S + 6) of C photos by what is unknown of all, and by the pose of each.

    Args:
        known: the camera, and the noise of observations.
        cam_from_target: poses (C, 4, 4).
        position_mm: points of the target (N, 3).
        weight: how many observations each point stands for in each photo (C, N); 0: not seen.
        modes_mm: displacements of the points by numbers of the target's shape (S, N, 3); None: of the camera only.
        seat: of a camera in a rig; None: the camera's own frame is that of poses, which turn about the target's middle.
    """
    modes_mm = np.zeros((0, *position_mm.shape)) if modes_mm is None else modes_mm
    step = max(1, CHUNK // max(len(position_mm), 1))
    parts = [slice(begin, begin + step) for begin in range(0, max(len(weight), 1), step)]
    return np.concatenate(
        [_products(known, cam_from_target[part], position_mm, weight[part], modes_mm, seat) for part in parts]
    )


def _products(
    known: Knowledge, pose: Array, position_mm: Array, weight: Array, modes_mm: Array, seat: PlaceInRig | None
) -> Array:
    is_seen = weight > 0
    photo = np.nonzero(is_seen)[0]
    rotation, origin = pose[:, :3, :3], position_mm.mean(axis=0) if seat is None else np.zeros(3)
    turned = (rotation @ (position_mm - origin).T).transpose(1, 0, 2)[:, is_seen]  # (3, M)
    place = turned + transform(pose, origin)[photo].T
    seen = linearise(known.camera, place)
    by_unknowns, by_point = (part.transpose(1, 0, 2) for part in (known.basis.T @ seen.by_params, seen.by_point))
    modes = (rotation @ modes_mm.transpose(0, 2, 1)[:, None]).transpose(0, 2, 1, 3)[:, :, is_seen]  # (S, 3, M)
    by_shape = (by_point * modes[:, :, None]).sum(axis=1)
    by_motion = _by_motion(turned, by_point)
    if seat is not None:
        moved = _by_motion(place - seat.cam_from_rig[:3, 3:], by_point)
        by_unknowns = by_unknowns + np.tensordot(seat.by_pose, moved, (0, 0))
        in_rig = seat.cam_from_rig[:3, :3].T @ by_motion.reshape(2, 3, -1)
        by_motion = in_rig.reshape(by_motion.shape)
    columns = np.concatenate([by_unknowns, by_shape, by_motion])  # (K, 2, M)
    columns *= np.sqrt(weight[is_seen]) / known.noise_px
    columns[:, :, ~np.isfinite(columns).all(axis=(0, 1))] = 0.0
    # As many rows for each photo: those of points that are not seen stay zero.
    spread = np.zeros((len(pose), len(columns), 2, len(position_mm)))
    spread.transpose(1, 2, 0, 3)[:, :, is_seen] = columns
    rows = spread.reshape(*spread.shape[:2], -1)
    products: Array = rows @ rows.transpose(0, 2, 1)
    return products


def _by_motion(lever: Array, by_point: Array) -> Array:
    """By a turn and a shift (6, 2, M): a turn by w moves a place p (3, M) by w x p."""
    by_turn = lever[[1, 2, 0], None] * by_point[[2, 0, 1]] - lever[[2, 0, 1], None] * by_point[[1, 2, 0]]
    return np.concatenate([by_turn, by_point])


def eliminated(products: Array) -> Array:
    """`A - B C^-1 B'` of products (C, Q + 6, Q + 6) whose last six unknowns are a pose.

    A photo that does not determine its whole pose tells nothing: what an unknown motion would take away is not known
    where the inverse is cut off, and none may be called surer than it is.
    """
    size = products.shape[1] - 6
    mixed = products[:, size:, :size]
    pose = symmetric_inverse(products[:, size:, size:], UNDETERMINED)
    left: Array = products[:, :size, :size] - mixed.transpose(0, 2, 1) @ (pose.inverse @ mixed)
    return np.where((pose.rank == 6)[:, None, None], 0.5 * (left + left.transpose(0, 2, 1)), 0.0)


@dataclass(frozen=True, eq=False)
class ImageGoal:
    """That the image is known: how far off the camera may be at its pixels, in sigmas along the worse axis."""

    change: Array  # (N, 2, Q) how q moves what is seen at N pixels, less the rotation that best explains it
    pixels: int  # of the image; more than N where the lens model breaks down

    def within_px(self, covariance: Array) -> float:
        """What 95 % of the image stays within, by a covariance of q (Q, Q); infinite if less is known."""
        return share_px(self._sigma_px(covariance), self.pixels)

    def compared_px(self, covariance: Array) -> Array:
        """The same of what is known, by covariances (..., Q, Q), so that close ones differ.  # (...)"""
        if not len(self.change):
            return np.zeros(covariance.shape[:-2])
        return np.asarray(np.percentile(self._sigma_px(covariance), SHARE_PERCENT, axis=-1))

    def mean_square(self) -> Array:
        """Of the change: its product with a covariance has the variance over the image as its trace.  # (Q, Q)"""
        flat = self.change.reshape(-1, self.change.shape[2])
        return np.asarray(flat.T @ flat / len(self.change))

    def _sigma_px(self, covariance: Array) -> Array:
        size = self.change.shape[2]
        spread = (self.change.reshape(-1, size) @ covariance).reshape(*covariance.shape[:-2], -1, 2, size)
        uu, vv, uv = (
            np.einsum("...nq,nq->...n", spread[..., row, :], self.change[:, column])
            for row, column in ((0, 0), (1, 1), (0, 1))
        )
        largest: Array = 0.5 * (uu + vv) + np.hypot(0.5 * (uu - vv), uv)
        return np.sqrt(np.maximum(largest, 0.0))


def image_goal(known: Knowledge, columns: int = COLUMNS, rows: int | None = None) -> ImageGoal:
    """Of a grid of pixels; those without a ray are left out."""
    pixel = image_grid(known.camera.image_size, columns, rows).reshape(-1, 2)
    change: Array = projected_change(known.camera, pixel) @ known.basis
    change = change[np.isfinite(change).all(axis=(1, 2))]
    return ImageGoal(change, len(change))


def covariance_of_photos(told: Array) -> Array | None:
    """Of q by what photos tell, with nothing that was known before; None: they leave something open."""
    found = symmetric_inverse(told)
    return found.inverse if int(found.rank) == len(told) else None


@dataclass(frozen=True, eq=False)
class StatedError:
    """The mean squares of e and s, the noise's part of e as a factor of its own."""

    noise: float  # of the variance: what halves of the photos enlarge it by
    by_target: Array  # (Q, Q) of e, by the target
    modes_mm: Array | None  # (S, K, 3) of points on faces; None: not known, so no photo takes anything from its part
    mixed: Array  # (Q, S) of e with s
    shape: Array  # (S, S) of s
    by_field: Array  # (Q, Q) of e, by what is fixed in the image

    def after(self, told: Array) -> Array:
        """Mean squares (Q, Q) of e after photos with the information (Q + S, Q + S) on q and s."""
        size = len(self.by_target)
        inverse, by_shape = covariance_with_prior(told[:size, :size]), told[:size, size:]
        if self.modes_mm is None:
            return self.noise * inverse + self.by_target + self.by_field
        across = self.mixed @ by_shape.T
        target = self.by_target - across - across.T + by_shape @ self.shape @ by_shape.T
        found: Array = self.noise * inverse + inverse @ target @ inverse + self.by_field
        return found


def stated_error(known: Knowledge, calibration: Calibration, factor: float, opened: LeftOpen | None) -> StatedError:
    """The error of a calibration as the verdict states it.

    Args:
        known: of the calibration.
        calibration: with what its target may be off, if that is known.
        factor: that halves of the photos enlarge the standard deviations of the noise by.
        opened: what photos so far leave open of the target's shape; None: not known, or no matter.
    """
    size, error = known.basis.shape[1], calibration.target_error
    none, to_q = np.zeros((size, 0)), pseudo_inverse(known.basis)
    by_field = np.zeros((size, size))
    parts = (calibration.image_field, calibration.capture_error, calibration.photo_error, calibration.circle_doubt)
    for part in parts:
        if known.is_determined and part is not None:
            by_field = by_field + to_q @ part.param_covariance @ to_q.T
    if error is None or not known.is_determined or not error.param_covariance.any():
        return StatedError(factor**2, np.zeros((size, size)), None, none, none.T @ none, by_field)
    by_target = to_q @ error.param_covariance @ to_q.T
    if opened is None:
        return StatedError(factor**2, by_target, None, none, none.T @ none, by_field)
    camera, square = opened.basis.shape[1], opened.mean_square
    mixed, shape = square[:camera, camera:], square[camera:, camera:]
    modes_mm = opened.modes_mm[:, calibration.observations.points.face >= 0]
    return StatedError(factor**2, by_target, modes_mm, to_q @ opened.basis @ mixed, shape, by_field)
