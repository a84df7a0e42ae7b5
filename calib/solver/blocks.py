"""The normal equations of every view: residuals and derivatives of its observations, and their products.

A view's unknowns are the P parameters of the camera and the six of its pose: `p_cam' = exp(w) R p + t + s` with the
rotation vector w (rad) and the shift s (mm). With J the derivatives of the whitened residuals r, a view's block is
`[J r]' [J r]`, (P + 7, P + 7): normal matrix, gradient and squared sum in one.
"""

from bisect import bisect_right
from dataclasses import dataclass

import numpy as np

from calib.cameras import linearise, project
from calib.cameras.camera import Camera, relinear
from calib.cameras.surface import linearise_points
from calib.core.jit import jit, jit_sums
from calib.solver.problem import Loss, Problem
from designer.base.arrays import Array, Flags, Rows

RUN = 2000
"""Observations at a time; their derivatives stay in the processor's cache."""
KEPT = 2**22
"""Bytes that the C library is to keep for the next step once they are freed. glibc learns that from the first such
block; before, it gives a step's arrays back to the system, and has them again page by page: a fifth of the time."""
np.empty(KEPT, dtype=np.int8)
CHUNK = 112
"""Of them at a time, at most; their derivatives and equations stay in the nearest cache."""

NO_IMAGE = 1e8
"""Squared length, in knees, that robust losses give to points that the camera does not show."""

LOSSES: dict[Loss, int] = {"squares": 0, "huber": 1, "cauchy": 2}
KNEE: dict[Loss, float] = {"squares": np.inf, "huber": 1.345, "cauchy": 2.385}
"""Where the losses bend, in standard deviations: 95 % efficient on normal noise (Holland and Welsch 1977)."""


@dataclass(frozen=True, eq=False)
class Misfit:
    """How far off V views are."""

    cost: Array  # (V,) sum of the losses of the whitened residuals; nan if an observation that counts has no image
    residual_px: Array  # (2, M) predicted - measured; of distances in space those, in mm


@dataclass(frozen=True, eq=False)
class Blocks(Misfit):
    """The normal equations of V views, too."""

    products: Array  # (V, S + P + 7, S + P + 7) symmetric; of the poses alone (V, 7, 7)
    prior: Array | None = None  # (S + P + 7, S + P + 7) of `Prior`

    @property
    def every(self) -> Array:
        """The views' products, and the prior's as if it were one more."""
        return self.products if self.prior is None else np.concatenate([self.products, self.prior[None]])

    @property
    def total(self) -> float:
        """The cost of all views and of the prior."""
        return float(self.cost.sum()) + (0.0 if self.prior is None else float(self.prior[-1, -1]))


@dataclass(frozen=True)
class RobustLoss:
    """A loss of the whitened residual's length: squares up to the knee, then flatter."""

    kind: Loss = "squares"
    sigma: float = 1.0  # standard deviation of a whitened residual, which the knee is a multiple of

    @property
    def knee(self) -> float:
        """The length of a whitened residual where it bends."""
        return KNEE[self.kind] * self.sigma

    def weights(self, length: Array) -> Array:
        """By which squares of whitened residuals of some lengths count: the loss's derivative by the square."""
        if self.kind == "huber":
            return np.asarray(np.minimum(1.0, self.knee / np.maximum(length, 1e-300)))
        return np.asarray(1 / (1 + (length / self.knee) ** 2))


@jit_sums
def _to_camera(
    view_start: Rows, first: int, last: int, pose: Array, position: Array, turned: Array, point: Array
) -> None:
    """R p and R p + t for the observations of some views."""
    base = view_start[first]
    for view in range(first, last):
        begin, end = view_start[view], view_start[view + 1]
        x, y, z = position[0, begin:end], position[1, begin:end], position[2, begin:end]
        for axis in range(3):
            rx, ry, rz, t = pose[view, axis, 0], pose[view, axis, 1], pose[view, axis, 2], pose[view, axis, 3]
            there, moved = turned[axis, begin - base : end - base], point[axis, begin - base : end - base]
            for n in range(end - begin):
                there[n] = rx * x[n] + ry * y[n] + rz * z[n]
            for n in range(end - begin):
                moved[n] = there[n] + t


@jit
def _loss(kind: int, knee: float, square: float) -> tuple[float, float]:
    """Loss and weight of a squared residual; the weight is the loss's derivative by the square."""
    if kind == 0 or square <= 0:
        return square, 1.0
    if kind == 1:
        if square <= knee * knee:
            return square, 1.0
        length = np.sqrt(square)
        return 2 * knee * length - knee * knee, knee / length
    ratio = square / (knee * knee)
    return knee * knee * np.log1p(ratio), 1 / (1 + ratio)


@jit
def _counted(kind: int, knee: float, square: float, is_used: bool) -> tuple[float, float]:
    """Loss and weight of an observation; with a weight of zero its derivatives are not to be looked at."""
    if not is_used:
        return 0.0, 0.0
    if kind != 0 and not square < NO_IMAGE * knee * knee:
        # The point has no image, or one that is lost: an outlier without a pull.
        return _loss(kind, knee, NO_IMAGE * knee * knee)[0], 0.0
    return _loss(kind, knee, square)


@jit_sums
def _whiten(
    begin: int, end: int, base: int, seen: Array, measured: Array, whitener: Array, residual: Array, factor: Array
) -> None:
    """The whiteners of some observations, their residuals whitened by them, and the squared lengths of these.

    Args:
        begin: of the observations.
        end: likewise.
        base: the observation that `seen` begins with.
        seen: pixels and derivatives.  # (8 + 2 P, N)
        measured: pixels.  # (2, M)
        whitener: see `Problem`.  # (3, M)
        residual: predicted - measured, a result.  # (2, M)
        factor: the other results.  # (6, CHUNK)
    """
    count = end - begin
    for k in range(2):
        predicted, known, off = seen[k, begin - base : end - base], measured[k, begin:end], residual[k, begin:end]
        for n in range(count):
            off[n] = predicted[n] - known[n]
    for k in range(3):
        given, kept = whitener[k, begin:end], factor[k]
        for n in range(count):
            kept[n] = given[n]
    a, b, c, du, dv = factor[0], factor[1], factor[2], residual[0, begin:end], residual[1, begin:end]
    white_u, white_v, square = factor[3], factor[4], factor[5]
    for n in range(count):
        white_u[n] = a[n] * du[n]
    for n in range(count):
        white_v[n] = b[n] * du[n] + c[n] * dv[n]
    for n in range(count):
        square[n] = white_u[n] * white_u[n] + white_v[n] * white_v[n]


@jit
def _weigh(
    begin: int, end: int, base: int, is_used: Flags, kind: int, knee: float, seen: Array, factor: Array
) -> float:
    """Weigh whiteners and residuals by the loss, which is returned.

    What does not count, or has no image, is given zeros in place of its derivatives.

    Args:
        begin: of the observations.
        end: likewise.
        base: the observation that `seen` begins with.
        is_used: see `Problem`.  # (M,)
        kind: of the loss.
        knee: likewise.
        seen: pixels and derivatives, of which those that do not count are overwritten.  # (8 + 2 P, N)
        factor: see `_whiten`.  # (6, CHUNK)
    """
    total = 0.0
    for n in range(end - begin):
        loss, weight = _counted(kind, knee, factor[5, n], is_used[begin + n])
        total += loss
        if weight == 0:
            factor[:5, n] = 0.0
            seen[:, begin - base + n] = 0.0
        elif weight != 1:
            factor[:5, n] *= np.sqrt(weight)
    return total


@jit_sums
def _fill(begin: int, count: int, turned: Array, seen: Array, factor: Array, rows: Array) -> None:
    """The rows [J r] of some observations, unknown by unknown: first those of u, then those of v.

    One simple loop a row: what it reads and writes does not overlap, so that the processor takes several at once.

    Args:
        begin: of the observations among those of `seen`.
        count: of them, at most `CHUNK`.
        turned: R p.  # (3, N)
        seen: pixels and derivatives.  # (8 + 2 P, N)
        factor: see `_weigh`.  # (6, CHUNK)
        rows: the result; the first P are left out if there is no room.  # (P + 7, 2 CHUNK) or (7, 2 CHUNK)
    """
    end, every, parameters = begin + count, (seen.shape[0] - 8) // 2, rows.shape[0] - 7
    a, b, c = factor[0], factor[1], factor[2]
    for unknown in range(parameters + 3):
        is_shift = unknown >= parameters
        # Pixels, then by the three coordinates of the point, u and v; then by the parameters, u and v.
        at, after = (unknown - parameters + 2, 3) if is_shift else (8 + unknown, every)
        by_u, by_v = seen[at, begin:end], seen[at + after, begin:end]
        row = rows[unknown + 3 if is_shift else unknown]
        u, v = row[:count], row[count:]
        for n in range(count):
            u[n] = a[n] * by_u[n]
        for n in range(count):
            v[n] = b[n] * by_u[n] + c[n] * by_v[n]
    for half in range(2):
        first, last = half * count, (half + 1) * count
        for axis in range(3):
            after, before = (axis + 1) % 3, (axis + 2) % 3
            turn, p, q = rows[parameters + axis, first:last], turned[after, begin:end], turned[before, begin:end]
            by_q, by_p = rows[parameters + 3 + after, first:last], rows[parameters + 3 + before, first:last]
            for n in range(count):
                turn[n] = p[n] * by_p[n] - q[n] * by_q[n]
        residual, weighted = rows[parameters + 6, first:last], factor[3 + half]
        for n in range(count):
            residual[n] = weighted[n]


@jit_sums
def _add_products(rows: Array, count: int, product: Array) -> None:
    """Add `rows @ rows.T`, four by four sums at a time so that each number loaded is used often; the lower triangle."""
    last = rows.shape[0] - 1
    for i in range(0, last + 1, 4):
        a, b, c, d = rows[i], rows[min(i + 1, last)], rows[min(i + 2, last)], rows[min(i + 3, last)]
        for j in range(0, i + 1, 4):
            p, q, r, s = rows[j], rows[min(j + 1, last)], rows[min(j + 2, last)], rows[min(j + 3, last)]
            ap, aq, ar, az, bp, bq, br, bz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            cp, cq, cr, cz, dp, dq, dr, dz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for n in range(count):
                ap += a[n] * p[n]
                aq += a[n] * q[n]
                ar += a[n] * r[n]
                az += a[n] * s[n]
                bp += b[n] * p[n]
                bq += b[n] * q[n]
                br += b[n] * r[n]
                bz += b[n] * s[n]
                cp += c[n] * p[n]
                cq += c[n] * q[n]
                cr += c[n] * r[n]
                cz += c[n] * s[n]
                dp += d[n] * p[n]
                dq += d[n] * q[n]
                dr += d[n] * r[n]
                dz += d[n] * s[n]
            sums = (ap, aq, ar, az), (bp, bq, br, bz), (cp, cq, cr, cz), (dp, dq, dr, dz)
            for k in range(4):
                for m in range(4):
                    if i + k <= last and j + m <= i + k:
                        product[i + k, j + m] += sums[k][m]


@jit_sums
def _add_gradient(begin: int, count: int, turned: Array, seen: Array, factor: Array, gradient: Array) -> None:
    """Add the last row of the products, `[J r]' r`, without the others; arguments as those of `_fill`.

    The factors are overwritten: by the pulls on the two coordinates, and on the three of the point.
    """
    end, parameters = begin + count, len(gradient) - 7
    a, b, c, u, v, square = factor[0], factor[1], factor[2], factor[3], factor[4], 0.0
    for n in range(count):
        square += u[n] * u[n] + v[n] * v[n]
    for n in range(count):
        u[n] = a[n] * u[n] + b[n] * v[n]
    for n in range(count):
        v[n] = c[n] * v[n]
    for unknown in range(parameters):
        by_u, by_v = seen[8 + unknown, begin:end], seen[8 + parameters + unknown, begin:end]
        total = 0.0
        for n in range(count):
            total += u[n] * by_u[n] + v[n] * by_v[n]
        gradient[unknown] += total
    for axis in range(3):
        by_u, by_v, pull = seen[2 + axis, begin:end], seen[5 + axis, begin:end], factor[axis]
        for n in range(count):
            pull[n] = u[n] * by_u[n] + v[n] * by_v[n]
        gradient[parameters + 3 + axis] += pull[:count].sum()
    for axis in range(3):
        after, before = (axis + 1) % 3, (axis + 2) % 3
        p, q, by_p, by_q = turned[after, begin:end], turned[before, begin:end], factor[before], factor[after]
        total = 0.0
        for n in range(count):
            total += p[n] * by_p[n] - q[n] * by_q[n]
        gradient[parameters + axis] += total
    gradient[parameters + 6] += square


@jit
def _view_products(
    view_start: Rows,
    first: int,
    last: int,
    turned: Array,
    seen: Array,
    measured: Array,
    whitener: Array,
    is_used: Flags,
    kind: int,
    knee: float,
    residual: Array,
    products: Array,
    cost: Array,
    is_renewed: bool,
) -> None:
    """Blocks and costs of some views, at most `CHUNK` observations at a time; or of the blocks the gradients only."""
    base, size = view_start[first], products.shape[1]
    rows, factor = np.empty((size, 2 * CHUNK)), np.empty((6, CHUNK))
    for view in range(first, last):
        cost[view] = 0.0
        products[view, 0 if is_renewed else size - 1 :] = 0.0
        begin = view_start[view]
        for left in range((view_start[view + 1] - begin + CHUNK - 1) // CHUNK, 0, -1):
            end = begin + (view_start[view + 1] - begin) // left
            _whiten(begin, end, base, seen, measured, whitener, residual, factor)
            cost[view] += _weigh(begin, end, base, is_used, kind, knee, seen, factor)
            if is_renewed:
                _fill(begin - base, end - begin, turned, seen, factor, rows)
                _add_products(rows, 2 * (end - begin), products[view])
            else:
                _add_gradient(begin - base, end - begin, turned, seen, factor, products[view, size - 1])
            begin = end
        for i in range(size):
            for j in range(i):
                products[view, j, i] = products[view, i, j]


@jit
def _view_costs(
    view_start: Rows,
    first: int,
    last: int,
    pixel: Array,
    measured: Array,
    whitener: Array,
    is_used: Flags,
    kind: int,
    knee: float,
    residual: Array,
    cost: Array,
) -> None:
    """Residuals and costs of some views, by their predicted pixels (N, 2)."""
    base = view_start[first]
    for view in range(first, last):
        total = 0.0
        for m in range(view_start[view], view_start[view + 1]):
            du, dv = pixel[m - base, 0] - measured[0, m], pixel[m - base, 1] - measured[1, m]
            residual[0, m], residual[1, m] = du, dv
            white_u, white_v = whitener[0, m] * du, whitener[1, m] * du + whitener[2, m] * dv
            total += _counted(kind, knee, white_u * white_u + white_v * white_v, is_used[m])[0]
        cost[view] = total


def view_blocks(
    problem: Problem,
    camera: Camera,
    cam_from_target: Array,
    loss: RobustLoss,
    *,
    of_poses: bool = False,
    near: Array | None = None,
) -> Blocks:
    """The normal equations of all views.

    Args:
        problem: what was seen.
        camera: where.
        cam_from_target: where (V, 4, 4).
        loss: of the whitened residuals.
        of_poses: those of the poses alone.
        near: products so near that only the gradients differ; takes half the time.
    """
    views, count = problem.view_count, problem.measured_px.shape[1]
    size = 7 if of_poses else len(problem.amount) + len(camera.params) + 7
    products = np.empty((views, size, size)) if near is None else near.copy()
    prior = None
    if problem.prior is not None and not of_poses:
        prior = problem.prior.block(np.concatenate([problem.amount, camera.params]))
    blocks = Blocks(np.empty(views), np.empty((2, count)), products, prior)
    pose, linear = np.ascontiguousarray(cam_from_target), problem.linear(camera)
    for first, last in _runs(problem.view_start):
        width = int(problem.view_start[last] - problem.view_start[first])
        turned, point = np.empty((3, width)), np.empty((3, width))
        _to_camera(problem.view_start, first, last, pose, problem.position_mm, turned, point)
        rows, lever, measured = _linearised(problem, camera, pose, (first, last), turned, point, of_poses=of_poses)
        if len(problem.amount) and not of_poses:
            among = slice(problem.view_start[first], problem.view_start[last])
            counts = np.diff(problem.view_start[first : last + 1])
            rotation, by_view = np.repeat(pose[first:last, :3, :3], counts, axis=0), None
            if linear is not None:
                view = np.repeat(np.arange(first, last), counts)
                slope = (rows[:2] - camera.params[2:4, None]) / camera.params[:2, None]
                by_view = problem.shifts[:, view, :2].transpose(2, 0, 1) * slope[:, None]
                by_view += problem.shifts[:, view, 2:].transpose(2, 0, 1)
                rows = _in_views(rows, camera, linear[view].T)
            rows = with_modes(rows, rotation, problem.modes_mm[:, :, among], by_view)
        _view_products(
            problem.view_start, first, last, lever, rows, measured, problem.whitener,
            problem.is_used, LOSSES[loss.kind], loss.knee, blocks.residual_px, products, blocks.cost,
            near is None,
        )  # fmt: skip
    return blocks


def _in_views(rows: Array, camera: Camera, linear: Array) -> Array:
    """Rows (8 + 2 P, N) of a camera whose fx, fy, cx, cy are others (4, N); by its own they are as they were."""
    gain, many = linear[:2] / camera.params[:2, None], len(camera.params)
    moved = rows.copy()
    moved[:2] = gain * (rows[:2] - camera.params[2:4, None]) + linear[2:]
    moved[2:8] = (gain[:, None] * rows[2:8].reshape(2, 3, -1)).reshape(6, -1)
    by_params = moved[8:].reshape(2, many, -1)
    by_params[:, 4:] *= gain[:, None]
    return moved


def with_modes(rows: Array, rotation: Array, modes_mm: Array, by_view: Array | None = None) -> Array:
    """The rows (8 + 2 P, N) with derivatives by displacements (S, 3, N) of the points before those by parameters.

    To these is added what the amounts do to the view itself (2, S, N).
    """
    by_point, by_params = rows[2:8].reshape(2, 3, -1), rows[8:].reshape(2, -1, rows.shape[1])
    by_modes = np.einsum("kjn,sjn->ksn", np.einsum("kin,nij->kjn", by_point, rotation), modes_mm)
    by_modes = by_modes if by_view is None else by_modes + by_view
    both = np.concatenate([by_modes, by_params], axis=1)
    return np.concatenate([rows[:8], both.reshape(-1, rows.shape[1])])


def view_misfit(problem: Problem, camera: Camera, cam_from_target: Array, loss: RobustLoss) -> Misfit:
    """What `view_blocks` says of the residuals, without derivatives."""
    misfit = Misfit(np.empty(problem.view_count), np.empty((2, problem.measured_px.shape[1])))
    pose, linear = np.ascontiguousarray(cam_from_target), problem.linear(camera)
    for first, last in _runs(problem.view_start):
        width = int(problem.view_start[last] - problem.view_start[first])
        turned, point = np.empty((3, width)), np.empty((3, width))
        _to_camera(problem.view_start, first, last, pose, problem.position_mm, turned, point)
        if problem.space is None:
            shown, measured = project(camera, point.T), problem.measured_px
            if linear is not None:
                counts = np.diff(problem.view_start[first : last + 1])
                shown = relinear(shown, camera.params[:4], np.repeat(linear[first:last], counts, axis=0))
        else:
            rows, _, measured = _linearised(problem, camera, pose, (first, last), turned, point)
            shown = np.ascontiguousarray(rows[:2].T)
        _view_costs(
            problem.view_start, first, last, shown, measured, problem.whitener,
            problem.is_used, LOSSES[loss.kind], loss.knee, misfit.residual_px, misfit.cost,
        )  # fmt: skip
    return misfit


def _linearised(
    problem: Problem,
    camera: Camera,
    pose: Array,
    views: tuple[int, int],
    turned: Array,
    point: Array,
    *,
    of_poses: bool = False,
) -> tuple[Array, Array, Array]:
    """What is compared with what, for a run of views.

    Returns:
        Pixels, or distances in space, with their derivatives (8 + 2 P, N); what turns of the target move (3, N); and
        what they are to be, for all observations (2, M).
    """
    if problem.space is None:
        seen = linearise_points(camera, point) if of_poses else linearise(camera, point)
        return seen.rows, turned, problem.measured_px
    first, last = views
    start = problem.view_start
    rotation = np.repeat(pose[first:last, :3, :3], np.diff(start[first : last + 1]), axis=0)
    rows, lever = problem.space.linearise(camera, slice(start[first], start[last]), rotation, turned, point)
    return rows, lever, np.zeros_like(problem.measured_px)


def _runs(view_start: Rows) -> list[tuple[int, int]]:
    """Runs of whole views with about `RUN` observations."""
    starts: list[int] = view_start.tolist()
    result, first = [], 0
    while first < len(starts) - 1:
        last = max(bisect_right(starts, starts[first] + RUN) - 1, first + 1)
        result.append((first, last))
        first = last
    return result
