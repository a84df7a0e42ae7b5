"""A damped Gauss-Newton step with the poses eliminated view by view (Schur complement; Triggs et al. 2000, section 6).

Of the normal equations `[A B; B' C]` over camera and poses, C is block diagonal. Each view's block is reduced to
`A - B C^-1 B'`; the sum over the views is solved for the camera, and its step put back into each view.
"""

from dataclasses import dataclass

import numpy as np

from calib.core.jit import jit
from calib.core.small_solve import cholesky_factor, substitute
from designer.base.arrays import Array, Rows


@dataclass(frozen=True, eq=False)
class Step:
    """A step of camera and poses, and what it promises."""

    free: Array  # (Q,) of the free parameters
    pose: Array  # (V, 6)
    predicted: float  # decrease of the cost by the undamped quadratic model
    solvable: bool


@jit
def _eliminate(
    products: Array, tie: Rows, damping: float, normal: Array, gradient: Array, lower: Array, part: Array
) -> bool:
    """Add each view's reduced block to `normal` and `gradient`.

    With C = L L' and W = L^-1 [B' g], what a view takes from them is W' W: no more than half a solution. Keeps L
    (V, 6, 6) and W (V, 6, Q + 1).
    """
    parameters, free = products.shape[1] - 7, normal.shape[0]
    for view in range(len(products)):
        h, c, w = products[view], lower[view], part[view]
        _add_camera(h, tie, damping, normal, gradient)
        w[:] = 0.0
        for i in range(6):
            for j in range(6):
                c[i, j] = h[parameters + i, parameters + j]
            c[i, i] *= 1 + damping
            for p in range(parameters):
                if tie[p] >= 0:
                    w[i, tie[p]] += h[parameters + i, p]
            w[i, free] = h[parameters + i, parameters + 6]
        if not cholesky_factor(c):
            return False
        _substitute_forward(c, w)
        for i in range(6):
            for p in range(free):
                gradient[p] -= w[i, p] * w[i, free]
                for q in range(free):
                    normal[p, q] -= w[i, p] * w[i, q]
    return True


@jit
def _substitute_forward(lower: Array, x: Array) -> None:
    """Solve L y = x of columns (6, K) in place."""
    for i in range(6):
        for k in range(i):
            for p in range(x.shape[1]):
                x[i, p] -= lower[i, k] * x[k, p]
        for p in range(x.shape[1]):
            x[i, p] /= lower[i, i]


@jit
def _substitute_back(lower: Array, x: Array) -> None:
    """Solve L' y = x of columns (6, K) in place."""
    for i in range(5, -1, -1):
        for k in range(i + 1, 6):
            for p in range(x.shape[1]):
                x[i, p] -= lower[k, i] * x[k, p]
        for p in range(x.shape[1]):
            x[i, p] /= lower[i, i]


@jit
def _add_camera(h: Array, tie: Rows, damping: float, normal: Array, gradient: Array) -> None:
    """Add a view's A and its gradient, parameters that share a value together."""
    parameters = len(tie)
    for p in range(parameters):
        if tie[p] >= 0:
            gradient[tie[p]] += h[p, parameters + 6]
            normal[tie[p], tie[p]] += damping * h[p, p]
            for q in range(parameters):
                if tie[q] >= 0:
                    normal[tie[p], tie[q]] += h[p, q]


@jit
def _solve_scaled(normal: Array, gradient: Array, step: Array) -> bool:
    """Solve `normal step = -gradient` after scaling the diagonal to one."""
    free = len(gradient)
    scale = np.empty(free)
    for i in range(free):
        if not normal[i, i] > 0:
            return False
        scale[i] = 1 / np.sqrt(normal[i, i])
    scaled = np.empty((free, free))
    for i in range(free):
        for j in range(free):
            scaled[i, j] = normal[i, j] * scale[i] * scale[j]
        step[i] = -gradient[i] * scale[i]
    if free > 0 and not cholesky_factor(scaled):
        return False
    substitute(scaled, step)
    for i in range(free):
        step[i] *= scale[i]
    return True


@jit
def _predicted(products: Array, tie: Rows, free: Array, pose: Array) -> float:
    """Decrease `-(2 g x + x' H x)` of the undamped model by the step x."""
    views, size = products.shape[0], products.shape[1]
    x = np.zeros(size - 1)
    for p in range(size - 7):
        x[p] = free[tie[p]] if tie[p] >= 0 else 0.0
    total = 0.0
    for view in range(views):
        for k in range(6):
            x[size - 7 + k] = pose[view, k]
        h = products[view]
        for i in range(size - 1):
            row = 2 * h[i, size - 1]
            for j in range(size - 1):
                row += h[i, j] * x[j]
            total -= x[i] * row
    return total


@jit
def _damped_step(products: Array, tie: Rows, damping: float, step: Array, pose: Array) -> tuple[bool, float]:
    free = len(step)
    normal, gradient = np.zeros((free, free)), np.zeros(free)
    lower, part = np.empty((len(products), 6, 6)), np.empty((len(products), 6, free + 1))
    if not _eliminate(products, tie, damping, normal, gradient, lower, part):
        return False, 0.0
    if not _solve_scaled(normal, gradient, step):
        return False, 0.0
    x = np.empty((6, 1))
    for view in range(len(products)):
        for k in range(6):
            x[k, 0] = -part[view, k, free]
            for q in range(free):
                x[k, 0] -= part[view, k, q] * step[q]
        _substitute_back(lower[view], x)
        pose[view] = x[:, 0]
    return True, _predicted(products, tie, step, pose)


def damped_step(products: Array, tie: Rows, damping: float) -> Step:
    """The step that `(H + damping diag H) x = -g` asks for, of blocks as `calib.solver.blocks` has them."""
    step = np.zeros(int(tie.max(initial=-1)) + 1)
    pose = np.zeros((len(products), 6))
    solvable, predicted = _damped_step(products, tie, damping, step, pose)
    return Step(step, pose, predicted, solvable)


def reduced_normal(products: Array, tie: Rows) -> tuple[Array, Array]:
    """The normal matrix (Q, Q) of the free parameters, the poses eliminated, and `C^-1 B'` of each view (V, 6, Q)."""
    free = int(tie.max(initial=-1)) + 1
    normal, inverse_times = np.zeros((free, free)), np.empty((len(products), 6, free + 1))
    if not _reduced_normal(products, tie, normal, inverse_times):
        raise np.linalg.LinAlgError("a view's pose is not determined")
    return normal, inverse_times[:, :, :free]


@jit
def _reduced_normal(products: Array, tie: Rows, normal: Array, inverse_times: Array) -> bool:
    lower = np.empty((len(products), 6, 6))
    if not _eliminate(products, tie, 0.0, normal, np.zeros(len(normal)), lower, inverse_times):
        return False
    for view in range(len(products)):
        _substitute_back(lower[view], inverse_times[view])
    return True


def reduced_blocks(products: Array) -> Array:
    """Each view's block over parameters and residual, its pose eliminated (V, P + 1, P + 1)."""
    size = products.shape[1] - 6
    reduced = np.empty((len(products), size, size))
    if not _reduce(products, np.arange(size - 1), reduced):
        raise np.linalg.LinAlgError("a view's pose is not determined")
    return reduced


@jit
def _reduce(products: Array, every: Rows, reduced: Array) -> bool:
    """[A a; a' s] - W' W of each view, see `_eliminate`."""
    count = len(every)
    lower, part = np.empty((len(products), 6, 6)), np.empty((len(products), 6, count + 1))
    if not _eliminate(products, every, 0.0, np.zeros((count, count)), np.zeros(count), lower, part):
        return False
    for view in range(len(products)):
        h, w = products[view], part[view]
        for p in range(count + 1):
            for q in range(count + 1):
                value = h[p if p < count else count + 6, q if q < count else count + 6]
                for i in range(6):
                    value -= w[i, p] * w[i, q]
                reduced[view, p, q] = value
    return True
