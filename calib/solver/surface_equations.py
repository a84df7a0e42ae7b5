"""The normal equations of a camera with a surface: of hundreds of control points, a sighting depends on sixteen.

With the unknowns c of the camera (those of the base, then the control points) and those of each view's pose, the
whitened and weighted residuals r of a view change by `G dc + E dp`. What is kept is `sum G'G` (P, P), and of every view
`E'G` (6, P) and `E'E` (6, 6); `eliminated` takes the poses out (Schur complement; Triggs et al. 2000, section 6).

What is believed of a surface before photos are seen: it is smooth; how smooth, the photos say.

The displacements are a Gaussian field with Matern's covariance (nu = 2), whose precision is
`tau^2 integral |(kappa^2 - Laplace)^(3/2) d|^2` (Lindgren, Rue and Lindstroem 2011): with binomial factors, the squares
of the surface's derivatives up to the third, which are exact sums over its control points. `kappa` is four over the
distance at which displacements are hardly alike any more, and `tau^2 = 1 / (8 pi kappa^4 amplitude^2)`.
"""

from dataclasses import dataclass
from math import comb, pi

import numpy as np

from calib.cameras.camera import Camera
from calib.cameras.surface import DEGREE, SurfaceModel
from calib.core.jit import jit_sums
from calib.core.linear_algebra import symmetric_inverse
from calib.core.se3 import skew
from calib.solver.blocks import with_modes
from calib.solver.problem import Problem
from designer.base.arrays import Array, Rows

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
    problem: Problem, model: SurfaceModel, camera: Camera, cam_from_target: Array, weight: Array
) -> SurfaceEquations:
    """The equations of the sightings that count, by their whiteners and by weights (M,).

    The problem's amounts of displacements stand before the parameters.
    """
    extra = len(problem.amount)
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
        if extra:
            rows = with_modes(rows, cam_from_target[view[part], :3, :3], problem.modes_mm[:, :, part])
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
    view: Rows,
    turned: Array,
    rows: Array,
    residual: Array,
    first: Rows,
    weight: Array,
    factor: Array,
    grid: Rows,
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


ORDER = 3
"""Of the highest derivatives: a cubic spline has no more."""


@dataclass(frozen=True)
class Smoothness:
    """Two numbers that say how smooth a surface is."""

    length: float  # at which displacements are hardly alike, in half diagonals of the image
    amplitude: float  # standard deviation of a displacement, in standard deviations of a whitened residual


def roughness(scale: Array, counts: tuple[int, int], half_diagonal_px: float) -> Array:
    """Integrals of the squared derivatives of orders 0 to 3 over the domain, of one coordinate's K points (4, K, K).

    Args:
        scale: see `SurfaceModel.scale`.
        counts: rows and columns of control points.
        half_diagonal_px: the unit of length.
    """
    down = _along(counts[0], half_diagonal_px * scale[1, 1])
    across = _along(counts[1], half_diagonal_px * scale[0, 1])
    return np.stack([
        sum(comb(order, k) * np.kron(down[order - k], across[k]) for k in range(order + 1))
        for order in range(ORDER + 1)
    ])  # fmt: skip


def _along(count: int, per_unit: float) -> Array:
    """Integrals of products of derivatives of B-splines along one axis, orders 0 to 3 (4, count, count)."""
    node, share = np.polynomial.legendre.leggauss(4)
    t, share = 0.5 * (node + 1), 0.5 * share
    s = 1 - t
    zero = np.ones_like(t)
    pieces = np.array(
        [
            (s**3 / 6, (3 * t**3 - 6 * t**2 + 4) / 6, (3 * s**3 - 6 * s**2 + 4) / 6, t**3 / 6),
            (-(s**2) / 2, 1.5 * t**2 - 2 * t, 2 * s - 1.5 * s**2, t**2 / 2),
            (s, 3 * t - 2, 3 * s - 2, t),
            (-zero, 3 * zero, -3 * zero, zero),
        ]
    )  # (order, piece, node)
    gram = np.zeros((ORDER + 1, count, count))
    for order in range(ORDER + 1):
        one = (pieces[order] * share) @ pieces[order].T * per_unit ** (2 * order - 1)
        for first in range(count - DEGREE):
            gram[order, first : first + 4, first : first + 4] += one
    return gram


def precision(parts: Array, smoothness: Smoothness) -> Array:
    """Of one coordinate's control points, in units of the residuals' variance."""
    kappa = 4 / smoothness.length
    total = sum(comb(ORDER, k) * kappa ** (2 * (ORDER - k)) * parts[k] for k in range(ORDER + 1))
    result: Array = total / (8 * pi * kappa**4 * smoothness.amplitude**2)
    return result


PIN = 1e3
"""Precision of what is left to others, times the largest of the normal matrix."""


@dataclass(frozen=True, eq=False)
class SurfaceProblem:
    """Squares of residuals as a function of the control points, all else eliminated: `s + 2 g'd + d'N d`."""

    normal: Array  # (2 K, 2 K)
    gradient: Array  # (2 K,)
    square: float
    freedom: int  # residuals less the unknowns that were eliminated
    pinned: Array  # (2 K, B) directions that are left to others
    parts: Array  # see `roughness`

    def prior(self, one: Array) -> Array:
        """The precision (2 K, 2 K) with that of one coordinate's points (K, K), what is left to others held at zero."""
        total: Array = PIN * float(np.diagonal(self.normal).max()) * (self.pinned @ self.pinned.T)
        half = len(one)
        total[:half, :half] += one
        total[half:, half:] += one
        return total


START = Smoothness(0.5, 30.0)
BOUNDS = (0.05, 20.0), (1e-3, 1e7)
FIRST_TRIALS, MORE_TRIALS = 30, 8
CLOSE, ALIKE = 0.2, 1.0
"""Of the logarithms of the two numbers, and of the likelihood: held-out photos do not tell apart what is closer."""


def likeliest(found: SurfaceProblem, start: Smoothness | None = None) -> Smoothness:
    """The smoothness of the greatest marginal likelihood (Rasmussen and Williams 2006, section 5.4)."""
    from scipy.optimize import minimize

    first = np.log([getattr(start or START, name) for name in ("length", "amplitude")])
    simplex = first + (1.0 if start is None else 0.3) * np.array([[0, 0], [0.7, 0], [0, 1.5]])
    best = minimize(
        lambda x: misfit(found, Smoothness(*np.exp(x).tolist())),
        first, method="Nelder-Mead", bounds=np.log(BOUNDS),
        options={
            "initial_simplex": simplex, "maxfev": FIRST_TRIALS if start is None else MORE_TRIALS,
            "xatol": CLOSE, "fatol": ALIKE,
        },
    )  # fmt: skip
    return Smoothness(*np.exp(best.x).tolist())


def misfit(found: SurfaceProblem, smoothness: Smoothness) -> float:
    """Minus twice the logarithm of the likelihood of the residuals, control points and noise integrated out.

    The control points are `Z y`, Z being orthogonal to the directions U that are left to others: with a precision Q,
    `log |Z'QZ| = log |Q| + log |U'Q^-1 U|`.
    """
    from scipy.linalg.lapack import dpotrf, dpotrs, dtrtrs

    one = precision(found.parts, smoothness)
    belief, failed = dpotrf(one, lower=1)
    total, failed_too = dpotrf((found.normal + found.prior(one)).T, lower=1, overwrite_a=1)
    if failed or failed_too:
        return np.inf
    told = dtrtrs(total, found.gradient, lower=1)[0]
    left = found.square - float(told @ told)
    if not left > 0:
        return np.inf
    columns = found.pinned.reshape(2, len(one), -1)
    across = sum(column.T @ dpotrs(belief, column, lower=1)[0] for column in columns)
    logs = float(np.log(np.diagonal(total)).sum() - 2 * np.log(np.diagonal(belief)).sum())
    return found.freedom * float(np.log(left / found.freedom)) + 2 * logs - float(np.linalg.slogdet(across)[1])
