"""What the noise of the detected centres costs to first order: the mean of every quantity's square, without draws.

A quantity is the length of a vector L du that is linear in the pixels' errors du (`calib.studies.tolerance.response`);
of errors with covariance C, `E |L du|^2 = tr(L C L')`. Observations are independent of each other. With
`g = J' W' W du` summed over a view, `k = P^-1 g_pose` is what the view's pose takes on its own and
`h = g_free + follow' g_pose` what it asks of the camera; the camera's step is `f = S^-1 sum h`, the pose's
`k + follow f`. So all that views have in common is f, and every covariance is one of du, f and the view's k.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.core.se3 import skew
from calib.studies.tolerance.first_order import FirstOrder

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Spread:
    """Covariances of the pixels' errors du, the camera's step f, each view's own k, and its unknowns x = (f, pose)."""

    pixel: Array  # (M, 2, 2) du
    free: Array  # (F, F) f
    own: Array  # (V, 6, 6) k
    own_free: Array  # (V, 6, F) k and f
    unknowns: Array  # (V, K, K) x
    pixel_free: Array  # (M, 2, F) du and f
    pixel_own: Array  # (M, 2, 6) du and k


def noise_squares(first: FirstOrder) -> Array:
    """The mean squares of all quantities over the noise, in the order of `QUANTITIES`.  # (Q,)"""
    spread = _spread(first)
    pixel, on_face = _residuals(first, spread)
    rebuilt = _rebuilt(first, spread)
    of_params = first.setting.anchor.spread
    variance = np.diagonal(of_params @ spread.free @ of_params.T)
    return np.array([
        pixel, on_face, rebuilt, on_face, rebuilt, _centre(first, spread), _turn(first, spread),
        variance[:2].mean(), variance[2:4].sum(), (first.image * spread.free).sum(),
    ])  # fmt: skip


def _spread(first: FirstOrder) -> _Spread:
    sums, free = first.sums, first.free_count
    a, b, c = first.setting.noise_root.T
    noise = np.stack([a * a, a * b, a * b, b * b + c * c], axis=1).reshape(-1, 2, 2)
    uu, uv, vv = first.observations.weight.T
    weighted = np.stack([uu, uv, uv, vv], axis=1).reshape(-1, 2, 2) @ first.observations.jacobian
    by_gradient = noise @ weighted  # covariance of du and g
    split = np.tile(np.eye(free + 6), (len(sums.follow), 1, 1))  # g to h and k
    split[:, :free, free:], split[:, free:, free:] = sums.follow.transpose(0, 2, 1), sums.pose_inverse
    gradient = np.stack([
        weighted[rows].reshape(-1, free + 6).T @ by_gradient[rows].reshape(-1, free + 6) for rows in first.views
    ])  # fmt: skip
    parts = split @ gradient @ split.transpose(0, 2, 1)
    joint = parts.copy()  # of f and k
    joint[:, :free, :free] = sums.free_inverse @ parts[:, :free, :free].sum(axis=0) @ sums.free_inverse
    joint[:, :free, free:] = sums.free_inverse @ parts[:, :free, free:]
    joint[:, free:, :free] = joint[:, :free, free:].transpose(0, 2, 1)
    follow = np.tile(np.eye(free + 6), (len(split), 1, 1))
    follow[:, free:, :free] = sums.follow
    by_parts = _times(first, by_gradient, split.transpose(0, 2, 1))
    return _Spread(
        noise, joint[0, :free, :free], joint[:, free:, free:], joint[:, free:, :free],
        follow @ joint @ follow.transpose(0, 2, 1), by_parts[:, :, :free] @ sums.free_inverse, by_parts[:, :, free:],
    )  # fmt: skip


def _times(first: FirstOrder, rows: Array, matrix: Array) -> Array:
    """Rows of each observation (M, N, A) times the matrix of its view (V, A, B).  # (M, N, B)"""
    count, width = rows.shape[1], rows.shape[2]
    return np.concatenate([
        (rows[of_view].reshape(-1, width) @ one).reshape(-1, count, one.shape[1])
        for of_view, one in zip(first.views, matrix, strict=True)
    ])  # fmt: skip


def _residuals(first: FirstOrder, spread: _Spread) -> tuple[float, float]:
    """Mean squares of `du - J x`, in the image and on the faces."""
    jacobian = first.observations.jacobian
    with_pose = spread.pixel_own + _times(first, spread.pixel_free, first.sums.follow.transpose(0, 2, 1))
    with_unknowns = np.concatenate([spread.pixel_free, with_pose], axis=2)
    # Only its symmetric part counts: J Z J' - Y J' - J Y' as (J Z - 2 Y) J'.
    change = (_times(first, jacobian, spread.unknowns) - 2 * with_unknowns) @ jacobian.transpose(0, 2, 1)
    covariance = spread.pixel + change
    uu, uv, vv = first.observations.metric.T
    off_diagonal = covariance[:, 0, 1] + covariance[:, 1, 0]
    on_face = uu * covariance[:, 0, 0] + uv * off_diagonal + vv * covariance[:, 1, 1]
    return float(np.trace(covariance, axis1=1, axis2=2).mean()), float(on_face.mean())


def _rebuilt(first: FirstOrder, spread: _Spread) -> float:
    """Mean square of the rings' reconstruction, whose rays' parts `N^-1 (A du - A J k)` are independent but for f."""
    observations, sums = first.observations, first.sums
    by_pixel, by_pose, ring = observations.rebuilt_by_pixel, observations.rebuilt_by_pose, observations.ring_number
    by_free = sums.rebuilt_by_free.copy()
    np.add.at(by_free, ring, _times(first, by_pose, sums.follow))
    alone = ((by_pixel @ spread.pixel - 2 * by_pose @ spread.pixel_own.transpose(0, 2, 1)) * by_pixel).sum()
    alone += (_times(first, by_pose, spread.own) * by_pose).sum()
    with_free = by_pixel @ spread.pixel_free - _times(first, by_pose, spread.own_free)
    common = ((by_free @ spread.free) * by_free).sum() - 2 * (with_free * by_free[ring]).sum()
    rings = sums.is_rebuilt.sum()
    return float((alone + common) / rings) if rings else math.nan


def _centre(first: FirstOrder, spread: _Spread) -> float:
    """Mean square error of the camera's centre, which moves by `s + t x w`."""
    free = first.free_count
    by_turn = skew(first.setting.anchor.cam_from_target[:, :3, 3])
    by_pose = np.concatenate([by_turn, np.tile(np.eye(3), (len(by_turn), 1, 1))], axis=2)
    return float(((by_pose @ spread.unknowns[:, free:, free:]) * by_pose).sum() / len(by_pose))


def _turn(first: FirstOrder, spread: _Spread) -> float:
    """Mean square turn after the one that all views share, in square degrees."""
    views, free = len(spread.own), first.free_count
    if views < 2:
        return math.nan
    follow = first.sums.follow[:, :3].mean(axis=0)
    mean = spread.own[:, :3, :3].sum(axis=0) / views**2 + follow @ spread.free @ follow.T
    mean += 2 * spread.own_free[:, :3].mean(axis=0) @ follow.T
    each = spread.unknowns[:, free : free + 3, free : free + 3].mean(axis=0)
    return math.degrees(math.degrees(float(np.trace(each - mean))))
