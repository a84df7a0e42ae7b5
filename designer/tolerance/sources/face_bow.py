"""Faces that are not flat."""

import numpy as np

from designer.base.arrays import Array
from designer.target import TargetGeometry
from designer.tolerance.shape import MadeShape, face_middle_mm
from designer.tolerance.source import ErrorSource


def bow_mm(target: TargetGeometry, values: Array) -> Array:
    """Height of each ring over its face's plane for values (F, 3): dome, saddle and twist.  # (R,)

        z = (d (x^2 + y^2) + s (x^2 - y^2) + t 2 x y) / rim^2 - mean over the face's rings

    with x, y from the middle of the face's outline and rim the distance of its farthest corner: a value is the
    sagitta from the middle to the rim in millimetres. The three span all quadratic surfaces: a cylinder of sagitta h
    along x is d = s = h / 2. Equal spreads of s and t prefer no direction.
    """
    middle = face_middle_mm(target)
    rim = np.linalg.norm(target.outline_mm - middle[:, None], axis=2).max(axis=1)
    face = target.ring_face
    x, y = ((target.center_in_face_mm[:, :2] - middle[face]) / rim[face, None]).T
    dome, saddle, twist = values[face].T
    height = dome * (x**2 + y**2) + saddle * (x**2 - y**2) + twist * 2 * x * y
    count = np.bincount(face, minlength=target.face_count)
    mean = np.bincount(face, weights=height, minlength=target.face_count) / np.maximum(count, 1)
    bow: Array = height - mean[face]
    return bow


def bent(shape: MadeShape, values: Array) -> MadeShape:
    """The shape with its rings lifted off their planes, and not moved along them."""
    height = bow_mm(shape.nominal, values)
    return shape.with_rings_moved(np.stack([np.zeros_like(height), np.zeros_like(height), height], axis=1))


SOURCE = ErrorSource("face_bow", "bow of faces", "mm", "face", 3, bent)
