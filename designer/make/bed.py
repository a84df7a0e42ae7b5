"""How the target lies on the printer's bed: its last face down, in the middle or as near to it as the bed is free."""

import math

import numpy as np

from designer.base.arrays import Array
from designer.base.units import NO_SKEW, skew_matrix
from designer.kinds.layout import corners_mm, face_down, is_turned
from designer.spec.spec import PrinterProfile, PrintSpec
from designer.target import TargetGeometry

_ALIKE = 1e-6
"""Normals differ by more."""
_QUARTER_TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def bed_from_target(target: TargetGeometry, printing: PrintSpec) -> Array:
    """The rigid motion that puts the printed part on the bed.

    The outward normal of the last face turns to -z (a board has only one), the lowest point comes to z = 0, and the
    longer of the two horizontal extents runs along the bed's longer side. It lies in the bed's middle, or as near to it
    as what the printer excludes of its bed allows. Skew compensation does not turn the part.

    Returns:
        bed_from_target, from the target frame in millimetres to the bed with its origin in a corner.  # (4, 4)
    """
    rotation = _bed_axes(target, printing)
    turned = printed_corners_mm(target, printing) @ rotation.T
    low, (width, depth, _) = turned.min(axis=0), np.ptp(turned, axis=0).tolist()
    motion = np.eye(4)
    motion[:3, :3] = rotation
    motion[:3, 3] = [*printing.printer.laid_mm((width, depth)), 0.0] - low
    return motion


def against_skew(target: TargetGeometry, printing: PrintSpec, points_mm: Array) -> Array:
    """Points of the target frame where the printed files have them: K^-1 along the bed's axes, about the origin.

    K is the `skew_matrix` of the compensation, so a printer with this skew puts them where the design has them.

    Args:
        target: the design.
        printing: gives the compensation; with none the points stay as they are.
        points_mm: in the target frame.  # (N, 3)
    """
    return against_skew_along(_bed_axes(target, printing), printing, points_mm)


def against_skew_along(bed_axes: Array, printing: PrintSpec, points_mm: Array) -> Array:
    """Points of a piece's frame where the printed files have them; `bed_axes` turn it to the bed's axes.  # (3, 3)"""
    if printing.skew_compensation_rad == NO_SKEW:
        return points_mm
    shear = bed_axes.T @ np.linalg.inv(skew_matrix(printing.skew_compensation_rad)) @ bed_axes
    return mapped(points_mm, shear)


def mapped(points_mm: Array, matrix: Array) -> Array:
    """A (3, 3) matrix times each point; like points stay alike to the bit, as the parts of a print need.  # (N, 3)

    Matrix products of libraries do not promise that: their rounding depends on a point's place in the array.
    """
    x, y, z = (points_mm[:, k, None] * matrix[:, k] for k in range(3))
    return x + y + z


def printed_size_mm(target: TargetGeometry, printing: PrintSpec) -> tuple[float, float, float]:
    """The part's bounding box along the bed's axes, as `bed_from_target` lays it."""
    corners = printed_corners_mm(target, printing)
    x, y, z = np.ptp(corners @ _bed_axes(target, printing).T, axis=0).tolist()
    return x, y, z


def bed_words(printer: PrinterProfile) -> str:
    """`the bed of bambu-p1s has 256 x 256 x 256 mm, of which 18 x 28 mm in front left may not be printed on`."""
    room = " x ".join(f"{length:g}" for length in printer.bed_mm)
    but = f", of which {printer.excluded_words} may not be printed on" if printer.excluded_mm else ""
    return f"the bed of {printer.name} has {room} mm{but}"


def overhang(target: TargetGeometry, printing: PrintSpec) -> tuple[int, float] | None:
    """How many faces hang over most, and how steeply they rise from the bed (rad); None: none does."""
    up = bed_from_target(target, printing)[2, :3]
    downward = -(target.target_from_face[:, :3, 2] @ up)
    over = downward[(downward > _ALIKE) & (downward < 1 - _ALIKE)]
    if not len(over):
        return None
    return int((over > over.max() - _ALIKE).sum()), math.acos(float(over.max()))


def printed_corners_mm(target: TargetGeometry, printing: PrintSpec) -> Array:
    """Corners of the printed solid in the target frame, with shrinkage and skew compensation and without stickers.

    A target made by others (without a spec) counts as flat faces.  # (N, 3)
    """
    return against_skew(target, printing, _straight_corners_mm(target, printing))


def _bed_axes(target: TargetGeometry, printing: PrintSpec) -> Array:
    """Rotation from the target's axes to the bed's, from the part before it is sheared.  # (3, 3)"""
    bed_x, bed_y, _ = printing.printer.bed_mm
    rotation = face_down(target)
    return _QUARTER_TURN @ rotation if is_turned(target, is_bed_deep=bed_y > bed_x) else rotation


def _straight_corners_mm(target: TargetGeometry, printing: PrintSpec) -> Array:
    """Corners of the printed solid, not yet sheared.  # (N, 3)"""
    corners, spec = corners_mm(target), target.spec
    if spec is not None and spec.solid is None:
        corners = np.concatenate([corners, corners - spec.depth_mm * target.target_from_face[:, None, :3, 2]])
    elif spec is not None and spec.solid is not None and printing.way.has_stickers:
        corners = corners * (1 - printing.sticker_thickness_mm / spec.solid.inradius_mm)
    printed: Array = corners.reshape(-1, 3) * (1 + printing.shrink_compensation_percent / 100)
    return printed
