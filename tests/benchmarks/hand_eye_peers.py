"""Hand-eye calibration in two stages, as it is usually done: the camera's poses, then P X = X Q for pairs of them.

Written from the papers, to stand beside ours in benchmarks: OpenCV 5 has lost its `calibrateHandEye`. P is a turn and a
shift between two frames as the camera saw them, `T_i T_j^-1`, Q the same as the robot says, `L_i L_j^-1` with
`rig_from_mechanism` L; X is cam_from_rig.
"""

from collections.abc import Callable

import numpy as np

from calib.core.se3 import exp_rotation, invert, log_rotation, make_pose, skew
from designer.base.arrays import Array

MM = 1e3
"""In a metre."""
LEAST_RAD, MOST_RAD = 0.02, 2.9
"""Pairs that turn less, or nearly by half a turn, have no sure axis; they are left out, of rotations and shifts."""


def pairs(cam_from_target: Array, rig_from_mechanism: Array) -> tuple[Array, Array]:
    """Motions between all pairs of frames, as seen and as told.  # (N, 4, 4) each"""
    first, second = np.triu_indices(len(cam_from_target), 1)
    seen = cam_from_target[first] @ invert(cam_from_target[second])
    told = rig_from_mechanism[first] @ invert(rig_from_mechanism[second])
    angle = np.linalg.norm([log_rotation(seen[:, :3, :3]), log_rotation(told[:, :3, :3])], axis=2)
    keep = ((angle > LEAST_RAD) & (angle < MOST_RAD)).all(axis=0)
    return seen[keep], told[keep]


def tsai(seen: Array, told: Array) -> Array:
    """Tsai and Lenz 1989: the rotation from linear equations of its Rodrigues vector, then the shift."""
    p, q = (_half_sines(pose) for pose in (seen, told))
    vector = np.linalg.lstsq(skew(p + q).reshape(-1, 3), (q - p).ravel(), rcond=None)[0]
    length = float(np.linalg.norm(vector))
    return _with_shift(exp_rotation(2 * np.arctan(length) * vector / max(length, 1e-12)), seen, told)


def park(seen: Array, told: Array) -> Array:
    """Park and Martin 1994: the rotation that brings rotation vectors onto each other, then the shift."""
    p, q = log_rotation(seen[:, :3, :3]), log_rotation(told[:, :3, :3])
    return _with_shift(_nearest_rotation(p.T @ q), seen, told)


def horaud(seen: Array, told: Array) -> Array:
    """Horaud and Dornaika 1995, closed form: the same of axes of unit length, by an eigenvector of quaternions."""
    p, q = (_unit(log_rotation(pose[:, :3, :3])) for pose in (seen, told))
    rows = np.zeros((len(p), 4, 4))  # p x = x q, products of quaternions
    rows[:, 0, 1:], rows[:, 1:, 0], rows[:, 1:, 1:] = q - p, p - q, skew(p + q)
    x = np.linalg.eigh(np.einsum("nij,nik->jk", rows, rows))[1][:, 0]
    return _with_shift(_rotation_of(x), seen, told)


def daniilidis(seen: Array, told: Array) -> Array:
    """Daniilidis 1999: rotation and shift at once, by dual quaternions, in metres (mm weigh shifts more)."""
    (p, p_dual), (q, q_dual) = (_dual_vectors(pose) for pose in (seen, told))
    rows = np.zeros((len(p), 6, 8))
    rows[:, :3, 0] = rows[:, 3:, 4] = p - q
    rows[:, :3, 1:4] = rows[:, 3:, 5:] = skew(p + q)
    rows[:, 3:, 0], rows[:, 3:, 1:4] = p_dual - q_dual, skew(p_dual + q_dual)
    one, other = np.linalg.svd(rows.reshape(-1, 8))[2][-2:]
    # A sum of the two whose real part has length one and is normal to the dual part.
    square = [one[:4] @ one[4:], one[:4] @ other[4:] + other[:4] @ one[4:], other[:4] @ other[4:]]
    found = [root * one + other for root in np.real(np.roots(square))]
    best = max(found, key=lambda x: float(np.linalg.norm(x[:4]) / np.linalg.norm(x)))
    real, dual = best[:4] / np.linalg.norm(best[:4]), best[4:] / np.linalg.norm(best[:4])
    shift = 2 * (real[0] * dual[1:] - dual[0] * real[1:] + np.cross(real[1:], dual[1:]))
    return make_pose(_rotation_of(real), MM * shift)


PEERS: dict[str, Callable[[Array, Array], Array]] = {
    "Tsai": tsai,
    "Park": park,
    "Horaud": horaud,
    "Daniilidis": daniilidis,
}


def carrier_from_target(cam_from_rig: Array, cam_from_target: Array, rig_from_mechanism: Array) -> Array:
    """The mean of what the frames say.  # (4, 4)"""
    each = invert(rig_from_mechanism) @ invert(cam_from_rig) @ cam_from_target
    shift: Array = each[:, :3, 3].sum(axis=0) / len(each)
    return make_pose(_nearest_rotation(each[:, :3, :3].sum(axis=0)), shift)


def _with_shift(rotation: Array, seen: Array, told: Array) -> Array:
    """Linear equations of the shift, once the rotation is known."""
    design = seen[:, :3, :3] - np.eye(3)
    right = told[:, :3, 3] @ rotation.T - seen[:, :3, 3]
    return make_pose(rotation, np.linalg.lstsq(design.reshape(-1, 3), right.ravel(), rcond=None)[0])


def _half_sines(pose: Array) -> Array:
    """Twice the sine of half the angle, along the axis.  # (N, 3)"""
    vector = log_rotation(pose[:, :3, :3])
    angle = np.linalg.norm(vector, axis=1, keepdims=True)
    half: Array = 2 * np.sin(angle / 2) * vector / angle
    return half


def _dual_vectors(pose: Array) -> tuple[Array, Array]:
    """The vector parts of dual quaternions: real (N, 3) and dual (N, 3)."""
    vector = log_rotation(pose[:, :3, :3])
    angle = np.linalg.norm(vector, axis=1, keepdims=True)
    real, cosine, shift = np.sin(angle / 2) * vector / angle, np.cos(angle / 2), pose[:, :3, 3] / MM
    return real, 0.5 * (cosine * shift + np.cross(shift, real))


def _unit(vector: Array) -> Array:
    unit: Array = vector / np.linalg.norm(vector, axis=1, keepdims=True)
    return unit


def _rotation_of(quaternion: Array) -> Array:
    """Of a unit quaternion, w first."""
    w, v = quaternion[0], quaternion[1:]
    rotation: Array = (w * w - v @ v) * np.eye(3) + 2 * np.outer(v, v) + 2 * w * skew(v)
    return rotation


def _nearest_rotation(matrix: Array) -> Array:
    left, _, right = np.linalg.svd(matrix)
    rotation: Array = (left * np.array([1.0, 1.0, np.linalg.det(left @ right)])) @ right
    return rotation
