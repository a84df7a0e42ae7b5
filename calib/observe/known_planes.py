"""The planes that points from elsewhere lie in."""

import numpy as np
from numpy.typing import NDArray

from calib.core.types import KnownPoints

Array = NDArray[np.float64]

FLAT = 1e-6
"""All points are in one plane if none is farther off than this share of their extent."""
UNEVEN = 1e-3
"""A face whose points are farther off their plane than this share of its extent is worth a remark."""
MAX_FACE = 9999
_NAMED = 4


def points_with_planes(position_mm: Array, face: NDArray[np.int64] | None) -> tuple[KnownPoints, tuple[str, ...]]:
    """The points with the one plane that they all lie in, else with the planes of their faces.

    Args:
        position_mm: the points (K, 3).
        face: the number of the face that each lies in (K,), -1 for none; None: not known.

    Returns:
        The points, and remarks: their extent, and faces that are no planes.
    """
    extent = np.ptp(position_mm, axis=0)
    said = [f"X, Y, Z are taken as mm: the points span {' x '.join(f'{side:.6g}' for side in extent)} mm"]
    whole, off_mm = _plane(position_mm)
    if whole is not None and off_mm <= FLAT * float(np.linalg.norm(extent)):
        return KnownPoints(position_mm, np.zeros(len(position_mm), dtype=np.int64), whole[None]), tuple(said)
    if face is None:
        return KnownPoints(position_mm, np.full(len(position_mm), -1), np.zeros((0, 4))), tuple(said)
    count = int(face.max(initial=-1)) + 1
    known = np.full(len(position_mm), -1)
    planes = np.tile([0.0, 0.0, 1.0, 0.0], (count, 1))  # stays so for numbers that no plane has
    uneven: list[str] = []
    order = np.argsort(face, kind="stable")
    for number, rows in enumerate(np.split(order, np.searchsorted(face[order], np.arange(count + 1)))[1:-1]):
        plane, off_mm = _plane(position_mm[rows])
        if plane is None:
            continue
        planes[number], known[rows] = plane, number
        if off_mm > UNEVEN * float(np.linalg.norm(np.ptp(position_mm[rows], axis=0))):
            uneven.append(f"{number} by {off_mm:.3g} mm")
    if uneven:
        more = f" and {len(uneven) - _NAMED} more" if len(uneven) > _NAMED else ""
        said.append(f"faces whose points are off their mean plane: {', '.join(uneven[:_NAMED])}{more}")
    return KnownPoints(position_mm, known, planes), tuple(said)


def _plane(position: Array) -> tuple[Array | None, float]:
    """The plane (4,) with the least squares of distances and the largest distance; None if points determine none.

    The normal's largest component is positive.
    """
    if len(position) < 3:
        return None, 0.0
    middle = position.mean(axis=0)
    _, singular, axes = np.linalg.svd(position - middle, full_matrices=False)
    if not singular[1] > 1e-6 * singular[0]:
        return None, 0.0
    normal = axes[2] * np.sign(axes[2][np.argmax(np.abs(axes[2]))])
    off = np.abs((position - middle) @ normal).max()
    return np.append(normal, normal @ middle), float(off)
