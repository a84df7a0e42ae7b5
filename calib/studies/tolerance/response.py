"""First-order responses: how errors of ring positions and pixels move the camera, the poses and every quantity.

At the minimum without errors, with J the derivatives of the whitened residuals, a change du of the pixels moves the
unknowns by `dx = (J' J)^-1 J' W du`, poses eliminated view by view as in `calib.solver.schur`. A ring displaced by dX
is seen `B R dX` elsewhere, with B the derivatives of the projection. All quantities then are lengths of vectors that
are linear in dx and du:

- reprojection: `J dx - du`;
- intersection against the drawing: the way in the face, F t, that B R takes to the residual, `B R F t = du - J dx`;
  against the true shape, which moves along: `B R F t = -J dx`;
- reconstruction: the same on the plane N across the ray, put together for all rays of a ring,
  `X = (sum I - d d')^-1 sum N t`;
- pose, rotation, camera: parts of dx.

Displacements are first freed of the rigid motion that `calib.studies.tolerance.true_shape` takes out, so that the true
poses stay where they are.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.cameras import linearise
from calib.linear_algebra import least_squares
from calib.metrics.reconstruction import LEAST_SPREAD_RAD
from calib.se3 import transform
from calib.studies.tolerance.map_error import turn_jacobian
from calib.studies.tolerance.setting import Setting

Array = NDArray[np.float64]


NUMBERS_AT_ONCE = 4_000_000
"""Sightings times columns; bounds the memory."""


@dataclass(frozen=True, eq=False)
class Responses:
    """What N columns, each one error, do to first order."""

    params: Array  # (P, N) of the camera
    pose: Array  # (V, 6, N) rotation vector (rad), translation (mm) about the middle of the rings
    square: Array  # (Q, N) of each quantity


@dataclass(frozen=True, eq=False)
class _View:
    """The derivatives of one view's n sightings."""

    rows: slice  # of the observations
    ring: NDArray[np.int64]  # (n,)
    by_ring: Array  # (n, 2, 3) pixels by the ring's position in the target's frame
    jacobian: Array  # (n, 2, Q + 6) pixels by free parameters and pose
    weighted: Array  # (n, 2, Q + 6) times W' W
    on_face: Array  # (n, 2, 2) mm on the face by px
    across: Array  # (n, 3, 2) mm across the ray by px, in the target's frame


def responses(setting: Setting, displacement_mm: Array, pixel: Array | None = None) -> Responses:
    """The responses to displacements of rings, or of pixels.

    Args:
        setting: what is photographed.
        displacement_mm: of the rings (R, 3, N).
        pixel: errors of all sightings besides, (M, 2, N).
    """
    still = without_rigid_motion(setting.target.center_mm, setting.seen, displacement_mm)
    views = [_view(setting, number) for number in range(setting.view_count)]
    columns = still.shape[2]
    width = max(1, NUMBERS_AT_ONCE // len(setting.observations.view))
    parts = []
    for first in range(0, columns, width):
        some = slice(first, first + width)
        parts.append(_part(setting, views, still[:, :, some], None if pixel is None else pixel[:, :, some]))
    return Responses(
        np.concatenate([part.params for part in parts], axis=-1),
        np.concatenate([part.pose for part in parts], axis=-1),
        np.concatenate([part.square for part in parts], axis=-1),
    )


def _part(setting: Setting, views: list[_View], still: Array, pixel: Array | None) -> Responses:
    pixels = [_pixels(view, still, pixel) for view in views]
    free, pose = _unknowns(setting, views, pixels)
    square = _squares(setting, views, pixels, still, free, pose)
    return Responses(setting.anchor.spread @ free, pose, square)


def without_rigid_motion(center_mm: Array, weight: Array, displacement_mm: Array) -> Array:
    """Displacements (R, 3, N) less the rigid motion that fits them best with weights (R,)."""
    share = weight / weight.sum()
    arm = center_mm - share @ center_mm
    zero = np.zeros(len(arm))
    x, y, z = arm.T
    # A turn by w moves a ring by w x arm.
    turn = np.stack([np.stack([zero, z, -y], 1), np.stack([-z, zero, x], 1), np.stack([y, -x, zero], 1)], axis=1)
    basis = np.concatenate([turn, np.tile(np.eye(3), (len(arm), 1, 1))], axis=2).reshape(-1, 6)
    flat = displacement_mm.reshape(len(basis), -1)
    weights = np.repeat(share, 3)[:, None]
    motion = least_squares(np.sqrt(weights) * basis, np.sqrt(weights) * flat)
    still: Array = (flat - basis @ motion).reshape(displacement_mm.shape)
    return still


def _view(setting: Setting, number: int) -> _View:
    anchor, seen = setting.anchor, setting.observations
    rows = slice(int(anchor.problem.view_start[number]), int(anchor.problem.view_start[number + 1]))
    ring = seen.point[rows]
    pose = anchor.cam_from_target[number]
    position = setting.target.center_mm[ring] - anchor.problem.origin_mm
    turned = position @ pose[:3, :3].T
    point = turned + pose[:3, 3]
    linear = linearise(anchor.camera, np.ascontiguousarray(point.T))
    by_point = linear.by_point.transpose(2, 0, 1)  # (n, 2, 3)
    by_params = linear.by_params.transpose(2, 0, 1) @ anchor.spread
    by_turn = np.cross(turned[:, None, :], by_point)  # a turn w moves R p by w x R p
    jacobian = np.concatenate([by_params, by_turn, by_point], axis=2)
    a, b, c = anchor.problem.whitener[:, rows]
    whitener = np.zeros((len(ring), 2, 2))
    whitener[:, 0, 0], whitener[:, 1, 0], whitener[:, 1, 1] = a, b, c
    by_ring = by_point @ pose[:3, :3]
    face = setting.target.target_from_face[setting.target.ring_face[ring], :3, :2]
    across = _across(point @ pose[:3, :3])
    return _View(
        rows, ring, by_ring, jacobian, whitener.transpose(0, 2, 1) @ whitener @ jacobian,
        np.linalg.inv(by_ring @ face), across @ np.linalg.inv(by_ring @ across),
    )  # fmt: skip


def _across(direction: Array) -> Array:
    """Two unit vectors across each direction (n, 3), and across each other.  # (n, 3, 2)"""
    unit = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    least = np.eye(3)[np.abs(unit).argmin(axis=1)]
    first = np.cross(unit, least)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(unit, first)], axis=2)


def _pixels(view: _View, still: Array, pixel: Array | None) -> Array:
    """How the pixels of a view move.  # (n, 2, N)"""
    moved: Array = view.by_ring @ still[view.ring]
    return moved if pixel is None else moved + pixel[view.rows]


def _unknowns(setting: Setting, views: list[_View], pixels: list[Array]) -> tuple[Array, Array]:
    """Steps of the free parameters (Q, N) and of the poses (V, 6, N)."""
    anchor = setting.anchor
    free = anchor.spread.shape[1]
    columns = pixels[0].shape[2]
    reduced, rest = np.zeros((free, columns)), np.empty((len(views), 6, columns))
    for number, (view, moved) in enumerate(zip(views, pixels, strict=True)):
        gradient = -view.weighted.reshape(-1, free + 6).T @ moved.reshape(-1, columns)
        rest[number] = -anchor.pose_inverse[number] @ gradient[free:]
        reduced += gradient[:free] + anchor.follow[number].T @ gradient[free:]
    step = -anchor.free_inverse @ reduced
    return step, rest + anchor.follow @ step


@dataclass(frozen=True, eq=False)
class _Sums:
    """What is summed over the views, by column: against the drawing, and against the true shape."""

    pixel: Array  # (N,) squared residuals
    on_face: Array  # (2, N) squared distances on the faces
    across: Array  # (2, R, 3, N) ways across the rays, summed for each ring
    matrix: Array  # (R, 3, 3) of the rays
    count: Array  # (R,) of the rays


def _squares(
    setting: Setting, views: list[_View], pixels: list[Array], still: Array, free: Array, pose: Array
) -> Array:
    """The squares of all quantities (Q, N), in the order of `QUANTITIES`."""
    rings, columns = setting.target.ring_count, free.shape[1]
    sums = _Sums(
        np.zeros(columns), np.zeros((2, columns)), np.zeros((2, rings, 3, columns)), np.zeros((rings, 3, 3)),
        np.zeros(rings),
    )  # fmt: skip
    for number, (view, moved) in enumerate(zip(views, pixels, strict=True)):
        _add_view(sums, view, moved, still, np.concatenate([free, pose[number]]))
        sums.matrix[view.ring] += _projector(setting, number, view.ring)
        sums.count[view.ring] += 1
    sightings = len(setting.observations.view)
    rebuilt = [_rebuilt(sums.matrix, sums.count, across) for across in sums.across]
    on_face = sums.on_face / sightings
    return np.stack([
        sums.pixel / sightings, on_face[0], rebuilt[0], on_face[1], rebuilt[1], *_pose_squares(setting, pose),
        *_camera_squares(setting, setting.anchor.spread @ free),
    ])  # fmt: skip


def _add_view(sums: _Sums, view: _View, moved: Array, still: Array, unknowns: Array) -> None:
    """Add a view's sightings, whose pixels moved by (n, 2, N)."""
    predicted = (view.jacobian.reshape(-1, len(unknowns)) @ unknowns).reshape(moved.shape)
    off = moved - predicted
    # Against the true shape, what the rings' own displacement moved is no error; what noise moved is.
    true = off - view.by_ring @ still[view.ring]
    sums.pixel[:] += np.einsum("nkc,nkc->c", off, off)
    metric = view.on_face.transpose(0, 2, 1) @ view.on_face
    for place, residual in enumerate((off, true)):
        u, v = residual[:, 0], residual[:, 1]
        sums.on_face[place] += metric[:, 0, 0] @ u**2 + 2 * (metric[:, 0, 1] @ (u * v)) + metric[:, 1, 1] @ v**2
        for axis in range(3):
            sums.across[place, view.ring, axis] += view.across[:, axis, :1] * u + view.across[:, axis, 1:] * v


def _projector(setting: Setting, number: int, ring: NDArray[np.int64]) -> Array:
    """`I - d d'` of a view's rays (n, 3, 3), in the target's frame."""
    pose = setting.anchor.cam_from_target[number]
    point = transform(pose, setting.target.center_mm[ring] - setting.anchor.problem.origin_mm)
    unit: Array = point / np.linalg.norm(point, axis=1, keepdims=True) @ pose[:3, :3]
    projector: Array = np.eye(3) - unit[:, :, None] * unit[:, None, :]
    return projector


def _rebuilt(matrix: Array, count: Array, right: Array) -> Array:
    """Mean square displacement of the rings that have rays from different sides.  # (N,)"""
    least = np.linalg.eigvalsh(matrix)[:, 0]
    good = (count >= 2) & (least > LEAST_SPREAD_RAD**2 * count)
    if not good.any():
        return np.full(right.shape[2], np.nan)
    position = np.linalg.solve(matrix[good], right[good])
    mean: Array = (position**2).sum(axis=(0, 1)) / good.sum()
    return mean


def _pose_squares(setting: Setting, pose: Array) -> tuple[Array, Array]:
    """Of the camera's centre, in mm, and of its axes after the turn that all share, in degrees.  # (N,) each

    The centre `C = -R' t` moves by `-R' (s + t x w)`.
    """
    shift = pose[:, 3:] + np.cross(setting.anchor.cam_from_target[:, :3, 3, None], pose[:, :3], axis=1)
    turn = np.degrees(pose[:, :3])
    own = turn - turn.mean(axis=0)
    alone = len(pose) < 2
    rotation = np.full(pose.shape[2], np.nan) if alone else (own**2).sum(axis=1).mean(axis=0)
    return (shift**2).sum(axis=1).mean(axis=0), rotation


def _camera_squares(setting: Setting, params: Array) -> tuple[Array, Array, Array]:
    """Of the focal lengths, of the principal point, and of the camera over the image.  # (N,) each"""
    grid = setting.grid
    linear = linearise(setting.anchor.camera, grid.ray)
    turn = turn_jacobian(grid.ray, linear.by_point)
    moved = linear.by_params.transpose(0, 2, 1).reshape(len(turn), -1) @ params
    basis, _ = np.linalg.qr(turn)
    left = moved - basis @ (basis.T @ moved)
    image = (left**2).sum(axis=0) / grid.pixel.shape[1]
    return (params[:2] ** 2).mean(axis=0), (params[2:4] ** 2).sum(axis=0), image
