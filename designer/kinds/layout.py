"""From a resolved spec to the nominal target geometry."""

import numpy as np
from numpy.typing import NDArray

from designer.base.code import Index
from designer.spec.spec import Spec
from designer.target import TargetGeometry

DECIMALS = 9
"""Coordinates are rounded to a picometre, so that processors whose sine differs in the last bit agree on ids."""


def lay_out(spec: Spec) -> TargetGeometry:
    """The nominal geometry of a target."""
    return spec.lay_out()


def same_on_all_faces(
    spec: Spec,
    *,
    index: list[Index],
    in_face_mm: NDArray[np.float64],  # (N, 2), the same on every face
    dots: list[frozenset[Index]],  # (F,)
    target_from_face: NDArray[np.float64],  # (F, 4, 4)
    outline_mm: NDArray[np.float64],  # (K, 2)
    window_mm: NDArray[np.float64],  # (K, 2)
    face_code: list[int],  # (F,)
    lattice_mm: NDArray[np.float64],  # (2, 2)
) -> TargetGeometry:
    """Put the same lattice on every face."""
    face_count, per_face = len(target_from_face), len(index)
    is_dot = np.array([pair in face_dots for face_dots in dots for pair in index])
    center = np.einsum("fij,nj->fni", target_from_face[:, :3, :2], in_face_mm) + target_from_face[:, None, :3, 3]
    radius = spec.ring_diameter_mm / 2

    def on_every_face(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.tile(np.round(values, DECIMALS), (face_count, 1, 1))

    return TargetGeometry(
        source="nominal",
        spec=spec,
        ring_face=np.repeat(np.arange(face_count), per_face),
        ring_index=np.tile(np.array(index), (face_count, 1)),
        center_mm=np.round(center.reshape(-1, 3), DECIMALS),
        radius_outer_mm=np.full(face_count * per_face, radius),
        radius_inner_mm=np.where(is_dot, 0.0, radius * spec.ring_ratio),
        is_dot=is_dot,
        target_from_face=np.round(target_from_face, 12),
        outline_mm=on_every_face(outline_mm),
        window_mm=on_every_face(window_mm),
        face_code=np.array(face_code),
        lattice_mm=on_every_face(lattice_mm),
    )
