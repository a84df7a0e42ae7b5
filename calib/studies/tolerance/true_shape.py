"""Where a made target's rings truly are, in the frame that a calibration with the drawing can know.

A calibration puts the made target where the drawing fits it best, so a rigid motion of the whole target changes
nothing but the frame. The true shape is therefore moved onto the drawing by least squares of the rings' distances,
each ring counting as often as it is seen (Kabsch 1976), and true poses are re-expressed in that frame.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.core.se3 import make_pose, transform
from designer.tolerance.shape import MadeShape, centers_mm

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TrueShape:
    """R rings of a made target, moved onto the drawing."""

    center_mm: Array  # (R, 3)
    plane: Array  # (R, 4) unit normal n and offset d (mm) of the plane n X = d through each ring, parallel to its face
    moved_from_made: Array  # (4, 4) the motion


def true_shape(shape: MadeShape, weight: Array) -> TrueShape:
    """The true shape.

    Args:
        shape: of the made target, in its own frame.
        weight: how often each ring is seen (R,).
    """
    return moved_onto(centers_mm(shape), _normals(shape), shape.nominal.center_mm, weight)


def moved_onto(center_mm: Array, normal: Array, onto_mm: Array, weight: Array) -> TrueShape:
    """Rings (R, 3) with the normals of their faces (R, 3), moved onto others by least squares with weights (R,)."""
    share = weight[:, None] / weight.sum()
    middle, aim = (share * center_mm).sum(axis=0), (share * onto_mm).sum(axis=0)
    left, _, right = np.linalg.svd((share * (onto_mm - aim)).T @ (center_mm - middle))
    rotation = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    motion = make_pose(rotation, aim - rotation @ middle)
    center, turned = transform(motion, center_mm), normal @ rotation.T
    return TrueShape(center, np.column_stack([turned, (turned * center).sum(axis=1)]), motion)


def _normals(shape: MadeShape) -> Array:
    """Outward normals of the rings' faces after all errors; bow and warp do not turn them.  # (R, 3)"""
    frame = shape.nominal.target_from_face[:, :3, :3] @ shape.nominal_from_moved[:, :3, :3]
    stretch = shape.bed_axes.T @ shape.bed_affine @ shape.bed_axes
    axes = stretch @ frame[:, :, :2]
    normal = np.cross(axes[:, :, 0], axes[:, :, 1])
    unit: Array = (normal / np.linalg.norm(normal, axis=1, keepdims=True))[shape.nominal.ring_face]
    return unit
