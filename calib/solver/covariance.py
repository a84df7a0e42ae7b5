"""Covariances from the normal equations at the minimum."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.solver.schur import reduced_normal

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Accuracy:
    """What is known of the unknowns, with the posterior scale factor in it; nan where they are not determined."""

    scale: float  # sqrt(sum of squares / redundancy)
    param_covariance: Array  # (P, P)
    pose_covariance: Array  # (V, 6, 6)
    weakest: Array  # (P,) the least determined direction, each parameter in units of its own conditional deviation
    weakest_eigenvalue: float  # of the normal matrix with a diagonal of ones; 0: not determined


def accuracy_of(
    products: Array, tie: NDArray[np.int64], used: int, robust: tuple[float, float] | None = None
) -> Accuracy:
    """The covariances of camera and poses.

    With the normal matrix `[A B; B' C]`, that of the camera is `S^-1` of `S = A - B C^-1 B'`, and that of a pose
    `C^-1 + C^-1 B' S^-1 B C^-1`; both times the scale squared.

    Args:
        products: the views' blocks at the minimum (V, P + 7, P + 7).
        tie: the free parameter that each parameter follows (P,); -1: fixed.
        used: observations that count.
        robust: if weights were lowered, the standard deviation of an observation, which the squares then do not tell,
            and the factor that makes the inverse normal matrix a covariance.
    """
    views, parameters = len(products), len(tie)
    free = int(tie.max(initial=-1)) + 1
    redundancy = 2 * used - free - 6 * views
    squares = float(products[:, -1, -1].sum())
    scale = float(np.sqrt(squares / redundancy)) if redundancy > 0 else float("nan")
    factor = scale**2
    if robust is not None and redundancy > 0:
        scale, factor = robust[0], robust[1] * 2 * used / redundancy
    spread: Array = (tie[:, None] == np.arange(free)).astype(np.float64)  # (P, Q)
    nothing = Accuracy(
        scale, np.full((parameters, parameters), np.nan), np.full((views, 6, 6), np.nan), np.zeros(parameters), 0.0
    )
    try:
        normal, inverse_times = reduced_normal(products, tie)
        pose_inverse = np.linalg.inv(products[:, -7:-1, -7:-1])
    except np.linalg.LinAlgError:
        return nothing
    if free == 0:
        return Accuracy(
            scale, np.zeros((parameters, parameters)), np.asarray(factor * pose_inverse), np.zeros(parameters), 1.0
        )
    diagonal = np.diagonal(normal)
    before = np.einsum("vpp->p", products[:, :parameters, :parameters]) @ spread
    # Against what a parameter had before the poses were let free: a direction that they take up whole is close to 0.
    if not (np.isfinite(normal).all() and (before > 0).all() and (diagonal > 0).all()):
        return nothing
    root = np.sqrt(diagonal)
    values, vectors = np.linalg.eigh(normal / (root[:, None] * root))
    weakest_eigenvalue = float(values[0] * min((diagonal / before).min(), 1.0))
    weakest = spread @ vectors[:, 0]
    if not values[0] > 0:
        return Accuracy(scale, nothing.param_covariance, nothing.pose_covariance, weakest, 0.0)
    inverse = (vectors / values) @ vectors.T / (root[:, None] * root)
    pose = pose_inverse + inverse_times @ inverse @ inverse_times.transpose(0, 2, 1)
    return Accuracy(scale, factor * spread @ inverse @ spread.T, factor * pose, weakest, weakest_eigenvalue)
