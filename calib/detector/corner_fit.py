"""Corners by the model of two blurred edges that cross, fitted to the pixels: all corners of a photo in one batch.

With `xi = v + q(v)` the straightened offset of a pixel from the corner (q: the lens's local bend), and two edges
through it with directions t_i, normals n_i and blurs s_i, the pixel lies `h = n_1 . xi / s_1` and `k = n_2 . xi / s_2`
blurs from them. The plane's quadrants, blurred, are bivariate normal distributions with the correlation
`r = n_1 . n_2`: products only where edges cross at right angles. With P = Phi_2(h, k; r), and Phi the normal one,

    saddle:  S = 4 P - 2 Phi(h) - 2 Phi(k) + 1       two opposite quadrants are of one colour
    L:       S = 2 P - 1                             the quadrant of h, k > 0 is alone

and the brightness is `w + g . v0 + (d + e . v0) S` with v0 the offset from where the fit began: light is linear over
the neighbourhood. `Phi_2 = Phi(h) Phi(k) + integral of the density phi_2(h, k; r') over r' = 0 .. r` (Plackett,
Biometrika 41, 1954), here by Gauss-Legendre over asin r'. By symmetry neither blurs nor levels move a saddle.
"""

import math
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from calib.core.jit import jit, jit_sums
from calib.core.linear_algebra import solve_square
from calib.core.parallel import in_chunks
from calib.core.small_solve import cholesky_invert, cholesky_solve
from calib.detector.ring_equations import CHUNK, add_products, edges
from calib.detector.ring_scores import STRETCHES, Scores, taken_up
from designer.base.arrays import Array, Flags

Floats: TypeAlias = Array

U: Final = 0
V: Final = 1
TURN: Final = 2
BLUR: Final = 4
LEVEL: Final = 6
STEP: Final = 9
PARAMETERS: Final = 12
"""u, v, angles of the two directions (rad), blurs of the two edges (px), w, g (2), d, e (2)."""
RESIDUAL: Final = PARAMETERS * CHUNK
H: Final = 16 * CHUNK
K: Final = 17 * CHUNK
ALONG: Final = 18 * CHUNK
DENSITY: Final = 20 * CHUNK
BELOW: Final = 22 * CHUNK
ON_LINE: Final = 24 * CHUNK
QUADRANT: Final = 26 * CHUNK
ROOM: Final = 28 * CHUNK
"""Rows of a chunk: derivatives, residuals (and what fills them to whole fours), and what is worked out on the way."""
MAX_PIXELS: Final = 4096
BUDGET = 1000
"""Wider neighbourhoods are thinned: so many pixels hold a corner far better than any print is true."""
FARTHEST_PX, ROUGHLY_PX, FARTHEST_BLURS = 30.0, 6.0, 4.0
"""How far along the edges pixels are used, and are as long as neither the lens nor the blur is known."""
BAND_PX, BAND_BLURS = 1.0, 3.0
"""How far from the edges."""
WIDER = 5.0
"""So many times as far a quarter of the pixels is used, for the levels; farther off light is not linear any more."""
MARGIN_BLURS, MARGIN_OF_SADDLE, LEAST_BAND_PX = 2.3, 2.0, 0.9
"""What stands beyond the free neighbourhood shines into it so far; that around a saddle does so alike on both sides,
and moves nothing. Some pixels beside the edges are always used."""
CROSSING = 4.0
"""In blurs: pixels farther from one of the edges see the other alone."""
SQUARE = 1e-6
"""Of a right angle's cosine: the correlation has no part there."""
MAX_ITERATIONS = 30
CONVERGED_PX, MOVED_PX, NO_STEP = 5e-3, 0.25, 1e8
SHARPEST_PX, SOFTEST_PX = 0.2, 15.0
MOST_TURN_RAD = 0.5
LEAST_SINE = 0.2
"""Of the angle between the edges: those nearly along each other have no crossing to speak of."""

# Gauss-Legendre, five points, on 0 .. 1.
_NODE = (0.046910077030668, 0.230765344947158, 0.5, 0.769234655052842, 0.953089922969332)
_WEIGHT = (0.118463442528095, 0.239314335249683, 0.284444444444444, 0.239314335249683, 0.118463442528095)


@dataclass(frozen=True, eq=False)
class CornerFits:
    """N fits. A fit that failed has `ok` false and numbers without meaning."""

    params: Floats  # (N, 12)
    cov_px2: Floats  # (N, 2, 2)
    noise: Floats  # (N,) residual standard deviation in grey levels
    scores: Scores
    half_px: Floats  # (N,) how far along the edges pixels were used
    ok: Flags  # (N,)

    @property
    def center_px(self) -> Floats:
        """The corners.  # (N, 2)"""
        return self.params[:, :2]

    def or_else(self, other: "CornerFits", keeps: Flags) -> "CornerFits":
        """With the other fits of the same corners where these are not kept."""

        def chosen(mine: Array, others: Array) -> Array:
            return np.where(keeps.reshape(-1, *[1] * (mine.ndim - 1)), mine, others)

        both = zip(vars(self.scores).values(), vars(other.scores).values(), strict=True)
        return CornerFits(
            chosen(self.params, other.params),
            chosen(self.cov_px2, other.cov_px2),
            chosen(self.noise, other.noise),
            Scores(*(chosen(mine, others) for mine, others in both)),
            chosen(self.half_px, other.half_px),
            np.where(keeps, self.ok, other.ok),
        )

    @property
    def contrast(self) -> Floats:
        """Light minus dark at the corner, in grey levels; negative where a lone quadrant is dark.  # (N,)"""
        return np.asarray(2 * self.params[:, STEP])

    @property
    def blur_px(self) -> Floats:
        """Root mean square of both edges'.  # (N,)"""
        return np.asarray(np.sqrt(np.mean(self.params[:, BLUR : BLUR + 2] ** 2, axis=1)))


@jit_sums
def _fill_rows(
    pixels: Floats,
    first: int,
    filled: int,
    p: Floats,
    q: Floats,
    origin: Floats,
    is_saddle: bool,
    clip: Floats,
    rows: Floats,
) -> None:
    """Derivatives and residuals of `filled` pixels from the first on, into the columns of `rows`."""
    cu, cv, per1, per2 = p[U], p[V], 1.0 / p[BLUR], 1.0 / p[BLUR + 1]
    c1, s1, c2, s2 = math.cos(p[2]), math.sin(p[2]), math.cos(p[3]), math.sin(p[3])
    q0, q1, q2, q3, q4, q5 = q[0], q[1], q[2], q[3], q[4], q[5]
    w0, g0, g1, d0, e0, e1 = p[6], p[7], p[8], p[9], p[10], p[11]
    u0, v0, low, high = origin[0], origin[1], clip[0], clip[1]
    r, turn = c1 * c2 + s1 * s2, s1 * c2 - c1 * s2
    m = 4.0 if is_saddle else 2.0
    for n in range(filled):
        rows[n], rows[CHUNK + n], rows[RESIDUAL + n] = pixels[0, first + n], pixels[1, first + n], pixels[2, first + n]
    # Loops without a branch, so that several pixels are worked out at once.
    for n in range(filled):
        x, y = rows[n] - cu, rows[CHUNK + n] - cv
        x0 = x + q0 * x * x + q1 * x * y + q2 * y * y
        x1 = y + q3 * x * x + q4 * x * y + q5 * y * y
        h, k = (c1 * x1 - s1 * x0) * per1, (c2 * x1 - s2 * x0) * per2
        tail_h, density_h, tail_k, density_k = edges(h, k)
        rows[H + n], rows[K + n] = h, k
        rows[ALONG + n], rows[ALONG + CHUNK + n] = c1 * x0 + s1 * x1, c2 * x0 + s2 * x1
        rows[DENSITY + n], rows[DENSITY + CHUNK + n] = density_h, density_k
        rows[BELOW + n], rows[BELOW + CHUNK + n] = 1.0 - tail_h, 1.0 - tail_k
        # Of one edge on the other's line; and the quadrant, with its derivative by the correlation.
        rows[ON_LINE + n], rows[ON_LINE + CHUNK + n] = 1.0 - tail_k, 1.0 - tail_h
        rows[QUADRANT + n], rows[QUADRANT + CHUNK + n] = (1.0 - tail_h) * (1.0 - tail_k), 0.0
    if abs(r) > SQUARE:
        _cross(r, filled, rows)
    for n in range(filled):
        x, y, value = rows[n] - cu, rows[CHUNK + n] - cv, rows[RESIDUAL + n]
        shape = m * rows[QUADRANT + n] - (m - 2.0) * (rows[BELOW + n] + rows[BELOW + CHUNK + n]) + (m - 3.0)
        du, dv = rows[n] - u0, rows[CHUNK + n] - v0
        step = d0 + e0 * du + e1 * dv
        model = w0 + g0 * du + g1 * dv + step * shape
        # What is clipped tells only that the light was beyond.
        is_beyond = ((value >= high) & (model > value)) | ((value <= low) & (model < value))
        w = 0.0 if is_beyond else 1.0
        step *= w
        by_h = step * rows[DENSITY + n] * (m * rows[ON_LINE + n] - (m - 2.0)) * per1
        by_k = step * rows[DENSITY + CHUNK + n] * (m * rows[ON_LINE + CHUNK + n] - (m - 2.0)) * per2
        by_r = step * m * rows[QUADRANT + CHUNK + n]
        # The lens's bend turns edges over the neighbourhood: d xi / d v is no unit matrix.
        b00, b01 = 1.0 + 2.0 * q0 * x + q1 * y, q1 * x + 2.0 * q2 * y
        b10, b11 = 2.0 * q3 * x + q4 * y, 1.0 + q4 * x + 2.0 * q5 * y
        by_x0, by_x1 = by_h * s1 + by_k * s2, -by_h * c1 - by_k * c2
        rows[n] = by_x0 * b00 + by_x1 * b10
        rows[CHUNK + n] = by_x0 * b01 + by_x1 * b11
        rows[2 * CHUNK + n] = -by_h * rows[ALONG + n] - by_r * turn
        rows[3 * CHUNK + n] = -by_k * rows[ALONG + CHUNK + n] + by_r * turn
        rows[4 * CHUNK + n] = -by_h * rows[H + n]
        rows[5 * CHUNK + n] = -by_k * rows[K + n]
        rows[6 * CHUNK + n] = w
        rows[7 * CHUNK + n] = w * du
        rows[8 * CHUNK + n] = w * dv
        rows[9 * CHUNK + n] = w * shape
        rows[10 * CHUNK + n] = w * shape * du
        rows[11 * CHUNK + n] = w * shape * dv
        rows[RESIDUAL + n] = w * (value - model)


@jit_sums
def _cross(r: float, filled: int, rows: Floats) -> None:
    """What the correlation adds to the quadrant and its derivatives, of pixels near both edges."""
    root = math.sqrt(max(1.0 - r * r, 1e-4))
    top, per_root = math.asin(r), 1.0 / root
    sine, scale = np.empty(5), np.empty(5)
    for i in range(5):
        sine[i] = math.sin(top * _NODE[i])
        scale[i] = -0.5 / (1.0 - sine[i] * sine[i])
    for n in range(filled):
        h, k = rows[H + n], rows[K + n]
        if abs(h) < CROSSING and abs(k) < CROSSING:
            square, product, total = h * h + k * k, 2.0 * h * k, 0.0
            for i in range(5):
                total += _WEIGHT[i] * math.exp((square - product * sine[i]) * scale[i])
            above_k, density, above_h, _ = edges((k - r * h) * per_root, (h - r * k) * per_root)
            rows[ON_LINE + n], rows[ON_LINE + CHUNK + n] = 1.0 - above_k, 1.0 - above_h
            rows[QUADRANT + n] += top * total / (2.0 * math.pi)
            rows[QUADRANT + CHUNK + n] = rows[DENSITY + n] * density * per_root


@jit
def _accumulate(
    pixels: Floats,
    count: int,
    p: Floats,
    q: Floats,
    origin: Floats,
    is_saddle: bool,
    clip: Floats,
    normal: Floats,
    gradient: Floats,
    rows: Floats,
) -> float:
    """Sum of squared residuals; fills J'J (its lower triangle) and J'r."""
    total = np.zeros((PARAMETERS + 1, PARAMETERS + 4))
    for first in range(0, count, CHUNK):
        filled = min(CHUNK, count - first)
        _fill_rows(pixels, first, filled, p, q, origin, is_saddle, clip, rows)
        add_products(rows, PARAMETERS, filled, total)
    normal[:] = total[:PARAMETERS, :PARAMETERS]
    gradient[:] = total[PARAMETERS, :PARAMETERS]
    cost: float = total[PARAMETERS, PARAMETERS]
    return cost


@jit
def _choose(
    image: NDArray[np.generic],
    p: Floats,
    is_saddle: bool,
    mm_from_px: Floats,
    q: Floats,
    farther: Floats,
    room_mm: Floats,
    farthest_px: float,
    pixels: Floats,
) -> tuple[int, float]:
    """Pixels in the free neighbourhood near the edges, u, v and grey level: how many, and how far along the edges.

    x runs along the first edge, y along the second, as the board's plane has them. Free is what has both of them
    within -`room_mm[1]` and `room_mm[0]`, and one of them within `room_mm[2]`.
    """
    height, width = image.shape
    a, b, c, d = mm_from_px[0, 0], mm_from_px[0, 1], mm_from_px[1, 0], mm_from_px[1, 1]
    det = abs(a * d - b * c)
    blur = max(p[BLUR], p[BLUR + 1])
    # Pixels across lines of even x, and how long a mm along the first edge is; likewise of y.
    across_x, across_y = 1.0 / math.sqrt(a * a + b * b), 1.0 / math.sqrt(c * c + d * d)
    along_x, along_y = math.sqrt(c * c + d * d) / det, math.sqrt(a * a + b * b) / det
    margin = blur * (MARGIN_OF_SADDLE if is_saddle else MARGIN_BLURS)
    margin_x, margin_y = margin / across_x, margin / across_y
    far, band = farthest_px + FARTHEST_BLURS * blur, BAND_PX + BAND_BLURS * blur
    most_x, most_y = min(room_mm[0] - margin_x, far / along_x), min(room_mm[0] - margin_y, far / along_y)
    least_x, least_y = max(margin_x - room_mm[1], -far / along_x), max(margin_y - room_mm[1], -far / along_y)
    if min(most_x, most_y, -least_x, -least_y) <= 0.0:
        return 0, 0.0
    least_x_mm, least_y_mm = min(LEAST_BAND_PX / across_x, room_mm[2]), min(LEAST_BAND_PX / across_y, room_mm[2])
    deep_x, deep_y = max(room_mm[2] - margin_x, least_x_mm), max(room_mm[2] - margin_y, least_y_mm)
    near_x, near_y = min(band / across_x, deep_x), min(band / across_y, deep_y)
    deep_x, deep_y = min(WIDER * near_x, deep_x), min(WIDER * near_y, deep_y)
    long_x, long_y = (most_x - least_x) * along_x, (most_y - least_y) * along_y
    every = max(1, round(math.sqrt((long_x + long_y) * 2.0 * band / BUDGET)))
    far_x, far_y = max(most_x, -least_x), max(most_y, -least_y)
    grown = 1.0 + abs(farther[0]) * far_x + abs(farther[1]) * far_y
    reach_u = grown * (abs(d) * far_x + abs(b) * far_y) / det
    reach_v = grown * (abs(c) * far_x + abs(a) * far_y) / det
    u_first, u_last = max(0, math.floor(p[U] - reach_u)), min(width - 1, math.ceil(p[U] + reach_u))
    v_first, v_last = max(0, math.floor(p[V] - reach_v)), min(height - 1, math.ceil(p[V] + reach_v))
    count = 0
    for v in range(v_first, v_last + 1, every):
        for u in range(u_first, u_last + 1, every):
            du, dv = u - p[U], v - p[V]
            x0 = du + q[0] * du * du + q[1] * du * dv + q[2] * dv * dv
            x1 = dv + q[3] * du * du + q[4] * du * dv + q[5] * dv * dv
            x, y = a * x0 + b * x1, c * x0 + d * x1
            scale = 1.0 / (1.0 - farther[0] * x - farther[1] * y)
            x, y = scale * x, scale * y
            if not (least_x <= x <= most_x and least_y <= y <= most_y) or count == MAX_PIXELS:
                continue
            is_near = abs(y) <= near_y or abs(x) <= near_x
            if is_near or (u // every % 2 == 0 and v // every % 2 == 0 and (abs(y) <= deep_y or abs(x) <= deep_x)):
                pixels[0, count], pixels[1, count], pixels[2, count] = u, v, image[v, u]
                count += 1
    return count, max(far_x * along_x, far_y * along_y)


@jit
def _is_sane(p: Floats, start: Floats, most_px: float) -> bool:
    """Whether parameters still describe the corner that was looked for."""
    for k in range(2):
        if not (SHARPEST_PX < p[BLUR + k] < SOFTEST_PX and abs(p[TURN + k] - start[TURN + k]) < MOST_TURN_RAD):
            return False
    is_near: bool = math.hypot(p[U] - start[U], p[V] - start[V]) < most_px
    return is_near and abs(math.sin(p[TURN] - p[TURN + 1])) > LEAST_SINE


@jit
def _descend(
    pixels: Floats,
    count: int,
    start: Floats,
    most_px: float,
    q: Floats,
    is_saddle: bool,
    clip: Floats,
    p: Floats,
    work: Floats,
    rows: Floats,
) -> float:
    """Levenberg-Marquardt from `start`, whose levels are solved for first; the sum of squares, or -1: no way down.

    `work[0]` is left with the normal equations there.
    """
    normal, damped, trial_normal = work[0], work[1], work[2]
    gradient, step, trial, trial_gradient = work[4, 0], work[4, 1], work[4, 2], work[4, 3]
    origin = start[:2]
    p[:] = start
    p[LEVEL:] = 0.0
    _accumulate(pixels, count, p, q, origin, is_saddle, clip, normal, gradient, rows)
    levels = normal[LEVEL:, LEVEL:].copy()
    if not cholesky_solve(levels, gradient[LEVEL:].copy(), p[LEVEL:]):
        return -1.0
    cost = _accumulate(pixels, count, p, q, origin, is_saddle, clip, normal, gradient, rows)
    damping = 1e-3
    for _ in range(MAX_ITERATIONS):
        if damping > NO_STEP:
            return -1.0
        damped[:] = normal
        for k in range(PARAMETERS):
            damped[k, k] += damping * damped[k, k] + 1e-30
        if not cholesky_solve(damped, gradient, step):
            damping = max(10.0 * damping, 1e-3)
            continue
        trial[:] = p + step
        if not _is_sane(trial, start, most_px):
            damping *= 10.0
            continue
        moved = math.hypot(step[U], step[V])
        trial_cost = _accumulate(pixels, count, trial, q, origin, is_saddle, clip, trial_normal, trial_gradient, rows)
        if trial_cost > cost:
            if moved < 1e-7:
                break
            damping = max(damping * 10.0, 1e-2)
            continue
        gain = cost - trial_cost
        p[:] = trial
        normal[:] = trial_normal
        gradient[:] = trial_gradient
        cost = trial_cost
        if moved < CONVERGED_PX and gain < 1e-4 * cost + 1e-6 * count:
            break
        damping = max(damping * 0.1, 1e-9)
    return cost


@jit
def _score(
    pixels: Floats,
    count: int,
    p: Floats,
    q: Floats,
    origin: Floats,
    is_saddle: bool,
    clip: Floats,
    half_px: float,
    noise2: float,
    inverse: Floats,
    center: Floats,
    score: Floats,
    rows: Floats,
) -> float:
    """Fill the covariance and the scores (2, STRETCHES, 2) along both edges; returns S0 (`ring_scores`)."""
    leverage = np.zeros((2 * STRETCHES, 2, PARAMETERS))
    score[:] = 0.0
    by_place = score.reshape((2 * STRETCHES, 2))
    even = uu = uv = vv = 0.0
    for first in range(0, count, CHUNK):
        filled = min(CHUNK, count - first)
        _fill_rows(pixels, first, filled, p, q, origin, is_saddle, clip, rows)
        for n in range(filled):
            du, dv = pixels[0, first + n] - p[U], pixels[1, first + n] - p[V]
            along0, along1 = (
                du * math.cos(p[TURN]) + dv * math.sin(p[TURN]),
                du * math.cos(p[TURN + 1]) + dv * math.sin(p[TURN + 1]),
            )
            edge = 0 if abs(along0) > abs(along1) else 1
            along = (along0 if edge == 0 else along1) / half_px
            a = edge * STRETCHES + min(max(int(0.5 * (along + 1.0) * STRETCHES), 0), STRETCHES - 1)
            h0 = h1 = 0.0
            for i in range(PARAMETERS):
                h0 += inverse[0, i] * rows[i * CHUNK + n]
                h1 += inverse[1, i] * rows[i * CHUNK + n]
            residual = rows[RESIDUAL + n]
            even += h0 * h0 + h1 * h1
            uu += h0 * h0 * residual * residual
            uv += h0 * h1 * residual * residual
            vv += h1 * h1 * residual * residual
            by_place[a, 0] += h0 * residual
            by_place[a, 1] += h1 * residual
            for i in range(PARAMETERS):
                leverage[a, 0, i] += h0 * rows[i * CHUNK + n]
                leverage[a, 1, i] += h1 * rows[i * CHUNK + n]
    scale = count / (count - PARAMETERS)
    center[0, 0], center[0, 1], center[1, 0], center[1, 1] = scale * uu, scale * uv, scale * uv, scale * vv
    score /= math.sqrt(even * noise2)
    radius = half_px / math.pi
    return 1.0 - taken_up(leverage, inverse, radius, radius) / even


@jit
def _fit_range(
    image: NDArray[np.generic],
    start: Floats,
    is_saddle: Flags,
    mm_from_px: Floats,
    farther: Floats,
    room_mm: Floats,
    most_px: Floats,
    q: Floats,
    clip: Floats,
    farthest_px: float,
    first: int,
    last: int,
    params: Floats,
    cov: Floats,
    noise: Floats,
    score: Floats,
    alone: Floats,
    half_px: Floats,
) -> None:
    """Fit corners first..last-1; `half_px` stays 0 where a fit failed."""
    work, rows = np.empty((5, PARAMETERS, PARAMETERS)), np.zeros(ROOM)
    pixels, begin = np.empty((3, MAX_PIXELS)), np.empty(PARAMETERS)
    for n in range(first, last):
        begin[:] = start[n]
        cost, count, half = -1.0, 0, 0.0
        for _ in range(3):
            count, half = _choose(
                image, begin, is_saddle[n], mm_from_px[n], q[n], farther[n], room_mm[n], farthest_px, pixels
            )
            cost = -1.0
            if count < 2 * PARAMETERS:
                break
            cost = _descend(pixels, count, begin, most_px[n], q[n], is_saddle[n], clip, params[n], work, rows)
            if cost < 0.0:
                break
            moved = math.hypot(params[n, U] - begin[U], params[n, V] - begin[V])
            wider = max(params[n, BLUR], params[n, BLUR + 1]) / max(begin[BLUR], begin[BLUR + 1])
            if moved < MOVED_PX and 0.8 < wider < 1.25:
                break
            begin[:] = params[n]
        if cost < 0.0 or not _is_sane(params[n], start[n], most_px[n]):
            continue
        noise2 = max(cost / (count - PARAMETERS), 1e-6)
        if not cholesky_invert(work[0], work[1], work[3]):
            continue
        alone[n] = _score(
            pixels, count, params[n], q[n], begin[:2], is_saddle[n], clip, half, noise2, work[3], cov[n], score[n], rows
        )
        noise[n] = math.sqrt(noise2)
        half_px[n] = half


def fit_corners(
    image: NDArray[np.generic],
    near_px: Floats,
    *,
    px_from_mm: Floats,
    farther: Floats,
    is_saddle: Flags,
    room_mm: Floats,
    most_px: Floats,
    blur_px: Floats,
    bend: Floats,
    is_rough: bool = False,
) -> CornerFits:
    """Fit the corners near some pixels of an image.

    Args:
        image: grey levels, uint8 or float32.  # (H, W)
        near_px: where to start.  # (N, 2)
        px_from_mm: the derivatives there of pixels by the board's x and y, which edges run along; of an L, by those
            that point into the lone quadrant.  # (N, 2, 2)
        farther: by what share a mm along x and y takes the board away from the camera.  # (N, 2)
        is_saddle: else an L.  # (N,)
        room_mm: how far along the edges nothing else begins, forth and back, and how deep between them.  # (N, 3)
        most_px: how far a corner may be from its start.  # (N,)
        blur_px: to start with.  # (N,)
        bend: the lens's, as `calib.detector.lens.local_form` gives it.  # (N, 6)
        is_rough: the pixels nearest to the corners will do.
    """
    count = len(near_px)
    start = np.zeros((count, PARAMETERS))
    start[:, :2] = near_px
    x, y = px_from_mm[:, :, 0], px_from_mm[:, :, 1]
    # Normals are directions turned by a right angle to the left; the second edge runs so that h, k > 0 between x and y.
    side = np.sign(x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0])
    start[:, TURN] = np.arctan2(side * x[:, 1], side * x[:, 0])
    start[:, TURN + 1] = np.arctan2(-side * y[:, 1], -side * y[:, 0])
    start[:, BLUR] = start[:, BLUR + 1] = blur_px
    clip = np.array([0.0, 255.0]) if image.dtype == np.uint8 else np.array([-np.inf, np.inf])
    params, cov, noise = start.copy(), np.zeros((count, 2, 2)), np.zeros(count)
    half_px, scores = np.zeros(count), Scores.empty(count)
    inverse, saddle = np.ascontiguousarray(solve_square(px_from_mm, np.eye(2))), np.ascontiguousarray(is_saddle)
    tilt, room, most, lens = (
        np.ascontiguousarray(each, dtype=np.float64) for each in (farther, room_mm, most_px, bend)
    )

    farthest_px = ROUGHLY_PX if is_rough else FARTHEST_PX

    def run(first: int, last: int) -> None:
        _fit_range(
            image, start, saddle, inverse, tilt, room, most, lens, clip, farthest_px, first, last,
            params, cov, noise, scores.score, scores.alone, half_px,
        )  # fmt: skip

    in_chunks(run, count)
    ok = (half_px > 0) & np.isfinite(params).all(axis=1) & np.isfinite(cov).all(axis=(1, 2))
    ok &= (cov[:, 0, 0] > 0) & (cov[:, 1, 1] > 0)
    return CornerFits(params, cov, noise, scores, half_px, ok)
