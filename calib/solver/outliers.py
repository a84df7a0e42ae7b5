"""What is far off: observations, in standard deviations that outliers do not move; a photo whose picture is shifted.

Its pose takes up most of a shift: what is left is spread over all photos, and looks like noise. So the principal point
of each photo is freed in turn, by the normal equations at the minimum: with the views' reduced blocks H_v, h_v (poses
eliminated), their sum N, and A the columns of the principal point, the shift is `-S^-1 h_v[A]` with
`S = H_v[A, A] - H_v[A, :] N^-1 H_v[:, A]`, and `T = h_v[A]' S^-1 h_v[A]` is by how much the squares would fall (a score
test; Cook and Weisberg 1982, section 2.2). The largest T is held against those of the others once it is accounted for:
against their median, and against the largest of them, which a model that does not fit makes as large.

By how much stated sigmas are wrong differently: the power of them that the residuals show, `sigma^(1 + p)`.

One factor for all is right only if all are wrong by the same. Where a tone curve, a blur or the target itself adds what
the detector does not know, features that are seen well are worth less than they say, and those seen edge-on as much or
more. So the standard deviation of an observation is a function of the stated one (Davidian and Carroll 1987, Variance
function estimation, JASA 82), `c (s / middle)^(1 + p)`, c being the one factor. With squares q of whitened residuals
and x = ln(s / middle), the likeliest p makes `sum x e = sum x`, `e = q exp(-2 p x)` scaled to a mean of one. From
-1, all alike, to 1.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.core.linear_algebra import symmetric_inverse
from calib.solver.blocks import RobustLoss
from calib.solver.problem import Tie, whiteners
from calib.solver.schur import reduced_blocks
from designer.base.arrays import Array, Flags

MEDIAN_LENGTH = 1.1774100225154747
"""Median length of a normal vector in the plane, sqrt(2 ln 2), in standard deviations of a coordinate."""
LEAST_SIGMA = 1e-9
"""Perfect data have no outliers."""
PRINCIPAL_POINT = slice(2, 4)
"""Of the parameters of every model."""
LEAST_VIEWS = 5
"""Of four, sound ones reach 20 times what the three others scatter, and 16 times the most of these."""
MEDIAN_SQUARE = 1.3862943611198906
"""Of a normal vector in the plane, 2 ln 2, in squares of a coordinate's standard deviation."""
SURE, CLEAR = 15.0, 5.0
"""Times what the others scatter, and times the most of them. Measured, of 5 to 20 photos: by a block's 16 px at .03 px
of noise 23 to 109 and 11 to 45, by 8 px 11 to 54 and 5.5 to 23; of sound photos at most 5 and 3.3, and where a model
leaves pixels over of a real wide lens 12 and 3.2. A few tenths of a pixel of noise, or a model that does not fit, hide
a shift: then nothing is said. In 800 random calibrations by models that lack the lens or a part
of it, one photo shifted by 4 to 100 px, no other was named."""
LEAST_PX = 0.2


def whitened(whitener: Array, residual_px: Array) -> Array:
    """Residuals (2, M) in units of their standard deviations, by whiteners (3, M)."""
    a, b, c = whitener
    return np.stack([a * residual_px[0], b * residual_px[0] + c * residual_px[1]])


def robust_sigma(residual: Array) -> float:
    """Standard deviation of a coordinate of residuals (2, M), from their median length."""
    square = _squares(residual)
    known = np.isfinite(square)
    finite = square if known.all() else square[known]
    return max(math.sqrt(np.median(finite)) / MEDIAN_LENGTH, LEAST_SIGMA) if len(finite) else math.inf


def _squares(residual: Array) -> Array:
    """Squared lengths of residuals (2, M)."""
    square: Array = residual[0] * residual[0] + residual[1] * residual[1]
    return square


def forgetful(residual: Array) -> RobustLoss:
    """A loss that outliers among such residuals (2, M) do not draw: squares would follow them before they are told."""
    return RobustLoss("cauchy", robust_sigma(residual))


def robust_covariance_factor(length: Array, loss: RobustLoss) -> float:
    """What the inverse of the weighted normal matrix is to be multiplied with for a covariance.

    With weights w(r) of residuals' lengths r, an M-estimator has the covariance `(J'J)^-1 E[w^2 r^2] / 2 / E[w + r w' /
    2]^2` (Huber 1981, section 7.6, in two dimensions), and the normal matrix is about `E[w] J'J`.
    """
    weight = loss.weights(length)
    slope = np.where(length <= loss.knee, 1.0, 0.5 * weight) if loss.kind == "huber" else weight**2
    return float(weight.mean() * 0.5 * (weight**2 * length**2).mean() / slope.mean() ** 2)


def robust_scale(standard: Array, is_used: Flags, loss: RobustLoss) -> tuple[float, float]:
    """A loss' sigma of a whitened coordinate, and the factor of covariances by the residuals (2, M) that count."""
    length = np.hypot(*standard)[is_used]
    return loss.sigma, robust_covariance_factor(length[np.isfinite(length)], loss)


def deviations(residual_px: Array, cov_px2: Array | None, sigma_px: float | None = None) -> Array:
    """Lengths (M,) of residuals (2, M) in robust standard deviations, `sigma_px` if that is known already.

    With covariances, the shorter of the lengths in pixels and in stated standard deviations: a ring that is seen all
    but edge-on may be off by more pixels than others, and where the model's errors outgrow the noise, one that is
    seen well may be off by many of its small standard deviations. Neither is an outlier.
    """
    length: Array = np.sqrt(_squares(residual_px)) / (robust_sigma(residual_px) if sigma_px is None else sigma_px)
    if cov_px2 is None:
        return length
    standard = whitened(whiteners(cov_px2), residual_px)
    shorter: Array = np.minimum(length, deviations(standard, None))
    return shorter


@dataclass(frozen=True)
class PhotoShift:
    """A photo whose picture is shifted against the others'."""

    view: int
    right_px: float
    down_px: float
    times: float  # what the others scatter


def shift_of_photo(products: Array, tie: Tie) -> PhotoShift | None:
    """The photo that is shifted most, if not by chance, from the views' blocks at the minimum."""
    if len(products) < LEAST_VIEWS or (tie.row[PRINCIPAL_POINT] < 0).any():
        return None
    reduced = reduced_blocks(products)
    block, gradient = reduced[:, :-1, :-1], reduced[:, :-1, -1]  # (V, P, P), (V, P)
    free = np.zeros((len(tie.row), int(tie.row.max()) + 1))
    free[tie.row >= 0, tie.row[tie.row >= 0]] = 1
    inverse = free @ symmetric_inverse(free.T @ block.sum(axis=0) @ free).inverse @ free.T

    own = block[:, :, PRINCIPAL_POINT]  # (V, P, 2)
    spread = symmetric_inverse(own[:, PRINCIPAL_POINT] - own.transpose(0, 2, 1) @ inverse @ own).inverse
    gain = _gain(gradient, spread)
    worst = int(gain.argmax())
    shift_px = -spread[worst] @ gradient[worst, PRINCIPAL_POINT]
    # What the other photos' gradients are once the camera no longer makes up for this one.
    others = gradient - block @ inverse @ own[worst] @ shift_px
    of_others = np.delete(_gain(others, spread), worst)
    usual = float(np.median(of_others)) / MEDIAN_SQUARE
    is_alone = gain[worst] > SURE**2 * usual and gain[worst] > CLEAR**2 * of_others.max()
    if not (is_alone and np.hypot(*shift_px) > LEAST_PX):
        return None
    return PhotoShift(worst, float(shift_px[0]), float(shift_px[1]), float(np.sqrt(gain[worst] / usual)))


def shifted_photo(products: Array, tie: Tie, names: Sequence[str]) -> list[str]:
    """A word on the photo that is shifted, if there is one."""
    found = shift_of_photo(products, tie)
    if found is None:
        return []
    return [
        f"{names[found.view]}: its picture is shifted by about {found.right_px:.2g}, {found.down_px:.2g} px against "
        f"the others' ({found.times:.0f} times what they scatter): damaged, cropped, or taken with another zoom, focus "
        "or a stabiliser; leave it out"
    ]


def _gain(gradient: Array, spread: Array) -> Array:
    """By how much the sum of squares would fall (V,)."""
    of_point = gradient[:, PRINCIPAL_POINT]
    return np.asarray(np.einsum("vi,vij,vj->v", of_point, spread, of_point))


STEPS, SAME = 30, 1e-4
SURE_POWER = 3.0
"""Standard deviations of p by which it is drawn to 0 (James and Stein's estimate, its positive part)."""
LEAST = 0.1
"""Of sigmas, root mean square: what changes them by less against each other changes no camera, and they stand."""
MOST_UNKNOWNS = 0.2
"""Of equations: with more unknowns, what they take of the residuals is not the same of all observations."""
WIDEST = 5.0
"""x beyond which an observation counts as there."""


def variance_power(square: Array, size: Array, is_used: Flags, unknowns: int) -> Array | None:
    """The factors (M,) of stated sigmas, about 1 in the middle; None where nothing shows that they differ.

    Args:
        square: of the lengths of whitened residuals (M,).
        size: logarithm of the stated sigmas (M,).
        is_used: which count (M,).
        unknowns: of the solution.
    """
    every = np.clip(size - np.median(size[is_used]), -WIDEST, WIDEST)
    x, q = every[is_used], square[is_used]
    off = x - x.mean()
    spread, mean = float(off @ off), float(q.mean())
    if unknowns > MOST_UNKNOWNS * 2 * len(x) or not (spread > 0 and 0 < mean < np.inf):
        return None
    p, e = 0.0, q / mean
    for _ in range(STEPS):
        step = float(off @ e) / (2 * spread)
        if abs(step) < SAME:
            break
        p = float(np.clip(p + step, -1.0, 1.0))
        e = q * np.exp(-2 * p * x)
        e /= e.mean()
    sigma = float(np.linalg.norm(off * (e - 1))) / (2 * spread)
    p = p * (1 - (SURE_POWER * sigma / p) ** 2) if abs(p) > SURE_POWER * sigma else 0.0
    return np.exp(p * every) if abs(p) * np.sqrt(spread / len(x)) > LEAST else None
