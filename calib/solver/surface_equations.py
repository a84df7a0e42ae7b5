"""The normal equations of a camera with a surface: of hundreds of control points, a sighting depends on sixteen.

With the unknowns c of the camera (those of the base, then the control points) and those of each view's pose, the
whitened and weighted residuals r of a view change by `G dc + E dp`. What is kept is `sum G'G` (P, P), and of every view
`E'G` (6, P) and `E'E` (6, 6); `eliminated` takes the poses out (Schur complement; Triggs et al. 2000, section 6).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.cameras.camera import Camera
from calib.cameras.surface import SurfaceModel
from calib.core.jit import jit_sums
from calib.core.linear_algebra import symmetric_inverse
from calib.core.se3 import skew
from calib.solver.blocks import with_modes
from calib.solver.problem import Problem
from designer.base.arrays import Array

POSE = 6
RUN = 4000
"""Sightings at a time."""


@dataclass(frozen=True, eq=False)
class SurfaceEquations:
    """Normal equations of P unknowns of the camera and of V poses."""

    normal: Array  # (P, P)
    gradient: Array  # (P,)
    square: float  # sum of the squares of the residuals
    by_pose: Array  # (V, 6, P) E'G
    pose: Array  # (V, 6, 6) E'E
    pose_gradient: Array  # (V, 6)


@dataclass(frozen=True, eq=False)
class Eliminated:
    """The same without the poses: `dp = -(shift + turn dc)` of each view is theirs."""

    normal: Array  # (P, P)
    gradient: Array  # (P,)
    square: float
    turn: Array  # (V, 6, P)
    shift: Array  # (V, 6)
    pose_inverse: Array  # (V, 6, 6)

    def pose_step(self, step: Array) -> Array:
        """What the poses do (V, 6) where the camera does `step` (P,)."""
        return -(self.shift + self.turn @ step)


def places(problem: Problem, cam_from_target: Array) -> tuple[Array, Array]:
    """R p and R p + t of all sightings.  # (3, M) each"""
    pose = cam_from_target[problem.view]
    turned = np.einsum("mij,jm->im", pose[:, :3, :3], problem.position_mm)
    return turned, turned + pose[:, :3, 3].T


def surface_equations(
    problem: Problem,
    model: SurfaceModel,
    camera: Camera,
    cam_from_target: Array,
    weight: Array,
    modes_mm: Array | None = None,
) -> SurfaceEquations:
    """The equations of the sightings that count, by their whiteners and by weights (M,).

    With displacements of the points (S, 3, M), the S numbers of these stand before the parameters.
    """
    extra = 0 if modes_mm is None else len(modes_mm)
    size, base, views = len(camera.params) + extra, model.first_control + extra, problem.view_count
    normal, by_pose = np.zeros((size, size)), np.zeros((views, POSE, size))
    pose = np.zeros((views, POSE + base + 1, POSE + base + 1))
    gradient = np.zeros(size)
    turned, point = places(problem, cam_from_target)
    view, grid = problem.view, np.array([model.control_rows, model.control_columns])
    for begin in range(0, len(view), RUN):
        part = slice(begin, begin + RUN)
        local = model.linearise_locally(camera, np.ascontiguousarray(point[:, part]))
        rows = local.rows
        if modes_mm is not None:
            rows = with_modes(rows, cam_from_target[view[part], :3, :3], modes_mm[:, :, part])
        residual = rows[:2] - problem.measured_px[:, part]
        factor = problem.whitener[:, part] * np.where(problem.is_used[part], np.sqrt(weight[part]), 0.0)
        _accumulate(
            view[part], np.ascontiguousarray(turned[:, part]), rows, residual, local.first, local.weight,
            factor, grid, normal, gradient, by_pose, pose,
        )  # fmt: skip
    dense = pose.sum(axis=0)
    normal += np.triu(normal, 1).T
    normal[:base, :base] = dense[POSE:-1, POSE:-1]
    gradient[:base] = dense[POSE:-1, -1]
    by_pose[:, :, :base] = pose[:, :POSE, POSE:-1]
    return SurfaceEquations(
        normal, gradient, float(dense[-1, -1]), by_pose, pose[:, :POSE, :POSE].copy(), pose[:, :POSE, -1].copy()
    )


@jit_sums
def _fill(turned: Array, row: Array, residual: Array, factor: Array, x: Array, y: Array) -> None:
    """Whitened derivatives of a sighting by pose and base, and its residual; y: times the whitener's transpose.

    The second is what they share with control points, whose derivatives are the whitener's columns.
    """
    a, b, c, base, dense = factor[0], factor[1], factor[2], len(row) // 2 - 4, x.shape[1]
    for axis in range(2):
        p, q, r = row[2 + 3 * axis], row[3 + 3 * axis], row[4 + 3 * axis]
        x[axis, 0] = turned[1] * r - turned[2] * q
        x[axis, 1] = turned[2] * p - turned[0] * r
        x[axis, 2] = turned[0] * q - turned[1] * p
        x[axis, 3], x[axis, 4], x[axis, 5] = p, q, r
        for k in range(base):
            x[axis, 6 + k] = row[8 + axis * base + k]
        x[axis, dense - 1] = residual[axis]
    for k in range(dense):
        x[1, k] = b * x[0, k] + c * x[1, k]
        x[0, k] = a * x[0, k]
        y[0, k], y[1, k] = a * x[0, k] + b * x[1, k], c * x[1, k]


@jit_sums
def _accumulate(
    view: NDArray[np.int64],
    turned: Array,
    rows: Array,
    residual: Array,
    first: NDArray[np.int64],
    weight: Array,
    factor: Array,
    grid: NDArray[np.int64],
    normal: Array,
    gradient: Array,
    by_pose: Array,
    pose: Array,
) -> None:
    """Add some sightings; of `normal` the upper triangle, and only the columns of control points.

    Args:
        view: of each.  # (N,)
        turned: R p.  # (3, N)
        rows: pixels and derivatives by point and base.  # (8 + 2 B, N)
        residual: predicted - measured.  # (2, N)
        first: see `LocalLinearised`.  # (2, N)
        weight: likewise.  # (8, N)
        factor: a, b, c of the whitener [[a, 0], [b, c]], weighted.  # (3, N)
        grid: rows and columns of control points.
        normal: result.  # (P, P)
        gradient: result, of control points.  # (P,)
        by_pose: result, by control points.  # (V, 6, P)
        pose: result: products of pose, base and residual.  # (V, 6 + B + 1, 6 + B + 1)
    """
    base, half = rows.shape[0] // 2 - 4, grid[0] * grid[1]
    dense = 7 + base
    x, y = np.empty((2, dense)), np.empty((2, dense))
    place, both = np.empty(16, dtype=np.int64), np.empty(16)
    for n in range(len(view)):
        a, b, c = factor[0, n], factor[1, n], factor[2, n]
        if a == 0:
            continue
        _fill(turned[:, n], rows[:, n], residual[:, n], factor[:, n], x, y)
        own = pose[view[n]]
        for k in range(dense):
            for m in range(dense):
                own[k, m] += x[0, k] * x[0, m] + x[1, k] * x[1, m]
        for j in range(4):
            for i in range(4):
                place[4 * j + i] = base + (first[0, n] + j) * grid[1] + first[1, n] + i
                both[4 * j + i] = weight[j, n] * weight[4 + i, n]
        uu, uv, vv = a * a + b * b, b * c, c * c
        for k in range(16):
            u, v, w = place[k], place[k] + half, both[k]
            for m in range(6):
                by_pose[view[n], m, u] += w * y[0, m]
                by_pose[view[n], m, v] += w * y[1, m]
            for m in range(base):
                normal[m, u] += w * y[0, 6 + m]
                normal[m, v] += w * y[1, 6 + m]
            gradient[u] += w * y[0, dense - 1]
            gradient[v] += w * y[1, dense - 1]
            for m in range(16):
                if m >= k:
                    normal[u, place[m]] += uu * w * both[m]
                    normal[v, place[m] + half] += vv * w * both[m]
                if uv != 0:
                    normal[u, place[m] + half] += uv * w * both[m]


def eliminated(equations: SurfaceEquations, damping: float = 0.0) -> Eliminated:
    """Take the poses out, damped by a part of their diagonal."""
    damped = equations.pose * (1 + damping * np.eye(POSE))
    inverse = symmetric_inverse(damped).inverse
    turn, shift = inverse @ equations.by_pose, np.einsum("vij,vj->vi", inverse, equations.pose_gradient)
    flat = equations.by_pose.reshape(-1, equations.by_pose.shape[2])
    taken = flat.T @ turn.reshape(flat.shape)
    return Eliminated(
        equations.normal - 0.5 * (taken + taken.T),
        equations.gradient - flat.T @ shift.ravel(),
        equations.square - float((equations.pose_gradient * shift).sum()),
        turn, shift, inverse,
    )  # fmt: skip


def free_motions(equations: SurfaceEquations, cam_from_target: Array, spread: Array, extra: int = 0) -> Array:
    """Orthonormal directions (2 R C, F + 3) of control points that do what the base or a turn of the camera would do.

    The base by its F free parameters, `spread` (B, F); `extra` unknowns before these are none of its. A turn by w of
    the camera moves a point p + t of a view by w x p and by the shift w x t.
    """
    base = len(spread) + extra
    by_turn = equations.by_pose[:, :3] + skew(cam_from_target[:, :3, 3]) @ equations.by_pose[:, 3:]
    motions = np.concatenate([spread.T @ equations.normal[extra:base, base:], by_turn.sum(axis=0)[:, base:]])
    length = np.linalg.norm(motions, axis=1)
    unit = motions[length > 0] / length[length > 0, None]
    basis: Array = np.linalg.qr(unit.T)[0]
    return basis
