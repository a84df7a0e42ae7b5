"""What the centres of a photo share, and how much less sure a camera is by it than by errors that are independent.

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
from dataclasses import replace

import numpy as np

from calib.cameras.surface import surface_model
from calib.core.linear_algebra import pseudo_inverse
from calib.core.parallel import one_thread
from calib.solver.calibration import Calibration, PhotoError
from calib.solver.free_shape import POSE, SINGULAR, PosedSightings, free_directions, whitened_views
from designer.base.arrays import Array

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

    Args:
        views: all photos, or frames of several cameras, each with a pose.
        stated: covariance (Q, Q) of their directions, by noise and all else that is known.
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
    if len(blocks) < LEAST_PHOTOS or equations <= 0:
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
    value, axis = np.linalg.eigh(stated)
    root, inverse_root = axis * np.sqrt(value), axis / np.sqrt(value)
    value, axis = np.linalg.eigh(inverse_root.T @ clustered @ inverse_root)
    times = math.sqrt(float(np.maximum(np.linalg.eigvalsh(clustered), 1.0).mean()))
    return times, root @ axis * np.sqrt(np.maximum(value - 1, 0.0))
