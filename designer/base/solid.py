"""Regular solids whose faces carry one lattice each and are told apart by codes of dots."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from designer.base.arrays import Array, Rows
from designer.base.codes import Index

BULGE = 1e-3
"""How far a body's corners may lie above one of its faces, as a share of its size."""
INLAY_SHARE = 0.9
"""Of a border's width, how much its floor may move in."""


@dataclass(frozen=True, eq=False)
class Polyhedron:
    """A regular solid of edge length 1 about the origin.

    A face's frame has its origin at the face's centroid, x along the lowest side, z outward; the first corner of the
    outline, at the top or left of it, is the one with the code.
    """

    name: str
    vertices: Array  # (V, 3)
    faces: Rows  # (F, K) counter-clockwise as seen from outside
    inradius: float  # from the origin to a face
    dihedral_rad: float  # between two faces, inside
    face_code: tuple[int, ...]  # rows of `CODES`  # (F,)
    code_corner: tuple[int, ...]  # which corner of each face carries its code  # (F,)
    net: tuple[tuple[int, int], ...]  # a face, and the one that it hangs on when unfolded; the first hangs on itself
    net_angle_rad: float  # in which direction the first vertex of the first face lies in the net

    @property
    def sides(self) -> int:
        """Of a face."""
        return int(self.faces.shape[1])

    @property
    def lattice(self) -> Literal["square", "triangular"]:
        """Of each face."""
        return "square" if self.sides == 4 else "triangular"

    @property
    def face_inradius(self) -> float:
        """From a face's centroid to its sides."""
        return 0.5 / math.tan(math.pi / self.sides)

    @property
    def height(self) -> float:
        """Of the solid on its last face: to the opposite face, or to a corner."""
        down = self.vertices[self.faces[-1]].mean(axis=0) / self.inradius
        return self.inradius - float((self.vertices @ down).min())

    @property
    def inset_per_depth(self) -> float:
        """How far the plane that halves the dihedral angle moves in from an edge, per unit of depth below the face."""
        return 1 / math.tan(self.dihedral_rad / 2)

    @property
    def border_per_inlay(self) -> float:
        """How wide a border must be for ink of depth 1: its floor moves in, and a tenth of its width must be left."""
        return self.inset_per_depth / INLAY_SHARE

    @property
    def faces_from_code(self) -> Rows:
        """The faces, each from the corner with its code on.  # (F, K)"""
        return np.array([np.roll(face, -corner) for face, corner in zip(self.faces, self.code_corner, strict=True)])

    def index(self, per_side: int) -> list[Index]:
        """Lattice indices of a face with so many features a side: i and j count along the sides at its code."""
        is_square = self.lattice == "square"
        return [(i, j) for i in range(per_side) for j in range(per_side if is_square else per_side - i)]

    def unfolded(self) -> tuple[Array, Array]:
        """The net of edge length 1 as seen from outside, its lower left corner at (0, 0).

        Returns:
            Rigid motions of the plane that bring the faces from their frames to the net, and the net's width and
            height.  # (F, 3, 3), (2,)
        """
        faces, outline = self.faces_from_code, regular_polygon(self.sides, self.face_inradius)
        motion = np.tile(np.eye(3), (len(faces), 1, 1))
        corner = np.empty((len(faces), self.sides, 2))
        for face, parent in self.net:
            if face == parent:
                shared = int(np.flatnonzero(faces[face] == self.faces[face, 0])[0])
                at, turn = np.zeros(2), self.net_angle_rad - _angle(outline[shared])
            else:
                place = dict(zip(faces[parent].tolist(), corner[parent], strict=True))
                own = faces[face].tolist()
                shared = next(k for k in range(self.sides) if own[k] in place and own[k - 1] in place)
                before, at = place[own[shared - 1]], place[own[shared]]
                turn = _angle(at - before) - _angle(outline[shared] - outline[shared - 1])
            rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
            motion[face, :2, :2] = rotation
            motion[face, :2, 2] = at - rotation @ outline[shared]
            corner[face] = outline @ rotation.T + motion[face, :2, 2]
        low, high = corner.min(axis=(0, 1)), corner.max(axis=(0, 1))
        motion[:, :2, 2] -= low
        return motion, high - low


@dataclass(frozen=True, eq=False)
class Solid:
    """A regular solid of some size."""

    polyhedron: Polyhedron
    edge_mm: float

    @property
    def inradius_mm(self) -> float:
        """From the centroid to a face."""
        return self.polyhedron.inradius * self.edge_mm

    @property
    def faces(self) -> tuple[tuple[int, ...], ...]:
        """Corners of each, from the one with its code on, counter-clockwise from outside."""
        return tuple(map(tuple, self.polyhedron.faces_from_code.tolist()))

    @property
    def bare(self) -> tuple[tuple[int, ...], ...]:
        """Faces without rings."""
        return ()

    @property
    def beside(self) -> dict[tuple[int, int], int]:
        """The face on the left of each edge, from one vertex to another."""
        return left_of(self.faces)

    @property
    def inset_per_depth(self) -> float:
        """See `Polyhedron.inset_per_depth`."""
        return self.polyhedron.inset_per_depth

    def corners_mm(self, *, below_mm: float = 0.0, scale: float = 1.0) -> Array:
        """Corners of the part that lies this deep and deeper below the faces, of the solid times a scale.  # (V, 3)"""
        return np.asarray((self.edge_mm * scale - below_mm / self.polyhedron.inradius) * self.polyhedron.vertices)


@dataclass(frozen=True, eq=False)
class Faceted:
    """A convex body of any flat faces, about the origin, or one that opens to it: faces with rings, and bare ones."""

    vertices_mm: Array  # (V, 3)
    faces: tuple[tuple[int, ...], ...]  # with rings, each from the corner at its code on, counter-clockwise outside
    bare: tuple[tuple[int, ...], ...] = ()  # from a corner on from which all others are seen
    is_inward: bool = False  # not convex: those with rings look at each other

    def __post_init__(self) -> None:
        every = (*self.faces, *self.bare)
        if not self.faces or not len(self.vertices_mm) or not np.isfinite(self.vertices_mm).all():
            raise ValueError("a body needs corners, and faces with rings")
        if any(len(set(face)) < max(len(face), 3) or not 0 <= min(face) <= max(face) < len(self.vertices_mm)
               for face in every):  # fmt: skip
            raise ValueError(
                f"a face must have 3 corners or more, each once, numbered 0 to {len(self.vertices_mm) - 1}"
            )
        edges = [(face[k - 1], face[k]) for face in every for k in range(len(face))]
        if len(set(edges)) < len(edges) or any((b, a) not in self.beside for a, b in edges):
            raise ValueError("faces must close the body: each edge belongs to two, which run along it in opposite ways")
        if self.is_inward:
            return
        above = self.vertices_mm @ self.planes[:, :3].T - self.planes[:, 3]
        if not above.max() <= BULGE * np.ptp(self.vertices_mm, axis=0).max() or self.planes[:, 3].min() <= 0:
            raise ValueError("the body is not convex about its origin, or a face is not flat or runs clockwise")

    @cached_property
    def planes(self) -> Array:
        """Outward normals and distances from the origin, the bare faces' last.  # (F + B, 4)"""
        return np.array([plane_of(self.vertices_mm[list(face)]) for face in (*self.faces, *self.bare)])

    def corners_mm(self, *, below_mm: float = 0.0, scale: float = 1.0) -> Array:
        """Corners with all faces moved in, of the solid times a scale; where more than three meet, on the mean."""
        moved = scale * self.vertices_mm
        for vertex in range(len(moved)) if below_mm else ():
            normal = self.planes[[vertex in face for face in (*self.faces, *self.bare)], :3]
            moved[vertex] -= below_mm * np.linalg.lstsq(normal, np.ones(len(normal)), rcond=None)[0]
        return np.asarray(moved)

    @cached_property
    def beside(self) -> dict[tuple[int, int], int]:
        """The face on the left of each edge, from one vertex to another; bare faces count on after the others."""
        return left_of((*self.faces, *self.bare))

    @property
    def mean_edge_mm(self) -> float:
        """Of all edges."""
        return float(np.mean([np.linalg.norm(self.vertices_mm[b] - self.vertices_mm[a]) for a, b in self.beside]))

    @cached_property
    def inset_per_depth(self) -> float:
        """How far a face's rim moves in per unit of depth, at the sharpest edge of a face with rings."""
        pairs = [(row, self.beside[b, a]) for (a, b), row in self.beside.items() if row < len(self.faces)]
        first, second = self.planes[np.array(pairs).T, :3]
        cosine = float(np.clip((first * second).sum(axis=1).min(), -1.0, 1.0))
        return math.tan(math.acos(cosine) / 2)


def left_of(faces: Sequence[Sequence[int]]) -> dict[tuple[int, int], int]:
    """The face on the left of each edge, from one vertex to another."""
    return {(face[k - 1], face[k]): row for row, face in enumerate(faces) for k in range(len(face))}


def area_of(corner: Array) -> float:
    """Of a flat polygon in space.  # (K, 3)"""
    return 0.5 * float(np.linalg.norm(_newell(corner)))


def plane_of(corner: Array) -> Array:
    """Unit normal and distance from the origin of a polygon in space, by Newell's sums.  # (K, 3) -> (4,)"""
    along = _newell(corner)
    normal = along / np.linalg.norm(along)
    return np.array([*normal, normal @ corner.mean(axis=0)])


def _newell(corner: Array) -> Array:
    """Along a polygon's normal, twice as long as its area is large.  # (K, 3) -> (3,)"""
    from_middle = corner - corner.mean(axis=0)
    (x, y, z), (u, v, w) = from_middle.T, np.concatenate([from_middle[1:], from_middle[:1]]).T
    return np.asarray(np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=1).sum(axis=0))


def regular_polygon(sides: int, inradius: float) -> Array:
    """Corners counter-clockwise about the origin, one side lowest; the first is at the top or left of it.  # (K, 2)"""
    first = math.pi / 2 + (math.pi / sides if sides % 2 == 0 else 0.0)
    turn = first + 2 * math.pi / sides * np.arange(sides)
    return inradius / math.cos(math.pi / sides) * np.stack([np.cos(turn), np.sin(turn)], axis=1)


def face_frames(corners: Array) -> Array:
    """Right-handed frames of regular faces: origin at the centroid, x along the lowest side, z along the normal.

    Args:
        corners: counter-clockwise as seen from the side z points to, from the top corner on.  # (F, K, 3)

    Returns:
        target_from_face.  # (F, 4, 4)
    """
    lowest = (corners.shape[1] - 1) // 2
    along = corners[:, lowest + 1] - corners[:, lowest]
    x_axis = along / np.linalg.norm(along, axis=1, keepdims=True)
    normal = np.cross(along, corners[:, (lowest + 2) % corners.shape[1]] - corners[:, lowest + 1])
    z_axis = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    frames = np.tile(np.eye(4), (len(corners), 1, 1))
    frames[:, :3, 0] = x_axis
    frames[:, :3, 1] = np.cross(z_axis, x_axis)
    frames[:, :3, 2] = z_axis
    frames[:, :3, 3] = corners.mean(axis=1)
    return frames


def _angle(step: Array) -> float:
    return math.atan2(step[1], step[0])
