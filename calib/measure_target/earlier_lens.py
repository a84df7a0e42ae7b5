"""What a lens that is not the right one did to centres, and what that leaves open of a measured target.

A circle is seen as an oval whose middle is not the circle's: how far off depends on the plane's vanishing line and on
how the lens bends the image across the oval. The detector takes both from a lens, and from where the design has the
rings. Through another lens, and of a print that is not as designed, it finds the middle elsewhere, in all photos alike.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib.cameras import project
from calib.cameras.camera import Camera
from calib.core import homography
from calib.core.linear_algebra import solve_square, symmetric_inverse
from calib.core.se3 import log_rotation
from calib.core.types import Observations
from calib.detector.lens import CameraLens
from calib.measure_target.result import AsBuilt
from calib.measure_target.unknowns import strain_numbers
from designer.base.arrays import Array, Rows
from designer.target import TargetGeometry

ANOTHER = 3.0
"""Standard deviations, root mean square over a camera's parameters."""
AROUND = 16
"""Points on a circle: a conic has five numbers."""
LEAST_RINGS = 6
"""Of a face, to tell its vanishing line."""
EARLIER_LENS = (
    "centres were found with the target as designed, which gives another lens than was measured: what that does to "
    "centres is in the standard deviations; with --photos the photos are searched again, and they are smaller"
)


def is_another_lens(found: AsBuilt, before: Sequence[Camera]) -> bool:
    """Whether a measured camera is not the one that the target as designed gave, by far more than its own noise."""
    for camera, covariance, other in zip(found.cameras, found.param_covariance, before, strict=True):
        off, known = other.params - camera.params, symmetric_inverse(covariance).inverse
        if off @ known @ off > ANOTHER**2 * np.count_nonzero(np.diagonal(covariance) > 0):
            return True
    return False


def seen_through(found: AsBuilt, before: Sequence[Camera]) -> tuple[Observations, ...]:
    """Observations moved as finding them through other lenses, with the target as designed, moves them."""
    return tuple(
        replace(seen, center_px=seen.center_px + _shifts_px(seen, found, poses, camera, other))
        for seen, poses, camera, other in zip(found.observations, found.poses, found.cameras, before, strict=True)
    )


def _shifts_px(seen: Observations, found: AsBuilt, poses: Array, camera: Camera, other: Camera) -> Array:
    """How far the other lens moves centres, 0 where it is not known.  # (M, 2)"""
    shifts, (target, face) = np.zeros_like(seen.center_px), (found.target, found.target.ring_face[seen.point])
    groups = np.stack([seen.view, face])
    for view, number in np.unique(groups, axis=1).T:
        (rows,) = np.nonzero((seen.view == view) & (face == number))
        if len(rows) >= LEAST_RINGS:
            ring = seen.point[rows]
            circle_px, center_px = (project(camera, _placed(place, poses[view])) for place in _circles(target, ring))
            lens = CameraLens(other).facing(center_px)
            design = np.ascontiguousarray(found.nominal.center_in_face_mm[ring, :2])
            straight_from_plane = homography.fit(design, lens.straighten(center_px), np.ones(len(ring)))[0]
            vanishing = np.cross(*straight_from_plane.T[:2])  # of the plane: what is at infinity along x, and along y
            moved = lens.distort(_poles(lens.straighten(circle_px), vanishing)) - center_px
            shifts[rows] = np.where(np.isfinite(moved), moved, 0.0)
    return shifts


def _circles(target: TargetGeometry, ring: Rows) -> tuple[Array, Array]:
    """Circles as large as rings' two edges are in the mean, and their centres.  # (N, K, 3), (N, 3)"""
    angle = np.arange(AROUND) * (2 * np.pi / AROUND)
    way = np.column_stack([np.cos(angle), np.sin(angle)]) @ target.target_from_face[target.ring_face[ring], :3, :2].mT
    radius = np.sqrt((target.radius_outer_mm[ring] ** 2 + target.radius_inner_mm[ring] ** 2) / 2)
    center = target.center_mm[ring]
    return center[:, None] + radius[:, None, None] * way, center


def _placed(place: Array, pose: Array) -> Array:
    placed: Array = place @ pose[:3, :3].T + pose[:3, 3]
    return placed


def _poles(oval: Array, line: Array) -> Array:
    """The poles of a line (3,) for the conics through points (N, K, 2): C^-1 l.  # (N, 2)"""
    middle = oval.mean(axis=1, keepdims=True)
    size = np.sqrt(((oval - middle) ** 2).mean(axis=(1, 2), keepdims=True))
    x, y = np.moveaxis((oval - middle) / size, -1, 0)
    terms = np.stack([x * x, x * y, y * y, x, y], axis=-1)
    a, b, c, d, e = solve_square(terms.mT @ terms, terms.sum(axis=1)[:, :, None])[:, :, 0].T
    conic = np.stack([a, b / 2, d / 2, b / 2, c, e / 2, d / 2, e / 2, -np.ones_like(a)], axis=-1).reshape(-1, 3, 3)
    # The line in the conics' own coordinates: l' = T^T l with u = T x.
    own = np.stack([line[0] * size[:, 0, 0], line[1] * size[:, 0, 0], middle[:, 0] @ line[:2] + line[2]], axis=-1)
    pole = solve_square(conic, own[:, :, None])[:, :, 0]
    poles: Array = middle[:, 0] + size[:, 0] * pole[:, :2] / pole[:, 2:]
    return poles


def with_shared_error(found: AsBuilt, moved: AsBuilt) -> AsBuilt:
    """A measurement that knows no better than by what another differs: one unknown that all its numbers share."""
    params = zip(found.param_covariance, found.cameras, moved.cameras, strict=True)
    face = np.array(found.target.face_covariance)
    for row, (here, there) in enumerate(zip(found.target.target_from_face, moved.target.target_from_face, strict=True)):
        turn = here[:3, :3].T
        face[row] += _square(np.concatenate([log_rotation(turn @ there[:3, :3]), turn @ (there[:3, 3] - here[:3, 3])]))
    inside = moved.target.center_in_face_mm - found.target.center_in_face_mm
    turns = found.target.target_from_face[found.target.ring_face, :3, :3]
    mode = np.einsum("rij,rj->ri", turns, inside)[None]
    modes = mode if found.target.mode_mm is None else np.concatenate([found.target.mode_mm, mode])
    return replace(
        found,
        target=replace(found.target, face_covariance=face, mode_mm=modes),
        param_covariance=tuple(known + _square(there.params - here.params) for known, here, there in params),
        strain_covariance=found.strain_covariance + _square(strain_numbers(moved.strain - found.strain)),
        motion_covariance=found.motion_covariance + _square((moved.motion - found.motion).ravel()),
        bow_covariance=found.bow_covariance + np.array([_square(one) for one in moved.bow_mm - found.bow_mm]),
        offset_sigma_mm=np.hypot(found.offset_sigma_mm, moved.offset_mm - found.offset_mm),
        remarks=(*found.remarks, EARLIER_LENS),
    )


def _square(off: Array) -> Array:
    return np.outer(off, off)
