"""The derivatives of all observations at the minimum without errors, and what sums over them every response needs.

    first = first_order(setting)
    responses(first, displacement_mm).square        # `calib.studies.tolerance.response`

A view's unknowns are K = F + 6: the free parameters of the camera, which all views share, and its pose. With B the
derivatives of a observation's pixel by its ring's position, A the way across the ray that takes a pixel back to
millimetres (`B A = 1`) and N = sum A B = sum (1 - d d') over the rays d of a ring, the ring's reconstruction moves by
`N^-1 sum A (du - J dx)`.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from calib.cameras import linearise
from calib.core.se3 import skew
from calib.solver.metrics.reconstruction import LEAST_SPREAD_RAD
from calib.studies.tolerance.seen import turn_jacobian
from calib.studies.tolerance.setting import Setting
from designer.base.arrays import Array, Flags, Rows


class ObservationDerivatives(NamedTuple):
    """The derivatives of M observations, the views one after the other."""

    view_number: Rows  # (M,)
    ring_number: Rows  # (M,)
    jacobian: Array  # (M, 2, K) pixels by the unknowns of the view
    by_ring: Array  # (M, 2, 3) pixels by the ring's position in the target's frame
    weight: Array  # (M, 3) W' W of the whitener: uu, uv, vv
    metric: Array  # (M, 3) squared distance on the face by pixels: uu, uv, vv
    rebuilt_by_pixel: Array  # (M, 3, 2) mm, N^-1 A; zero where a ring is not reconstructed
    rebuilt_by_pose: Array  # (M, 3, 6) likewise


class Sums(NamedTuple):
    """Sums over the observations of V views, and of R rings."""

    pixel: Array  # (V, K, K) J' J
    on_face: Array  # (V, K, K) J' metric J
    pose_inverse: Array  # (V, 6, 6)
    follow: Array  # (V, 6, F)
    free_inverse: Array  # (F, F)
    rebuilt_by_free: Array  # (R, 3, F)
    is_rebuilt: Flags  # (R,) has rays from sides that are different enough
    motion: Array  # (6, R, 3) the rigid motion (turn about the rings' middle, shift) that fits displacements best
    by_motion: Array  # (R, 3, 6) displacements by that motion
    pose_by_motion: Array  # (V, 6, 6) the change of the pose that shows the same


@dataclass(frozen=True, eq=False)
class FirstOrder:
    """All that is linear about a setting."""

    setting: Setting
    observations: ObservationDerivatives
    sums: Sums

    @property
    def free_count(self) -> int:
        """F."""
        return len(self.sums.free_inverse)

    @property
    def views(self) -> tuple[slice, ...]:
        """The observations of each view."""
        start = self.setting.anchor.problem.view_start.tolist()
        return tuple(map(slice, start[:-1], start[1:]))

    @cached_property
    def image(self) -> Array:
        """The mean square distance over the image, the best rotation removed, by the free parameters.  # (F, F)"""
        grid, anchor = self.setting.grid, self.setting.anchor
        linear = linearise(anchor.camera, grid.ray)
        turn = turn_jacobian(grid.ray, linear.by_point)
        moved = linear.by_params.transpose(0, 2, 1).reshape(len(turn), -1) @ anchor.spread
        basis, _ = np.linalg.qr(turn)
        left = moved - basis @ (basis.T @ moved)
        gram: Array = left.T @ left / grid.pixel.shape[1]
        return gram


def first_order(setting: Setting) -> FirstOrder:
    """The derivatives of a setting."""
    anchor, seen = setting.anchor, setting.observations
    view, ring = seen.view, seen.point
    pose = anchor.cam_from_target[view]
    rotation = pose[:, :3, :3]
    turned = (rotation @ (setting.target.center_mm[ring] - anchor.problem.origin_mm)[:, :, None])[:, :, 0]
    point = turned + pose[:, :3, 3]
    linear = linearise(anchor.camera, np.ascontiguousarray(point.T))
    by_point = np.ascontiguousarray(linear.by_point.transpose(2, 0, 1))
    by_params = linear.by_params.transpose(2, 0, 1) @ anchor.spread
    by_turn = np.cross(turned[:, None, :], by_point)  # a turn w moves R p by w x R p
    jacobian = np.concatenate([by_params, by_turn, by_point], axis=2)
    by_ring = by_point @ rotation
    a, b, c = anchor.problem.whitener
    face = setting.target.target_from_face[setting.target.ring_face[ring], :3, :2]
    on_face = np.linalg.inv(by_ring @ face)
    gram = on_face.transpose(0, 2, 1) @ on_face
    rebuilt, is_rebuilt = _rebuilt_by_pixel(setting, by_ring, (point[:, None] @ rotation)[:, 0])
    rebuilt_by_unknown = rebuilt @ jacobian
    free = anchor.spread.shape[1]
    observations = ObservationDerivatives(
        view, ring, jacobian, by_ring, np.stack([a * a + b * b, b * c, c * c], axis=1),
        np.stack([gram[:, 0, 0], gram[:, 0, 1], gram[:, 1, 1]], axis=1), rebuilt,
        np.ascontiguousarray(rebuilt_by_unknown[:, :, free:]),
    )  # fmt: skip
    by_free = np.zeros((setting.target.ring_count, 3, free))
    np.add.at(by_free, ring, rebuilt_by_unknown[:, :, :free])
    return FirstOrder(setting, observations, _sums(setting, jacobian, gram @ jacobian, by_free, is_rebuilt))


def _sums(setting: Setting, jacobian: Array, on_face: Array, by_free: Array, is_rebuilt: Flags) -> Sums:
    anchor = setting.anchor
    start = anchor.problem.view_start.tolist()
    views = list(map(slice, start[:-1], start[1:]))
    unknowns = jacobian.shape[2]
    flat = [jacobian[rows].reshape(-1, unknowns) for rows in views]
    pixel = np.stack([one.T @ one for one in flat])
    face = np.stack([one.T @ on_face[rows].reshape(-1, unknowns) for one, rows in zip(flat, views, strict=True)])
    share = setting.seen / setting.seen.sum()
    middle = share @ setting.target.center_mm
    by_motion = np.concatenate(
        [skew(middle - setting.target.center_mm), np.tile(np.eye(3), (len(share), 1, 1))], axis=2
    )
    weighted = (share[:, None, None] * by_motion).reshape(-1, 6)
    motion = np.linalg.pinv(weighted.T @ by_motion.reshape(-1, 6), hermitian=True) @ weighted.T
    rotation = anchor.cam_from_target[:, :3, :3]
    pose_by_motion = np.zeros((len(views), 6, 6))
    pose_by_motion[:, :3, :3] = pose_by_motion[:, 3:, 3:] = rotation
    pose_by_motion[:, 3:, :3] = rotation @ skew(middle - anchor.problem.origin_mm)
    return Sums(
        pixel, face, anchor.pose_inverse, anchor.follow, anchor.free_inverse, by_free, is_rebuilt,
        np.ascontiguousarray(motion.reshape(6, -1, 3)), by_motion, pose_by_motion,
    )  # fmt: skip


def _rebuilt_by_pixel(setting: Setting, by_ring: Array, ray: Array) -> tuple[Array, Flags]:
    """`N^-1 A` of each observation (M, 3, 2), and which rings have rays from different sides (R,)."""
    ring, rings = setting.observations.point, setting.target.ring_count
    unit = ray / np.linalg.norm(ray, axis=1, keepdims=True)
    matrix = np.zeros((rings, 3, 3))
    np.add.at(matrix, ring, np.eye(3) - unit[:, :, None] * unit[:, None, :])
    count = np.bincount(ring, minlength=rings)
    least = np.linalg.eigvalsh(matrix)[:, 0]
    is_rebuilt = (count >= 2) & (least > LEAST_SPREAD_RAD**2 * count)
    inverse = np.zeros_like(matrix)
    inverse[is_rebuilt] = np.linalg.inv(matrix[is_rebuilt])
    across = _across(unit)
    rebuilt: Array = inverse[ring] @ (across @ np.linalg.inv(by_ring @ across))
    return rebuilt, is_rebuilt


def _across(unit: Array) -> Array:
    """Two unit vectors across each direction (n, 3), and across each other.  # (n, 3, 2)"""
    least = np.eye(3)[np.abs(unit).argmin(axis=1)]
    first = np.cross(unit, least)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(unit, first)], axis=2)
