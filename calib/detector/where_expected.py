"""Where the features of a face should lie in a photo, from those that were found: for drawing only."""

from dataclasses import dataclass

import cv2
import numpy as np

from calib.core.types import Detections
from designer.base.arrays import Array, Rows
from designer.target import TargetGeometry

_NEAREST = 4
"""Found features whose residuals predict that of another."""
_ENOUGH_FOR_HOMOGRAPHY = 8
_AT_ONCE = 256
"""Places in one block of distances, so that large boards need no large memory."""


@dataclass(frozen=True, eq=False)
class _FaceMap:
    """From a face's plane to the picture: its homography, moved as the nearest found features are off it.

    The second part follows lens distortion. With few features the map is affine; with fewer there is none.
    """

    from_mm: Array  # (N, 2) found features
    off_px: Array  # (N, 2) their places in the picture less those of the homography
    plane: Array | None  # (3, 3)

    def at(self, at_mm: Array) -> tuple[Array, Array]:
        """Places, and px over mm there; nan where they are not known.  # (K, 2) -> (K, 2), (K, 2, 2)"""
        if self.plane is None:
            return np.full((len(at_mm), 2), np.nan), np.full((len(at_mm), 2, 2), np.nan)
        mapped, slope = _mapped(self.plane, at_mm)
        for first in range(0, len(at_mm), _AT_ONCE):
            some = slice(first, first + _AT_ONCE)
            mapped[some] += _nearby(self.from_mm, self.off_px, at_mm[some])
        return mapped, slope


@dataclass(frozen=True, eq=False)
class ImagedFace:
    """A face with N found features."""

    face: int
    rows: Rows  # (N,) of the detections
    ring: Rows  # (N,) of the target
    in_face_mm: Array  # (N, 2)
    map: _FaceMap
    center_px: Array  # (N, 2)
    ellipse_px: Array  # (N, 5)
    missing_ellipse_px: Array  # (K, 5) expected inside the picture, but not found
    middle_px: Array  # (2,)
    size_px: float  # square root of the face's area; nan if too few features tell it

    def at_index(self, target: TargetGeometry, i: float, j: float) -> Array | None:
        """Where lattice index (i, j) lies; None if the found features do not tell.  # (2,)"""
        at = _origin_mm(target, self.face) + np.array([i, j]) @ target.lattice_mm[self.face]
        place, _ = self.map.at(at[None])
        return place[0] if np.isfinite(place).all() else None

    def gaps_px(self, target: TargetGeometry) -> Array:
        """Middles of the gaps around each found feature, side by side.  # (K, N, 2)"""
        steps = _gap_steps(target.lattice_mm[self.face])
        place, _ = self.map.at((self.in_face_mm + steps[:, None]).reshape(-1, 2))
        return place.reshape(len(steps), -1, 2)

    def corner_rows(self, target: TargetGeometry) -> list[int]:
        """The found features at the extremes of the lattice, as rows of `ring`."""
        i, j = target.ring_index[self.ring].T
        return sorted({int(at) for key in (i + j, i - j) for at in (np.argmin(key), np.argmax(key))})


def imaged_face(seen: Detections, target: TargetGeometry, face: int) -> ImagedFace:
    """The found features of a face, and where the others should be."""
    rows = np.flatnonzero(target.ring_face[seen.ring] == face)
    ring = seen.ring[rows]
    flat = target.center_in_face_mm[:, :2]
    missing = np.setdiff1d(np.flatnonzero(target.ring_face == face), ring)
    found_mm, found_px = flat[ring], seen.center_px[rows]
    of_face = face_map(found_mm, found_px)
    place, affine = of_face.at(flat[missing])
    ellipse = imaged_circles(place, affine, target.reach_mm[missing])
    width, height = seen.image_size
    inside = (
        np.isfinite(ellipse).all(axis=1)
        & (place > 0).all(axis=1)
        & (place[:, 0] < width - 1)
        & (place[:, 1] < height - 1)
        & (ellipse[:, 3] > 0.15 * ellipse[:, 2])
    )
    outline = target.outline_mm[face]
    middle, at_middle = of_face.at(outline.mean(axis=0)[None])
    area_mm2 = 0.5 * abs(
        float(np.sum(outline[:, 0] * np.roll(outline[:, 1], -1) - outline[:, 1] * np.roll(outline[:, 0], -1)))
    )
    size = float(np.sqrt(abs(_determinant(at_middle[0])) * area_mm2))
    return ImagedFace(
        face=face,
        rows=rows,
        ring=ring,
        in_face_mm=found_mm,
        map=of_face,
        center_px=found_px,
        ellipse_px=seen.ellipse_px[rows],
        missing_ellipse_px=ellipse[inside],
        middle_px=middle[0] if np.isfinite(middle).all() else found_px.mean(axis=0),
        size_px=size,
    )


def _determinant(slope: Array) -> float:
    """Of a 2 x 2 matrix, nan included."""
    return float(slope[0, 0] * slope[1, 1] - slope[0, 1] * slope[1, 0])


def face_map(from_mm: Array, to_px: Array) -> _FaceMap:
    """The map that found features tell.  # (N, 2), (N, 2)"""
    spread = np.linalg.svd(from_mm - from_mm.mean(axis=0), compute_uv=False) if len(from_mm) > 2 else np.zeros(2)
    plane = None if spread[1] <= 0.05 * spread[0] else _plane_map(from_mm, to_px)
    off_px = to_px - _mapped(plane, from_mm)[0] if plane is not None else np.zeros_like(to_px)
    return _FaceMap(from_mm, off_px, plane)


def _nearby(from_mm: Array, off: Array, at_mm: Array) -> Array:
    """Mean of the values at the nearest points, the nearer the heavier.  # (N, 2), (N, 2), (K, 2) -> (K, 2)"""
    distance2 = np.sum((at_mm[:, None] - from_mm) ** 2, axis=2)  # (K, N)
    count = min(_NEAREST, len(from_mm))
    near = np.argpartition(distance2, count - 1, axis=1)[:, :count]
    nearest2 = np.take_along_axis(distance2, near, axis=1)
    weight = 1 / (nearest2 + 0.01 * nearest2.max(axis=1, keepdims=True))
    mean: Array = np.einsum("kn,knc->kc", weight / weight.sum(axis=1, keepdims=True), off[near])
    return mean


def _plane_map(from_mm: Array, to_px: Array) -> Array | None:
    """The homography, or with few points the affine map, that takes a plane to the picture.  # (3, 3)"""
    if len(from_mm) >= _ENOUGH_FOR_HOMOGRAPHY:
        homography, _ = cv2.findHomography(from_mm, to_px)
        return None if homography is None else np.asarray(homography, dtype=np.float64)
    solution = np.linalg.lstsq(np.column_stack([from_mm, np.ones(len(from_mm))]), to_px, rcond=None)[0]
    return np.vstack([solution.T, [0.0, 0.0, 1.0]])


def _mapped(plane: Array, at: Array) -> tuple[Array, Array]:
    """Images of points and the map's derivative there; nan beyond the horizon.  # (K, 2) -> (K, 2), (K, 2, 2)"""
    in_plane = np.column_stack([at, np.ones(len(at))]) @ plane.T
    depth = np.where(in_plane[:, 2] > 1e-9, in_plane[:, 2], np.nan)
    image = in_plane[:, :2] / depth[:, None]
    slope = (plane[:2, :2] - image[:, :, None] * plane[2, :2]) / depth[:, None, None]
    return image, slope


def imaged_circles(center_px: Array, affine: Array, radius_mm: Array) -> Array:
    """Ellipses of circles under local affine maps.  # (K, 2), (K, 2, 2), (K,) -> (K, 5)"""
    ellipse = np.full((len(center_px), 5), np.nan)
    for k in np.flatnonzero(np.isfinite(affine).all(axis=(1, 2))):
        axes, length, _ = np.linalg.svd(affine[k])
        ellipse[k] = *center_px[k], *(length * radius_mm[k]), np.arctan2(axes[1, 0], axes[0, 0])
    return ellipse


def _origin_mm(target: TargetGeometry, face: int) -> Array:
    """Where index (0, 0) lies in the face's frame, whether there is a feature or not.  # (2,)"""
    first = int(np.flatnonzero(target.ring_face == face)[0])
    origin: Array = target.center_in_face_mm[first, :2] - target.ring_index[first] @ target.lattice_mm[face]
    return origin


def _gap_steps(lattice_mm: Array) -> Array:
    """From a feature to the middles of the gaps around it: of square cells, or of triangles.  # (2, 2) -> (K, 2)"""
    steps = np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)]) @ lattice_mm
    length = np.linalg.norm(steps, axis=1)
    nearest = steps[length < 1.2 * length.min()]
    turned = nearest[np.argsort(np.arctan2(nearest[:, 1], nearest[:, 0]))]
    corners = 2 if len(turned) == 4 else 3
    middles: Array = (turned + np.roll(turned, -1, axis=0)) / corners
    return middles
