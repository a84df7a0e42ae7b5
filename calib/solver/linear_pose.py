"""First poses, by linear equations: homographies of planar views, direct linear transforms of others.

Both work on points and image coordinates that are moved to their mean and scaled (Hartley 1997), with the last entry
one: the middle of what is seen lies in front of the camera, so that it is never zero.
"""

from dataclasses import dataclass

import numpy as np

from calib.core.jit import jit
from calib.core.small_solve import cholesky_solve, diagonalise
from designer.base.arrays import Array, Flags, Rows

FLAT = 0.02
"""A view whose points are this much thinner than wide is taken for planar; a transform of it would be unsure."""

SOLID = 1e-3
"""Thinner than this part of their extent, points are in a plane."""
TRIALS = 100
"""Draws for a consensus; with seven of a fifth outliers each, a good one is missed once in ten billion views."""
FEWEST_DRAWN, MOST_DRAWN = 5, 7
"""Observations of a plane, and of a solid."""
NEAR_MEDIANS = 5.0
POLAR_STEPS, POLAR_ROUNDING = 30, 1e-15


@dataclass(frozen=True, eq=False)
class LinearViews:
    """What linear equations say of each of V views."""

    projection: Array  # (V, 3, 4) from the plane's or the target's coordinates to the image; nan: not determined
    target_from_plane: Array  # (V, 4, 4) the frame of the points' plane
    is_planar: Flags  # (V,) the projection's third column is then zero


def linear_views(
    view_start: Rows, position_mm: Array, image: Array, *, as_planes: bool = False, is_robust: bool = False
) -> LinearViews:
    """Fit a homography or a projection to each view: points (3, M), and their places (2, M) in an image without lens.

    Observations of the view v begin at `view_start[v]`; it has one or more. All are taken for planar if asked, and
    what most of them agree on is fitted.
    """
    frame, spread = principal_frames(view_start, position_mm)
    is_planar = (spread[:, 0] < FLAT * spread[:, 2]) | as_planes
    projection = np.empty((len(frame), 3, 4))
    position, plane = np.ascontiguousarray(position_mm), np.ascontiguousarray(image)
    if is_robust:  # the draws are the same each time
        share = np.random.default_rng(0).random((TRIALS, MOST_DRAWN))
        _fit_views_by_consensus(view_start, position, plane, frame, is_planar, share, projection)
    else:
        _fit_views(view_start, position, plane, frame, is_planar, projection)
    return LinearViews(projection, frame, is_planar)


def principal_frames(view_start: Rows, position_mm: Array) -> tuple[Array, Array]:
    """The frame of each view's points, z along their least extent, and their extents in ascending order."""
    frame, extent = np.zeros((len(view_start) - 1, 4, 4)), np.empty((len(view_start) - 1, 3))
    _principal_frames(view_start, np.ascontiguousarray(position_mm), frame, extent)
    return frame, extent


@jit
def _principal_frames(view_start: Rows, position: Array, frame: Array, extent: Array) -> None:
    """The mean of each view's points, and the eigenvectors of their mean products about it."""
    scatter, vectors = np.empty((3, 3)), np.empty((3, 3))
    for view in range(len(frame)):
        begin, end = view_start[view], view_start[view + 1]
        axes, middle = frame[view, :3, :3], frame[view, :3, 3]
        frame[view, 3, 3] = 1.0
        for axis in range(3):
            middle[axis] = position[axis, begin:end].mean()
        for i in range(3):
            for j in range(i + 1):
                total = 0.0
                for n in range(begin, end):
                    total += (position[i, n] - middle[i]) * (position[j, n] - middle[j])
                scatter[i, j] = scatter[j, i] = total / (end - begin)
                vectors[i, j] = vectors[j, i] = 1.0 if i == j else 0.0
        diagonalise(scatter, vectors)
        square = np.diag(scatter)
        order = np.argsort(square)
        for k in range(3):
            extent[view, k] = np.sqrt(max(square[order[k]], 0.0))
            axes[k, 0], axes[k, 1] = vectors[k, order[2]], vectors[k, order[1]]
        for k in range(3):
            i, j = (k + 1) % 3, (k + 2) % 3
            axes[k, 2] = axes[i, 0] * axes[j, 1] - axes[j, 0] * axes[i, 1]


@jit
def _fit_views(
    view_start: Rows, position: Array, image: Array, frame: Array, is_planar: Flags, projection: Array
) -> None:
    for view in range(len(frame)):
        begin, end = view_start[view], view_start[view + 1]
        _fit_view(position[:, begin:end], image[:, begin:end], frame[view], is_planar[view], projection[view])


@jit
def _fit_views_by_consensus(
    view_start: Rows, position: Array, image: Array, frame: Array, is_planar: Flags, share: Array, projection: Array
) -> None:
    """Of fits to a few observations drawn at random, the one with the least median distance (Rousseeuw 1984).

    It is fitted again, twice, to what it shows within a few of those medians. `share` (TRIALS, MOST_DRAWN), from 0 to
    1, says which observations are drawn.
    """
    for view in range(len(frame)):
        begin, end = view_start[view], view_start[view + 1]
        p, u = position[:, begin:end], image[:, begin:end]
        count, drawn = end - begin, FEWEST_DRAWN if is_planar[view] else MOST_DRAWN
        best, trial = projection[view], np.empty((3, 4))
        _fit_view(p, u, frame[view], is_planar[view], best)
        if count < 2 * drawn:
            continue
        distance = np.empty(count)
        least = _median_distance(p, u, frame[view], best, distance)
        for row in range(TRIALS):
            rows = (share[row, :drawn] * count).astype(np.int64)
            _fit_view(p[:, rows], u[:, rows], frame[view], is_planar[view], trial)
            middle = _median_distance(p, u, frame[view], trial, distance)
            if middle < least:
                least, best[:] = middle, trial
        for _ in range(2):
            least = _median_distance(p, u, frame[view], best, distance)
            near = distance <= NEAR_MEDIANS * least
            if near.sum() >= drawn:
                _fit_view(p[:, near], u[:, near], frame[view], is_planar[view], best)


@jit
def _median_distance(position: Array, image: Array, frame: Array, projection: Array, distance: Array) -> float:
    """Distances in the image, and their median; infinite where there is no image."""
    for n in range(position.shape[1]):
        shown = projection[:, 3].copy()
        for axis in range(3):
            value = 0.0
            for k in range(3):
                value += frame[k, axis] * (position[k, n] - frame[k, 3])
            for i in range(3):
                shown[i] += projection[i, axis] * value
        du, dv = shown[0] / shown[2] - image[0, n], shown[1] / shown[2] - image[1, n]
        length = np.sqrt(du * du + dv * dv)
        distance[n] = length if length < np.inf else np.inf
    return float(np.median(distance))


@jit
def _fit_view(position: Array, image: Array, frame: Array, is_planar: bool, projection: Array) -> None:
    """Least squares on `q . p u - P . p = 0`, with p the point in its frame, and the lower right entry one."""
    axes = 2 if is_planar else 3
    local, scale_p = _in_frame(position, frame, axes)
    middle_u, middle_v = image[0].mean(), image[1].mean()
    spread = ((image[0] - middle_u) ** 2).sum() + ((image[1] - middle_v) ** 2).sum()
    projection[:] = np.nan
    if not spread > 0 or not scale_p < np.inf:
        return
    scale_u = np.sqrt(2 * image.shape[1] / spread)
    unknowns = 3 * axes + 2
    normal, right, row = np.zeros((unknowns, unknowns)), np.zeros(unknowns), np.zeros(unknowns)
    for n in range(image.shape[1]):
        for k in range(2):
            value = scale_u * (image[k, n] - (middle_u if k == 0 else middle_v))
            row[:] = 0.0
            for axis in range(axes):
                row[k * (axes + 1) + axis] = scale_p * local[axis, n]
                row[2 * (axes + 1) + axis] = -scale_p * local[axis, n] * value
            row[k * (axes + 1) + axes] = 1.0
            for i in range(unknowns):
                right[i] += row[i] * value
                for j in range(i + 1):
                    normal[i, j] += row[i] * row[j]
    solution = np.empty(unknowns)
    if not cholesky_solve(normal, right, solution):
        return
    projection[:] = 0.0
    for i in range(3):
        for axis in range(axes):
            projection[i, axis] = solution[i * (axes + 1) + axis] * scale_p
        projection[i, 3] = solution[i * (axes + 1) + axes] if i < 2 else 1.0
    for axis in range(4):
        projection[0, axis] = projection[0, axis] / scale_u + middle_u * projection[2, axis]
        projection[1, axis] = projection[1, axis] / scale_u + middle_v * projection[2, axis]


@jit
def _in_frame(position: Array, frame: Array, axes: int) -> tuple[Array, float]:
    """Points (3, N) in a frame, and the factor that brings them to a mean square of one per axis."""
    local = np.empty_like(position)
    square = 0.0
    for n in range(position.shape[1]):
        for axis in range(3):
            value = 0.0
            for k in range(3):
                value += frame[k, axis] * (position[k, n] - frame[k, 3])
            local[axis, n] = value
            square += value * value
    return local, np.sqrt(axes * position.shape[1] / square)


def poses_of(views: LinearViews) -> Array:
    """Poses `cam_from_target` (V, 4, 4) from projections to normalised coordinates; nan where there is none.

    The columns of a homography are two axes and the origin of the plane (Zhang 2000, section 3.1); those of a
    transform are all three axes. Both are turned to the nearest rotation.
    """
    poses = np.empty((len(views.projection), 4, 4))
    _poses_of(views.projection, views.target_from_plane, views.is_planar, poses)
    return poses


@jit
def _poses_of(projection: Array, target_from_plane: Array, is_planar: Flags, pose: Array) -> None:
    for view in range(len(pose)):
        frame, axes, origin = target_from_plane[view], projection[view, :, :3].copy(), projection[view, :, 3]
        known = 2 if is_planar[view] else 3
        scale = np.sqrt((axes[:, :known] ** 2).sum(axis=0)).mean()
        axes /= scale
        if is_planar[view]:
            for k in range(3):
                i, j = (k + 1) % 3, (k + 2) % 3
                axes[k, 2] = axes[i, 0] * axes[j, 1] - axes[j, 0] * axes[i, 1]
        _to_rotation(axes)
        pose[view] = 0.0
        for i in range(3):
            pose[view, i, 3] = origin[i] / scale
            for j in range(3):
                for k in range(3):
                    pose[view, i, j] += axes[i, k] * frame[j, k]
                pose[view, i, 3] -= pose[view, i, j] * frame[j, 3]
        pose[view, 3, 3] = 1.0
        if not np.isfinite(pose[view]).all():
            pose[view] = np.nan


@jit
def _to_rotation(a: Array) -> None:
    """The rotation nearest to a matrix (3, 3), or to its negative; not finite where there is none.

    Newton's iteration to the orthogonal factor of the polar decomposition (Higham 1986).
    """
    cofactor = np.empty((3, 3))
    for _ in range(POLAR_STEPS):
        for i in range(3):
            for j in range(3):
                k, m, p, q = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
                cofactor[i, j] = a[k, p] * a[m, q] - a[k, q] * a[m, p]
        determinant = a[0, 0] * cofactor[0, 0] + a[0, 1] * cofactor[0, 1] + a[0, 2] * cofactor[0, 2]
        if determinant < 0:
            a[:], determinant = -a, -determinant  # whose cofactors are the same
        stretch = determinant ** (-1 / 3)
        change = 0.0
        for i in range(3):
            for j in range(3):
                x = 0.5 * (stretch * a[i, j] + cofactor[i, j] / (stretch * determinant))
                change = max(change, abs(x - a[i, j]))
                a[i, j] = x
        if not change > POLAR_ROUNDING:
            return


def weak_perspective_poses(view_start: Rows, position_mm: Array, ray: Array) -> Array:
    """Poses (V, 4, 4) as if all points were equally far: linear in the two first rows of the rotation.

    For views with too few points for a projection; nan where the points are in a plane. With m the mean of the points,
    `x = s r1 (p - m) + x0` and `y = s r2 (p - m) + y0` (DeMenthon and Davis 1995, the first step). Rays are x and y
    of directions at z = 1 (2, M).
    """
    first, count = view_start[:-1], np.diff(view_start)
    middle, sight = (np.add.reduceat(values, first, axis=1) / count for values in (position_mm, ray))
    offset, seen = position_mm - np.repeat(middle, count, axis=1), ray - np.repeat(sight, count, axis=1)
    normal = np.add.reduceat(offset[:, None] * offset[None], first, axis=2).transpose(2, 0, 1)
    right = np.add.reduceat(offset[:, None] * seen[None], first, axis=2).transpose(2, 0, 1)
    extent = np.linalg.eigvalsh(normal)
    is_solid = extent[:, 0] > SOLID**2 * extent[:, 2]
    rows = np.linalg.solve(np.where(is_solid[:, None, None], normal, np.eye(3)), right).transpose(0, 2, 1)
    scale = np.linalg.norm(rows, axis=2).max(axis=1)
    is_solid &= scale > 0
    scale = np.where(is_solid, scale, 1.0)
    rows = np.where(is_solid[:, None, None], rows / scale[:, None, None], np.eye(3)[:2])
    across = np.cross(rows[:, 0], rows[:, 1])
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
    u, _, vt = np.linalg.svd(np.concatenate([rows, across[:, None]], axis=1))
    u[:, :, 2] *= np.linalg.det(u @ vt)[:, None]
    poses = np.tile(np.eye(4), (len(count), 1, 1))
    poses[:, :3, :3] = u @ vt
    in_sight = np.column_stack([sight.T, np.ones(len(count))]) / scale[:, None]
    poses[:, :3, 3] = in_sight - np.einsum("vij,jv->vi", poses[:, :3, :3], middle)
    return np.where(is_solid[:, None, None], poses, np.nan)


def focal_of(views: LinearViews) -> float:
    """The focal length, in the image's units, that the views agree on; nan if they do not determine it.

    The image's origin is taken for the principal point, and pixels for square. Of a homography with the columns a, b
    then `(a1 b1 + a2 b2) / f^2 + a3 b3 = 0` and `(a1^2 + a2^2 - b1^2 - b2^2) / f^2 + a3^2 - b3^2 = 0` (Zhang 2000);
    of a transform with the rows m1, m2, m3 (less their parts along m3), `|m1|^2 = |m2|^2 = f^2 |m3|^2`.
    """
    with np.errstate(all="ignore"):
        planar = views.projection[views.is_planar]
        norm = np.linalg.norm(planar[:, :, :2], axis=(1, 2))[:, None]
        a, b = planar[:, :, 0] / norm, planar[:, :, 1] / norm
        left = np.concatenate([a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1], ((a**2 - b**2)[:, :2]).sum(axis=1)])
        right = np.concatenate([a[:, 2] * b[:, 2], a[:, 2] ** 2 - b[:, 2] ** 2])
        ok = np.isfinite(left) & np.isfinite(right)
        inverse_square = -(left[ok] * right[ok]).sum() / (left[ok] ** 2).sum()
        rows = views.projection[~views.is_planar, :, :3]
        third = rows[:, 2] / np.linalg.norm(rows[:, 2], axis=1)[:, None]
        across = rows[:, :2] - np.einsum("vik,vk->vi", rows[:, :2], third)[:, :, None] * third[:, None]
        squares = (across**2).sum(axis=(1, 2)) / (2 * (rows[:, 2] ** 2).sum(axis=1))
        solid = squares[np.isfinite(squares) & (squares > 0)]
        if len(solid):
            return float(np.sqrt(np.median(solid)))
        return float(1 / np.sqrt(inverse_square)) if inverse_square > 0 else float("nan")
