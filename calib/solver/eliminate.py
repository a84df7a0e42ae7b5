"""The normal equations of one adjustment, solved by blocks, and factors of their inverse.

Poses couple to each other only through rings and what is shared, and so do the rings' offsets. Of the two the one with
more unknowns is eliminated block by block (Schur complement; Triggs et al. 2000, section 6): with blocks `C = L L'` and
their couplings B, `S = A - (L^-1 B)' (L^-1 B)` is left.

Poses that hang on others: `cam_from_target = cam_from_rig rig_from_target`, and what that makes of normal equations.

The kernels know a view's pose `cam_from_target` and its six numbers. With a rig these six are linear, to first order,
in the frame's six and in unknowns that frames share (where the camera stands, when it takes its photos), so that
equations over views become equations over frames by products with small matrices; residuals stay the same.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cho_solve, cholesky, solve_triangular

from calib.core.jit import jit
from calib.core.se3 import skew
from calib.core.small_solve import cholesky_factor
from designer.base.arrays import Array, Rows


@dataclass(frozen=True, eq=False)
class Normal:
    """The normal equations `H x = -g` of V poses, R offsets (or none) and G others: cameras, then what else is shared.

    A row of the rings' couplings has the poses first, then the others, then the gradient.
    """

    pose: Array  # (V, 6, 6)
    pose_row: Array  # (V, 6, G + 1)
    ring: Array  # (R, 3, 3)
    ring_row: Array  # (R, 3, 6 V + G + 1)
    other: Array  # (G, G + 1)
    cost: float  # squares of the whitened residuals, and of the priors; nan if an observation has no image
    squares: float  # without the priors
    residual_px: tuple[Array, ...]  # (2, M) of each camera, predicted - measured


@dataclass(frozen=True, eq=False)
class JointStep:
    """A step of all unknowns, and what it promises."""

    pose: Array  # (V, 6)
    ring: Array  # (R, 3)
    other: Array  # (G,)
    predicted: float  # decrease of the cost by the undamped quadratic model


@dataclass(frozen=True, eq=False)
class Arrow:
    """Blocks C with their couplings to a dense rest A; the last columns are gradients."""

    block: Array  # (N, B, B)
    row: Array  # (N, B, K + 1)
    rest: Array  # (K, K + 1)
    rings_first: bool  # the blocks are the rings', and the rest has the poses first; else the other way round


@jit
def _whiten(block: Array, row: Array) -> bool:
    """Replace blocks by their lower factors L and rows by `L^-1 row`."""
    size, width = block.shape[1], row.shape[2]
    for n in range(len(block)):
        lower, x = block[n], row[n]
        if not cholesky_factor(lower):
            return False
        for i in range(size):
            for k in range(i):
                factor = lower[i, k]
                for j in range(width):
                    x[i, j] -= factor * x[k, j]
            inverse = 1 / lower[i, i]
            for j in range(width):
                x[i, j] *= inverse
    return True


@jit
def _back(block: Array, x: Array) -> None:
    """Replace x by `L^-T x`, block by block."""
    size = block.shape[1]
    for n in range(len(block)):
        lower = block[n]
        for i in range(size - 1, -1, -1):
            for j in range(x.shape[2]):
                value = x[n, i, j]
                for k in range(i + 1, size):
                    value -= lower[k, i] * x[n, k, j]
                x[n, i, j] = value / lower[i, i]


def arrow_of(normal: Normal, damping: float) -> Arrow:
    """The damped normal equations, arranged so that the more numerous unknowns are eliminated."""
    rings_first = 3 * len(normal.ring) > 6 * len(normal.pose)
    blocks, kept = (normal.ring, normal.pose) if rings_first else (normal.pose, normal.ring)
    others, size = len(normal.other), kept.shape[0] * kept.shape[1]
    rest = np.zeros((size + others, size + others + 1))
    width, poses = kept.shape[1], 6 * len(normal.pose)
    for n, block in enumerate(kept):
        rest[n * width : (n + 1) * width, n * width : (n + 1) * width] = block
    if rings_first:
        row = normal.ring_row.copy()
        kept_row = normal.pose_row.reshape(-1, others + 1)
    else:
        coupling = normal.ring_row.reshape(size, normal.ring_row.shape[2])
        row = np.concatenate([coupling[:, :poses].T, normal.pose_row.reshape(-1, others + 1)], axis=1)
        row = np.ascontiguousarray(row.reshape(len(normal.pose), 6, -1))
        kept_row = coupling[:, poses:]
    rest[:size, size:] = kept_row
    rest[size:, :size] = kept_row[:, :-1].T
    rest[size:, size:] = normal.other
    diagonal = np.arange(len(rest))
    rest[diagonal, diagonal] *= 1 + damping
    return Arrow(blocks * (1 + damping * np.eye(blocks.shape[1])), row, rest, rings_first)


def _reduce(arrow: Arrow) -> tuple[Array, Array] | None:
    """The rest's matrix S (K, K) and gradient (K,) with the blocks eliminated, which are replaced by their factors."""
    if not _whiten(arrow.block, arrow.row):
        return None
    row = arrow.row.reshape(-1, arrow.row.shape[2])
    inner = row.T @ row
    return arrow.rest[:, :-1] - inner[:-1, :-1], arrow.rest[:, -1] - inner[:-1, -1]


def _scaled_factor(matrix: Array) -> tuple[Array, Array] | None:
    """The lower factor of a matrix with a diagonal of ones, and what it was scaled by; None: not definite."""
    diagonal = np.diagonal(matrix)
    if not (diagonal > 0).all():
        return None
    scale = 1 / np.sqrt(diagonal)
    try:
        return cholesky(matrix * scale[:, None] * scale, lower=True, check_finite=True), scale
    except (LinAlgError, ValueError):
        return None


def damped_step(normal: Normal, damping: float) -> JointStep | None:
    """The step that `(H + damping diag H) x = -g` asks for; None if there is none."""
    arrow = arrow_of(normal, damping)
    reduced = _reduce(arrow)
    factor = None if reduced is None else _scaled_factor(reduced[0])
    if reduced is None or factor is None:
        return None
    lower, scale = factor
    kept = -scale * cho_solve((lower, True), scale * reduced[1])
    row = arrow.row.reshape(-1, arrow.row.shape[2])
    gone = -(row[:, :-1] @ kept + row[:, -1]).reshape(*arrow.row.shape[:2], 1)
    _back(arrow.block, gone)
    others = len(normal.other)
    first, other = kept[: len(kept) - others], kept[len(kept) - others :]
    pose, ring = (first, gone[:, :, 0]) if arrow.rings_first else (gone[:, :, 0], first)
    pose, ring = pose.reshape(-1, 6), ring.reshape(-1, 3)
    return JointStep(pose, ring, other, _predicted(normal, pose, ring, other, damping))


def _predicted(normal: Normal, pose: Array, ring: Array, other: Array, damping: float) -> float:
    """`-(2 g x + x' H x)`, which for the damped solution x is `-g x + damping sum diag(H) x^2`."""
    slope = (normal.pose_row[:, :, -1] * pose).sum() + normal.other[:, -1] @ other
    slope += (normal.ring_row[:, :, -1] * ring).sum()
    curve = (np.einsum("vii->vi", normal.pose) * pose**2).sum() + np.diagonal(normal.other) @ other**2
    curve += (np.einsum("rii->ri", normal.ring) * ring**2).sum()
    return float(-slope + damping * curve)


@dataclass(frozen=True, eq=False)
class Factor:
    """A factor of the covariance: unknowns are `other @ n` and `ring @ n + ring_own @ m` of standard normal n, m."""

    other: Array  # (G, K)
    ring: Array  # (R, 3, K)
    ring_own: Array  # (R, 3, 3), m is of each ring on its own


def covariance_factor(normal: Normal) -> Factor | None:
    """The factor of the inverse of the normal matrix, without the poses; None if it is not definite."""
    arrow = arrow_of(normal, 0.0)
    reduced = _reduce(arrow)
    factor = None if reduced is None else _scaled_factor(reduced[0])
    if factor is None:
        return None
    lower, scale = factor
    inverse = solve_triangular(lower, np.diag(scale), lower=True).T  # S^-1 = inverse inverse'
    others, rings = len(normal.other), len(normal.ring)
    other = inverse[len(inverse) - others :]
    if not arrow.rings_first:
        return Factor(other, inverse[: 3 * rings].reshape(rings, 3, len(inverse)), np.zeros((rings, 3, 3)))
    row = arrow.row.reshape(-1, arrow.row.shape[2])
    ring = -(row[:, :-1] @ inverse).reshape(rings, 3, -1)
    _back(arrow.block, ring)
    own = np.tile(np.eye(3), (rings, 1, 1))
    _back(arrow.block, own)
    return Factor(other, ring, own)


@dataclass(frozen=True, eq=False)
class Chain:
    """A step of the pose of view b of one camera: `by_frame[b] @ frame step + by_shared[b] @ shared[column] step`."""

    frame: Rows  # (B,) of each view, each another
    by_frame: Array  # (B, 6, 6)
    by_shared: Array  # (B, 6, K)
    column: Rows  # (K,) among the shared unknowns; -1: not free


def through_camera(cam_from_rig: Array, rig_from_target: Array) -> tuple[Array, Array]:
    """What steps of a frame's pose, and of the camera's own, do to `cam_from_target`: (B, 6, 6) each.

    All steps turn what is turned and shift the translation: `R' = exp(w) R, t' = t + s`, in the left frame's axes.

    Args:
        cam_from_rig: (4, 4)
        rig_from_target: (B, 4, 4)
    """
    rotation, views = cam_from_rig[:3, :3], len(rig_from_target)
    by_frame, by_camera = np.zeros((views, 6, 6)), np.tile(np.eye(6), (views, 1, 1))
    by_frame[:, :3, :3] = by_frame[:, 3:, 3:] = rotation
    by_camera[:, 3:, :3] = -skew(rig_from_target[:, :3, 3] @ rotation.T)
    return by_frame, by_camera


def no_equations(frames: int, shared: int) -> Normal:
    """Equations of nothing yet, without rings."""
    return Normal(
        np.zeros((frames, 6, 6)), np.zeros((frames, 6, shared + 1)), np.zeros((0, 3, 3)),
        np.zeros((0, 3, 6 * frames + shared + 1)), np.zeros((shared, shared + 1)), 0.0, 0.0, (),
    )  # fmt: skip


def add_chained(into: Normal, products: Array, params: Rows, chain: Chain) -> None:
    """Add one camera's equations over views to those over frames.

    Of blocks of its views (B, P + 7, P + 7); `params` are the shared unknowns of its parameters (P,); -1: fixed.
    """
    columns = np.concatenate([params, chain.column])
    free, place = np.unique(columns[columns >= 0], return_inverse=True)
    count, own = len(params), len(chain.column)
    pick = np.zeros((count + own, len(free)))  # parameters that share a value add up
    pick[columns >= 0, place] = 1.0
    of_pose = chain.by_shared @ pick[count:]
    residual = np.zeros((len(products), 6, 1))
    to_pose = np.concatenate([chain.by_frame, of_pose, residual], axis=2)  # (B, 6, 6 + Q + 1)
    width = to_pose.shape[2]
    design = np.zeros((len(products), count + 7, width))
    design[:, :count, 6 : width - 1] = pick[:count]
    design[:, count : count + 6] = to_pose
    design[:, -1, -1] = 1.0
    block = design.transpose(0, 2, 1) @ (products @ design)
    into.pose[chain.frame] += block[:, :6, :6]
    target = np.concatenate([free, [into.other.shape[0]]])
    into.pose_row[chain.frame[:, None, None], np.arange(6)[:, None], target] += block[:, :6, 6:]
    into.other[free[:, None], target] += block[:, 6:-1, 6:].sum(axis=0)
