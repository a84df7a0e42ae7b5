"""A learned map from measured pixels to a distortion-free sensor: a homography plus a Gaussian process.

`s(u) = trend(u) + sum_n k(u, knot_n) weight_n`, `k(u, v) = exp(-|u - v|^2 / (2 length_px^2))`; what is known of it
has the variance `1 - k(u)' (K + diag(noise_variance))^-1 k(u)` of the kernel's (Rasmussen and Williams, Gaussian
Processes for Machine Learning, eq. 2.25 and 2.26). After De Boi, Pathak, Oliveira and Penne, "How to turn your camera
into a perfect pinhole model", 2023.

A sum over hundreds of knots for each pixel of an image would be slow, so the sum is tabled on a grid much finer than
the kernel, with its derivatives, and read by bicubic Hermite interpolation. All functions read the same table, so the
map and its inverse agree to rounding.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from calib.cameras.camera import LearnedMap
from calib.core.jit import jit
from calib.core.parallel import one_thread, one_thread_with_scipy
from designer.base.arrays import Array, Flags, Rows

STEPS_PER_LENGTH = 8.0
"""Nodes of the first table along a length of the kernel; doubled until `TABLE_ERROR` is met."""
TABLE_ERROR = 1e-6
"""Largest error of the table, in units of the sensor."""
MAX_NODES = 1_000_000
LEAST_CELLS = 48
"""Of the table of what is known, along the longer side of the image."""
LEAST_VARIANCE = 1e-14
MAX_STEPS = 30
LAST_STEP_PX = 1e-5
"""A step of Newton's method below it leaves an error of about its square times the map's curvature: nothing."""
KERNEL_VALUES_AT_ONCE = 2_000_000


class SplineNodes(NamedTuple):
    """The homography, and the sum at H x W nodes."""

    trend: Array  # (3, 3)
    first_px: Array  # (2,) the first node
    step_px: float
    node: Array  # (H, W, 8) of the sum's two coordinates: value, derivatives by u, by v, by both, times the step


class MapRegion(NamedTuple):
    """What is known of the map."""

    first_px: Array  # (2,) left and upper edge of the image
    last_px: Array  # (2,) right and lower edge
    step_px: float
    log_variance: Array  # (H, W) in units of the kernel's variance
    log_limit: float  # largest of what is known


class Starts(NamedTuple):
    """Where to begin the search for the pixel that the map takes to a point of the sensor."""

    pixel: Array  # (A, B, 2) one that it takes near a cell of the sensor
    first: Array  # (2,) corner of the first cell
    step: Array  # (2,) size of a cell


class MapTable(NamedTuple):
    """A learned map over an image, ready to be read."""

    spline: SplineNodes
    region: MapRegion
    starts: Starts


def square_distances(pixel: Array, knot_px: Array) -> Array:
    """Squared distances of pixels (N, 2) from knots (K, 2).  # (N, K)"""
    square = pixel[:, None, 0] - knot_px[None, :, 0]
    square *= square
    across = pixel[:, None, 1] - knot_px[None, :, 1]
    across *= across
    square += across
    return np.asarray(square)


def kernel(pixel: Array, knot_px: Array, length_px: float) -> Array:
    """The squared exponential kernel of pixels (N, 2) and knots (K, 2).  # (N, K)"""
    return correlation(square_distances(pixel, knot_px), length_px)


def correlation(square_px2: Array, length_px: float) -> Array:
    """The kernel at squared distances (N, K)."""
    exponent = square_px2 * (-0.5 / length_px**2)
    return np.asarray(np.exp(exponent, out=exponent))


def trend_at(trend: Array, pixel: Array) -> Array:
    """Points (N, 2) to which a homography takes pixels (N, 2)."""
    lifted = pixel @ trend[:, :2].T + trend[:, 2]
    point: Array = lifted[:, :2] / lifted[:, 2:]
    return point


@one_thread
def exact_point(learned: LearnedMap, pixel: Array) -> Array:
    """The map at pixels (N, 2), knot by knot, known or not.  # (N, 2)"""
    point = trend_at(learned.trend, pixel)
    at_once = max(1, KERNEL_VALUES_AT_ONCE // max(len(learned.knot_px), 1))
    for at in range(0, len(pixel), at_once):
        rows = slice(at, at + at_once)
        point[rows] += kernel(pixel[rows], learned.knot_px, learned.length_px) @ learned.weight
    return point


def jacobian_with(learned: LearnedMap, pixel: Array, values: Array) -> Array:
    """The derivative of the map by the pixel at pixels (N, 2), with the kernel's values there (N, K).  # (N, 2, 2)

    The kernel's slope is `(knot - pixel) k / length^2`: the sums of `w k` and `knot w k` come of one product.
    """
    trend, weight = learned.trend, learned.weight
    jacobian = trend[None, :2, :2] - trend_at(trend, pixel)[:, :, None] * trend[None, None, 2, :2]
    jacobian /= (pixel @ trend[2, :2] + trend[2, 2])[:, None, None]
    middle = pixel.mean(axis=0)  # a far origin would cost digits
    knot = learned.knot_px - middle
    sums = values @ np.concatenate([weight, knot[:, :1] * weight, knot[:, 1:] * weight], axis=1)
    for axis in range(2):
        here = (pixel[:, axis] - middle[axis])[:, None]
        jacobian[:, :, axis] += (sums[:, 2 + 2 * axis : 4 + 2 * axis] - here * sums[:, :2]) / learned.length_px**2
    return np.asarray(jacobian)


@one_thread_with_scipy
def exact_variance(learned: LearnedMap, pixel: Array) -> Array:
    """What is not known of the map at pixels (N, 2), in units of the kernel's variance.  # (N,)"""
    from scipy.linalg import solve_triangular

    gram = kernel(learned.knot_px, learned.knot_px, learned.length_px)
    gram[np.diag_indices_from(gram)] += learned.noise_variance
    factor = np.linalg.cholesky(gram)
    variance = np.empty(len(pixel))
    at_once = max(1, KERNEL_VALUES_AT_ONCE // max(len(learned.knot_px), 1))
    for at in range(0, len(pixel), at_once):
        rows = slice(at, at + at_once)
        # Not by the factor's inverse: what is left of 1 may be a part in 10^11.
        explained = solve_triangular(factor, kernel(learned.knot_px, pixel[rows], learned.length_px), lower=True)
        variance[rows] = 1 - (explained * explained).sum(axis=0)
    return np.maximum(variance, 0.0)


@lru_cache(maxsize=2)
@one_thread
def table_of(learned: LearnedMap, image_size: tuple[int, int]) -> MapTable:
    """The map's table over an image; kept for the maps last used."""
    spline = spline_of(learned, image_size)
    first, last = _edges(image_size)
    step = min(learned.length_px / STEPS_PER_LENGTH, float((last - first).max()) / LEAST_CELLS)
    pixel = _grid(first, step, _node_count(first, last, step))
    variance = exact_variance(learned, pixel.reshape(-1, 2)).reshape(pixel.shape[:2])
    region = MapRegion(
        first, last, step, np.log(np.maximum(variance, LEAST_VARIANCE)), 2 * float(np.log(learned.limit))
    )
    return MapTable(spline, region, _starts(spline, pixel, region.log_variance <= region.log_limit))


@lru_cache(maxsize=2)
@one_thread
def spline_of(learned: LearnedMap, image_size: tuple[int, int]) -> SplineNodes:
    """The coarsest table of the map alone that is exact enough.

    The error of Hermite's interpolation is at most step^4 / 384 of the fourth derivative along each axis; it is
    measured where it is largest.
    """
    first, last = _edges(image_size)
    step = min(learned.length_px / STEPS_PER_LENGTH, float((last - first).max()))
    while True:
        count = _node_count(first, last, step)
        node = _nodes(learned, first, step, count)
        if _table_error(learned, node, first, step) <= TABLE_ERROR or 4 * count.prod() > MAX_NODES:
            return SplineNodes(learned.trend, first, step, node)
        step /= 2


def _edges(image_size: tuple[int, int]) -> tuple[Array, Array]:
    """The upper left and the lower right corner of an image."""
    return np.array([-0.5, -0.5]), np.array(image_size, dtype=np.float64) - 0.5


def _node_count(first: Array, last: Array, step: float) -> Rows:
    """How many nodes along u and v cover the image."""
    count: Rows = np.maximum(np.ceil((last - first) / step - 1e-9), 1).astype(np.int64) + 1
    return count


def _grid(first: Array, step: float, count: Rows) -> Array:
    """The nodes' pixels.  # (H, W, 2)"""
    return np.stack(np.meshgrid(*(first[k] + step * np.arange(count[k]) for k in range(2))), axis=-1)


def _nodes(learned: LearnedMap, first: Array, step: float, count: Rows) -> Array:
    """The sum and its derivatives at nodes; the kernel is a product of one factor an axis.  # (H, W, 8)"""
    factors = []
    for axis in range(2):
        away = (first[axis] + step * np.arange(count[axis]))[:, None] - learned.knot_px[None, :, axis]
        value = np.exp(-0.5 * (away / learned.length_px) ** 2)
        factors.append((value, -step * away / learned.length_px**2 * value))
    (u, du), (v, dv) = factors
    layers = [
        (row * learned.weight[:, k]) @ column.T
        for k in range(2)
        for row, column in ((v, u), (v, du), (dv, u), (dv, du))
    ]
    return np.ascontiguousarray(np.stack(layers, axis=-1))


def _table_error(learned: LearnedMap, node: Array, first: Array, step: float) -> float:
    """Largest error of the table in the middles of its cells, where it is largest."""
    count = np.array([node.shape[1] - 1, node.shape[0] - 1])
    middle = _nodes(learned, first + step / 2, step, count)[..., [0, 4]]
    weight = np.array([0.5, 0.5]), np.array([0.125, -0.125])  # of the values and slopes at the ends of an interval
    read = np.zeros_like(middle)
    for a in range(2):
        for b in range(2):
            corner = node[b : b + count[1], a : a + count[0]].reshape(count[1], count[0], 2, 4)
            (va, sa), (vb, sb) = (weight[0][a], weight[1][a]), (weight[0][b], weight[1][b])
            read += corner @ np.array([va * vb, sa * vb, va * sb, sa * sb])
    return float(np.abs(read - middle).max(initial=0.0))


def _starts(spline: SplineNodes, pixel: Array, known: Flags) -> Starts:
    """Sort known pixels (H, W, 2), and those beside them, into cells of the sensor."""
    rows, columns = known.shape
    point = np.empty((rows * columns, 2))
    _points(spline, pixel.reshape(-1, 2), point, np.empty((rows * columns, 2, 2)))
    framed = np.pad(known, 1)
    near = np.logical_or.reduce([framed[i : i + rows, j : j + columns] for i in range(3) for j in range(3)])
    usable = near.ravel() & np.isfinite(point).all(axis=1)
    start = np.full((rows, columns, 2), np.nan)
    if not usable.any():
        return Starts(start, np.zeros(2), np.ones(2))
    first, last = point[usable].min(axis=0), point[usable].max(axis=0)
    step = np.maximum((last - first) / np.array([columns, rows]), 1e-9 * (1 + np.abs(first)))
    cell = np.minimum(((point[usable] - first) / step).astype(np.int64), np.array([columns - 1, rows - 1]))
    start[cell[:, 1], cell[:, 0]] = pixel.reshape(-1, 2)[usable]
    _spread(start)
    return Starts(start, first, step)


@jit
def _spread(start: Array) -> None:
    """Give each empty cell the pixel of a neighbour, ring by ring."""
    rows, columns, _ = start.shape
    left = True
    while left:
        left = False
        before = start.copy()
        for i in range(rows):
            for j in range(columns):
                if not np.isnan(before[i, j, 0]):
                    continue
                left = True
                for a, b in ((i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1)):
                    if 0 <= a < rows and 0 <= b < columns and not np.isnan(before[a, b, 0]):
                        start[i, j, 0], start[i, j, 1] = before[a, b, 0], before[a, b, 1]


@jit
def read(spline: SplineNodes, u: float, v: float) -> tuple[float, float, float, float, float, float]:
    """The map and its derivatives at one pixel: x, y, dx/du, dx/dv, dy/du, dy/dv; known or not."""
    trend, node, step = spline.trend, spline.node, spline.step_px
    rows, columns, _ = node.shape
    s, t = (u - spline.first_px[0]) / step, (v - spline.first_px[1]) / step
    j = min(max(int(np.floor(s)), 0), columns - 2)
    i = min(max(int(np.floor(t)), 0), rows - 2)
    s, t = s - j, t - i
    w = trend[2, 0] * u + trend[2, 1] * v + trend[2, 2]
    x = (trend[0, 0] * u + trend[0, 1] * v + trend[0, 2]) / w
    y = (trend[1, 0] * u + trend[1, 1] * v + trend[1, 2]) / w
    xu, xv = (trend[0, 0] - x * trend[2, 0]) / w, (trend[0, 1] - x * trend[2, 1]) / w
    yu, yv = (trend[1, 0] - y * trend[2, 0]) / w, (trend[1, 1] - y * trend[2, 1]) / w
    for a in range(2):
        p, q, dp, dq = _hermite(a, s)
        for b in range(2):
            m, n, dm, dn = _hermite(b, t)
            f = node[i + b, j + a]
            x += m * (p * f[0] + q * f[1]) + n * (p * f[2] + q * f[3])
            y += m * (p * f[4] + q * f[5]) + n * (p * f[6] + q * f[7])
            xu += (m * (dp * f[0] + dq * f[1]) + n * (dp * f[2] + dq * f[3])) / step
            yu += (m * (dp * f[4] + dq * f[5]) + n * (dp * f[6] + dq * f[7])) / step
            xv += (dm * (p * f[0] + q * f[1]) + dn * (p * f[2] + q * f[3])) / step
            yv += (dm * (p * f[4] + q * f[5]) + dn * (p * f[6] + q * f[7])) / step
    return x, y, xu, xv, yu, yv


@jit
def _hermite(end: int, s: float) -> tuple[float, float, float, float]:
    """Hermite's polynomials of the value and of the slope at one end of an interval, and their derivatives."""
    if end == 0:
        return (1 + 2 * s) * (1 - s) * (1 - s), s * (1 - s) * (1 - s), 6 * s * (s - 1), (1 - s) * (1 - 3 * s)
    return s * s * (3 - 2 * s), s * s * (s - 1), 6 * s * (1 - s), s * (3 * s - 2)


@jit
def is_known(region: MapRegion, u: float, v: float) -> bool:
    """Whether the map is known at a pixel: inside the image, and its variance, read between nodes, within the limit."""
    if not (region.first_px[0] <= u <= region.last_px[0] and region.first_px[1] <= v <= region.last_px[1]):
        return False
    table = region.log_variance
    s, t = (u - region.first_px[0]) / region.step_px, (v - region.first_px[1]) / region.step_px
    j, i = min(int(s), table.shape[1] - 2), min(int(t), table.shape[0] - 2)
    s, t = s - j, t - i
    upper = (1 - s) * table[i, j] + s * table[i, j + 1]
    lower = (1 - s) * table[i + 1, j] + s * table[i + 1, j + 1]
    return bool((1 - t) * upper + t * lower <= region.log_limit)


@jit
def search(table: MapTable, x: float, y: float) -> tuple[float, float]:
    """The pixel that the map takes to a point of the sensor, by Newton's method; nan where it finds none.

    The pixel may lie a little outside what is known.
    """
    spline, starts = table.spline, table.starts
    rows, columns, _ = starts.pixel.shape
    a, b = (x - starts.first[0]) / starts.step[0], (y - starts.first[1]) / starts.step[1]
    if not (-2 <= a <= columns + 2 and -2 <= b <= rows + 2):
        return np.nan, np.nan
    j, i = min(max(int(a), 0), columns - 1), min(max(int(b), 0), rows - 1)
    u, v = starts.pixel[i, j, 0], starts.pixel[i, j, 1]
    longest = 4 * table.region.step_px
    low_u, low_v = table.region.first_px[0] - longest, table.region.first_px[1] - longest
    high_u, high_v = table.region.last_px[0] + longest, table.region.last_px[1] + longest
    for _ in range(MAX_STEPS):
        px, py, xu, xv, yu, yv = read(spline, u, v)
        determinant = xu * yv - xv * yu
        du = (yv * (x - px) - xv * (y - py)) / determinant
        dv = (xu * (y - py) - yu * (x - px)) / determinant
        length = np.sqrt(du * du + dv * dv)
        if length < LAST_STEP_PX:
            return u + du, v + dv
        if not length < np.inf:
            break
        scale = min(1.0, longest / length)
        u, v = min(max(u + scale * du, low_u), high_u), min(max(v + scale * dv, low_v), high_v)
    return np.nan, np.nan


@jit
def _points(spline: SplineNodes, pixel: Array, point: Array, jacobian: Array) -> None:
    for n in range(len(pixel)):
        x, y, xu, xv, yu, yv = read(spline, pixel[n, 0], pixel[n, 1])
        point[n, 0], point[n, 1] = x, y
        jacobian[n, 0, 0], jacobian[n, 0, 1], jacobian[n, 1, 0], jacobian[n, 1, 1] = xu, xv, yu, yv


@jit
def _known(region: MapRegion, pixel: Array, known: Flags) -> None:
    for n in range(len(pixel)):
        known[n] = is_known(region, pixel[n, 0], pixel[n, 1])


@jit
def _pixels(table: MapTable, point: Array, pixel: Array) -> None:
    for n in range(len(point)):
        pixel[n, 0], pixel[n, 1] = search(table, point[n, 0], point[n, 1])


class Moved(NamedTuple):
    """Pixels taken to the sensor."""

    point: Array  # (N, 2)
    jacobian: Array  # (N, 2, 2) derivative of the point by the pixel


def to_sensor(learned: LearnedMap, image_size: tuple[int, int], pixel: Array) -> Moved:
    """The map at pixels (N, 2) of the image, also where it is not known."""
    result = Moved(np.empty((len(pixel), 2)), np.empty((len(pixel), 2, 2)))
    _points(spline_of(learned, image_size), np.ascontiguousarray(pixel, dtype=np.float64), *result)
    return result


def known_at(learned: LearnedMap, image_size: tuple[int, int], pixel: Array) -> Flags:
    """Whether the map is known at pixels (N, 2).  # (N,)"""
    known = np.empty(len(pixel), dtype=np.bool_)
    _known(table_of(learned, image_size).region, np.ascontiguousarray(pixel, dtype=np.float64), known)
    return known


def to_image(learned: LearnedMap, image_size: tuple[int, int], point: Array) -> Array:
    """The pixels that the map takes to points (N, 2) of the sensor, also a little outside what is known; or nan."""
    pixel = np.empty((len(point), 2))
    _pixels(table_of(learned, image_size), np.ascontiguousarray(point, dtype=np.float64), pixel)
    return pixel
