"""First-order responses: how errors of ring positions and pixels move the camera, the poses and every quantity.

At the minimum without errors, with J the derivatives of the whitened residuals, a change du of the pixels moves the
unknowns by `dx = (J' J)^-1 J' W du`, poses eliminated view by view as in `calib.solver.schur`. A ring displaced by dX
is seen `B dX` elsewhere, with B the derivatives of the projection. All quantities then are lengths of vectors that
are linear in dX and du:

- reprojection: `du - J dx`;
- intersection against the drawing: the way in the face that B takes to the residual `du - J dx`; against the true
  shape, which moves along: to what of it is not dX's, `du - B dX - J dx`;
- reconstruction: the same across the rays, put together for all rays of a ring (`calib.studies.tolerance.first_order`);
- pose, rotation, camera: parts of dx.

The square of a residual over a view is `du' M du - 2 (J' M du)' dx + dx' (J' M J) dx`: with the last matrix known,
only the observations of rings that move are looked at, and a source of single rings costs no more than one of the whole
print. What such sums lose in rounding is a share of 1e-15 of the squared displacement of the pixels.

Displacements count without the rigid motion that `calib.studies.tolerance.draw` takes out of the true shape, so
that the true poses stay where they are; to the solver that motion is one of the poses, so these alone are freed of it.

What the noise of the detected centres costs to first order: the mean of every quantity's square, without draws.

A quantity is the length of a vector L du that is linear in the pixels' errors du (`calib.studies.tolerance.response`);
of errors with covariance C, `E |L du|^2 = tr(L C L')`. Observations are independent of each other. With
`g = J' W' W du` summed over a view, `k = P^-1 g_pose` is what the view's pose takes on its own and
`h = g_free + follow' g_pose` what it asks of the camera; the camera's step is `f = S^-1 sum h`, the pose's
`k + follow f`. So all that views have in common is f, and every covariance is one of du, f and the view's k.
"""

import math
from dataclasses import dataclass

import numpy as np

from calib.core.jit import jit_inside, jit_sums
from calib.core.se3 import skew
from calib.studies.tolerance.first_order import FirstOrder, ObservationDerivatives, Sums
from designer.base.arrays import Array, Flags

TILE = 16
"""Columns at a time: what belongs to one observation stays in the processor's registers and nearest memory."""
U, V, WEIGHTED_U, WEIGHTED_V, METRIC_U, METRIC_V, OWN_U, OWN_V = (TILE * row for row in range(8))
PIXEL, ON_FACE, TRUE_ON_FACE, REBUILT, TRUE_REBUILT = (TILE * row for row in range(8, 13))
ROOM = 13 * TILE
"""Rows of one array, which the compiler can tell do not overlap."""


@dataclass(frozen=True, eq=False)
class Responses:
    """What N columns, each one error, do to first order."""

    params: Array  # (P, N) of the camera
    pose: Array  # (V, 6, N) rotation vector (rad), translation (mm) about the middle of the rings
    square: Array  # (Q, N) of each quantity


def responses(first: FirstOrder, displacement_mm: Array, pixel: Array | None = None) -> Responses:
    """The responses to displacements of rings, or of pixels.

    Args:
        first: the derivatives.
        displacement_mm: of the rings (R, 3, N).
        pixel: errors of all observations besides, (M, 2, N).
    """
    setting, columns = first.setting, displacement_mm.shape[2]
    noise = np.zeros((0, 2, columns)) if pixel is None else pixel
    free, pose = np.empty((first.free_count, columns)), np.empty((setting.view_count, 6, columns))
    total = np.empty((5, columns))
    moved, noise = np.ascontiguousarray(displacement_mm), np.ascontiguousarray(noise)
    _respond(first.observations, first.sums, moved, noise, free, pose, total)
    total = np.maximum(total, 0.0)  # where nothing is left, rounding may be below it
    observations, rings = len(first.observations.view_number), int(first.sums.is_rebuilt.sum())
    rebuilt = total[3:] / rings if rings else np.full((2, columns), np.nan)
    params = setting.anchor.spread @ free
    image = (free * (first.image @ free)).sum(axis=0)
    square = np.stack([
        total[0] / observations, total[1] / observations, rebuilt[0], total[2] / observations, rebuilt[1],
        *_pose_squares(setting.anchor.cam_from_target, pose),
        (params[:2] ** 2).mean(axis=0), (params[2:4] ** 2).sum(axis=0), image,
    ])  # fmt: skip
    return Responses(params, pose, square)


def _pose_squares(cam_from_target: Array, pose: Array) -> tuple[Array, Array]:
    """Of the camera's centre, in mm, and of its axes after the turn that all share, in degrees.  # (N,) each

    The centre `C = -R' t` moves by `-R' (s + t x w)`.
    """
    x, y, z = cam_from_target[:, :3, 3].T[:, :, None]
    a, b, c = pose[:, :3].transpose(1, 0, 2)
    square = (pose[:, 3] + y * c - z * b) ** 2
    square += (pose[:, 4] + z * a - x * c) ** 2
    square += (pose[:, 5] + x * b - y * a) ** 2
    own = pose[:, :3] - pose[:, :3].mean(axis=0)
    turn = np.full(pose.shape[2], np.nan) if len(pose) < 2 else np.einsum("vkn,vkn->n", own, own) / len(pose)
    return square.mean(axis=0), np.degrees(np.degrees(turn))


@jit_sums
def _respond(
    observations: ObservationDerivatives, sums: Sums, moved: Array, pixel: Array, free: Array, pose: Array, total: Array
) -> None:
    """The unknowns and the sums of squares of all columns, `TILE` of them at a time."""
    rings, columns = moved.shape[0], moved.shape[2]
    views, unknowns = len(sums.pixel), observations.jacobian.shape[2]
    still, rebuilt = np.empty((rings, 3, TILE)), np.empty((rings, 3, TILE))
    is_moved = np.empty(rings, dtype=np.bool_)
    moments, row = np.empty((views, 4, unknowns, TILE)), np.empty(ROOM)
    step, place, motion = np.empty((unknowns - 6, TILE)), np.empty((views, 6, TILE)), np.empty((6, TILE))
    for begin in range(0, columns, TILE):
        width = min(TILE, columns - begin)
        for r in range(rings):
            is_moved[r] = False
            for axis in range(3):
                for t in range(TILE):
                    still[r, axis, t] = moved[r, axis, begin + t] if t < width else 0.0
                    is_moved[r] |= still[r, axis, t] != 0.0
        row[:] = 0.0
        moments[:] = 0.0
        _add_moments(observations, still, is_moved, pixel, begin, width, row, moments)
        _solve(sums, moments, step, place)
        _free_of_motion(sums, still, is_moved, motion)
        _add_squares(sums, moments, step, place, motion, row)
        _rebuild(observations, sums, still, pixel, begin, width, step, place, rebuilt, row)
        for t in range(width):
            free[:, begin + t] = step[:, t]
            pose[:, :, begin + t] = place[:, :, t]
            for k in range(5):
                total[k, begin + t] = row[PIXEL + k * TILE + t]


@jit_sums
def _add_moments(
    observations: ObservationDerivatives,
    moved: Array,
    is_moved: Flags,
    pixel: Array,
    begin: int,
    width: int,
    row: Array,
    moments: Array,
) -> None:
    """Of the pixels' changes u = B dX + du: `J' W' W u`, `J' u`, `J' metric u` and `J' metric du` of each view."""
    view, ring, jacobian, by_ring, weight, metric, _, _ = observations
    unknowns = jacobian.shape[2]
    for m in range(len(view)):
        v, r = view[m], ring[m]
        if not (is_moved[r] or len(pixel)):
            continue
        ax, ay, az, bx, by, bz = (
            by_ring[m, 0, 0], by_ring[m, 0, 1], by_ring[m, 0, 2], by_ring[m, 1, 0], by_ring[m, 1, 1], by_ring[m, 1, 2],
        )  # fmt: skip
        wa, wb, wc = weight[m, 0], weight[m, 1], weight[m, 2]
        ma, mb, mc = metric[m, 0], metric[m, 1], metric[m, 2]
        for t in range(TILE):
            x, y, z = moved[r, 0, t], moved[r, 1, t], moved[r, 2, t]
            row[U + t], row[V + t] = ax * x + ay * y + az * z, bx * x + by * y + bz * z
        if len(pixel):
            for t in range(width):
                u, v_px = pixel[m, 0, begin + t], pixel[m, 1, begin + t]
                row[OWN_U + t], row[OWN_V + t] = ma * u + mb * v_px, mb * u + mc * v_px
                row[TRUE_ON_FACE + t] += u * row[OWN_U + t] + v_px * row[OWN_V + t]
                row[U + t], row[V + t] = row[U + t] + u, row[V + t] + v_px
        for t in range(TILE):
            u, v_px = row[U + t], row[V + t]
            row[WEIGHTED_U + t], row[WEIGHTED_V + t] = wa * u + wb * v_px, wb * u + wc * v_px
            row[METRIC_U + t], row[METRIC_V + t] = ma * u + mb * v_px, mb * u + mc * v_px
            row[PIXEL + t] += u * u + v_px * v_px
            row[ON_FACE + t] += u * row[METRIC_U + t] + v_px * row[METRIC_V + t]
        for k in range(unknowns):
            j_u, j_v = jacobian[m, 0, k], jacobian[m, 1, k]
            for t in range(TILE):
                moments[v, 0, k, t] += j_u * row[WEIGHTED_U + t] + j_v * row[WEIGHTED_V + t]
            for t in range(TILE):
                moments[v, 1, k, t] += j_u * row[U + t] + j_v * row[V + t]
            for t in range(TILE):
                moments[v, 2, k, t] += j_u * row[METRIC_U + t] + j_v * row[METRIC_V + t]
            if len(pixel):
                for t in range(TILE):
                    moments[v, 3, k, t] += j_u * row[OWN_U + t] + j_v * row[OWN_V + t]


@jit_inside
def _add(share: float, what: Array, to: Array) -> None:
    """Add a share of one row of columns to another."""
    for t in range(TILE):
        to[t] += share * what[t]


@jit_inside
def _take_six(share: Array, what: Array, to: Array) -> None:
    """Take shares of six rows from another, which is read and written once."""
    a, b, c, d, e, f = share[0], share[1], share[2], share[3], share[4], share[5]
    for t in range(TILE):
        to[t] -= a * what[0, t] + b * what[1, t] + c * what[2, t] + d * what[3, t] + e * what[4, t] + f * what[5, t]


@jit_sums
def _solve(sums: Sums, moments: Array, step: Array, place: Array) -> None:
    """Steps of the free parameters (F, TILE) and of the poses (V, 6, TILE)."""
    views, free = len(place), len(step)
    reduced = np.zeros((free, TILE))
    for v in range(views):
        for q in range(free):
            _add(1.0, moments[v, 0, q], reduced[q])
            for i in range(6):
                _add(sums.follow[v, i, q], moments[v, 0, free + i], reduced[q])
    step[:] = 0.0
    for q in range(free):
        for p in range(free):
            _add(sums.free_inverse[q, p], reduced[p], step[q])
    place[:] = 0.0
    for v in range(views):
        for i in range(6):
            for j in range(6):
                _add(sums.pose_inverse[v, i, j], moments[v, 0, free + j], place[v, i])
            for q in range(free):
                _add(sums.follow[v, i, q], step[q], place[v, i])


@jit_sums
def _free_of_motion(sums: Sums, moved: Array, is_moved: Flags, motion: Array) -> None:
    """Take the rigid motion (6, TILE) that fits displacements best out of them."""
    motion[:] = 0.0
    for r in range(len(moved)):
        for axis in range(3 if is_moved[r] else 0):
            for j in range(6):
                _add(sums.motion[j, r, axis], moved[r, axis], motion[j])
    for r in range(len(moved)):
        for axis in range(3):
            _take_six(sums.by_motion[r, axis], motion, moved[r, axis])


@jit_sums
def _add_squares(sums: Sums, moments: Array, step: Array, place: Array, motion: Array, row: Array) -> None:
    """Complete the squares of the residuals, and take the rigid motion out of the poses."""
    free = len(step)
    x, product = np.empty((free + 6, TILE)), np.empty(TILE)
    pixel, on_face, true = row[PIXEL : PIXEL + TILE], row[ON_FACE : ON_FACE + TILE], row[TRUE_ON_FACE:REBUILT]
    x[:free] = step
    for v in range(len(place)):
        x[free:] = place[v]
        _add_square(sums.pixel[v], x, moments[v, 1], product, pixel)
        _add_square(sums.on_face[v], x, moments[v, 2], product, on_face)
        for i in range(6):
            _take_six(sums.pose_by_motion[v, i], motion, place[v, i])
        x[free:] = place[v]
        _add_square(sums.on_face[v], x, moments[v, 3], product, true)


@jit_sums
def _add_square(matrix: Array, x: Array, moment: Array, product: Array, to: Array) -> None:
    """Add `x' M x - 2 m' x`, one column each."""
    for k in range(len(x)):
        for t in range(TILE):
            product[t] = -2.0 * moment[k, t]
        for j in range(len(x)):
            _add(matrix[k, j], x[j], product)
        for t in range(TILE):
            to[t] += x[k, t] * product[t]


@jit_sums
def _rebuild(
    observations: ObservationDerivatives,
    sums: Sums,
    still: Array,
    pixel: Array,
    begin: int,
    width: int,
    step: Array,
    place: Array,
    rebuilt: Array,
    row: Array,
) -> None:
    """Squared errors of the reconstructed rings, against the drawing and against the true shape."""
    view, ring = observations.view_number, observations.ring_number
    rebuilt[:] = still
    for r in range(len(still)):
        for axis in range(3):
            for q in range(len(step)):
                _add(-sums.rebuilt_by_free[r, axis, q], step[q], rebuilt[r, axis])
    for m in range(len(view)):
        v, r = view[m], ring[m]
        for axis in range(3):
            _take_six(observations.rebuilt_by_pose[m, axis], place[v], rebuilt[r, axis])
            if len(pixel):
                by_u, by_v = observations.rebuilt_by_pixel[m, axis, 0], observations.rebuilt_by_pixel[m, axis, 1]
                for t in range(width):
                    rebuilt[r, axis, t] += by_u * pixel[m, 0, begin + t] + by_v * pixel[m, 1, begin + t]
    for r in range(len(still)):
        for axis in range(3 if sums.is_rebuilt[r] else 0):
            for t in range(TILE):
                off, own = rebuilt[r, axis, t], rebuilt[r, axis, t] - still[r, axis, t]
                row[REBUILT + t] += off * off
                row[TRUE_REBUILT + t] += own * own


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
    gradient = np.stack(
        [weighted[rows].reshape(-1, free + 6).T @ by_gradient[rows].reshape(-1, free + 6) for rows in first.views]
    )
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
