"""Direct fit of the ring model to the pixels: Levenberg-Marquardt in compiled code, all rings in one batch.

The vanishing line enters as a Gaussian prior on `m`: with zero information it is free, with the information of the
face's grid the fit weighs line and pixels as they deserve, and the covariance contains the line's own uncertainty.
"""

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calib.core.jit import jit
from calib.core.parallel import in_chunks
from calib.core.small_solve import cholesky_invert, cholesky_solve
from calib.detector.ring_equations import accumulate, add_prior
from calib.detector.ring_model import (
    BLUR,
    CENTER_U,
    CENTER_V,
    DARKNESS,
    E00,
    E10,
    E11,
    M0,
    M1,
    MAX_PIXELS,
    PARAMETERS,
    RATIO,
    WHITE,
    choose_pixels,
)
from calib.detector.ring_scores import SCORES_ROOM, Scores, score_ring
from designer.base.arrays import Array, Flags, Rows

Floats: TypeAlias = Array

MAX_ITERATIONS = 25
CONVERGED_PX = 1e-3
"""A step of the centre this small is the last: the next would be some hundred times smaller."""
MOVED_PX = 0.25
NO_MOVE_PX = 1e-7
NO_GAIN = 1e-6
"""Grey levels squared a pixel: less than rounding."""
ASTRAY = 1e-2
"""The damping after a step that did not lead down: with less, the next would be the same step."""
NO_STEP = 1e8
"""With more damping than this there is nowhere to go."""


@dataclass(frozen=True, eq=False)
class RingFits:
    """N fits. A fit that failed has `ok` false and numbers without meaning."""

    params: Floats  # (N, 15) see calib.detector.ring_model
    cov_px2: Floats  # (N, 2, 2) of the centre
    noise: Floats  # (N,) residual standard deviation in grey levels
    scores: Scores
    pixels: Rows  # (N,) how many pixels were used
    ok: Flags  # (N,)

    @property
    def center_px(self) -> Floats:
        """Projected centres.  # (N, 2)"""
        return self.params[:, :2]

    @property
    def radii_px(self) -> Floats:
        """Mean radii of both edges.  # (N, 2)"""
        outer = 1 / np.sqrt(np.maximum(self.params[:, E00] * self.params[:, E11], 1e-12))
        return np.column_stack([outer, outer * self.params[:, RATIO]])

    @property
    def contrast(self) -> Floats:
        """White minus black at the centre, in grey levels.  # (N,)"""
        return self.params[:, WHITE] * self.params[:, DARKNESS]


@jit
def _is_sane(p: Floats, start: Floats) -> bool:
    """Whether parameters still describe a ring near its start."""
    if not (p[E00] > 0.0 and p[E11] > 0.0 and p[BLUR] > 0.15 and p[BLUR] < 12.0 and p[WHITE] > 0.0):
        return False
    if start[RATIO] > 0.0 and not 0.05 < p[RATIO] < 0.95:
        return False
    area, area_start = p[E00] * p[E11], start[E00] * start[E11]
    if not 0.4 * area_start < area < 2.5 * area_start:
        return False
    du, dv = p[CENTER_U] - start[CENTER_U], p[CENTER_V] - start[CENTER_V]
    y0 = start[E00] * du
    y1 = start[E10] * du + start[E11] * dv
    # The vanishing line must stay away from the ring: |m| in units of its size.
    w0 = p[M0] / p[E00] - p[M1] * p[E10] / (p[E00] * p[E11])
    w1 = p[M1] / p[E11]
    is_near: bool = y0 * y0 + y1 * y1 < 0.6 and w0 * w0 + w1 * w1 < 0.25
    return is_near


@jit
def _is_elsewhere(p: Floats, start: Floats) -> bool:
    """Whether a fit ended so far from its start that pixels chosen there are not the right ones."""
    du, dv = p[CENTER_U] - start[CENTER_U], p[CENTER_V] - start[CENTER_V]
    growth = p[E00] * p[E11] / (start[E00] * start[E11])
    is_off: bool = du * du + dv * dv > MOVED_PX * MOVED_PX or not 0.95 < growth < 1.05
    return is_off or abs(p[BLUR] - start[BLUR]) > MOVED_PX


@jit
def _descend(
    pixels: Floats,
    count: int,
    start: Floats,
    q: Floats,
    line: Floats,
    information: Floats,
    params: Floats,
    work: Floats,
    rows: Floats,
) -> float:
    """Levenberg-Marquardt from `start`; returns the sum of squares, or -1 if there is no way down.

    Args:
        pixels: u, v and grey level.  # (3, >= count)
        count: how many.
        start: where to start; the fit stays near it.
        q: the lens's bend.
        line: mean of the prior on m.
        information: its inverse covariance.
        params: the result.
        work: room; afterwards normal equations and gradient, one small step before the result.
        rows: room.
    """
    normal, damped, trial_normal = work[0], work[1], work[2]
    gradient, total, step, trial, trial_gradient = work[4, 0], work[4, 1], work[4, 2], work[4, 3], work[4, 4]
    origin = start[:2]
    is_ring = start[RATIO] > 0.0
    params[:] = start
    cost = accumulate(pixels, count, params, q, origin, normal, gradient, rows)
    damping = 1e-4
    for _ in range(MAX_ITERATIONS):
        if damping > NO_STEP:
            return -1.0
        # The prior weighs in units of the noise, which is known better with every step.
        noise2 = max(cost / (count - PARAMETERS), 1e-6)
        damped[:] = normal
        total[:] = gradient
        prior = add_prior(params, line, information, noise2, is_ring, damped, total)
        for k in range(PARAMETERS):
            damped[k, k] += damping * damped[k, k] + 1e-30
        if not cholesky_solve(damped, total, step):
            damping = max(10.0 * damping, 1e-3)
            continue
        trial[:] = params + step
        moved = math.sqrt(step[0] * step[0] + step[1] * step[1])
        if not _is_sane(trial, start):
            damping *= 10.0
            continue
        promised = 0.0
        for k in range(PARAMETERS):
            promised += total[k] * step[k]
        if moved < CONVERGED_PX and promised < 1e-3 * cost + NO_GAIN * count:
            # Neither the centre nor anything else has far to go: taken without looking again.
            params[:] = trial
            return cost
        trial_cost = accumulate(pixels, count, trial, q, origin, trial_normal, trial_gradient, rows)
        trial_prior = add_prior(trial, line, information, noise2, is_ring, damped, total)
        if trial_cost + trial_prior > cost + prior:
            if moved < NO_MOVE_PX:
                break
            damping = max(damping * 10.0, ASTRAY)
            continue
        params[:] = trial
        normal[:] = trial_normal
        gradient[:] = trial_gradient
        cost = trial_cost
        damping = max(damping * 0.1, 1e-9)
    return cost


@jit
def _fit_range(
    image: NDArray[np.generic],
    start: Floats,
    q: Floats,
    line: Floats,
    information: Floats,
    limit: float,
    first: int,
    last: int,
    params: Floats,
    center_cov: Floats,
    noise: Floats,
    score: Floats,
    alone: Floats,
    tone: Floats,
    has_tone: Flags,
    used: Rows,
) -> None:
    """Fit rings first..last-1; `used` stays 0 where a fit failed."""
    work = np.empty((5, PARAMETERS, PARAMETERS))
    rows = np.empty(SCORES_ROOM)
    pixels = np.empty((3, MAX_PIXELS))
    origin = np.empty(PARAMETERS)
    for n in range(first, last):
        is_ring = start[n, RATIO] > 0.0
        origin[:] = start[n]
        count = choose_pixels(image, origin, q[n], 3.0 * origin[BLUR] + 1.0, limit, pixels)
        if count < 2 * PARAMETERS:
            continue
        cost = _descend(pixels, count, start[n], q[n], line[n], information[n], params[n], work, rows)
        if cost >= 0.0 and _is_elsewhere(params[n], start[n]):
            # Other pixels are near its edges than those that were taken.
            origin[:] = params[n]
            count = choose_pixels(image, origin, q[n], 3.0 * origin[BLUR] + 1.0, limit, pixels)
            if count < 2 * PARAMETERS:
                continue
            cost = _descend(pixels, count, origin, q[n], line[n], information[n], params[n], work, rows)
        if cost < 0.0:
            continue
        noise2 = max(cost / (count - PARAMETERS), 1e-6)
        add_prior(params[n], line[n], information[n], noise2, is_ring, work[0], work[4, 0])
        if not cholesky_invert(work[0], work[1], work[3]):
            continue
        alone[n] = score_ring(
            pixels, count, params[n], q[n], origin[:2], noise2, information[n], work[3], center_cov[n], score[n],
            tone[n], has_tone[n], rows,
        )  # fmt: skip
        noise[n] = math.sqrt(noise2)
        used[n] = count


def fit_rings(
    image: NDArray[np.generic],
    start: Floats,
    *,
    limit: float,
    line: Floats | None = None,
    line_information: Floats | None = None,
    bend: Floats | None = None,
    growth: Floats | None = None,
    tone_asked: Flags | None = None,
) -> RingFits:
    """Fit the ring model to the pixels of an image.

    Args:
        image: grey levels, uint8, uint16 or float32.  # (H, W)
        start: parameters to start from; a ratio of 0 makes a dot.  # (N, 15)
        limit: how far out, in outer radii, pixels may be used before something else than white comes.
        line: mean of the prior on m.  # (N, 2), default 0
        line_information: inverse covariance of that prior; zero leaves m free.  # (N, 2, 2), default zero
        bend: the lens's local quadratic form: xi_u in v_u^2, v_u v_v, v_v^2, then xi_v.  # (N, 6), default zero
        growth: the gradient of the blur's logarithm over the image (per px).  # (N, 2), default zero
        tone_asked: rings that are asked for a tone curve, which takes half as long again.  # (N,), default none

    Returns:
        The fits, in the order of `start`. Dots need a prior: m is not to be had from one ellipse.
    """
    count = len(start)
    line = np.zeros((count, 2)) if line is None else np.ascontiguousarray(line)
    information = np.zeros((count, 2, 2)) if line_information is None else np.ascontiguousarray(line_information)
    bend = np.zeros((count, 6)) if bend is None else bend
    growth = np.zeros((count, 2)) if growth is None else growth
    has_tone = np.zeros(count, dtype=np.bool_) if tone_asked is None else tone_asked
    lens = np.ascontiguousarray(np.hstack([bend, growth]))
    start = np.ascontiguousarray(start, dtype=np.float64)
    params, noise = np.array(start), np.zeros(count)
    center_cov = np.zeros((count, 2, 2))
    used, scores = np.zeros(count, dtype=np.int64), Scores.empty(count)

    def run(first: int, last: int) -> None:
        _fit_range(
            image, start, lens, line, information, limit, first, last,
            params, center_cov, noise, scores.score, scores.alone, scores.tone, has_tone, used,
        )  # fmt: skip

    in_chunks(run, count)
    ok = (used > 0) & np.isfinite(params).all(axis=1) & np.isfinite(center_cov).all(axis=(1, 2))
    ok &= (center_cov[:, 0, 0] > 0) & (center_cov[:, 1, 1] > 0)
    return RingFits(params, center_cov, noise, scores, used, ok)
