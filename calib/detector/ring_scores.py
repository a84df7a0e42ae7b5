"""How far neighbouring residuals go together, and what that does to a centre's covariance.

To first order a centre errs by `e = sum_i h_i r_i`, with `r_i` the error of pixel i and `h_i` its influence, the
centre's rows of `inv(J'J) J_i`. If pixels err alone its variance is `sum_i h_i h_i' r_i^2`. Denoising, compression,
resampling and stairs along an edge tie neighbours together, and a blur of another shape than the model's leaves
residuals across the edge whose influences cancel. Both show in the scores `s_a`, the sums of `h_i r_i` over short
stretches of an edge: with

    S = sum over |a - b| <= reach of s_a' s_b        (stretches of one edge; Newey and West, Econometrica 55, 1987,
                                                     with an even window)

the variance is S. The fit takes a part of the errors up, so even pixels that err alone leave scores that go together:
`E[r r'] = noise^2 (I - J inv(J'J) J')` says what S would be then, S0 (Bell and McCaffrey, Survey Methodology 28, 2002).
`S / S0` is what a covariance that takes pixels for independent has to be multiplied with. One ring tells it poorly, the
rings of a photo together well. What all rings of a face have in common (the direction of a blur, the raster of a
screen) moves them all alike, as a turned camera does, and is taken off first.
"""

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from calib.core.jit import jit, jit_inside, jit_sums
from calib.core.small_solve import cholesky_solve
from calib.detector.ring_equations import CHUNK, DISTANCE, RESIDUAL, ROOM, add_products, fill_rows
from calib.detector.ring_model import (
    CENTER_U,
    CENTER_V,
    E00,
    E10,
    E11,
    M0,
    M1,
    PARAMETERS,
    RATIO,
    WHITE,
    Numbers,
    bend_of,
    parameters_of,
)
from designer.base.arrays import Array, Rows

Floats: TypeAlias = Array

REACH_PX = 4.0
"""Residuals no farther apart along an edge may go together; twice that changes no ratio of the benchmark by 10 %."""
STRETCHES = 32
"""Into so many parts, of equal angles in the target's plane, each edge is cut."""
LEAST_OF_A_FACE = 4
MOST_ROUGH = 1.5
"""Times the usual residuals: a ring with more is disturbed by something of its own, and tells nothing of the photo."""
TRUST = 4.0
"""So many rings' worth is the photo's ratio for one ring, whose own scatters by 80 % (simulated), and the usual ratio
for a photo."""
LEAST_RATIO = 0.25
"""An even window can make S negative: no covariance shrinks to less than a quarter."""
PLACE = ROOM
"""Where the numbers of stretches stand in a chunk's room, both edges', and after them two rows of influences."""
INFLUENCE = PLACE + CHUNK
SCORES_ROOM = INFLUENCE + 2 * CHUNK
LEAST_LEVEL = 1e-3
"""Of white: what a tone curve does to darker pixels is not looked at."""


@dataclass(frozen=True, eq=False)
class Scores:
    """Of N rings; zero of dots, and of fits that failed or were not final."""

    score: Floats  # (N, 2, STRETCHES, 2) outer and inner edge; in units of what even noise makes of the centre
    alone: Floats  # (N,) S0 in these units squared
    tone: Floats  # (N, 2) information on the exponent of a tone curve, and its score; 0: not asked for

    @staticmethod
    def empty(count: int) -> "Scores":
        """To be filled."""
        return Scores(np.zeros((count, 2, STRETCHES, 2)), np.zeros(count), np.zeros((count, 2)))


@jit
def _reach(radius_px: float) -> int:
    """REACH_PX in stretches of an edge of this radius."""
    return min(max(math.ceil(REACH_PX * STRETCHES / (2.0 * math.pi * max(radius_px, 1.0))), 1), STRETCHES // 2 - 1)


@jit_inside
def _turn(x: float, y: float) -> float:
    """The direction of (x, y) in turns, 0 to 1, to 2e-6, without a branch or a call."""
    ax, ay = abs(x), abs(y)
    is_steep = ay > ax
    t = (ax if is_steep else ay) / ((ay if is_steep else ax) + 1e-300)
    t2 = t * t
    # Hastings' polynomial for the arc tangent (Approximations for Digital Computers, 1955, sheet 11).
    arc = 0.05265332 - 0.01172120 * t2
    arc = 0.19354346 + t2 * (-0.11643287 + t2 * arc)
    turn = t * (0.99997726 + t2 * (-0.33262347 + t2 * arc)) / (2.0 * math.pi)
    turn = 0.25 - turn if is_steep else turn
    turn = 0.5 - turn if x < 0.0 else turn
    return 1.0 - turn if y < 0.0 else turn


@jit_sums
def prepare(
    p: Numbers, inverse: Floats, pixels: Floats, first: int, filled: int, rows: Floats
) -> tuple[float, float, float, float]:
    """Influences h and stretches of a chunk's pixels, into `rows`; the sums of h'h, and of h h' r^2: uu, uv, vv."""
    for k in range(filled):
        rows[PLACE + k] = pixels[0, first + k]
        rows[INFLUENCE + k] = pixels[1, first + k]
    middle = 0.5 * (1.0 + p[RATIO])
    for k in range(filled):
        du, dv = rows[PLACE + k] - p[CENTER_U], rows[INFLUENCE + k] - p[CENTER_V]
        place = float(np.floor(_turn(p[E00] * du, p[E10] * du + p[E11] * dv) * STRETCHES))
        # Rounding can make a whole turn.
        place = STRETCHES - 1.0 if place >= STRETCHES else place
        rows[PLACE + k] = place if rows[DISTANCE + k] > middle else place + STRETCHES
    for c in range(2):
        here = INFLUENCE + c * CHUNK
        for k in range(filled):
            rows[here + k] = 0.0
        for i in range(PARAMETERS):
            weight = inverse[c, i]
            for k in range(filled):
                rows[here + k] += weight * rows[i * CHUNK + k]
    even = uu = uv = vv = 0.0
    for k in range(filled):
        h0, h1, residual = rows[INFLUENCE + k], rows[INFLUENCE + CHUNK + k], rows[RESIDUAL + k]
        even += h0 * h0 + h1 * h1
        uu += h0 * h0 * residual * residual
        uv += h0 * h1 * residual * residual
        vv += h1 * h1 * residual * residual
    return even, uu, uv, vv


@jit
def _add_scores(filled: int, rows: Floats, score: Floats, leverage: Floats) -> None:
    """Add a chunk's scores and `h_i J_i'` by stretch.  # (2 STRETCHES, 2), (2 STRETCHES, 2, PARAMETERS)"""
    for k in range(filled):
        a = int(rows[PLACE + k])
        h0, h1 = rows[INFLUENCE + k], rows[INFLUENCE + CHUNK + k]
        score[a, 0] += h0 * rows[RESIDUAL + k]
        score[a, 1] += h1 * rows[RESIDUAL + k]
        for i in range(PARAMETERS):
            leverage[a, 0, i] += h0 * rows[i * CHUNK + k]
            leverage[a, 1, i] += h1 * rows[i * CHUNK + k]


@jit_sums
def _add_tone(white: float, pixels: Floats, first: int, filled: int, rows: Floats, total: Floats) -> None:
    """Add products of a chunk's equations and of two rows more: of a tone curve, and of edges that move into the ink.

    A tone curve changes levels y by `y ln(y / white)`: all edges move by as many pixels, and their profile is skewed. A
    ring that is seen straight on takes up the first, and what is left, the skewness, any lens and any program has,
    too. So only the first is asked for, which slanted rings show.
    # (PARAMETERS + 3, 4 K)
    """
    for k in range(filled):
        level = (pixels[2, first + k] - rows[RESIDUAL + k]) / white
        level = LEAST_LEVEL if level < LEAST_LEVEL else level
        rows[DISTANCE + k] = white * level * np.log(level)
        rows[PLACE + k] = -np.sqrt(rows[k] * rows[k] + rows[CHUNK + k] * rows[CHUNK + k])
    add_products(rows, PARAMETERS + 2, filled, total)


@jit
def _tone(total: Floats, information: Floats, noise2: float, tone: Floats) -> None:
    """Information and score of a tone curve, less what the ring's own parameters take up.  # (2,)"""
    normal, taken = total[:PARAMETERS, :PARAMETERS].copy(), np.empty(PARAMETERS)
    for i in range(2):
        for j in range(2):
            normal[M0 + i, M0 + j] += information[i, j] * noise2
    if not cholesky_solve(normal, total[PARAMETERS + 2, :PARAMETERS].copy(), taken):
        return
    product, residual = total[PARAMETERS + 2, PARAMETERS + 1], total[PARAMETERS + 2, PARAMETERS]
    for i in range(PARAMETERS):
        product -= taken[i] * total[PARAMETERS + 1, i]
        # The line's pull on m is in balance with its prior.
        residual -= 0.0 if i in (M0, M1) else taken[i] * total[PARAMETERS, i]
    tone[0], tone[1] = product / noise2, -residual / noise2


@jit_sums
def taken_up(leverage: Floats, inverse: Floats, outer_px: float, inner_px: float) -> float:
    """What the fit takes up of the scores of even noise: the sum over |a - b| <= reach of l_a' inv(J'J) l_b.

    Edges are circles of the radii given, or as long as these.
    """
    count = leverage.shape[2]
    # By parameter, so that all stretches are worked out at once.
    own, near = np.empty((count, 4 * STRETCHES)), np.empty((count, 4 * STRETCHES))
    window = np.empty(count)
    for edge in range(2):
        reach = _reach(outer_px if edge == 0 else inner_px)
        for c in range(2):
            of_edge = leverage[edge * STRETCHES : (edge + 1) * STRETCHES, c]
            window[:] = 0.0
            for b in range(-reach - 1, reach):
                window += of_edge[b % STRETCHES]
            for a in range(STRETCHES):
                # The window's sum follows from its neighbour's.
                comes, goes = (a + reach) % STRETCHES, (a - reach - 1) % STRETCHES
                column = (2 * edge + c) * STRETCHES + a
                for i in range(count):
                    window[i] += of_edge[comes, i] - of_edge[goes, i]
                    own[i, column] = of_edge[a, i]
                    near[i, column] = window[i]
    total = 0.0
    for i in range(count):
        for j in range(count):
            product = 0.0
            for a in range(4 * STRETCHES):
                product += own[i, a] * near[j, a]
            total += inverse[i, j] * product
    return total


@jit
def score_ring(
    pixels: Floats,
    count: int,
    p: Floats,
    q: Floats,
    origin: Floats,
    noise2: float,
    information: Floats,
    inverse: Floats,
    center: Floats,
    score: Floats,
    tone: Floats,
    has_tone: bool,
    rows: Floats,
) -> float:
    """Fill the covariance of one centre and the scores of its ring; returns S0, and 0 of a dot, which has no scores.

    The covariance is right also where noise grows with brightness: each pixel errs by its own residual, and the prior
    on m scatters with its own covariance.

    Args:
        pixels: those of the fit: u, v and grey level.  # (3, >= count)
        count: how many.
        p: the ring's parameters.
        q: the lens's bend.
        origin: of the light's gradients.
        noise2: the residuals' variance.
        information: of the prior on m.  # (2, 2)
        inverse: of the normal equations, prior included.  # (PARAMETERS, PARAMETERS)
        center: the covariance.  # (2, 2)
        score: the scores.  # (2, STRETCHES, 2)
        tone: information and score of a tone curve.  # (2,)
        has_tone: whether these are asked for.
        rows: room.  # (SCORES_ROOM,)
    """
    leverage = np.zeros((2 * STRETCHES, 2, PARAMETERS))
    score[:] = 0.0
    by_place = score.reshape((2 * STRETCHES, 2))
    parameters, bend = parameters_of(p), bend_of(q)
    is_ring = p[RATIO] > 0.0
    total = np.zeros((PARAMETERS + 3, PARAMETERS + 5))
    even = uu = uv = vv = 0.0
    for first in range(0, count, CHUNK):
        filled = min(CHUNK, count - first)
        fill_rows(pixels, first, filled, parameters, bend, origin, rows)
        sums = prepare(parameters, inverse, pixels, first, filled, rows)
        even, uu, uv, vv = even + sums[0], uu + sums[1], uv + sums[2], vv + sums[3]
        if is_ring:
            _add_scores(filled, rows, by_place, leverage)
        if is_ring and has_tone:  # over the rows of distances and places, which nobody needs any more
            _add_tone(p[WHITE], pixels, first, filled, rows, total)
    scale = count / (count - PARAMETERS)
    center[0, 0], center[0, 1], center[1, 1] = scale * uu, scale * uv, scale * vv
    for a in range(2):
        for b in range(a, 2):
            for i in range(2):
                for j in range(2):
                    prior = noise2 * noise2 * information[i, j]
                    center[a, b] += inverse[a, M0 + i] * prior * inverse[b, M0 + j]
    center[1, 0] = center[0, 1]
    if not is_ring:
        return 0.0
    score /= math.sqrt(even * noise2)
    if has_tone:
        _tone(total, information, noise2, tone)
    radius_px = 1.0 / math.sqrt(p[E00] * p[E11])
    return 1.0 - taken_up(leverage, inverse, radius_px, radius_px * p[RATIO]) / even


def together(score: Floats, radius_px: Floats) -> Floats:
    """S of rings from their scores.  # (N, 2, STRETCHES, 2), (N, 2) of both edges -> (N,)"""
    reach = np.vectorize(_reach, otypes=[np.int64])(radius_px)
    # Sums over the stretches near each, as differences of running sums that go around.
    around = np.concatenate([score, score, score], axis=2)
    running = np.concatenate([np.zeros_like(score[:, :, :1]), np.cumsum(around, axis=2)], axis=2)
    stretch = STRETCHES + np.arange(STRETCHES)
    last = (stretch + reach[:, :, None] + 1)[..., None]
    first = (stretch - reach[:, :, None])[..., None]
    near = np.take_along_axis(running, last, axis=2) - np.take_along_axis(running, first, axis=2)
    return np.asarray((score * near).sum(axis=(1, 2, 3)))


@dataclass(frozen=True, eq=False)
class Ratios:
    """S over S0, by what stated covariances have to be multiplied."""

    photo: float  # of all rings that nothing disturbs; the usual one where they are too few to tell
    ring: Floats  # (N,)


def variance_ratios(
    scores: Scores, radius_px: Floats, roughness: Floats, face: Rows, usual_ratio: float = 1.0
) -> Ratios:
    """The ratio of a photo from its usual rings, and that of each ring between the photo's and its own.

    Edges are circles of the radii given (N, 2), or as long as these. Rings on face -1 do not count; `usual_ratio` is
    what is expected of such a photo before its rings are asked.
    """
    counts = (face >= 0) & (scores.alone > 0)
    is_usual = counts & (roughness <= MOST_ROUGH * np.median(roughness[counts])) if counts.any() else counts
    common = np.zeros_like(scores.score)
    lost = np.ones(len(face))
    for f in np.unique(face[is_usual]):
        usual = is_usual & (face == f)
        count = int(np.count_nonzero(usual))
        if count < LEAST_OF_A_FACE:
            is_usual = is_usual & (face != f)
            continue
        common[face == f] = scores.score[usual].mean(axis=0)
        lost[usual] = 1 - 1 / count
    seen = together(scores.score - common, radius_px)
    expected = lost * scores.alone
    if not is_usual.any():
        return Ratios(usual_ratio, np.full(len(face), usual_ratio))
    as_alone = TRUST * float(expected[is_usual].mean())
    total = float(seen[is_usual].sum()) + usual_ratio * as_alone
    photo = max(total / (float(expected[is_usual].sum()) + as_alone), LEAST_RATIO)
    own = np.where(counts, seen / np.where(counts, expected, 1.0), photo)
    return Ratios(photo, np.maximum((TRUST * photo + own) / (TRUST + 1), LEAST_RATIO))
