"""What is fixed in the image and that the lens model does not follow, and what the parameters took of it.

    calibration = with_image_field(calibration)
    calibration.image_field.left_px, calibration.stated_covariance

A lens that is not of the model's kind, or a picture that was warped or resampled, displaces all sightings at one place
of the image alike. Halves of the photos agree on it; the parameters take up what looks like a lens; only the rest shows
in the residuals. If the displacement is a Gaussian process over the image, the rest tells how much the parameters took
(restricted maximum likelihood; Patterson and Thompson 1971, Recovery of inter-block information, Biometrika 58). With
X and Z the derivatives of the whitened residuals r by camera and field, the poses eliminated from all of them,

    r = X c + Z z + noise,   noise ~ N(0, v),   z ~ N(0, a^2 K(l)),

the amplitude a and the length l are the likeliest for what c does not take up, and the camera's covariance is more by
`a^2 T K T'`, T = (X' X)^-1 X' Z. K is Matern's with the smoothness 5/2: twice differentiable as lenses are, rough where
l is short. That the large scales, which the camera takes, follow from the smaller ones, which show, is an assumption: a
field that looks like a lens to begin with is larger than is stated. The longer l, the more is taken to follow so; where
the residuals do not tell a longer one from a shorter one, the shorter one stands.
"""

from dataclasses import dataclass, replace

import numpy as np

from calib.cameras.surface import surface_model
from calib.core.linear_algebra import symmetric_inverse
from calib.core.parallel import one_thread
from calib.solver.calibration import Calibration, ImageField
from calib.solver.free_shape import POSE, WhitenedView, free_directions, whitened_views
from designer.base.arrays import Array, Rows

ACROSS = 15
"""Nodes along the longer side of the image, between which the field is bilinear; 11 to 21 state much the same."""
LENGTHS = 2.0 ** np.arange(-2, 6)
"""Of the correlation, in distances of nodes: from nodes on their own to more than the image."""
AMPLITUDES = np.geomspace(1e-2, 1e8, 101)
"""a^2 over the mean variance of the noise."""
SURE = 10.0
"""Twice the logarithm of the likelihood's gain, by a field and by each longer correlation than the last that stands:
noise alone reaches it in less than 1 of 100 calibrations."""


@one_thread
def with_image_field(calibration: Calibration) -> Calibration:
    """The calibration with what its parameters may have taken of a field; the solution stays as it is.

    Without one where the residuals do not show it beyond chance.
    """
    without = replace(calibration, image_field=None)
    basis = free_directions(calibration.param_covariance)
    if not basis.size or calibration.camera.learned is not None or surface_model(calibration.camera.model):
        return without  # a map and a surface follow what is fixed in the image
    equations = _equations(calibration, basis)
    if not (equations.freedom > 0 and equations.square > 0):
        return without
    covariance = _likeliest(equations)
    if not covariance.any():
        return without
    taken = basis @ equations.taken
    left_px = float(np.sqrt((equations.normal * covariance).sum() / equations.weights))
    return replace(calibration, image_field=ImageField(left_px, taken @ covariance @ taken.T))


@dataclass(frozen=True, eq=False)
class _Nodes:
    """The field's nodes and how the sightings lie between them."""

    place_px: Array  # (K, 2)
    spacing_px: float
    corner: Rows  # (M, 4) the nodes about each sighting
    share: Array  # (M, 4) theirs in it, in sum 1; 0 of sightings that do not count


@dataclass(frozen=True, eq=False)
class _Equations:
    """Normal equations of 2 K displacements of nodes, first all u, then all v; poses and camera eliminated."""

    normal: Array  # (2 K, 2 K)
    gradient: Array  # (2 K,)
    square: float  # of the residuals
    freedom: int
    taken: Array  # (Q, 2 K) T, what the camera takes of each
    count: int  # of residuals
    weights: float  # sum of their squares: a residual of 1 stands for sqrt(count / weights) px
    nodes: _Nodes


def _nodes(calibration: Calibration) -> _Nodes:
    """Nodes (rows, columns) over the image; only those about sightings that count."""
    size = np.array(calibration.camera.image_size, dtype=np.float64)
    cells = np.maximum(np.round((ACROSS - 1) * size / size.max()), 1).astype(np.int64)
    cell = size / cells
    # Where the camera shows the points: a field that is taken where they were measured, and scales the image, would
    # repeat their residuals. The first pixel's outer edge is at -.5; what lies beyond the image counts as at its edge.
    shown_px = calibration.observations.center_px + calibration.residual_px
    shown_px[calibration.is_outlier] = 0.0
    at = np.clip((shown_px + 0.5) / cell, 0.0, cells)
    first = np.minimum(at.astype(np.int64), cells - 1)
    right, below = (at - first).T
    node = first[:, 1] * (cells[0] + 1) + first[:, 0]
    corner = node[:, None] + np.array([0, 1, cells[0] + 1, cells[0] + 2])
    share = np.stack([(1 - right) * (1 - below), right * (1 - below), (1 - right) * below, right * below], axis=1)
    used, slot = np.unique(corner[~calibration.is_outlier], return_inverse=True)
    place = np.stack([used % (cells[0] + 1), used // (cells[0] + 1)], axis=1) * cell - 0.5
    among = np.zeros_like(corner)
    among[~calibration.is_outlier] = slot.reshape(-1, 4)
    share[calibration.is_outlier] = 0.0
    return _Nodes(place, float(cell.mean()), among, share)


def _equations(calibration: Calibration, basis: Array) -> _Equations:
    nodes, inner = _nodes(calibration), basis.shape[1]
    count = len(nodes.place_px)
    square, cross = np.zeros((inner + 1,) * 2), np.zeros((2 * count, inner + 1))
    normal, taken, taken_field = np.zeros((2 * count,) * 2), [np.zeros((0, inner + 1))], [np.zeros((0, 2 * count))]
    freedom, residuals, weights = -inner, 0, 0.0
    for view in whitened_views(calibration, basis):
        if 2 * len(view.row) <= POSE:
            continue
        column, by_node = _by_nodes(nodes, view, count)
        known = np.concatenate([view.by_camera, view.residual], axis=2)
        square += np.einsum("mip,miq->pq", known, known)
        np.add.at(cross, column, by_node.transpose(0, 2, 1) @ known)
        np.add.at(normal, (column[:, :, None], column[:, None, :]), by_node.transpose(0, 2, 1) @ by_node)
        across = view.poses_taken()
        part = np.zeros((POSE, 2 * count))
        np.add.at(part, (np.arange(POSE)[:, None], column[:, None, :]), across.transpose(0, 2, 1) @ by_node)
        taken.append(np.einsum("mij,mip->jp", across, known))
        taken_field.append(part)
        freedom += 2 * len(view.row) - POSE
        residuals += 2 * len(view.row)
        weights += float((view.weight**2).sum())
    by_poses, field_by_poses = np.concatenate(taken), np.concatenate(taken_field)
    square -= by_poses.T @ by_poses
    cross -= field_by_poses.T @ by_poses
    normal -= field_by_poses.T @ field_by_poses
    inverse = symmetric_inverse(square[:-1, :-1]).inverse
    by_camera, pull = inverse @ cross[:, :-1].T, inverse @ square[:-1, -1]
    return _Equations(
        normal - cross[:, :-1] @ by_camera, cross[:, -1] - cross[:, :-1] @ pull,
        float(square[-1, -1] - square[-1, :-1] @ pull), freedom, by_camera, residuals, weights, nodes,
    )  # fmt: skip


def _by_nodes(nodes: _Nodes, view: WhitenedView, count: int) -> tuple[Rows, Array]:
    """The eight columns that each sighting depends on (M, 8), and its derivatives by them (M, 2, 8)."""
    corner, share = nodes.corner[view.row], nodes.share[view.row]
    derivative = view.weight[:, :, :, None] * share[:, None, None, :]
    return np.concatenate([corner, corner + count], axis=1), derivative.reshape(len(corner), 2, 8)


def _likeliest(equations: _Equations) -> Array:
    """The covariance of the field's nodes (2 K, 2 K); zero if noise alone explains the residuals.

    In the eigenvectors of `R' normal R`, K = R R', the likelihood is a sum for every amplitude at once.
    """
    freedom, square = equations.freedom, equations.square
    alone = freedom * np.log(square / freedom)
    ratio = AMPLITUDES * equations.count / equations.weights
    best, covariance = 0.0, np.zeros_like(equations.normal)
    for length in LENGTHS:
        field = _correlation(equations.nodes, length)
        value, vector = np.linalg.eigh(field)
        root = np.kron(np.eye(2), vector * np.sqrt(np.maximum(value, 0.0)))
        told, axis = np.linalg.eigh(root.T @ equations.normal @ root)
        told, pull = np.maximum(told, 0.0), (axis.T @ (root.T @ equations.gradient)) ** 2
        wider = 1 + ratio[:, None] * told
        left = np.maximum(square - (ratio[:, None] * pull / wider).sum(axis=1), np.finfo(float).tiny)
        worse = freedom * np.log(left / freedom) + np.log(wider).sum(axis=1) - alone
        least = int(np.argmin(worse))
        if worse[least] < best - SURE:
            best = float(worse[least])
            covariance = ratio[least] * left[least] / freedom * np.kron(np.eye(2), field)
    return covariance


def _correlation(nodes: _Nodes, length: float) -> Array:
    """Of the nodes (K, K), so that a sighting's variance is 1 on average."""
    place = nodes.place_px
    distance = np.linalg.norm(place[:, None] - place[None], axis=2)
    x = np.sqrt(5) * distance / (length * nodes.spacing_px)
    decay: Array = (1 + x + x**2 / 3) * np.exp(-x)
    within = decay[nodes.corner[:, :, None], nodes.corner[:, None, :]]
    mean = float(np.einsum("mi,mij,mj->", nodes.share, within, nodes.share) / nodes.share.sum())
    return decay / mean
