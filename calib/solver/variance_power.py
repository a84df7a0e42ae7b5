"""By how much stated sigmas are wrong differently: the power of them that the residuals show, `sigma^(1 + p)`.

One factor for all is right only if all are wrong by the same. Where a tone curve, a blur or the target itself adds what
the detector does not know, features that are seen well are worth less than they say, and those seen edge-on as much or
more. So the standard deviation of an observation is a function of the stated one (Davidian and Carroll 1987, Variance
function estimation, JASA 82), `c (s / middle)^(1 + p)`, c being the one factor. With squares q of whitened residuals
and x = ln(s / middle), the likeliest p makes `sum x e = sum x`, `e = q exp(-2 p x)` scaled to a mean of one. From
-1, all alike, to 1.
"""

import numpy as np

from designer.base.arrays import Array, Flags

STEPS, SAME = 30, 1e-4
SURE = 3.0
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
    p = p * (1 - (SURE * sigma / p) ** 2) if abs(p) > SURE * sigma else 0.0
    return np.exp(p * every) if abs(p) * np.sqrt(spread / len(x)) > LEAST else None
