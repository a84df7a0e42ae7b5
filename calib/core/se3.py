"""Rotations and rigid motions, batched over leading axes.

A pose is a 4 x 4 matrix that reads right to left: `p_cam = cam_from_target @ p_target`.
"""

import numpy as np

from designer.base.arrays import Array

SMALL_ANGLE_RAD = 1e-4
"""Below it the series of sin(a)/a and its like, cut after two terms, are exact to the last bit."""
RIGID = 1e-6
MAX_DISTANCE_MM = 1e7


def exp_rotation(vector_rad: Array) -> Array:
    """Rotations (..., 3, 3) of rotation vectors (..., 3): Rodrigues' formula."""
    vector = np.asarray(vector_rad, dtype=np.float64)
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    is_small = angle < SMALL_ANGLE_RAD
    safe = np.where(is_small, 1.0, angle)
    square = angle**2
    first = np.where(is_small, 1 - square / 6, np.sin(safe) / safe)
    second = np.where(is_small, 0.5 - square / 24, 2 * (np.sin(safe / 2) / safe) ** 2)
    cross = skew(vector)
    result: Array = np.eye(3) + first * cross + second * (cross @ cross)
    return result


def angles_between(first: Array, second: Array) -> Array:
    """The angles (...) between unit directions (..., 3), exact for small ones, too."""
    chord, sum_ = (np.linalg.norm(one, axis=-1) for one in (first - second, first + second))
    angle: Array = 2 * np.arctan2(chord, sum_)
    return angle


def rotation_between(first: Array, second: Array) -> Array:
    """The smallest rotations (..., 3, 3) that turn unit vectors (..., 3) into others."""
    axis = np.cross(first, second)
    sine = np.linalg.norm(axis, axis=-1, keepdims=True)
    angle = np.arctan2(sine, (first * second).sum(axis=-1, keepdims=True))
    return exp_rotation(axis / np.where(sine > 0, sine, 1.0) * angle)


def log_rotation(rotation: Array) -> Array:
    """Rotation vectors (..., 3), at most pi long, of rotations (..., 3, 3).

    Through the unit quaternion, from its largest component (Shepperd 1978), so that it stays exact near 0 and pi.
    """
    quaternion = quaternion_wxyz(rotation)
    scalar, vector = quaternion[..., :1], quaternion[..., 1:]
    length = np.linalg.norm(vector, axis=-1, keepdims=True)
    is_small = length < SMALL_ANGLE_RAD
    safe = np.where(is_small, 1.0, length)
    result: Array = vector * np.where(is_small, 2 + length**2 / 3, 2 * np.arctan2(length, scalar) / safe)
    return result


def rotation_of_quaternion(wxyz: Array) -> Array:
    """Rotations (..., 3, 3) of quaternions (..., 4), scalar first, whatever their length and sign."""
    vector = wxyz[..., 1:]
    sine = np.linalg.norm(vector, axis=-1, keepdims=True)
    return exp_rotation(vector * (2 * np.arctan2(sine, wxyz[..., :1]) / np.where(sine > 0, sine, 1.0)))


def quaternion_wxyz(rotation: Array) -> Array:
    """Unit quaternions (..., 4) of rotations (..., 3, 3), scalar first and not negative."""
    r = np.asarray(rotation, dtype=np.float64)
    xx, yy, zz = r[..., 0, 0], r[..., 1, 1], r[..., 2, 2]
    a, b, c = r[..., 2, 1] - r[..., 1, 2], r[..., 0, 2] - r[..., 2, 0], r[..., 1, 0] - r[..., 0, 1]
    d, e, f = r[..., 1, 0] + r[..., 0, 1], r[..., 0, 2] + r[..., 2, 0], r[..., 2, 1] + r[..., 1, 2]
    # Each row is 4 q_k times the quaternion; the row of the largest component loses no digits.
    rows = np.stack(
        [
            np.stack([1 + xx + yy + zz, a, b, c], axis=-1),
            np.stack([a, 1 + xx - yy - zz, d, e], axis=-1),
            np.stack([b, d, 1 - xx + yy - zz, f], axis=-1),
            np.stack([c, e, f, 1 - xx - yy + zz], axis=-1),
        ],
        axis=-2,
    )
    largest = np.argmax(np.diagonal(rows, axis1=-2, axis2=-1), axis=-1)
    row = np.take_along_axis(rows, largest[..., None, None], axis=-2)[..., 0, :]
    unit: Array = row / np.linalg.norm(row, axis=-1, keepdims=True)
    return unit * np.where(unit[..., :1] < 0, -1.0, 1.0)


def skew(vector: Array) -> Array:
    """Matrices (..., 3, 3) of vectors (..., 3) with `skew(a) @ b = a x b`."""
    matrix = np.zeros((*vector.shape, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        matrix[..., k, j], matrix[..., j, k] = vector[..., i], -vector[..., i]
    return matrix


def make_pose(rotation: Array, translation: Array) -> Array:
    """Rigid motions (..., 4, 4) from rotations (..., 3, 3) and translations (..., 3)."""
    shape = np.broadcast_shapes(rotation.shape[:-2], translation.shape[:-1])
    pose = np.zeros((*shape, 4, 4))
    pose[..., :3, :3] = rotation
    pose[..., :3, 3] = translation
    pose[..., 3, 3] = 1.0
    return pose


def compose(*poses: Array) -> Array:
    """The product of rigid motions (..., 4, 4), the last applied first."""
    result = poses[0]
    for pose in poses[1:]:
        result = result @ pose
    return result


def invert(pose: Array) -> Array:
    """The inverse rigid motions (..., 4, 4)."""
    rotation = np.swapaxes(pose[..., :3, :3], -1, -2)
    return make_pose(rotation, -(rotation @ pose[..., :3, 3:])[..., 0])


def inverse_slope(pose: Array) -> Array:
    """How the inverse of a pose (4, 4) moves as it is turned and shifted on the left: both rad, then mm.  # (6, 6)"""
    turn = pose[:3, :3].T
    return -np.block([[turn, np.zeros((3, 3))], [turn @ skew(pose[:3, 3]), turn]])


def nearest_rotation(matrix: Array) -> Array:
    """The rotation R (3, 3) of the largest trace(R' M); with M = sum y x', it brings x nearest to y (Kabsch 1976)."""
    left, _, right = np.linalg.svd(matrix)
    rotation: Array = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return rotation


def steps_between(first: Array, second: Array) -> Array:
    """What leads from first poses to second (..., 6): the turns before these as rotation vectors (rad), and the shifts.

    As the steps of `calib.solver.levenberg.move_poses`.
    """
    turn = log_rotation(second[..., :3, :3] @ first[..., :3, :3].swapaxes(-1, -2))
    return np.concatenate([turn, second[..., :3, 3] - first[..., :3, 3]], axis=-1)


def interpolated(time_s: Array, pose: Array, at_s: Array) -> Array:
    """Poses at times (T,) between poses (N, 4, 4) at ascending times (N,): a steady turn and a straight way.

    Before the first and after the last time they are those.  # (T, 4, 4)
    """
    after = np.clip(np.searchsorted(time_s, at_s), 1, len(time_s) - 1)
    first, second = pose[after - 1], pose[after]
    share = np.clip((at_s - time_s[after - 1]) / (time_s[after] - time_s[after - 1]), 0, 1)[:, None]
    step = share * steps_between(first, second)
    return make_pose(exp_rotation(step[:, :3]) @ first[:, :3, :3], first[:, :3, 3] + step[:, 3:])


def transform(pose: Array, point: Array) -> Array:
    """Points (..., 3) moved by rigid motions (..., 4, 4)."""
    moved: Array = (pose[..., :3, :3] @ point[..., None])[..., 0] + pose[..., :3, 3]
    return moved


def transform_each(pose: Array, point: Array) -> Array:
    """All points (N, 3) moved by each of rigid motions (C, 4, 4): `transform(pose[:, None], point)`.  # (C, N, 3)"""
    moved: Array = point @ pose[:, :3, :3].swapaxes(1, 2) + pose[:, None, :3, 3]
    return moved


def look_at(eye: Array, aim: Array, roll_rad: Array | float = 0.0) -> Array:
    """Poses `cam_from_world` (..., 4, 4) of cameras at `eye` that look at `aim`, both (..., 3).

    Without roll the world's z axis points up in the image; seen along it, the world's y axis does. A positive roll
    turns the camera clockwise about its viewing direction.
    """
    eye, aim = np.broadcast_arrays(np.asarray(eye, dtype=np.float64), np.asarray(aim, dtype=np.float64))
    forward = _unit(aim - eye)
    along_z = np.abs(forward[..., 2:]) > 1 - 1e-9
    up = np.where(along_z, np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0]))
    right = _unit(np.cross(forward, up))
    down = np.cross(forward, right)
    cosine, sine = np.cos(roll_rad), np.sin(roll_rad)
    cosine, sine = np.asarray(cosine)[..., None], np.asarray(sine)[..., None]
    rotation = np.stack([cosine * right + sine * down, cosine * down - sine * right, forward], axis=-2)
    return make_pose(rotation, -(rotation @ eye[..., None])[..., 0])


def _unit(vector: Array) -> Array:
    unit: Array = vector / np.linalg.norm(vector, axis=-1, keepdims=True)
    return unit


def rigid_fault(poses: Array) -> tuple[int, str] | None:
    """The first of poses (V, 4, 4) that is no rigid motion, and what is wrong with it; None if all are."""
    rotation, shift = poses[:, :3, :3], poses[:, :3, 3]
    with np.errstate(invalid="ignore", over="ignore"):
        product = rotation @ rotation.transpose(0, 2, 1)
        determinant = np.linalg.det(np.where(np.abs(rotation) < 2, rotation, 0))
        is_right_handed = np.abs(determinant - 1) < 10 * RIGID
        is_orthogonal = np.abs(product - np.eye(3)).max(axis=(1, 2)) < RIGID
        faults = (
            (~np.isfinite(np.abs(poses).max(axis=(1, 2))), "holds a number that is not finite"),
            (is_orthogonal & (determinant < 0), "has no rotation in it but a mirror: one of its axes is reversed"),
            (~is_orthogonal | ~is_right_handed, "has no rotation in it"),
            (np.abs(poses[:, 3] - np.eye(4)[3]).max(axis=1) > 0, "must end with the row 0 0 0 1"),
            (np.abs(shift).max(axis=1) > MAX_DISTANCE_MM, f"lies more than {MAX_DISTANCE_MM:g} mm away"),
        )
    for number in range(len(poses)):
        for is_faulty, what in faults:
            if is_faulty[number]:
                return number, what
    return None
