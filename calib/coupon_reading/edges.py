"""The edges of a coupon's ink: which there are, and the pixels across each.

An edge's displacement is positive where ink has grown into the white. Around a ring it is b_x cos^2 a + b_y sin^2 a in
the direction a, which is to first order what growing by b_x along x and by b_y along y does to a circle.

How an edge between ink and white looks in a picture: its blur, the picture's tone curve, and its sharpening.

Light is blurred by the lens, so that across an edge it rises from ink to white as z(x), x = d / s in standard
deviations of the blur: a bell, or the disc of a lens out of focus, or something between. The file holds grey levels

    v = S(l^(1/g)),    S(t) = t + c (3 t^2 - 2 t^3 - t),    0 to 1 = full scale,

with a power g and a contrast c, and sharpening adds a (v - G * v), with G a bell of r blurs. A power moves the middle
of an edge into the ink by nearly half a blur (g = 2.2), which ink that shrank by as much would do too. But it also
makes the edge lopsided, which bleeding ink does not: any symmetric blur has z(-x) = 1 - z(x). So the curve is told by
the edge's shape.
"""

import math
from collections.abc import Iterator
from dataclasses import astuple, dataclass, fields
from functools import cached_property
from typing import Literal

import numpy as np

from calib.core.jit import jit_inside
from calib.coupon_reading.place import Placed
from designer.base.arrays import Array, Flags
from designer.target import TargetGeometry

Feature = Literal["ring", "black line", "white line"]

END_MM = 0.6
"""Of a line's length that is left out at either end."""
MOST_REACH_PX = 7.0
"""On either side of an edge where it is."""
MOST_ROOM_MM = 1.0
MOST_MOVED_MM = 0.3
"""More than any printer's ink runs; the pixels that are first looked at reach as much further."""
LEAST_PIXELS = 60
MOST_PIXELS = 1000
"""Of an edge: more tell it no better than any printer draws it."""


@dataclass(frozen=True, eq=False)
class Edge:
    """An edge as drawn."""

    feature: Feature
    width_mm: float  # of the stroke, or of the line
    axis: int  # of a line's normal: 0 along x, 1 along y; -1: a circle
    middle_mm: Array  # (2,) a circle's centre, or a point on a line's edge
    to_white: float  # +1: the white lies outside of the circle, or further along the axis; -1: the other way
    radius_mm: float  # of a circle; of a line half its length
    room_mm: tuple[float, float]  # into the ink and into the white, halfway to the next edge

    def distance_mm(self, place: Array) -> tuple[Array, Array]:
        """How far places (N, 2) lie in the white, and the unit normals into it (N, 2)."""
        offset = place - self.middle_mm
        if self.axis >= 0:
            normal = np.zeros_like(offset)
            normal[:, self.axis] = self.to_white
            return self.to_white * offset[:, self.axis], normal
        length = np.maximum(np.linalg.norm(offset, axis=1), 1e-9)
        return self.to_white * (length - self.radius_mm), self.to_white * offset / length[:, None]

    def is_beside(self, place: Array) -> Flags:
        """Whether places lie where the edge is, not beyond a line's ends."""
        if self.axis < 0:
            return np.ones(len(place), dtype=bool)
        along: Flags = np.abs((place - self.middle_mm)[:, 1 - self.axis]) < self.radius_mm - END_MM
        return along

    def moves(self, place: Array, normal: Array) -> Array:
        """How the numbers of the edge's displacement move it at places: of a circle four, of a line one.  # (N, K)"""
        moves: Array = np.column_stack([normal**2, normal]) if self.axis < 0 else np.ones((len(place), 1))
        return moves

    @property
    def corners_mm(self) -> Array:
        """Of a box around all that belongs to the edge.  # (4, 2)"""
        half = np.full(2, self.radius_mm + max(self.room_mm))
        if self.axis >= 0:
            half[self.axis] = max(self.room_mm)
        corners: Array = self.middle_mm + half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        return corners


def edges_of(target: TargetGeometry) -> tuple[Edge, ...]:
    """All edges of a coupon's rings, dots and lines."""
    return (*_circles(target), *_lines(target))


def _circles(target: TargetGeometry) -> Iterator[Edge]:
    gap_mm = float(np.linalg.norm(target.lattice_mm[0, 0])) - 2 * float(target.radius_outer_mm.max())
    for row, middle in enumerate(target.center_in_face_mm[:, :2]):
        outer, inner = float(target.radius_outer_mm[row]), float(target.radius_inner_mm[row])
        width = outer - inner
        yield Edge("ring", width, -1, middle, 1.0, outer, _rooms(width, gap_mm))
        if inner > 0:
            yield Edge("ring", width, -1, middle, -1.0, inner, _rooms(width, inner))


def _rooms(ink_mm: float, white_mm: float) -> tuple[float, float]:
    """Halves of what is next to an edge: where ink grows or shrinks, the middle between two edges stays."""
    return min(ink_mm / 2, MOST_ROOM_MM), min(white_mm / 2, MOST_ROOM_MM)


def _lines(target: TargetGeometry) -> Iterator[Edge]:
    """Of two bars beside each other the narrower is the line: the black, or the white between them."""
    if target.spec is None:
        return
    bars = target.spec.marks_mm
    low, high = bars.min(axis=1), bars.max(axis=1)
    axis = (high - low).argmin(axis=1)
    for number, along in enumerate(axis.tolist()):
        start, end = low[number, along], high[number, along]
        side = (axis == along) & (np.abs((low + high - low[number] - high[number])[:, 1 - along]) < 1e-6)
        before, after = high[side, along], low[side, along]
        gaps = (start - before[before < start].max(initial=-np.inf), after[after > end].min(initial=np.inf) - end)
        for at, to_white, gap in ((start, -1.0, gaps[0]), (end, 1.0, gaps[1])):
            width = float(end - start)
            is_white, narrow = gap < width, float(min(gap, width))
            if is_white or min(gaps) >= width:
                middle = np.zeros(2)
                middle[along], middle[1 - along] = at, (low[number] + high[number])[1 - along] / 2
                half = float((high - low)[number, 1 - along]) / 2
                name: Feature = "white line" if is_white else "black line"
                yield Edge(name, narrow, along, middle, to_white, half, _rooms(width, float(gap)))


@dataclass(frozen=True, eq=False)
class Pixels:
    """N pixels across an edge."""

    value: Array  # (N,) grey levels
    offset: Array  # (N, 2) from the edge's middle, over its size, for the light's gradients
    place: Array  # (N, 2) in the picture, from -1 to 1 along its longer side
    distance_px: Array  # (N,) into the white of the edge as drawn
    per_mm: Array  # (N,) pixels along the normal
    direction: Array  # (N, 2) of the normal in the picture
    moves: Array  # (N, K) of the distance in mm, by the numbers of the displacement
    bend_px: Array  # (N,) curvature of the edge, 1 / px; above 0: the ink is convex
    room_px: tuple[float, float]  # into the ink and into the white as drawn

    @cached_property
    def usual_per_mm(self) -> float:
        """Pixels along the normal."""
        return float(np.median(self.per_mm))

    @cached_property
    def lightest(self) -> float:
        """The largest grey level."""
        return float(self.value.max())

    def within(self, rows: Flags) -> "Pixels":
        """Some of them."""
        arrays = {one.name: getattr(self, one.name)[rows] for one in fields(self) if one.name != "room_px"}
        return Pixels(**arrays, room_px=self.room_px)


def pixels_of(image: Array, placed: Placed, edge: Edge) -> Pixels | None:
    """The pixels across an edge; None: too few are in the picture, or it is too coarse.

    Args:
        image: grey levels (H, W).
        placed: where the design lies in it.
        edge: which.
    """
    box = placed.pixel(edge.corners_mm)
    height, width = image.shape
    low = np.floor(box.min(axis=0)).astype(int)
    high = np.ceil(box.max(axis=0)).astype(int) + 1
    if (low < 0).any() or high[0] > width or high[1] > height:
        return None
    u, v = (axis.ravel() for axis in np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1])))
    pixel = np.column_stack([u, v]).astype(np.float64)
    place = placed.design(pixel)
    distance_mm, normal = edge.distance_mm(place)
    into_ink, into_white = edge.room_mm
    near = (-into_ink < distance_mm) & (distance_mm < into_white) & edge.is_beside(place)
    if near.sum() < LEAST_PIXELS:
        return None
    pixel, place, distance_mm, normal = pixel[near], place[near], distance_mm[near], normal[near]
    # Rows of the Jacobian of the place by the pixel, by central differences of half a pixel: exact for all that is
    # quadratic there.
    by_u, by_v = (placed.design(pixel + half) - placed.design(pixel - half) for half in 0.5 * np.eye(2))
    slope = np.column_stack([(by_u * normal).sum(axis=1), (by_v * normal).sum(axis=1)])
    mm_per_px = np.linalg.norm(slope, axis=1)
    distance_px = distance_mm / mm_per_px
    px_per_mm = float(np.quantile(1 / mm_per_px, 0.05))
    most_px = MOST_REACH_PX + MOST_MOVED_MM * px_per_mm
    room_px = min(most_px, into_ink * px_per_mm), min(most_px, into_white * px_per_mm)
    (taken,) = np.nonzero((-room_px[0] < distance_px) & (distance_px < room_px[1]))
    if len(taken) < LEAST_PIXELS:
        return None
    taken = taken[:: len(taken) // MOST_PIXELS + 1]
    bend = 0.0 if edge.axis >= 0 else edge.to_white / edge.radius_mm
    half = max(image.shape) / 2
    return Pixels(
        value=image[v[near][taken], u[near][taken]].astype(np.float64),
        offset=((place - edge.middle_mm) / edge.radius_mm)[taken],
        place=(pixel[taken] - [(width - 1) / 2, (height - 1) / 2]) / half,
        distance_px=distance_px[taken],
        per_mm=1 / mm_per_px[taken],
        direction=(slope / mm_per_px[:, None])[taken],
        moves=edge.moves(place, normal)[taken],
        bend_px=bend * mm_per_px[taken],
        room_px=room_px,
    )


REACH, STEP = 9.0, 0.05
"""Of the profile, in blurs."""
GAMMA, GAMMA_SIGMA = 2.0, 0.35
"""The tone curve's power before anything was seen, and the standard deviation of its logarithm: linear to steep. The
usual encoding (IEC 61966-2-1, sRGB) is near 2.2; what a phone does on top is not published."""
SHARPENING_SIGMA, RADIUS, RADIUS_SIGMA = 0.4, 1.5, 0.3
"""Likewise of the sharpening: none, with this much to either side, and its bell in blurs. Assumptions."""


CONTRAST_SIGMA = 0.3
"""Likewise of the contrast: an S-curve lifts the slope in the middle by half as much. Assumption."""
DISC, DISC_SIGMA = 0.2, 0.4
"""Likewise of the disc's share of the blur's variance: pixels and most lenses give a bell. Assumption."""


@dataclass(frozen=True)
class Tone:
    """The shape of an edge: `tone.profile(ink, white)`."""

    disc: float = DISC
    log_gamma: float = math.log(GAMMA)
    contrast: float = 0.0
    sharpening: float = 0.0
    log_radius: float = math.log(RADIUS)

    @property
    def numbers(self) -> Array:
        """All of them.  # (5,)"""
        return np.array(astuple(self))

    def profile(self, levels: tuple[float, float]) -> "Profile":
        """Of edges between ink and white of these shares of the full scale."""
        return Profile(_levels(self, *levels))


COUNT = len(fields(Tone))
PRIOR = Tone().numbers
PRIOR_SIGMA = np.array([DISC_SIGMA, GAMMA_SIGMA, CONTRAST_SIGMA, SHARPENING_SIGMA, RADIUS_SIGMA])
LEAST = np.array([0.0, math.log(0.5), -0.9, -0.9, -1.2])
MOST = np.array([0.98, math.log(6.0), 0.9, 3.0, 1.2])
"""What the numbers are held within: S must rise everywhere, and no picture has more."""


@dataclass(frozen=True, eq=False)
class Profile:
    """The rise of an edge from 0 (ink) to 1 (white)."""

    level: Array  # at steps of STEP from -REACH on

    def at(self, x: Array) -> Array:
        """The rise at distances into the white, in blurs."""
        return np.array([risen(self.level, one) for one in x])


@jit_inside
def risen(level: Array, x: float) -> float:
    """A profile's rise at a distance into the white, in blurs."""
    place = (min(max(x, -REACH), REACH - 2 * STEP) + REACH) / STEP
    low = int(place)
    return float(level[low] + (place - low) * (level[low + 1] - level[low]))


def _levels(tone: Tone, ink: float, white: float) -> Array:
    """The profile's numbers."""
    gamma = math.exp(tone.log_gamma)
    x, rise = _blurred_edge(tone.disc)
    curve = np.linspace(0.0, 1.2, 601)
    light_ink, light_white = np.interp([ink, white], _s_curve(curve, tone.contrast), curve) ** gamma
    level = _s_curve((light_ink + (light_white - light_ink) * rise) ** (1 / gamma), tone.contrast)
    level = (level - level[0]) / (level[-1] - level[0])
    bell = _bell(math.exp(tone.log_radius))
    sharpened: Array = level + tone.sharpening * (level - _smoothed(level, bell))
    inside = np.abs(x) <= REACH + STEP / 2
    return sharpened[inside]


def _s_curve(level: Array, contrast: float) -> Array:
    curve: Array = level + contrast * (3 * level**2 - 2 * level**3 - level)
    return curve


def _blurred_edge(disc: float) -> tuple[Array, Array]:
    """Distances in blurs, and the light there; `disc` of the blur's variance is a disc's, of radius twice its root."""
    from scipy.special import ndtr

    x = np.arange(-2 * REACH, 2 * REACH + STEP / 2, STEP)
    rise = ndtr(x / math.sqrt(1 - min(disc, 0.98)))
    radius = 2 * math.sqrt(max(disc, 0.0))
    if radius < 2 * STEP:
        return x, rise
    edge = np.arange(-math.ceil(radius / STEP), math.ceil(radius / STEP) + 1) * STEP
    # Each step's share of the disc's area, so that the profile changes smoothly with the radius.
    angle = np.arcsin(np.clip(np.stack([edge - STEP / 2, edge + STEP / 2]) / radius, -1, 1))
    area = (angle + np.sin(2 * angle) / 2) / np.pi
    return x, _smoothed(rise, area[1] - area[0])


def _bell(sigma: float) -> Array:
    reach = np.arange(-math.ceil(4 * sigma / STEP), math.ceil(4 * sigma / STEP) + 1) * STEP
    bell = np.exp(-0.5 * (reach / sigma) ** 2)
    normed: Array = bell / bell.sum()
    return normed


def _smoothed(level: Array, kernel: Array) -> Array:
    """A profile convolved; beyond its ends it goes on as it ends."""
    half = len(kernel) // 2
    smooth: Array = np.convolve(np.pad(level, half, mode="edge"), kernel, mode="valid")
    return smooth
