"""The metrics of `calib.solver.metrics` as root mean squares over a sample, in one pass over its distinct views.

A view drawn twice counts twice: errors are summed with the view's weight. What an error is, and when there is none, is
as in `calib.solver.metrics`; only `rays` and `project` of the camera enter.
"""

import math
from dataclasses import dataclass

import numpy as np

from calib.cameras import project, rays
from calib.cameras.camera import Camera
from calib.core.jit import jit
from calib.core.small_solve import cholesky_factor, substitute
from calib.core.types import Observations
from calib.solver.metrics.errors import centers_mm
from calib.solver.metrics.intersection import LEAST_SINE
from calib.solver.metrics.reconstruction import LEAST_SPREAD_RAD
from calib.solver.problem import Problem
from calib.studies.gradients import chunks_of
from calib.studies.samples import SampleErrors
from designer.base.arrays import Array, Rows


@dataclass(frozen=True, eq=False)
class Sample:
    """A sample of D distinct views with its camera."""

    observations: Observations  # of the pool
    problem: Problem  # of the same views
    views: Rows  # (D,) numbers in the pool
    weight: Rows  # (D,) how often drawn
    camera: Camera
    cam_from_target: Array  # (D, 4, 4) from the problem's origin


def sample_errors(sample: Sample, true_center_mm: Array | None, square_px2: float | None = None) -> SampleErrors:
    """All metrics of a sample.

    Args:
        sample: what to evaluate.
        true_center_mm: of the pool's cameras (V, 3), if known.
        square_px2: the sum of the squared reprojection errors, each as often as drawn, if it is known already.
    """
    problem, points = sample.problem, sample.observations.points
    face_normal = np.ascontiguousarray(points.plane[:, :3])
    sums = np.zeros(4)  # of squares and of weights: of intersection, of reprojection
    normal = np.zeros((len(points.face), 10))
    for first, last in chunks_of(problem.view_start, sample.views):
        views, weight = sample.views[first:last], sample.weight[first:last]
        pose = sample.cam_from_target[first:last]
        pixel = np.empty((int((problem.view_start[views + 1] - problem.view_start[views]).sum()), 2))
        _gather(problem.view_start, views, problem.measured_px, pixel)
        ray = rays(sample.camera, pixel)
        _intersect(
            problem.view_start, views, weight, pose, ray, problem.position_mm, sample.observations.point, points.face,
            face_normal, sums, normal,
        )  # fmt: skip
        if square_px2 is None:
            point = np.empty((len(pixel), 3))
            _place(problem.view_start, views, pose, problem.position_mm, point)
            _reproject(problem.view_start, views, weight, project(sample.camera, point), pixel, sums)
    if square_px2 is not None:
        sums[2], sums[3] = square_px2, sample.weight @ np.diff(problem.view_start)[sample.views]
    return SampleErrors(
        _root_mean(sums[2], sums[3]), _root_mean(sums[0], sums[1]), _root_mean(*_reconstruct(normal)),
        _pose_mm(sample, true_center_mm),
    )  # fmt: skip


def _root_mean(square: float, count: float) -> float:
    return math.sqrt(square / count) if count > 0 else math.nan


def _pose_mm(sample: Sample, true_center_mm: Array | None) -> float:
    """Root mean squared distance of the cameras' centres from where they were."""
    if true_center_mm is None:
        return math.nan
    off = centers_mm(sample.cam_from_target) + sample.problem.origin_mm - true_center_mm[sample.views]
    square = np.einsum("vi,vi->v", off, off)
    known = np.isfinite(square)
    return _root_mean(float(square[known] @ sample.weight[known]), float(sample.weight[known].sum()))


@jit
def _gather(view_start: Rows, views: Rows, measured: Array, pixel: Array) -> None:
    """The measured pixels of some views, one view after the other."""
    k = 0
    for view in views:
        for m in range(view_start[view], view_start[view + 1]):
            pixel[k, 0], pixel[k, 1] = measured[0, m], measured[1, m]
            k += 1


@jit
def _place(view_start: Rows, views: Rows, pose: Array, position: Array, point: Array) -> None:
    """The known points of some views in their cameras' axes, a row each: a transposed copy would take longer."""
    k = 0
    for place in range(len(views)):
        r = pose[place]
        for m in range(view_start[views[place]], view_start[views[place] + 1]):
            x, y, z = position[0, m], position[1, m], position[2, m]
            for axis in range(3):
                point[k, axis] = r[axis, 0] * x + r[axis, 1] * y + r[axis, 2] * z + r[axis, 3]
            k += 1


@jit
def _reproject(view_start: Rows, views: Rows, weight: Rows, pixel: Array, measured: Array, sums: Array) -> None:
    k = 0
    for place in range(len(views)):
        for _ in range(view_start[views[place] + 1] - view_start[views[place]]):
            du, dv = pixel[k, 0] - measured[k, 0], pixel[k, 1] - measured[k, 1]
            if math.isfinite(du + dv):
                sums[2] += weight[place] * (du * du + dv * dv)
                sums[3] += weight[place]
            k += 1


@jit
def _intersect(
    view_start: Rows,
    views: Rows,
    weight: Rows,
    pose: Array,
    ray: Array,
    position: Array,
    point: Rows,
    face: Rows,
    face_normal: Array,
    sums: Array,
    normal: Array,
) -> None:
    """Errors on the planes into `sums`, and each ray into the normal equations of its point.

    Of a point, `normal` has the upper triangle of the matrix (6), the right-hand side (3), and the number of rays.
    """
    k = -1
    for place in range(len(views)):
        r, w = pose[place], float(weight[place])
        sx = -(r[0, 0] * r[0, 3] + r[1, 0] * r[1, 3] + r[2, 0] * r[2, 3])
        sy = -(r[0, 1] * r[0, 3] + r[1, 1] * r[1, 3] + r[2, 1] * r[2, 3])
        sz = -(r[0, 2] * r[0, 3] + r[1, 2] * r[1, 3] + r[2, 2] * r[2, 3])
        for m in range(view_start[views[place]], view_start[views[place] + 1]):
            k += 1
            a, b, c = ray[k, 0], ray[k, 1], ray[k, 2]
            square = a * a + b * b + c * c
            if not square < math.inf:
                continue
            scale = 1 / math.sqrt(square)
            a, b, c = scale * a, scale * b, scale * c
            x = r[0, 0] * a + r[1, 0] * b + r[2, 0] * c
            y = r[0, 1] * a + r[1, 1] * b + r[2, 1] * c
            z = r[0, 2] * a + r[1, 2] * b + r[2, 2] * c
            # From the point, so that no digits are lost far from the origin.
            fx, fy, fz = sx - position[0, m], sy - position[1, m], sz - position[2, m]
            row = normal[point[m]]
            row[0], row[1], row[2] = row[0] + w * (1 - x * x), row[1] - w * x * y, row[2] - w * x * z
            row[3], row[4], row[5] = row[3] + w * (1 - y * y), row[4] - w * y * z, row[5] + w * (1 - z * z)
            along = x * fx + y * fy + z * fz
            row[6], row[7], row[8] = (
                row[6] + w * (fx - along * x),
                row[7] + w * (fy - along * y),
                row[8] + w * (fz - along * z),
            )
            row[9] += w
            if face[point[m]] < 0:
                continue
            n = face_normal[face[point[m]]]
            sine = n[0] * x + n[1] * y + n[2] * z
            if abs(sine) < LEAST_SINE:
                continue
            along = -(n[0] * fx + n[1] * fy + n[2] * fz) / sine
            if not along > 0:
                continue
            ex, ey, ez = fx + along * x, fy + along * y, fz + along * z
            sums[0] += w * (ex * ex + ey * ey + ez * ez)
            sums[1] += w


@jit
def _reconstruct(normal: Array) -> tuple[float, float]:
    """Sum of the squared errors of the points that have rays from different sides, and how many these are."""
    total, count = 0.0, 0.0
    matrix, x = np.empty((3, 3)), np.empty(3)
    for k in range(len(normal)):
        row = normal[k]
        if row[9] < 2:
            continue
        # The rays are spread enough if the smallest eigenvalue is at least this: the rest is positive definite.
        least = LEAST_SPREAD_RAD**2 * row[9]
        _unpack(row, least, matrix)
        if not cholesky_factor(matrix):
            continue
        _unpack(row, 0.0, matrix)
        if not cholesky_factor(matrix):
            continue
        x[:] = row[6:9]
        substitute(matrix, x)
        total += x[0] * x[0] + x[1] * x[1] + x[2] * x[2]
        count += 1
    return total, count


@jit
def _unpack(row: Array, less: float, matrix: Array) -> None:
    """The symmetric matrix of a point, with less on its diagonal."""
    k = 0
    for i in range(3):
        for j in range(i, 3):
            matrix[i, j] = matrix[j, i] = row[k]
            k += 1
        matrix[i, i] -= less
