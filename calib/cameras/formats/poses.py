"""Poses in other tools' files: matrices, rotation vectors, quaternions and their units, held to be rigid."""

from collections.abc import Sequence

import numpy as np

from calib.cameras.formats.parsing import numbers, shown_plain
from calib.core.se3 import MAX_DISTANCE_MM, exp_rotation, make_pose, rotation_of_quaternion
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.words import shown, suggestion

UNIT_MM = {"m": 1000.0, "mm": 1.0}
"""Units of length that files may have."""
UNIT_WORDS = {"m": "metres", "mm": "millimetres"}
MOST_RAD = 100.0
"""Longer rotation vectors are degrees, or no rotations."""
FAR_FROM_RIGID = 1e-3
"""Rotations typed with a few digits are made whole; what is farther off than this is none."""


def unit_mm(unit: str) -> float:
    """The unit in millimetres.

    Raises:
        InputError: it is none.
    """
    if unit not in UNIT_MM:
        hint = suggestion(unit, list(UNIT_MM)) or f"; there are {', '.join(UNIT_MM)}"
        raise InputError(f"unit {shown(unit)}{hint}")
    return UNIT_MM[unit]


def unit_said(value: object, origin: str) -> str | None:
    """The unit that a file says; None: it says none.

    Raises:
        InputError: it is none.
    """
    if value is None:
        return None
    if not isinstance(value, str) or value not in UNIT_MM:
        raise InputError(f"{origin}: length_unit {shown_plain(value)}: must be one of {', '.join(UNIT_MM)}")
    return value


def in_unit(pose: Array, unit: str) -> Array:
    """Poses (..., 4, 4) in mm with their shifts in a unit."""
    result = pose.copy()
    result[..., :3, 3] /= unit_mm(unit)
    return result


def pose_of(rotation: Array, shift: Sequence[float], unit: str, origin: str) -> Array:
    """A pose in mm (4, 4) from a nearly whole rotation (3, 3) and a shift (3,) in a unit."""
    return make_pose(nearest_rotation(rotation, origin), shift_mm(shift, unit, origin))


def shift_mm(shift: Sequence[float], unit: str, origin: str) -> Array:
    """A shift in a unit in mm (3,), where one can be.

    Raises:
        InputError: it is absurdly long.
    """
    far = MAX_DISTANCE_MM / unit_mm(unit)
    if max(map(abs, shift)) > far:
        raise InputError(f"{origin}: is {max(map(abs, shift)):g} {unit} away: must be at most {far:g} {unit}")
    return np.array(shift) * unit_mm(unit)


def matrix_pose(value: object, name: str, unit: str, origin: str) -> Array:
    """A pose in mm (4, 4) from a file's four rows, or the first three of them."""
    if not isinstance(value, list) or len(value) not in (3, 4):
        raise InputError(f"{origin}: {name} must be a 4 x 4 matrix, row by row")
    rows = np.array([numbers(row, f"{name}[{index}]", origin, (4,)) for index, row in enumerate(value)])
    if len(rows) == 4 and rows[3].tolist() != [0, 0, 0, 1]:
        raise InputError(f"{origin}: {name} must end with the row 0 0 0 1")
    return pose_of(rows[:3, :3], rows[:3, 3].tolist(), unit, f"{origin}: {name}")


def vector_pose(rotation: Sequence[float], shift: Sequence[float], unit: str, origin: str) -> Array:
    """A pose in mm (4, 4) from a rotation vector (rad) and a shift in a unit."""
    if max(map(abs, rotation)) > MOST_RAD:
        raise InputError(f"{origin}: a rotation vector of {max(map(abs, rotation)):g}: must be radians")
    return make_pose(exp_rotation(np.array(rotation)), shift_mm(shift, unit, origin))


def quaternion_pose(wxyz: Sequence[float], shift: Sequence[float], unit: str, origin: str) -> Array:
    """A pose in mm (4, 4) from a quaternion, scalar first, and a shift in a unit."""
    quaternion = np.array(wxyz)
    length = float(np.linalg.norm(np.clip(quaternion, -2, 2)))
    if not abs(length - 1) < FAR_FROM_RIGID:
        raise InputError(f"{origin}: a quaternion of length {length:.6g}: must be 1; scalar first: w x y z")
    return make_pose(rotation_of_quaternion(quaternion), shift_mm(shift, unit, origin))


def nearest_rotation(matrix: Array, origin: str) -> Array:
    """The rotation (3, 3) nearest to a matrix that is one to some digits.

    Raises:
        InputError: it is none.
    """
    if not np.abs(matrix).max() < 2:
        raise InputError(f"{origin}: has no rotation in it; check its rows")
    left, _, right = np.linalg.svd(matrix)
    rotation: Array = left @ right
    if np.linalg.det(rotation) < 0:
        raise InputError(f"{origin}: mirrors; its determinant is -1, that of a rotation is 1")
    if np.abs(rotation - matrix).max() > FAR_FROM_RIGID:
        raise InputError(f"{origin}: has no rotation in it; check its rows")
    return rotation


def roll_pitch_yaw_rad(rotation: Array) -> tuple[float, float, float]:
    """URDF's angles about the fixed axes x, y, z of a rotation (3, 3) = Rz(yaw) Ry(pitch) Rx(roll)."""
    pitch = float(np.arctan2(-rotation[2, 0], np.hypot(rotation[0, 0], rotation[1, 0])))
    if np.hypot(rotation[0, 0], rotation[1, 0]) < 1e-9:  # roll and yaw turn about one axis: all of it is yaw's
        return 0.0, pitch, float(np.arctan2(-rotation[0, 1], rotation[1, 1]))
    return float(np.arctan2(rotation[2, 1], rotation[2, 2])), pitch, float(np.arctan2(rotation[1, 0], rotation[0, 0]))
