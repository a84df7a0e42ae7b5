"""What planes parallel to the bed cut out of a mesh."""

from functools import cache, cached_property

import numpy as np
from manifold3d import CrossSection, FillRule, Manifold
from numpy.typing import NDArray

from designer.base.arrays import Array, Flags, Rows
from designer.make.mesh import Mesh, Part

Polyline = Array  # (N, 2)
SIMPLE_MM = 0.0125
"""Slicers leave out points that stray less (PrusaSlicer's G-code resolution, Bambu Studio's 0.012 mm)."""
_UPRIGHT_MM2 = 1e-9


class Layered:
    """A mesh in the bed's frame, to be cut into layers of one height; the plane of a layer is in its middle."""

    def __init__(self, mesh: Mesh, layer_mm: float) -> None:
        self._mesh = mesh
        self._layer_mm = layer_mm
        # Of each vertex the first layer whose plane is not below it: what is above a plane is told by these alone.
        self._rank = np.maximum(np.ceil(mesh.vertices_mm[:, 2] / layer_mm - 0.5), 0).astype(np.int32)
        a, b, c = self._rank[mesh.triangles.T]
        self._first, self._after = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)

    @cached_property
    def is_there(self) -> Flags:
        """In which layers there is any of it.  # (L,)"""
        there: Flags = self._count(self._first, self._after) > 0
        return there

    def is_in(self, layer: int) -> bool:
        """Whether a layer has any of it."""
        return 0 <= layer < len(self.is_there) and bool(self.is_there[layer])

    def lowest_like(self, layer: int) -> int:
        """The lowest layer that is cut as a layer is, between the same upright walls; -1 below the bed."""
        return int(self._alike[min(layer, len(self._alike) - 1)]) if layer >= 0 else -1

    @cached_property
    def _alike(self) -> Rows:
        """`lowest_like` of each layer and of those above: a new one where walls begin, end or lean.  # (L + 1,)"""
        cut = np.flatnonzero(self._first < self._after)
        a, b, c = (self._mesh.vertices_mm[self._mesh.triangles[cut, k], :2] for k in range(3))
        (first_x, first_y), (second_x, second_y) = (b - a).T, (c - a).T
        leans = cut[np.abs(first_x * second_y - first_y * second_x) >= _UPRIGHT_MM2]  # twice the areas from above
        count = len(self.is_there)
        ends = np.concatenate([self._first[cut], self._after[cut]])
        is_new = np.bincount(ends, minlength=count + 1) > 0
        is_new[:count] |= self._count(self._first[leans], self._after[leans]) > 0
        alike: Rows = np.maximum.accumulate(np.where(is_new, np.arange(count + 1), 0))
        return alike

    def _count(self, first: NDArray[np.int32], after: NDArray[np.int32]) -> Rows:
        """How many of some triangles each layer's plane cuts.  # (L,)"""
        count = int(self._after.max(initial=0))
        steps = np.bincount(first, minlength=count + 1) - np.bincount(after, minlength=count + 1)
        return np.cumsum(steps[:count])

    def section(self, layer: int) -> CrossSection:
        """What a layer's plane cuts out of it: the area between the triangles that reach through it."""
        cut = np.flatnonzero((self._first <= layer) & (self._after > layer))
        triangles = self._mesh.triangles.take(cut, axis=0)  # in a third of the time that flags take
        if not len(triangles):
            return CrossSection()
        points, following = _segments(
            self._mesh.vertices_mm, triangles.astype(np.int64), self._rank[triangles] > layer,
            (layer + 0.5) * self._layer_mm,
        )  # fmt: skip
        return CrossSection(contours(points, following), FillRule.Positive).simplify(SIMPLE_MM)


def _segments(vertices_mm: Array, triangles: Rows, above: Flags, plane: float) -> tuple[Array, Rows]:
    """Where each triangle's piece of the contour begins, and the triangle that goes on from its end.

    Seen from outside, a triangle's edges run counter-clockwise: the piece goes from the edge that falls through the
    plane to the edge that rises through it, which its neighbour has as the falling one.
    """
    ahead = above[:, [1, 2, 0]]
    rows = np.arange(len(triangles))

    def edge(at: NDArray[np.intp]) -> tuple[Rows, Rows]:
        """Its two vertices, the smaller number first.  # (T,) twice"""
        one, other = triangles[rows, at], triangles[rows, (at + 1) % 3]
        return np.minimum(one, other), np.maximum(one, other)

    falling, rising = edge((above & ~ahead).argmax(axis=1)), edge((~above & ahead).argmax(axis=1))
    a, b = (vertices_mm.take(vertex, axis=0) for vertex in falling)
    share = (plane - a[:, 2]) / (b[:, 2] - a[:, 2])
    points = a[:, :2] + share[:, None] * (b[:, :2] - a[:, :2])
    begins, ends = (low * len(vertices_mm) + high for low, high in (falling, rising))
    order = np.argsort(begins)
    return points, order[np.minimum(np.searchsorted(begins[order], ends), len(order) - 1)]


def contours(points: Array, following: Rows) -> list[Polyline]:
    """The closed contours, each from its first point on: jumps twice as far at a time find it, and how far it is."""
    rows = np.arange(len(points))
    first, ahead = rows, following
    for _ in range(len(points).bit_length()):
        first, ahead = np.minimum(first, first[ahead]), ahead[ahead]
    away, ahead = (rows != first).astype(np.int64), np.where(rows == first, rows, following)
    for _ in range(len(points).bit_length()):
        away, ahead = away + away[ahead], ahead[ahead]
    order = np.lexsort((-away, rows != first, first))
    begins = np.flatnonzero((rows == first)[order])
    return [loop for loop in np.split(points[order], begins[1:]) if len(loop) > 2]


class Sliced:
    """A piece in layers: what the plane of each cuts out of its body, of its ink, and of both together.

    Layers that are cut alike share their sections.
    """

    def __init__(self, part: Part, layer_mm: float) -> None:
        self._layer_mm = layer_mm
        meshes = (part.body,) if part.ink is None else (part.body, part.ink)
        self._layered = tuple(Layered(mesh, layer_mm) for mesh in meshes)
        hull = Manifold.hull_points(np.concatenate([mesh.vertices_mm for mesh in meshes]))
        self._is_hull = sum(mesh.volume_mm3 for mesh in meshes) > (1 - _EXACTLY) * hull.volume()
        self._hull = hull if self._is_hull else None
        self.count = max(len(one.is_there) for one in self._layered)
        self._outline_of, self._sections_of = cache(self._cut_outline), cache(self._cut_sections)

    @property
    def is_there(self) -> Flags:
        """In which layers there is any body, and any ink.  # (2, L)"""
        there = np.zeros((2, self.count), dtype=bool)
        for row, one in enumerate(self._layered):
            there[row, : len(one.is_there)] = one.is_there
        return there

    def lowest_like(self, layer: int) -> int:
        """The lowest layer that is cut as a layer is, between the same upright walls; -1 below the bed."""
        return max(one.lowest_like(layer) for one in self._layered)

    def outline(self, layer: int) -> CrossSection:
        """Of body and ink together; nothing beside the layers that there are."""
        return self._outline_of(self.lowest_like(layer))

    def sections(self, layer: int) -> tuple[CrossSection, ...]:
        """Of the body, and of the ink where a piece has any."""
        return self._sections_of(self.lowest_like(layer))

    def _cut_outline(self, layer: int) -> CrossSection:
        if not 0 <= layer < self.count:
            return CrossSection()
        if self._hull is not None:
            return self._hull.slice((layer + 0.5) * self._layer_mm).simplify(SIMPLE_MM)
        body, *ink = self.sections(layer)
        return body + ink[0] if ink else body

    def _cut_sections(self, layer: int) -> tuple[CrossSection, ...]:
        if len(self._layered) == 1:
            return (self.outline(layer) if self._is_hull else self._layered[0].section(layer),)
        body, ink = self._layered
        if not ink.is_in(layer):
            return body.section(layer), CrossSection()
        inside = body.section(layer)
        return inside, (self.outline(layer) - inside).simplify(SIMPLE_MM) if self._is_hull else ink.section(layer)


_EXACTLY = 1e-6
"""Of a convex part's volume, by which body and ink may miss it: rounding."""
