"""A damped Gauss-Newton step with the poses eliminated view by view (Schur complement; Triggs et al. 2000, section 6).

Of the normal equations `[A B; B' C]` over camera and poses, C is block diagonal. Each view's block is reduced to
`A - B C^-1 B'`; the sum over the views is solved for the camera, and its step put back into each view.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.jit import jit
from calib.small_solve import cholesky_factor, substitute

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Step:
    """A step of camera and poses, and what it promises."""

    free: Array  # (Q,) of the free parameters
    pose: Array  # (V, 6)
    predicted: float  # decrease of the cost by the undamped quadratic model
    solvable: bool


@jit
def _eliminate(
    products: Array, tie: NDArray[np.int64], damping: float, normal: Array, gradient: Array, inverse_times: Array
) -> bool:
    """Add each view's reduced block to `normal` and `gradient`; keep `C^-1 [B' g]` (V, 6, Q + 1)."""
    parameters, free = products.shape[1] - 7, normal.shape[0]
    c = np.empty((6, 6))
    for view in range(len(products)):
        h = products[view]
        _add_camera(h, tie, damping, normal, gradient)
        solved = inverse_times[view]
        solved[:] = 0.0
        for i in range(6):
            for j in range(6):
                c[i, j] = h[parameters + i, parameters + j]
            c[i, i] *= 1 + damping
            for p in range(parameters):
                if tie[p] >= 0:
                    solved[i, tie[p]] += h[parameters + i, p]
            solved[i, free] = h[parameters + i, parameters + 6]
        if not cholesky_factor(c):
            return False
        before = solved.copy()
        for column in range(free + 1):
            substitute(c, solved[:, column])
        for i in range(6):
            for p in range(free):
                gradient[p] -= before[i, p] * solved[i, free]
                for q in range(free):
                    normal[p, q] -= before[i, p] * solved[i, q]
    return True


@jit
def _add_camera(h: Array, tie: NDArray[np.int64], damping: float, normal: Array, gradient: Array) -> None:
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
def _predicted(products: Array, tie: NDArray[np.int64], free: Array, pose: Array) -> float:
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
def _damped_step(
    products: Array, tie: NDArray[np.int64], damping: float, step: Array, pose: Array
) -> tuple[bool, float]:
    free = len(step)
    normal, gradient = np.zeros((free, free)), np.zeros(free)
    inverse_times = np.empty((len(products), 6, free + 1))
    if not _eliminate(products, tie, damping, normal, gradient, inverse_times):
        return False, 0.0
    if not _solve_scaled(normal, gradient, step):
        return False, 0.0
    for view in range(len(products)):
        for k in range(6):
            pose[view, k] = -inverse_times[view, k, free]
            for q in range(free):
                pose[view, k] -= inverse_times[view, k, q] * step[q]
    return True, _predicted(products, tie, step, pose)


def damped_step(products: Array, tie: NDArray[np.int64], damping: float) -> Step:
    """The step that `(H + damping diag H) x = -g` asks for.

    Args:
        products: the views' blocks (V, P + 7, P + 7), see `calib.solver.blocks`.
        tie: the free parameter that each parameter follows (P,); -1: fixed.
        damping: Marquardt's factor.
    """
    step = np.zeros(int(tie.max(initial=-1)) + 1)
    pose = np.zeros((len(products), 6))
    solvable, predicted = _damped_step(products, tie, damping, step, pose)
    return Step(step, pose, predicted, solvable)


def reduced_normal(products: Array, tie: NDArray[np.int64]) -> tuple[Array, Array]:
    """The normal matrix of the free parameters with the poses eliminated (Q, Q), and `C^-1 B'` of each view (V, 6, Q).

    Raises:
        np.linalg.LinAlgError: a view's pose is not determined.
    """
    free = int(tie.max(initial=-1)) + 1
    normal, gradient = np.zeros((free, free)), np.zeros(free)
    inverse_times = np.empty((len(products), 6, free + 1))
    if not _eliminate(products, tie, 0.0, normal, gradient, inverse_times):
        raise np.linalg.LinAlgError("a view's pose is not determined")
    return normal, inverse_times[:, :, :free]


def reduced_blocks(products: Array) -> Array:
    """Each view's block over parameters and residual, its pose eliminated (V, P + 1, P + 1).

    Raises:
        np.linalg.LinAlgError: a view's pose is not determined.
    """
    size = products.shape[1] - 6
    reduced = np.empty((len(products), size, size))
    if not _reduce(products, reduced):
        raise np.linalg.LinAlgError("a view's pose is not determined")
    return reduced


@jit
def _reduce(products: Array, reduced: Array) -> bool:
    """With C = L L' of the pose's block and W = L^-1 [B' g], what is left is [A a; a' s] - W' W."""
    parameters = products.shape[1] - 7
    lower, part = np.empty((6, 6)), np.empty((6, parameters + 1))
    for view in range(len(products)):
        h = products[view]
        lower[:] = h[parameters : parameters + 6, parameters : parameters + 6]
        if not cholesky_factor(lower):
            return False
        for p in range(parameters + 1):
            column = p if p < parameters else p + 6
            for i in range(6):
                value = h[parameters + i, column]
                for k in range(i):
                    value -= lower[i, k] * part[k, p]
                part[i, p] = value / lower[i, i]
        for p in range(parameters + 1):
            for q in range(parameters + 1):
                value = h[p if p < parameters else p + 6, q if q < parameters else q + 6]
                for i in range(6):
                    value -= part[i, p] * part[i, q]
                reduced[view, p, q] = value
    return True
