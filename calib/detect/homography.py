"""Homographies from points, with covariance, and the vanishing line they carry."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calib.linear_algebra import least_squares, symmetric_inverse

Floats: TypeAlias = NDArray[np.float64]

LEAST_DETERMINED = 1e-6
"""Least share of the second smallest eigenvalue: two rows of a hundred points have more, a bent row less."""


def apply(homography: Floats, point: Floats) -> Floats:
    """Map points of a plane.  # (3, 3), (..., 2) -> (..., 2)"""
    mapped = point @ homography[:, :2].T + homography[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(mapped[..., :2] / mapped[..., 2:])


def _normaliser(point: Floats) -> Floats:
    """The similarity that brings points to the origin and a mean distance of sqrt(2).  # (N, 2) -> (3, 3)"""
    centre = point.mean(axis=0)
    scale = np.sqrt(2) / max(float(np.linalg.norm(point - centre, axis=1).mean()), 1e-12)
    return np.array([[scale, 0, -scale * centre[0]], [0, scale, -scale * centre[1]], [0, 0, 1]])


def is_determined(plane: Floats) -> bool:
    """Whether images of these points fix a homography: four of them stand in general position.

    All points but one on a line leave it open, and what is solved from them is noise. The equations of the map that
    leaves the points where they are have rank eight then, as those of any other map.  # (N, 2)
    """
    if len(plane) < 4:
        return False
    x = apply(_normaliser(plane), plane)
    eigenvalue = np.linalg.eigvalsh(_normal_matrix(x, x))
    return bool(eigenvalue[1] > LEAST_DETERMINED * eigenvalue[-1])


def _normal_matrix(x: Floats, u: Floats) -> Floats:
    """Of the direct linear transform from x to u: the homography spans its null space.  # (N, 2) twice -> (9, 9)"""
    one = np.column_stack([x, np.ones(len(x))])
    zero = np.zeros_like(one)
    rows = np.concatenate([np.hstack([one, zero, -u[:, :1] * one]), np.hstack([zero, one, -u[:, 1:] * one])])
    return np.asarray(rows.T @ rows)


def direct(plane: Floats, image: Floats) -> Floats:
    """Direct linear transform with normalised points (Hartley), which must be `is_determined`.  # (N, 2) twice"""
    to_plane, to_image = _normaliser(plane), _normaliser(image)
    x, u = apply(to_plane, plane), apply(to_image, image)
    _, vectors = np.linalg.eigh(_normal_matrix(x, u))
    homography = np.linalg.inv(to_image) @ vectors[:, 0].reshape(3, 3) @ to_plane
    return scaled(homography, plane)


def scaled(homography: Floats, plane: Floats) -> Floats:
    """The same map, its denominator 1 at the points' mean, where they are seen from the front."""
    middle = plane.mean(axis=0)
    return np.asarray(homography / (homography[2, :2] @ middle + homography[2, 2]))


def fit(plane: Floats, image: Floats, weight: Floats, rounds: int = 4) -> tuple[Floats, Floats, Floats]:
    """Least squares on the image distances, by Gauss-Newton from the direct solution.

    Args:
        plane: points in the plane.  # (N, 2)
        image: their images.  # (N, 2)
        weight: inverse variance of each.  # (N,)
        rounds: Gauss-Newton steps.

    Returns:
        The homography (3, 3), the inverse of its normal matrix in its first eight entries with the points moved to
        their mean (8, 8), and the residuals (N, 2); nan where the points are not
        `is_determined`.
    """
    middle = plane.mean(axis=0)
    size = max(float(np.abs(plane - middle).max()), 1e-12)
    x = (plane - middle) / size
    if not is_determined(x):
        return np.full((3, 3), np.nan), np.full((8, 8), np.nan), np.full(image.shape, np.nan)
    homography = direct(x, image)  # 1 at the points' mean, which is x = 0
    normal = np.eye(8)
    for _ in range(rounds):
        mapped, jacobian = linearised(homography, x)
        residual = image - mapped
        weighted = jacobian * weight[:, None, None]
        normal = np.einsum("nia,nib->ab", weighted, jacobian)
        step = least_squares(normal, np.einsum("nia,ni->a", weighted, residual))
        homography = (homography.ravel() + np.append(step, 0.0)).reshape(3, 3)
    shift = np.array([[1 / size, 0, -middle[0] / size], [0, 1 / size, -middle[1] / size], [0, 0, 1]])
    residual = image - apply(homography, x)
    return homography @ shift, symmetric_inverse(normal).inverse, residual


def linearised(homography: Floats, point: Floats) -> tuple[Floats, Floats]:
    """Mapped points (N, 2), and their derivatives by the first eight entries of the homography (N, 2, 8)."""
    one = np.column_stack([point, np.ones(len(point))])
    mapped = one @ homography.T
    inverse = 1 / mapped[:, 2:]
    u = mapped[:, :2] * inverse
    jacobian = np.zeros((len(point), 2, 8))
    jacobian[:, 0, 0:3] = one * inverse
    jacobian[:, 1, 3:6] = one * inverse
    jacobian[:, :, 6:8] = -u[:, :, None] * point[:, None, :] * inverse[:, :, None]
    return u, jacobian


def vanishing_terms(homography: Floats, image: Floats) -> Floats:
    """The line term m at image points: the vanishing line is `m . (u - point) = 1`.  # (3, 3), (N, 2) -> (N, 2)"""
    line = np.linalg.inv(homography)[2]
    return np.asarray(-line[:2] / (image @ line[:2] + line[2])[:, None])


def vanishing_covariance(homography: Floats, plane: Floats, covariance: Floats, image: Floats) -> Floats:
    """Covariance of m at image points, from that of the homography as `fit` returns it.  # -> (N, 2, 2)"""
    middle = plane.mean(axis=0)
    size = max(float(np.abs(plane - middle).max()), 1e-12)
    back = np.array([[size, 0, middle[0]], [0, size, middle[1]], [0, 0, 1]])
    local = homography @ back
    base = vanishing_terms(local, image)
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0))
    derivative = np.zeros((len(image), 2, 8))
    for k in range(8):
        step = 1e-3 * sigma[k] if sigma[k] > 0 else 1e-12
        moved = local.ravel().copy()
        moved[k] += step
        derivative[:, :, k] = (vanishing_terms(moved.reshape(3, 3), image) - base) / step
    return np.asarray(np.einsum("nia,ab,njb->nij", derivative, covariance, derivative))
