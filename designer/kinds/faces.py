"""How a target's faces lie to each other, as its geometry has them."""

import math

import numpy as np
from numpy.typing import NDArray

from designer.base.solid import INLAY_SHARE
from designer.target import TargetGeometry

SAME_PLACE = 0.02
"""Corners and middles of sides nearer than this share of a side are one: faces of a print meet about so well."""
_FACE_DOWN = np.diag([1.0, -1.0, -1.0])
PARALLEL = 1e-6
"""How far the normals of opposite faces may be from opposite."""


def corners_mm(target: TargetGeometry) -> NDArray[np.float64]:
    """Corners of the faces' outlines in the target's frame.  # (F, K, 3)"""
    frame = target.target_from_face
    placed: NDArray[np.float64] = np.einsum("fij,fkj->fki", frame[:, :3, :2], target.outline_mm)
    return placed + frame[:, None, :3, 3]


def adjacent_faces(target: TargetGeometry) -> NDArray[np.int64]:
    """The face across each side of each face, from corner k to the next; -1: none.  # (F, K)"""
    corner = corners_mm(target)
    after = np.roll(corner, -1, axis=1)
    middle, length = (corner + after) / 2, np.linalg.norm(after - corner, axis=2)
    apart = np.linalg.norm(middle[:, :, None, None] - middle, axis=4)  # (F, K, F, K)
    faces = np.arange(target.face_count)
    apart[faces, :, faces] = np.inf
    nearest = apart.min(axis=3)  # (F, K, F)
    return np.where(nearest.min(axis=2) < SAME_PLACE * length, nearest.argmin(axis=2), -1)


def opposite_faces(target: TargetGeometry) -> tuple[tuple[int, int], ...]:
    """Pairs of faces whose normals are opposite, the smaller number first."""
    normals = target.target_from_face[:, :3, 2]
    pairs = np.argwhere(np.triu(normals @ normals.T < PARALLEL - 1, 1))
    return tuple((int(first), int(second)) for first, second in pairs)


def inset_per_depth(target: TargetGeometry) -> float:
    """How far the plane that halves the angle of two faces moves in from their edge, per unit of depth; 0: no edge.

    Of faces whose normals are an angle a apart, tan(a / 2); of a solid's edges the largest.
    """
    beside = adjacent_faces(target)
    face, side = np.nonzero(beside >= 0)
    if not len(face):
        return 0.0
    normals = target.target_from_face[:, :3, 2]
    cosine = (normals[face] * normals[beside[face, side]]).sum(axis=1)
    return math.tan(math.acos(float(np.clip(cosine.min(), -1.0, 1.0))) / 2)


def deepest_inlay_mm(target: TargetGeometry) -> float:
    """The deepest inlay of a border: its floor moves in with depth, and a tenth of its width must be left."""
    inset = inset_per_depth(target)
    return INLAY_SHARE * border_width_mm(target) / inset if inset > 0 else math.inf


def face_down(target: TargetGeometry) -> NDArray[np.float64]:
    """Axes of a bed on which the target lies on its last face, x along that face's x.  # (3, 3)"""
    axes: NDArray[np.float64] = _FACE_DOWN @ target.target_from_face[-1, :3, :3].T
    return axes


def is_turned(target: TargetGeometry, *, is_bed_deep: bool = False) -> bool:
    """Whether `design` turns a target by a quarter from `face_down`, so that its longer side lies along the bed's.

    Of sides alike the last bit does not decide.
    """
    width, depth, _ = np.ptp(corners_mm(target).reshape(-1, 3) @ face_down(target).T, axis=0).tolist()
    along, across = (depth, width) if is_bed_deep else (width, depth)
    return bool(across > along * (1 + PARALLEL))


def border_width_mm(target: TargetGeometry) -> float:
    """Width of the border, where it is narrowest, to a nanometre; 0 without one."""
    edge = np.roll(target.outline_mm, -1, axis=1) - target.outline_mm
    outward = np.stack([edge[..., 1], -edge[..., 0]], axis=2) / np.linalg.norm(edge, axis=2, keepdims=True)
    # From each side of the outline to the nearest corner of the window.
    to_corner = target.outline_mm[:, :, None] - target.window_mm[:, None]  # (F, K, K, 2)
    return round(float(np.einsum("fski,fsi->fsk", to_corner, outward).min()), 6)
