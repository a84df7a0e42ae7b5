"""Faces that lie unlike all others: they are told as such, and take no part in saying where the target is.

A datum in least squares shares one face's displacement out among all, as if each had moved a little. So the motion of
the whole, and how far all faces stand out alike, is fitted with the least sum of distances, not of squares (the
iterative weighted similarity transformation of deformation analysis, Chen 1983), and what then stands out is left out.
"""

import numpy as np

from calib.core.linear_algebra import least_squares
from calib.core.se3 import skew
from calib.measure_target.datum import SeenParts
from calib.measure_target.unknowns import TargetUnknowns, Unknowns
from designer.base.arrays import Array, Flags
from designer.target import TargetGeometry

FAR = 3.0
"""Times the median distance. Of six normal numbers that are alike, one in 10^8 faces is so far off."""
LEAST_FACES = 5
"""Fewer do not tell which of them is the odd one."""
ROUNDS = 30
CLOSE = 1e-3
"""Least distance to weigh by, in expected deviations."""


def motions_of_whole(target: TargetGeometry) -> Array:
    """Motions of faces (rotation vector, shift, in their frames) by a small one of the whole target.  # (F, 6, 6)"""
    frame = target.target_from_face
    turn = frame[:, :3, :3].transpose(0, 2, 1)
    motion = np.zeros((len(frame), 6, 6))
    motion[:, :3, :3] = turn
    motion[:, 3:, 3:] = turn
    motion[:, 3:, :3] = -turn @ skew(frame[:, :3, 3])
    return motion


def outlying_faces(unknowns: Unknowns, seen: SeenParts, shape: TargetUnknowns) -> Flags:
    """The faces of the datum that lie far off while the others agree.  # (F,)"""
    outlying = np.zeros(unknowns.target.face_count, dtype=bool)
    which = np.flatnonzero(seen.datum)
    if not unknowns.has_motion or len(which) < LEAST_FACES:
        return outlying
    sigma = unknowns.sigma[unknowns.column[which, 6:12]]  # (N, 6)
    lift = np.tile([[0.0], [0.0], [0.0], [0.0], [0.0], [1.0]], (len(which), 1, 1))
    design = np.concatenate([motions_of_whole(unknowns.target)[which], lift], axis=2) / sigma[:, :, None]
    value = shape.motion[which] / sigma
    distance = np.ones(len(which))
    for _ in range(ROUNDS):
        root = np.sqrt(1 / np.maximum(distance, CLOSE))
        common = least_squares((root[:, None, None] * design).reshape(-1, 7), (root[:, None] * value).ravel())
        distance = np.linalg.norm(value - design @ common, axis=1)
    outlying[which] = distance > FAR * max(float(np.median(distance)), CLOSE)
    return outlying
