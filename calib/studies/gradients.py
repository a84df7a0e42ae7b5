"""Cost and gradient of some of many views, read where they stand: nothing is copied, no normal matrix made.

Whatever the camera, a view's best pose follows from its own points (variable projection; Golub and Pereyra 1973). So of
the gradient by the poses two parts are taken: what each pose lacks of its best, and what that asks of the camera.
"""

from dataclasses import dataclass

import numpy as np

from calib.cameras import linearise
from calib.cameras.camera import Camera
from calib.core.jit import jit, jit_sums
from calib.solver.problem import Problem
from designer.base.arrays import Array, Rows

CHUNK = 3000
"""Observations at a time; their derivatives stay in the processor's cache."""


@dataclass(frozen=True, eq=False)
class Gradients:
    """Of D views."""

    cost: Array  # (D,) sum of the squared whitened residuals; nan if a point has no image
    gradient: Array  # (D, P + 6) half of its derivative by the parameters and by the pose


def gradients_of(problem: Problem, views: Rows, camera: Camera, cam_from_target: Array) -> Gradients:
    """Cost and gradient of views at a camera and their poses.

    Args:
        problem: what was seen.
        views: (D,) numbers of views.
        camera: where.
        cam_from_target: (D, 4, 4) from the problem's origin.
    """
    result = Gradients(np.empty(len(views)), np.empty((len(views), len(camera.params) + 6)))
    for first, last in chunks_of(problem.view_start, views):
        chosen = views[first:last]
        width = int((problem.view_start[chosen + 1] - problem.view_start[chosen]).sum())
        turned, point = np.empty((3, width)), np.empty((3, width))
        _to_camera(problem.view_start, chosen, cam_from_target[first:last], problem.position_mm, turned, point)
        seen = linearise(camera, point)
        _sum_gradients(
            problem.view_start, chosen, turned, seen.pixel, seen.by_point, seen.by_params, problem.measured_px,
            problem.whitener, result.cost[first:last], result.gradient[first:last],
        )  # fmt: skip
    return result


def chunks_of(view_start: Rows, views: Rows) -> list[tuple[int, int]]:
    """Runs of a list of views with about `CHUNK` observations."""
    end = np.cumsum(view_start[views + 1] - view_start[views])
    result, first, before = [], 0, 0
    while first < len(views):
        last = max(int(np.searchsorted(end, before + CHUNK, side="right")), first + 1)
        result.append((first, last))
        first, before = last, int(end[last - 1])
    return result


@jit
def _to_camera(view_start: Rows, views: Rows, pose: Array, position: Array, turned: Array, point: Array) -> None:
    """R p and R p + t for the observations of some views, one view after the other."""
    k = 0
    for place in range(len(views)):
        r = pose[place]
        begin, end = view_start[views[place]], view_start[views[place] + 1]
        for axis in range(3):
            a, b, c, shift = r[axis, 0], r[axis, 1], r[axis, 2], r[axis, 3]
            for m in range(begin, end):
                value = a * position[0, m] + b * position[1, m] + c * position[2, m]
                turned[axis, k + m - begin] = value
                point[axis, k + m - begin] = value + shift
        k += end - begin


@jit_sums
def _sum_gradients(
    view_start: Rows,
    views: Rows,
    turned: Array,
    pixel: Array,
    by_point: Array,
    by_params: Array,
    measured: Array,
    whitener: Array,
    cost: Array,
    gradient: Array,
) -> None:
    """With W the whitener of an observation and e its residual, the gradient is the sum of `J' W' W e`."""
    parameters = by_params.shape[1]
    weighted = np.empty((2, pixel.shape[1]))
    k = 0
    for place in range(len(views)):
        begin = view_start[views[place]]
        count = view_start[views[place] + 1] - begin
        end = begin + count
        pu, pv, mu, mv = (
            pixel[0, k : k + count],
            pixel[1, k : k + count],
            measured[0, begin:end],
            measured[1, begin:end],
        )
        wa, wb, wc = whitener[0, begin:end], whitener[1, begin:end], whitener[2, begin:end]
        weighted_u, weighted_v = weighted[0, :count], weighted[1, :count]
        for n in range(count):
            du, dv = pu[n] - mu[n], pv[n] - mv[n]
            ru, rv = wa[n] * du, wb[n] * du + wc[n] * dv
            weighted_u[n], weighted_v[n] = wa[n] * ru + wb[n] * rv, wc[n] * rv
        # Loops that sum store nothing else: a check whether what is stored and what is read overlap would be made at
        # run time, and would choose another order of the sum for other places in memory.
        total = 0.0
        for n in range(count):
            du, dv = pu[n] - mu[n], pv[n] - mv[n]
            ru, rv = wa[n] * du, wb[n] * du + wc[n] * dv
            total += ru * ru + rv * rv
        cost[place] = total
        for p in range(parameters):
            u, v = by_params[0, p, k : k + count], by_params[1, p, k : k + count]
            total = 0.0
            for n in range(count):
                total += u[n] * weighted_u[n] + v[n] * weighted_v[n]
            gradient[place, p] = total
        ux, uy, uz = by_point[0, 0, k : k + count], by_point[0, 1, k : k + count], by_point[0, 2, k : k + count]
        vx, vy, vz = by_point[1, 0, k : k + count], by_point[1, 1, k : k + count], by_point[1, 2, k : k + count]
        tx, ty, tz = turned[0, k : k + count], turned[1, k : k + count], turned[2, k : k + count]
        wx, wy, wz, sx, sy, sz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for n in range(count):
            wu, wv = weighted_u[n], weighted_v[n]
            px, py, pz = wu * ux[n] + wv * vx[n], wu * uy[n] + wv * vy[n], wu * uz[n] + wv * vz[n]
            x, y, z = tx[n], ty[n], tz[n]
            wx, wy, wz = wx + y * pz - z * py, wy + z * px - x * pz, wz + x * py - y * px
            sx, sy, sz = sx + px, sy + py, sz + pz
        last = parameters
        gradient[place, last], gradient[place, last + 1], gradient[place, last + 2] = wx, wy, wz
        gradient[place, last + 3], gradient[place, last + 4], gradient[place, last + 5] = sx, sy, sz
        k += count


@dataclass(frozen=True, eq=False)
class CameraFit:
    """The camera and the poses that fit some views best."""

    camera: Camera
    cam_from_target: Array  # (D, 4, 4) from the problem's origin
    cost: float  # sum of squared whitened residuals, views as often as they count
    looks: int  # how often the observations were looked at


def step_length(decrease: float, deviation: float) -> float:
    """A step in standard deviations, from the decrease of the cost that it promises; nan uphill."""
    return float(np.sqrt(decrease)) / deviation if decrease >= 0 else float("nan")


@jit
def reduced_gradient(
    direction: Array, pose_inverse: Array, views: Rows, weight: Rows, gradient: Array, follow: Array
) -> tuple[Array, Array, float]:
    """The sample's gradient by y with the poses at their best (Q,), what these lack (D, 6), and what that promises."""
    parameters, free = direction.shape
    reduced, rest, square = np.zeros(free), np.zeros((len(views), 6)), 0.0
    for place in range(len(views)):
        w, inverse = weight[place], pose_inverse[views[place]]
        for i in range(6):
            for j in range(6):
                rest[place, i] -= inverse[i, j] * gradient[place, parameters + j]
            square -= w * rest[place, i] * gradient[place, parameters + i]
        for q in range(free):
            total = 0.0
            for p in range(parameters):
                total += direction[p, q] * gradient[place, p]
            for i in range(6):
                total += follow[place, i, q] * gradient[place, parameters + i]
            reduced[q] += w * total
    return reduced, rest, square
