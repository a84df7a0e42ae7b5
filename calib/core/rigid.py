"""Whether matrices from a file are rigid motions."""

import numpy as np
from numpy.typing import NDArray

TOLERANCE = 1e-6
MAX_DISTANCE_MM = 1e7


def rigid_fault(poses: NDArray[np.float64]) -> tuple[int, str] | None:
    """The first of poses (V, 4, 4) that is no rigid motion, and what is wrong with it; None if all are."""
    rotation, shift = poses[:, :3, :3], poses[:, :3, 3]
    with np.errstate(invalid="ignore", over="ignore"):
        product = rotation @ rotation.transpose(0, 2, 1)
        determinant = np.linalg.det(np.where(np.abs(rotation) < 2, rotation, 0))
        is_right_handed = np.abs(determinant - 1) < 10 * TOLERANCE
        faults = (
            (~np.isfinite(np.abs(poses).max(axis=(1, 2))), "holds a number that is not finite"),
            (~(np.abs(product - np.eye(3)).max(axis=(1, 2)) < TOLERANCE) | ~is_right_handed, "has no rotation in it"),
            (np.abs(poses[:, 3] - np.eye(4)[3]).max(axis=1) > 0, "must end with the row 0 0 0 1"),
            (np.abs(shift).max(axis=1) > MAX_DISTANCE_MM, f"lies more than {MAX_DISTANCE_MM:g} mm away"),
        )
    for number in range(len(poses)):
        for is_faulty, what in faults:
            if is_faulty[number]:
                return number, what
    return None
