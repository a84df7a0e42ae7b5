"""Whether the camera depends on the target being as its file says.

Two halves of the photos share their target, so they agree on what a bent one does to the camera. But if the faces may
bend, stretch and move a little (`calib.verdict.deformation`), a bent one shows: another shape explains the sightings
better, and with it goes another camera. The least-squares solution is extended by those unknowns; one linear step from
the solution gives the change of the camera. The extended camera is right with either target, the plain one is the more
accurate if the target is as its file says, and then the difference of the two has the covariance of the first less
that of the second, which tells chance from fault (Hausman 1978, Specification tests in econometrics, Econometrica 46).
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.cameras import linearise
from calib.one_thread import one_thread
from calib.solver.problem import whiteners
from calib.types import Calibration
from calib.verdict.apart import in_sigmas, moved_over
from calib.verdict.coverage import Coverage
from calib.verdict.deformation import Deformation, deformation_of

Array = NDArray[np.float64]

SINGULAR = 1e-13
"""Of the eigenvalues of the parameters' correlations; those of fixed and shared parameters are less."""
QUANTILE = 95
POSE = 6


@dataclass(frozen=True)
class ShapeEffect:
    """What a target that may have another shape does to the camera, over the covered area."""

    percentile_95_px: float  # change of the camera's pixels, less their best turn
    ratio: float  # the same in its standard deviations, 1 on average if the target is as its file says
    sigma_px: float  # of the change, along its worse axis, 95 % of the area
    bow_mm: float  # of the most bent face, from its middle to its farthest ring
    explained: float = 1.0  # of the residuals' variance, 0 to 1: how much less another shape leaves over


@one_thread
def shape_effect(calibration: Calibration, coverage: Coverage) -> ShapeEffect | None:
    """The effect; None if it cannot be told: a learned map, points on no known face, or too few sightings."""
    seen = calibration.observations
    used = np.unique(seen.point[~calibration.is_outlier])
    basis = _free(calibration.param_covariance)
    if calibration.camera.learned is not None or not basis.size or not len(used) or (seen.points.face[used] < 0).any():
        return None
    deformation = deformation_of(seen.points, used)
    normal, gradient, square, equations = _normal_equations(calibration, basis, deformation)
    count = basis.shape[1]
    freedom = equations - len(normal)
    if freedom <= 0:
        return None
    # A prior of one unit keeps at zero what the photos leave open: the target's pose and size, faces seen once.
    plain = np.linalg.inv(normal[:count, :count])
    noise = square / (equations - count)
    prior = np.concatenate([np.zeros(count), np.full(deformation.count, noise)])
    extended = np.linalg.inv(normal + np.diag(prior))
    step = -extended @ gradient
    variance = max(square + float(gradient @ step), 0.0) / freedom
    spread = basis @ (variance * (extended[:count, :count] - plain)) @ basis.T
    field, covariance = moved_over(calibration.camera, basis @ step[:count], spread, coverage)
    if not len(field):
        return None
    worst = np.sqrt(np.maximum(np.linalg.eigvalsh(covariance)[:, 1], 0.0))
    return ShapeEffect(
        float(np.percentile(np.linalg.norm(field, axis=1), QUANTILE)),
        in_sigmas(field, covariance),
        float(np.percentile(worst, QUANTILE)),
        deformation.bow_mm(step[count:]),
        min(max(1 - variance / noise, 0.0), 1.0) if noise > 0 else 0.0,
    )


def _free(param_covariance: Array) -> Array:
    """Independent directions (P, K) in which the parameters were estimated, each a standard deviation long."""
    sigma = np.sqrt(np.maximum(np.diagonal(param_covariance), 0.0))
    if not np.isfinite(param_covariance).all() or not (sigma > 0).any():
        return np.zeros((len(sigma), 0))
    unit = np.where(sigma > 0, sigma, 1.0)
    value, axis = np.linalg.eigh(param_covariance / unit[:, None] / unit)
    able = value > SINGULAR * value.max()
    free: Array = sigma[:, None] * axis[:, able] * np.sqrt(value[able])
    return free


def _normal_equations(
    calibration: Calibration, basis: Array, deformation: Deformation
) -> tuple[Array, Array, float, int]:
    """Normal matrix (N, N) and gradient (N,) of camera and deformation, the poses eliminated, and sum of squares.

    The last is the number of equations, less those that the poses take.
    """
    size = basis.shape[1] + deformation.count
    normal, gradient, square, equations = np.zeros((size, size)), np.zeros(size), 0.0, 0
    for residual, by_camera, by_pose, by_shape in _views(calibration, deformation):
        if len(residual) <= POSE:
            continue
        across, _ = np.linalg.qr(by_pose / np.maximum(np.linalg.norm(by_pose, axis=0), 1e-300))
        both = np.column_stack([by_camera @ basis, by_shape, residual])
        both -= across @ (across.T @ both)
        normal += both[:, :-1].T @ both[:, :-1]
        gradient += both[:, :-1].T @ both[:, -1]
        square += float(both[:, -1] @ both[:, -1])
        equations += len(residual) - POSE
    return normal, gradient, square, equations


def _views(calibration: Calibration, deformation: Deformation) -> Iterator[tuple[Array, Array, Array, Array]]:
    """Of each view residuals (2M,) with derivatives by the camera (2M, P), the pose (2M, 6) and the shape (2M, S)."""
    seen = calibration.observations
    for view, pose in enumerate(calibration.cam_from_target):
        rows = np.flatnonzero((seen.view == view) & ~calibration.is_outlier)
        point = seen.point[rows]
        place = seen.points.position_mm[point] @ pose[:3, :3].T + pose[:3, 3]
        linear = linearise(calibration.camera, np.ascontiguousarray(place.T))
        by_place = linear.by_point.transpose(2, 0, 1)
        # A turn by w about the camera's axes moves a place p by w x p.
        by_pose = np.concatenate([np.cross(place[:, None, :], by_place), by_place], axis=2)
        own = by_place @ pose[:3, :3] @ deformation.shift_mm[point].transpose(0, 2, 1)
        by_shape = np.zeros((len(rows), 2, deformation.count))
        columns = deformation.first[point][:, None] + np.arange(deformation.per_face)
        np.put_along_axis(by_shape, np.broadcast_to(columns[:, None, :], own.shape), own, axis=2)
        fields = [calibration.residual_px[rows][:, :, None], linear.by_params.transpose(2, 0, 1), by_pose, by_shape]
        if calibration.weighted and seen.cov_px2 is not None and len(rows):
            a, b, c = whiteners(seen.cov_px2[rows])
            weight = np.stack([a, np.zeros_like(a), b, c], axis=1).reshape(-1, 2, 2)
            fields = [weight @ field for field in fields]
        residual, *derivatives = (field.reshape(2 * len(rows), -1) for field in fields)
        yield residual[:, 0], derivatives[0], derivatives[1], derivatives[2]
