"""Poses that hang on others: `cam_from_target = cam_from_rig rig_from_target`, and what that makes of normal equations.

The kernels know a view's pose `cam_from_target` and its six numbers. With a rig these six are linear, to first order,
in the frame's six and in unknowns that frames share (where the camera stands, when it takes its photos), so that
equations over views become equations over frames by products with small matrices; residuals stay the same.
"""

from dataclasses import dataclass

import numpy as np

from calib.core.se3 import skew
from calib.solver.eliminate import Normal
from designer.base.arrays import Array, Rows


@dataclass(frozen=True, eq=False)
class Chain:
    """A step of the pose of view b of one camera: `by_frame[b] @ frame step + by_shared[b] @ shared[column] step`."""

    frame: Rows  # (B,) of each view, each another
    by_frame: Array  # (B, 6, 6)
    by_shared: Array  # (B, 6, K)
    column: Rows  # (K,) among the shared unknowns; -1: not free


def through_camera(cam_from_rig: Array, rig_from_target: Array) -> tuple[Array, Array]:
    """What steps of a frame's pose, and of the camera's own, do to `cam_from_target`: (B, 6, 6) each.

    All steps turn what is turned and shift the translation: `R' = exp(w) R, t' = t + s`, in the left frame's axes.

    Args:
        cam_from_rig: (4, 4)
        rig_from_target: (B, 4, 4)
    """
    rotation, views = cam_from_rig[:3, :3], len(rig_from_target)
    by_frame, by_camera = np.zeros((views, 6, 6)), np.tile(np.eye(6), (views, 1, 1))
    by_frame[:, :3, :3] = by_frame[:, 3:, 3:] = rotation
    by_camera[:, 3:, :3] = -skew(rig_from_target[:, :3, 3] @ rotation.T)
    return by_frame, by_camera


def no_equations(frames: int, shared: int) -> Normal:
    """Equations of nothing yet, without rings."""
    return Normal(
        np.zeros((frames, 6, 6)), np.zeros((frames, 6, shared + 1)), np.zeros((0, 3, 3)),
        np.zeros((0, 3, 6 * frames + shared + 1)), np.zeros((shared, shared + 1)), 0.0, 0.0, (),
    )  # fmt: skip


def add_chained(into: Normal, products: Array, params: Rows, chain: Chain) -> None:
    """Add one camera's equations over views to those over frames.

    Args:
        into: equations, of which the arrays are changed.
        products: blocks of the views (B, P + 7, P + 7), see `calib.solver.blocks`.
        params: the shared unknown that each parameter is (P,); -1: fixed.
        chain: of the camera.
    """
    columns = np.concatenate([params, chain.column])
    free, place = np.unique(columns[columns >= 0], return_inverse=True)
    count, own = len(params), len(chain.column)
    pick = np.zeros((count + own, len(free)))  # parameters that share a value add up
    pick[columns >= 0, place] = 1.0
    of_pose = chain.by_shared @ pick[count:]
    residual = np.zeros((len(products), 6, 1))
    to_pose = np.concatenate([chain.by_frame, of_pose, residual], axis=2)  # (B, 6, 6 + Q + 1)
    width = to_pose.shape[2]
    design = np.zeros((len(products), count + 7, width))
    design[:, :count, 6 : width - 1] = pick[:count]
    design[:, count : count + 6] = to_pose
    design[:, -1, -1] = 1.0
    block = design.transpose(0, 2, 1) @ (products @ design)
    into.pose[chain.frame] += block[:, :6, :6]
    target = np.concatenate([free, [into.other.shape[0]]])
    into.pose_row[chain.frame[:, None, None], np.arange(6)[:, None], target] += block[:, :6, 6:]
    into.other[free[:, None], target] += block[:, 6:-1, 6:].sum(axis=0)
