"""What each frame of a rig tells of its cameras and where they sit, the frame's own pose eliminated.

With H of the sightings by the shared unknowns and the frame's pose F, a frame tells `A - B C^-1 B'` of the blocks of
`[A B; B' C] = H'H`. Where a robot carries the cameras or the target, F is held to the robot's word by the robot's noise
(`calib.rigs.carrier`): with E of the robot's errors it is `H'H + E'E`. Errors that all of a photo share
(`calib.rigs.slack`, k times what its noise lets it tell of its pose) first take `k / (1 + k) h W^-1 h'` from the
sightings' part, W being its block of the pose and h its columns.
"""

import numpy as np

from calib.core.linear_algebra import symmetric_inverse
from calib.rigs.carrier import error_derivatives, weights
from calib.rigs.result import RigCalibration
from calib.rigs.target_error import carrier_prior, posed_frames, tells_size
from calib.solver.free_shape import POSE
from designer.base.arrays import Array

AT_A_TIME = 256
"""Frames times cameras: derivatives of all would take much memory."""


def frame_information(found: RigCalibration, basis: Array) -> Array:
    """Of each frame: `frame_information(found, free_directions(found.covariance)).sum(axis=0)`.  # (V, Q, Q)

    The Q unknowns are the basis's directions; with a carrier also the target's size if it was solved, and
    `carrier_from_target`.

    Args:
        found: a rig; with a carrier one of a single camera.
        basis: directions (N, K) of the rows of the rig's covariance.
    """
    besides = 0 if found.carrier is None else POSE + tells_size(found)
    wide = np.concatenate([basis, np.zeros((len(basis), besides))], axis=1)
    count, frames = wide.shape[1], found.observations.frame_count
    product = np.zeros((frames, count + POSE, count + POSE))
    for some in np.array_split(np.arange(frames), -(-frames * len(found.cameras) // AT_A_TIME)):
        for frame, one in zip(some.tolist(), posed_frames(found, wide, some), strict=True):
            column = np.concatenate([one.by_camera, one.by_pose], axis=2).reshape(-1, count + POSE)
            product[frame] = column.T @ column
    if found.slack is not None:
        pose = product[:, :, count:]
        taken = pose @ symmetric_inverse(pose[:, count:]).inverse @ pose.transpose(0, 2, 1)
        product -= found.slack / (1 + found.slack) * taken
    if found.carrier is not None:
        prior, fit = carrier_prior(found)
        by_frame, by_carrier = error_derivatives(prior, found.rig_from_target, fit.carrier_from_target)
        told = np.zeros((len(product), POSE, count + POSE))
        told[:, :, count - POSE : count], told[:, :, count:] = by_carrier, by_frame
        told *= weights(prior)[:, None]
        product += told.transpose(0, 2, 1) @ told
    cross = product[:, :count, count:]
    left: Array = product[:, :count, :count] - (
        cross @ symmetric_inverse(product[:, count:, count:]).inverse @ cross.transpose(0, 2, 1)
    )
    return left


def expected_information(found: RigCalibration, directions: int) -> Array:
    """What is known without any frame, of the same unknowns: about how large a target is.  # (Q, Q)"""
    least = np.zeros(directions + tells_size(found) + POSE)
    if found.carrier is not None and tells_size(found):
        least[directions] = found.carrier.size_sigma_before**-2
    return np.diag(least)
