"""How the target lies on the printer's bed: its last face down, centred."""

import numpy as np
from numpy.typing import NDArray

from designer.polyhedron import INRADIUS
from designer.spec import BoardSpec, IcoSpec, PrintSpec
from designer.target import TargetGeometry

_FACE_DOWN = np.diag([1.0, -1.0, -1.0])
_QUARTER_TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def bed_from_target(target: TargetGeometry, printing: PrintSpec) -> NDArray[np.float64]:
    """The rigid motion that puts the printed part on the bed.

    The outward normal of the last face turns to -z (of an icosahedron that is face 19, of a board its only
    one), the lowest point comes to z = 0, and the longer of the two horizontal extents runs along the bed's
    longer side, centred on the bed.

    Returns:
        bed_from_target, from the target frame in millimetres to the bed with its origin in a corner.  # (4, 4)
    """
    bed_x, bed_y, _ = printing.printer.bed_mm
    rotation = _FACE_DOWN @ target.target_from_face[-1, :3, :3].T
    corners = printed_corners_mm(target, printing)
    size = np.ptp(corners @ rotation.T, axis=0)
    if (size[1] > size[0]) != (bed_y > bed_x):
        rotation = _QUARTER_TURN @ rotation
    turned = corners @ rotation.T
    low, high = turned.min(axis=0), turned.max(axis=0)
    motion = np.eye(4)
    motion[:3, :3] = rotation
    motion[:3, 3] = [(bed_x - low[0] - high[0]) / 2, (bed_y - low[1] - high[1]) / 2, -low[2]]
    return motion


def printed_size_mm(target: TargetGeometry, printing: PrintSpec) -> tuple[float, float, float]:
    """The part's bounding box along the bed's axes, as `bed_from_target` lays it."""
    corners = printed_corners_mm(target, printing)
    x, y, z = np.ptp(corners @ bed_from_target(target, printing)[:3, :3].T, axis=0).tolist()
    return x, y, z


def printed_corners_mm(target: TargetGeometry, printing: PrintSpec) -> NDArray[np.float64]:
    """Corners of the printed solid in the target frame, with shrinkage compensation and without stickers.

    A target made by others (without a spec) counts as flat faces.  # (N, 3)
    """
    frame = target.target_from_face
    corners = np.einsum("fij,fkj->fki", frame[:, :3, :2], target.outline_mm) + frame[:, None, :3, 3]
    if isinstance(target.spec, BoardSpec):
        corners = np.concatenate([corners, corners - target.spec.thickness_mm * frame[:, None, :3, 2]])
    elif isinstance(target.spec, IcoSpec) and printing.build == "stickers":
        corners = corners * (1 - printing.sticker_thickness_mm / (INRADIUS * target.spec.edge_mm))
    printed: NDArray[np.float64] = corners.reshape(-1, 3) * (1 + printing.shrink_compensation_percent / 100)
    return printed
