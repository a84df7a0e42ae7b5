"""What the detector needs of a target, worked out once."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from calib.detector.grid import Lattice, lattice_of
from designer.base.arrays import Array, Flags, Rows
from designer.kinds.layout import true_corners
from designer.target import TargetGeometry, corners_mm

ALIKE = 0.25
"""How far features of faces that are alike may lie apart, as a share of the pitch."""


@dataclass(frozen=True, eq=False)
class TargetPlan:
    """A target with its lattice, a table from indices to rows, and where its marks are."""

    target: TargetGeometry
    lattice: Lattice
    row_table: Rows  # (F, I, J) row of the target at an index less `low`; -1: nothing there
    low: Rows  # (2,) smallest index
    ratio: float  # inner over outer radius of the rings; 0: another maker's circles, all of which are dots
    radius_mm: float  # outer, the usual one
    limit: float  # how far out pixels may be used, in outer radii: half the white gap
    alike: Rows  # (F,) the first face with the same lattice in the same outline
    corner: tuple[Rows, ...]  # (F,) the true corners of each outline
    corner_vertex: Rows  # (F, K) which corners are one point of the solid; of faces with fewer, points of their own
    beyond_face: Rows  # (B,) of the places one step outside the target, on its lattice
    beyond_mm: Array  # (B, 2) these places in the face's plane
    mark_index: Rows  # (P, 2) candidate positions of marks on a face
    mark_is_dot: Flags  # (F, P) which of them carry a dot

    @property
    def pitch_radii(self) -> float:
        """Distance of neighbours in outer radii."""
        return float(np.linalg.norm(self.lattice.move_in_radii, axis=1).min())

    def by_face(self, ring: Rows, pixel: Array) -> list[tuple[Array, Array]]:
        """Features face by face: their places in the face's plane in mm, and in the image.  # (N,), (N, 2)"""
        face = self.target.ring_face[ring]
        plane = self.target.center_in_face_mm[ring, :2]
        return [(plane[face == f], pixel[face == f]) for f in np.unique(face)]

    def rows_on_all(self, index: Rows) -> Rows:
        """Rows of the target at indices, for each face; -1 where it has nothing.  # (N, 2) -> (F, N)"""
        return _looked_up(self.row_table, index - self.low)

    def lattice_mm(self, face: int, index: Rows) -> Array:
        """Where indices lie on a face, whether the target has a feature there or not.  # (N, 2) -> (N, 2)"""
        return _lattice_mm(self.target, face, index)

    def rows_at(self, face: int, index: Rows) -> Rows:
        """Rows of the target at indices of one face, -1 where it has nothing.  # (N, 2) -> (N,)"""
        return np.asarray(_looked_up(self.row_table[face : face + 1], index - self.low)[0])


def _looked_up(table: Rows, at: Rows) -> Rows:
    """What tables have at an index; -1 outside.  # (F, I, J), (N, 2) -> (F, N)"""
    size = table.shape[1:]
    i, j = at[:, 0], at[:, 1]
    inside = (i >= 0) & (i < size[0]) & (j >= 0) & (j < size[1])
    return np.asarray(np.where(inside, table[:, np.where(inside, i, 0), np.where(inside, j, 0)], -1))


@lru_cache(maxsize=8)
def plan_for(target: TargetGeometry) -> TargetPlan:
    """The plan of a target."""
    rings = ~target.is_dot
    if not rings.any() and target.marks is None:
        raise ValueError("the target holds dots only; the detector starts from rings")
    rings |= target.marks is not None
    low = target.ring_index.min(axis=0)
    size = target.ring_index.max(axis=0) - low + 1
    table = np.full((target.face_count, *size), -1, dtype=np.int64)
    at = target.ring_index - low
    table[target.ring_face, at[:, 0], at[:, 1]] = np.arange(target.ring_count)
    radius = float(np.median(target.radius_outer_mm))
    mark_index, mark_is_dot = _marks(target)
    corner = tuple(true_corners(outline) for outline in target.outline_mm)
    lattice = lattice_of(target)
    beyond_face, beyond_mm = _one_step_outside(target, lattice, table, low)
    return TargetPlan(
        target=target,
        lattice=lattice,
        row_table=table,
        low=low,
        ratio=float(np.median(target.radius_inner_mm[rings] / target.radius_outer_mm[rings])),
        radius_mm=radius,
        limit=1 + 0.5 * _white_gap_mm(target) / radius,
        alike=_alike(target),
        corner=corner,
        corner_vertex=_shared_corners(target, corner),
        beyond_face=beyond_face,
        beyond_mm=beyond_mm,
        mark_index=mark_index,
        mark_is_dot=mark_is_dot,
    )


def _lattice_mm(target: TargetGeometry, face: int, index: Rows) -> Array:
    """Where indices lie on a face.  # (N, 2) -> (N, 2)"""
    first = int(np.flatnonzero(target.ring_face == face)[0])
    steps = target.lattice_mm[face]
    return np.asarray(target.center_in_face_mm[first, :2] + (index - target.ring_index[first]) @ steps)


def _one_step_outside(target: TargetGeometry, lattice: Lattice, table: Rows, low: Rows) -> tuple[Rows, Array]:
    """Places of the lattice that the target does not have, next to those that it has: faces (B,), places (B, 2)."""
    faces, places = [], []
    for face in range(target.face_count):
        own = target.ring_index[target.ring_face == face]
        near = np.unique((own[:, None] + lattice.move[None]).reshape(-1, 2), axis=0)
        near = near[_looked_up(table[face : face + 1], near - low)[0] < 0]
        faces.append(np.full(len(near), face))
        places.append(_lattice_mm(target, face, near))
    return np.concatenate(faces), np.concatenate(places)


def _white_gap_mm(target: TargetGeometry) -> float:
    """The least white between a ring and its neighbour or the border."""
    radius = float(target.radius_outer_mm.max())
    gaps = []
    for face in range(target.face_count):
        rows = np.flatnonzero(target.ring_face == face)
        point = target.center_in_face_mm[rows, :2]
        if len(rows) > 1:
            nearest = np.inf
            for start in range(0, len(rows), 256):
                offset = point[start : start + 256, None] - point[None]
                distance = np.hypot(offset[..., 0], offset[..., 1])
                distance[distance == 0] = np.inf
                nearest = min(nearest, float(distance.min()))
            gaps.append(nearest - 2 * radius)
        corner = target.window_mm[face]
        along = np.roll(corner, -1, axis=0) - corner
        inward = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)
        depth = np.einsum("kc,nkc->nk", inward, point[:, None] - corner[None])
        gaps.append(2 * (float(depth.min()) - radius))
    return max(min(gaps), 0.1 * radius)


def _alike(target: TargetGeometry) -> Rows:
    """The first face whose features lie as a face's own do, index by index, in the same outline.  # (F,)"""
    near = ALIKE * float(np.linalg.norm(target.lattice_mm[0], axis=1).min())
    order = np.lexsort((*target.ring_index.T, target.ring_face))
    face = target.ring_face[order]
    index = [target.ring_index[order][face == number] for number in range(target.face_count)]
    place = [target.center_in_face_mm[order][face == number] for number in range(target.face_count)]
    alike = np.arange(target.face_count)
    for number in alike:
        for other in range(number):
            if (
                np.array_equal(index[other], index[number])
                and np.abs(place[other] - place[number]).max(initial=0.0) < near
                and np.abs(target.outline_mm[other] - target.outline_mm[number]).max() < near
            ):
                alike[number] = other
                break
    return alike


def _shared_corners(target: TargetGeometry, corner: tuple[Rows, ...]) -> Rows:
    """Number the corners of all outlines so that corners at one place share a number.  # (F, K)"""
    every = corners_mm(target)
    most = max(map(len, corner))
    flat = np.full((target.face_count, most, 3), np.inf)
    for face, own in enumerate(corner):
        flat[face, : len(own)] = every[face, own]
    tolerance = 0.1 * min(
        float(np.linalg.norm(every[face, own] - every[face, np.roll(own, 1)], axis=1).min())
        for face, own in enumerate(corner)
    )
    point = flat.reshape(-1, 3)
    with np.errstate(invalid="ignore"):
        is_one = np.linalg.norm(point[:, None] - point[None], axis=2) < tolerance
    np.fill_diagonal(is_one, val=True)
    return np.asarray(np.argmax(is_one, axis=1).reshape(target.face_count, most))


def _marks(target: TargetGeometry) -> tuple[Rows, Flags]:
    """Where marks may be, and where they are: of coded faces wherever one has a dot, row by row from the corner on."""
    face, index = target.ring_face[target.is_dot], target.ring_index[target.is_dot]
    place, row = np.unique(np.column_stack([index.sum(axis=1), index[:, ::-1]]), axis=0, return_inverse=True)
    is_dot = np.zeros((target.face_count, len(place)), dtype=np.bool_)
    is_dot[face, row.reshape(-1)] = True
    return place[:, :0:-1].copy(), is_dot
