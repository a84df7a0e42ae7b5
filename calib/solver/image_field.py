"""What is fixed in the image and that the lens model does not follow, and what the parameters took of it.

    calibration = with_image_field(calibration)
    calibration.image_field.left_px, calibration.stated_covariance

A lens that is not of the model's kind, or a picture that was warped or resampled, displaces all sightings at one place
of the image alike. Halves of the photos agree on it; the parameters take up what looks like a lens; only the rest shows
in the residuals. If the displacement is a Gaussian process over the image, the rest tells how much the parameters took
(restricted maximum likelihood; Patterson and Thompson 1971, Recovery of inter-block information, Biometrika 58). With
X and Z the derivatives of the whitened residuals r by camera and field, the poses eliminated from all of them,

    r = X c + Z z + noise,   noise ~ N(0, v),   z ~ N(0, a^2 K(l)),

the amplitude a and the length l are the likeliest for what c does not take up, and K is Matern's with the smoothness
5/2: twice differentiable as lenses are, rough where l is short. With them the residuals tell what z is, its mean and
its covariance: `E(z z')`. Where no camera of the model is the lens, that is meant that follows it best over the image
as it was seen, `F z` from the camera without a field. What was solved is `T z`, T = (X' X)^-1 X' Z: photos and poses
have a part in it. The camera's covariance is more by `(T - F) E(z z') (T - F)'`, and the image is off by what even the
best leaves. Where the residuals do not tell a longer l from a shorter one, the shorter one stands.

What the centres of a photo share, and how much less sure a camera is by it than by errors that are independent.

    calibration = with_photo_error(calibration)
    calibration.photo_error.times, calibration.stated_covariance

Where neighbouring centres err alike, a photo tells less than its number of centres says. The scores of the photos,
s_v = X_v' r_v with the poses taken off, then vary by more than independent errors let them, and the covariance of the
camera is `N^-1 (sum s_v s_v') N^-1` (Liang and Zeger 1986, Biometrika 73), each score as it were if its own photo had
not drawn the camera to it (Bell and McCaffrey 2002, Bias reduction in standard errors for linear regression with
multi-stage samples, Survey Methodology 28). Target, field and capture make scores vary, too: only what is beyond all
that is stated already is added. Few photos tell few directions, so nothing is taken off in any.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.cameras import linearise, rays
from calib.cameras.surface import surface_model
from calib.core.linear_algebra import pseudo_inverse, sums_by, symmetric_inverse
from calib.core.parallel import one_thread
from calib.solver.calibration import Calibration, ImageField, PhotoError
from calib.solver.free_shape import POSE, SINGULAR, PosedSightings, WhitenedView, free_directions, whitened_views
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
    field = _likeliest(equations)
    if field is None:
        return without
    fitted, rest_px = _fitted(calibration, equations.nodes, basis, field)
    wrong = basis @ (equations.taken @ field - fitted)
    return replace(calibration, image_field=ImageField(rest_px, wrong @ wrong.T))


def _fitted(calibration: Calibration, nodes: "_Nodes", basis: Array, field: Array) -> tuple[Array, float]:
    """By how much the camera would follow fields (2 K, N) at best (Q, N), and what it leaves of them all, in px.

    Over the image as it was seen, and the camera turned as it likes. What it would be then is the camera that is meant
    where the lens is of no model's kind.
    """
    counted = ~calibration.is_outlier
    shown_px = (calibration.observations.center_px + calibration.residual_px)[counted]
    ray = rays(calibration.camera, shown_px)
    known = np.isfinite(ray).all(axis=1)
    linear = linearise(calibration.camera, np.ascontiguousarray(ray[known].T))
    by_turn = np.cross(ray[known][:, None, :], linear.by_point.transpose(2, 0, 1))
    change = np.concatenate([linear.by_params.transpose(2, 0, 1) @ basis, by_turn], axis=2)  # (M, 2, Q + 3)
    count, size = len(nodes.place_px), change.shape[2]
    corner, share = nodes.corner[counted][known], nodes.share[counted][known]
    summed = sums_by(corner.ravel(), (share[:, :, None, None] * change[:, None]).reshape(-1, 2 * size), count)
    cross = summed.reshape(count, 2, size).transpose(2, 1, 0).reshape(size, 2 * count) @ field
    follows = symmetric_inverse(np.einsum("mip,miq->pq", change, change)).inverse @ cross
    both = field.reshape(2, count, -1)
    square = len(change) * np.einsum("ikn,kl,iln->", both, nodes.together, both) - (cross * follows).sum()
    return follows[: basis.shape[1]], math.sqrt(max(square, 0.0) / (2 * len(change)))


@dataclass(frozen=True, eq=False)
class _Nodes:
    """The field's nodes and how the sightings lie between them."""

    place_px: Array  # (K, 2)
    spacing_px: float
    corner: Rows  # (M, 4) the nodes about each sighting
    share: Array  # (M, 4) theirs in it, in sum 1; 0 of sightings that do not count

    @cached_property
    def together(self) -> Array:
        """How sightings lie between pairs of nodes: `z' together z` is a field's mean square over them.  # (K, K)"""
        count = len(self.place_px)
        pair = count * self.corner[:, :, None] + self.corner[:, None, :]
        sums = np.bincount(pair.ravel(), (self.share[:, :, None] * self.share[:, None, :]).ravel(), count**2)
        return np.asarray(sums.reshape(count, count) / self.share.sum())


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
        across, by_column, slot = view.poses_taken(), by_node.transpose(0, 2, 1), column.ravel()
        cross += sums_by(slot, (by_column @ known).reshape(len(slot), -1), 2 * count)
        pair = (2 * count * column[:, :, None] + column[:, None, :]).ravel()
        np.add.at(normal.reshape(-1), pair, (by_column @ by_node).ravel())
        taken.append(np.einsum("mij,mip->jp", across, known))
        taken_field.append(sums_by(slot, (by_column @ across).reshape(-1, POSE), 2 * count).T)
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


def _likeliest(equations: _Equations) -> Array | None:
    """A root (2 K, N) of what the residuals tell of the field: of its mean's square and its covariance.

    None if noise alone explains the residuals. In the eigenvectors of `R' normal R`, K = R R', the likelihood is a sum
    for every amplitude at once. As the nodes lie on a grid, the least eigenvalue of K is 3e-11 of the largest or more,
    far from rounding.
    """
    freedom, square, nodes = equations.freedom, equations.square, equations.nodes
    alone = freedom * np.log(square / freedom)
    ratio = AMPLITUDES * equations.count / equations.weights
    distance = np.linalg.norm(nodes.place_px[:, None] - nodes.place_px, axis=2) / nodes.spacing_px
    count = len(nodes.place_px)
    normal = equations.normal.reshape(2, count, 2, count).transpose(0, 2, 1, 3)
    best, found = 0.0, None
    for length in LENGTHS:
        x = np.sqrt(5) * distance / length
        field = (1 + x + x**2 / 3) * np.exp(-x)
        field /= (nodes.together * field).sum()  # so that a sighting's variance is 1 on average
        root = np.linalg.cholesky(field)  # the same for u and v
        scaled = (root.T @ normal @ root).transpose(0, 2, 1, 3).reshape(2 * count, -1)
        told, axis = np.linalg.eigh(scaled)
        told, pull = np.maximum(told, 0.0), axis.T @ (equations.gradient.reshape(2, count) @ root).ravel()
        wider = 1 + ratio[:, None] * told
        left = np.maximum(square - (ratio[:, None] * pull**2 / wider).sum(axis=1), np.finfo(float).tiny)
        worse = freedom * np.log(left / freedom) + np.log(wider).sum(axis=1) - alone
        least = int(np.argmin(worse))
        if worse[least] < best - SURE:
            best = float(worse[least])
            share = ratio[least] / wider[least]
            spread = np.sqrt(share * left[least] / freedom)  # what is left open
            amounts = (axis @ np.column_stack([share * pull, np.diag(spread)])).reshape(2, count, -1)
            found = (root @ amounts).reshape(2 * count, -1)
    return found


BY_CHANCE = 4.0
"""Standard deviations of the root mean square of independent scores: beyond, the centres of a photo err alike."""
LEAST_ALONE = 0.2
"""Part of a direction that the other photos tell at least, where one tells nearly all: its score is raised no more."""
LEAST_PHOTOS = 4
NO_NOISE = 1e-6
"""Of a whitened residual: what is less is rounding."""


@one_thread
def with_photo_error(calibration: Calibration) -> Calibration:
    """The calibration with what its photos' centres share beyond chance and beyond what is stated of it already."""
    without = replace(calibration, photo_error=None)
    basis = free_directions(calibration.param_covariance)
    if not basis.size or calibration.camera.learned is not None or surface_model(calibration.camera.model) is not None:
        return without
    to_q = pseudo_inverse(basis)
    found = shared_by_photos(whitened_views(calibration, basis), to_q @ without.stated_covariance @ to_q.T)
    if found is None:
        return without
    times, more = found
    return replace(calibration, photo_error=PhotoError(times, (basis @ more) @ (basis @ more).T))


def shared_by_photos(views: Iterable[PosedSightings], stated: Array) -> tuple[float, Array] | None:
    """How much less is known than by independent errors, and a root (Q, Q) of the covariance that is to be added.

    None if photos share nothing beyond chance, or are too few to tell.

    Of photos, or frames of several cameras, each with a pose; `stated` is the covariance (Q, Q) of their directions.
    """
    blocks, equations = [], -len(stated)
    for view in views:
        if 2 * len(view.point) <= POSE:
            continue
        flat = np.concatenate([view.by_camera, view.residual], axis=2).reshape(2 * len(view.point), -1)
        across = view.poses_taken().reshape(-1, POSE)
        left = flat - across @ (across.T @ flat)
        blocks.append(left.T @ left)
        equations += 2 * len(view.point) - POSE
    if len(blocks) < LEAST_PHOTOS or equations <= 0 or not (np.diagonal(stated) > 0).all():
        return None
    block = np.stack(blocks)  # (V, Q + 1, Q + 1)
    whole = block.sum(axis=0)
    variance = float(whole[-1, -1]) / equations
    value, axis = np.linalg.eigh(whole[:-1, :-1])
    if not (variance > NO_NOISE**2 and value[0] > SINGULAR * value[-1]):
        return None
    root = axis / np.sqrt(value)  # of the inverse normal matrix
    told = root.T @ block[:, :-1, :-1] @ root  # (V, Q, Q) in sum the identity
    score = block[:, :-1, -1] @ root / math.sqrt(variance)  # (V, Q)
    independent = len(root) - float((told**2).sum())
    ratio = math.sqrt(float((score**2).sum()) / independent) if independent > 0 else 1.0
    if not ratio > 1 + BY_CHANCE / math.sqrt(2 * independent * (len(block) - 1)):
        return None
    value, axis = np.linalg.eigh(np.eye(len(root)) - told)
    raised = np.einsum("vpk,vk,vk->vp", axis, 1 / np.maximum(value, LEAST_ALONE), np.einsum("vqk,vq->vk", axis, score))
    clustered = variance * root @ (raised.T @ raised) @ root.T
    # In units of standard deviations, so that directions of other sizes are no rounding of each other.
    sigma = np.sqrt(np.diagonal(stated))
    value, axis = np.linalg.eigh(stated / np.outer(sigma, sigma))
    if not value[-1] > 0:
        return None
    value = np.maximum(value, SINGULAR * value[-1])
    root, inverse_root = sigma[:, None] * axis * np.sqrt(value), axis / (sigma[:, None] * np.sqrt(value))
    value, axis = np.linalg.eigh(inverse_root.T @ clustered @ inverse_root)
    times = math.sqrt(float(np.maximum(np.linalg.eigvalsh(clustered), 1.0).mean()))
    return times, root @ axis * np.sqrt(np.maximum(value - 1, 0.0))
